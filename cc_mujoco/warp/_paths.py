"""Arrays of the cables that a tendon leads, and how their kernels are launched."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import NDArray

from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._route import Route
from cc_mujoco.warp._path_kernels import PathRows, add_pulls, path_kernels
from cc_mujoco.warp._place_kernels import Links, Pose
from cc_mujoco.warp._variants import Paths

_FIELDS: tuple[str, ...] = tuple(vars(Pose)["vars"])
_OF_DATA = _FIELDS.index("qpos")


class Poses:
    """The `Pose` of a model and its data, made anew where an array is another one."""

    def __init__(self) -> None:
        self._arrays: list[Any] = []
        self._pose: Any = None

    def of(self, m: mjw.Model, d: mjw.Data) -> Any:
        arrays = [
            getattr(m if i < _OF_DATA else d, name) for i, name in enumerate(_FIELDS)
        ]
        same = (one is other for one, other in zip(arrays, self._arrays, strict=True))
        if not self._arrays or not all(same):
            self._arrays, self._pose = arrays, Pose()
            for name, array in zip(_FIELDS, arrays, strict=True):
                setattr(self._pose, name, array)
        return self._pose


def links_of(
    model: mujoco.MjModel,
    tendons: Iterable[int],
    bodies: NDArray[np.int32],
    device: Any,
) -> tuple[Any, int]:
    """Return the `Links` of tendons that lead cables, and the most of one."""
    starts, numbers, carriers = np.zeros((3, model.ntendon), np.int32)
    places = np.full(bodies.size, -1, np.int32)
    linked: list[int] = []
    above: list[int] = []
    for tendon in tendons:
        start = int(model.tendon_adr[tendon])
        own = range(start, start + int(model.tendon_num[tendon]))
        lines = [_ancestors(model, int(bodies[place])) for place in own]
        common = max(set(lines[0]).intersection(*lines))
        # A body has a lower number than what it carries.
        found = sorted({body for line in lines for body in line if body > common})
        starts[tendon], numbers[tendon] = len(linked), len(found)
        carriers[tendon] = common
        index = {body: k for k, body in enumerate(found)}
        above += [index.get(int(model.body_parentid[body]), -1) for body in found]
        linked += found
        for place in own:
            places[place] = index.get(int(bodies[place]), -1)
    links: Any = Links()
    for name, value in (
        ("starts", starts), ("numbers", numbers), ("carriers", carriers),
        ("bodies", linked), ("above", above), ("places", places),
    ):  # fmt: skip
        setattr(links, name, wp.array(value, dtype=int, device=device))
    return links, int(numbers.max(initial=0))


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and all that carry it, the world last."""
    found = [body]
    while found[-1] != 0:
        found.append(int(model.body_parentid[found[-1]]))
    return found


_KINDS = {
    int(mujoco.mjtWrap.mjWRAP_SPHERE): geometry.SPHERE,
    int(mujoco.mjtWrap.mjWRAP_CYLINDER): geometry.CYLINDER,
}
Matrix = Callable[..., Any]
"""Function that returns an array with a row for each cable and world."""


class LedCables:
    """Led cables of all worlds, among those that nothing leads.

    Attributes:
        rows: their arrays.
        reference: path in the pose `qpos0`, a row for each cable and world.
        memory: path of the committed and the pending state, a row for each.
        kernels: kernels by name.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        cables: Sequence[Cable],
        routes: Sequence[Route | None],
        worlds: int,
        matrix: Matrix,
        device: Any,
        kernels: tuple[frozenset[str], bool, Paths],
    ) -> None:
        """Make the arrays.

        `routes` are None where no tendon leads the cable. `matrix` makes an array of so
        many columns, and of planes before it; `kernels` are arguments of
        `path_kernels`.
        """
        own = path_kernels(*kernels)
        self._own = own
        self.kernels = {"survey": own.survey, "lay": own.lay}
        self._has_open = kernels[2].lengthens != 0.0
        if self._has_open:
            self.kernels |= {"pull": own.pull, "add_pulls": add_pulls}
        self._cables, self._worlds = len(cables), worlds
        self._segments = [cable.segments for cable in cables]
        most = max(self._segments)
        led = [(i, route) for i, route in enumerate(routes) if route is not None]
        numbers = np.zeros(self._cables, np.int32)
        for i, route in led:
            numbers[i] = model.tendon_num[route.tendon]
        rows: Any = PathRows()
        ints: dict[str, Any] = {"dtype": int, "device": device}

        def by_cable(values: dict[int, int], other: int) -> Any:
            found = [values.get(i, other) for i in range(self._cables)]
            return wp.array(found, **ints)

        rows.tendons = by_cable({i: route.tendon for i, route in led}, -1)
        starts = {i: int(model.tendon_adr[route.tendon]) for i, route in led}
        rows.starts, rows.numbers = by_cable(starts, 0), wp.array(numbers, **ints)
        rows.mouths = by_cable({i: route.mouth for i, route in led}, 0)
        rows.guided = by_cable({i: route.guided for i, route in led}, most)
        rows.bends = by_cable({i: int(route.bends) for i, route in led}, 0)
        guides = np.zeros((self._cables, most), np.float32)
        for i, route in led:
            guides[i, : route.guides.size] = route.guides
        rows.guides = wp.array(guides, dtype=float, device=device)
        objects = np.maximum(model.wrap_objid, 0)
        is_geom = np.isin(model.wrap_type, list(_KINDS))
        is_site = model.wrap_type == int(mujoco.mjtWrap.mjWRAP_SITE)
        bodies = np.zeros(objects.size, np.int32)
        bodies[is_geom] = model.geom_bodyid[objects[is_geom]]
        bodies[is_site] = model.site_bodyid[objects[is_site]]
        kinds = [_KINDS.get(int(kind), geometry.SITE) for kind in model.wrap_type]
        rows.kinds = wp.array(kinds, dtype=float, device=device)
        rows.objects, rows.bodies = wp.array(objects, **ints), wp.array(bodies, **ints)
        rows.last_dofs = wp.array(_last_dofs(model), **ints)
        rows.parents = wp.array(model.dof_parentid, **ints)
        rows.roots = wp.array(model.body_rootid, **ints)
        size, number = open_path.shape_size(most), int(numbers.max())
        self._size = size
        rows.reference, rows.shape = matrix(size), matrix(size)
        rows.memory = matrix(open_path.memory_size(most), 2)
        tendons = [route.tendon for _, route in led]
        self._links, most_links = links_of(model, tendons, bodies, device)
        self._poses = Poses()
        rows.near = matrix(3 * most_links + 3)
        rows.places = matrix(geometry.PLACE_SIZE * number)
        rows.forces, rows.gained = matrix(6 * number), matrix(most + 1)
        rows.pulls = matrix(int(model.nv))
        self.rows, self.reference, self.memory = rows, rows.reference, rows.memory
        given = np.zeros((self._cables, worlds, size), np.float32)
        for i, route in led:
            given[i, :] = self.reference_row(route, cables[i])
        self.reference.assign(given.reshape(-1, size))

    def reference_row(self, route: Route, cable: Cable) -> NDArray[np.float32]:
        """Return a row of `reference` for a cable that may have another conduit."""
        row = np.zeros(self._size, np.float32)
        own = route.reference_of(cable)
        row[: own.size] = own
        return row

    def memory_size(self, index: int) -> int:
        return int(open_path.memory_size(self._segments[index]))

    def repack(self, rows: Any, values: Any) -> None:
        given = [rows, self.rows, values]
        wp.launch(
            self._own.repack, (self._cables, self._worlds), given, device=values.device
        )

    def lead(
        self, rows: Any, fresh: Any, rest_in_pose: bool, m: mjw.Model, d: mjw.Data
    ) -> None:
        size, device = (self._cables, self._worlds), d.time.device
        given = [rows, self.rows, self._links, self._poses.of(m, d), d.ten_length]
        wp.launch(self._own.survey, size, given, device=device)
        wp.launch(
            self._own.lay, size, [rows, self.rows, fresh, rest_in_pose], device=device
        )

    def pull(
        self, rows: Any, is_pending: bool, m: mjw.Model, d: mjw.Data, total: Any
    ) -> None:
        """Add the forces of the pieces to those on the degrees of freedom (worlds, nv).

        With `is_pending` the tensions are those after the step, not before it.
        """
        if not self._has_open:
            return
        device = d.time.device
        given = [
            rows, self.rows, int(is_pending), m.actuator_gear, d.subtree_com, d.cdof,
        ]  # fmt: skip
        wp.launch(self._own.pull, (self._cables, self._worlds), given, device=device)
        given = [self._worlds, self._cables, self.rows.pulls, total]
        wp.launch(add_pulls, total.shape, given, device=device)


def _last_dofs(model: mujoco.MjModel) -> NDArray[np.int32]:
    found = np.full(model.nbody, -1, np.int32)
    for body in range(1, model.nbody):
        found[body] = found[model.body_parentid[body]]
        if model.body_dofnum[body] > 0:
            found[body] = model.body_dofadr[body] + model.body_dofnum[body] - 1
    return found
