"""Arrays of the cables that tendons guide, and launches of their kernels."""

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
from cc_mujoco.cable._route import Route, ancestors
from cc_mujoco.warp._build import Paths
from cc_mujoco.warp._kernels import CableRows
from cc_mujoco.warp._path_kernels import PathRows, add_pulls, path_kernels
from cc_mujoco.warp._place_kernels import Links, Pose


class Views:
    """Warp structure of a model's and, from field `of_data` on, its data's arrays."""

    def __init__(self, kind: Any, of_data: str) -> None:
        self._kind, self._names = kind, tuple(vars(kind)["vars"])
        self._first = self._names.index(of_data)
        self._arrays: list[Any] = []
        self._whole: Any = None

    def of(self, m: mjw.Model, d: mjw.Data) -> Any:
        arrays = [
            getattr(m if i < self._first else d, name)
            for i, name in enumerate(self._names)
        ]
        same = (one is other for one, other in zip(arrays, self._arrays, strict=True))
        if not self._arrays or not all(same):
            self._arrays, self._whole = arrays, self._kind()
            for name, array in zip(self._names, arrays, strict=True):
                setattr(self._whole, name, array)
        return self._whole


def links_of(
    model: mujoco.MjModel,
    tendons: Iterable[int],
    bodies: NDArray[np.int32],
    device: Any,
) -> tuple[Any, int]:
    """Return the `Links` of tendons that guide cables, and the most of one tendon."""
    starts, numbers, carriers = np.zeros((3, model.ntendon), np.int32)
    places = np.full(bodies.size, -1, np.int32)
    linked: list[int] = []
    above: list[int] = []
    for tendon in tendons:
        start = int(model.tendon_adr[tendon])
        own = range(start, start + int(model.tendon_num[tendon]))
        lines = [ancestors(model, int(bodies[place])) for place in own]
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


class LedCables:
    """Cables of all worlds that tendons guide.

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
        of_cables: CableRows,
        matrix: Callable[..., Any],
        kernels: tuple[frozenset[str], bool, Paths],
    ) -> None:
        """Allocate the arrays.

        `routes` are None for cables without a tendon. `matrix` returns an array with a
        row for each cable and world, and these numbers of columns and planes; `kernels`
        are arguments of `path_kernels`.
        """
        own = path_kernels(*kernels)
        self._own, self._of_cables = own, of_cables
        self.kernels = {"survey": own.survey, "lay": own.lay}
        self._has_open = kernels[2].lengthens != 0.0
        if self._has_open:
            self.kernels |= {"pull": own.pull, "add_pulls": add_pulls}
        self._segments = [cable.segments for cable in cables]
        count, worlds, most = len(cables), of_cables.worlds, max(self._segments)
        self._shape, self._device = (count, worlds), of_cables.segments.device
        rows: Any = PathRows()
        self._size = size = open_path.shape_size(most)
        led = [(i, route) for i, route in enumerate(routes) if route is not None]
        heads, numbers = np.zeros((5, count), np.int32), np.zeros(count, np.int32)
        heads[0], heads[3] = -1, most
        guides = np.zeros((count, most), np.float32)
        reference = np.zeros((count, worlds, size), np.float32)
        for i, route in led:
            numbers[i] = model.tendon_num[route.tendon]
            start = int(model.tendon_adr[route.tendon])
            heads[:, i] = route.tendon, start, route.mouth, route.guided, route.bends
            guides[i, : route.guides.size] = route.guides
            reference[i, :] = self.reference_row(route, cables[i])
        rows.guides = self._array(guides, float)
        objects = np.maximum(model.wrap_objid, 0)
        kinds = np.full(objects.size, geometry.SITE)
        kinds[model.wrap_type == int(mujoco.mjtWrap.mjWRAP_SPHERE)] = geometry.SPHERE
        is_cylinder = model.wrap_type == int(mujoco.mjtWrap.mjWRAP_CYLINDER)
        kinds[is_cylinder] = geometry.CYLINDER
        is_geom = kinds != geometry.SITE
        is_site = model.wrap_type == int(mujoco.mjtWrap.mjWRAP_SITE)
        bodies = np.zeros(objects.size, np.int32)
        bodies[is_geom] = model.geom_bodyid[objects[is_geom]]
        bodies[is_site] = model.site_bodyid[objects[is_site]]
        rows.kinds = self._array(kinds, float)
        rows.tendons, rows.starts, rows.mouths, rows.guided, rows.bends = map(
            self._array, heads
        )
        rows.numbers, rows.objects = self._array(numbers), self._array(objects)
        rows.bodies = self._array(bodies)
        rows.last_dofs = self._array(_last_dofs(model))
        rows.parents = self._array(model.dof_parentid)
        rows.roots = self._array(model.body_rootid)
        rows.reference, rows.shape = matrix(size), matrix(size)
        rows.memory = matrix(open_path.memory_size(most), 2)
        tendons = [route.tendon for _, route in led]
        self._links, most_links = links_of(model, tendons, bodies, self._device)
        self._poses = Views(Pose, of_data="qpos")
        rows.near = matrix(3 * most_links + 3)
        rows.places = matrix(geometry.PLACE_SIZE * int(numbers.max()))
        rows.forces = matrix(6 * int(numbers.max()))
        rows.gained, rows.pulls = matrix(most + 1), matrix(int(model.nv))
        self.rows, self.reference, self.memory = rows, rows.reference, rows.memory
        self.reference.assign(reference.reshape(-1, size))

    def _array(self, values: Any, dtype: type = int) -> Any:
        return wp.array(values, dtype=dtype, device=self._device)

    def reference_row(self, route: Route, cable: Cable) -> NDArray[np.float32]:
        """Return a row of `reference` for a cable whose conduit may differ."""
        row = np.zeros(self._size, np.float32)
        own = route.reference_of(cable)
        row[: own.size] = own
        return row

    def memory_size(self, index: int) -> int:
        return int(open_path.memory_size(self._segments[index]))

    def _launch(self, kernel: Any, *given: Any) -> None:
        given = self._of_cables, self.rows, *given
        wp.launch(kernel, self._shape, given, device=self._device)

    def repack(self, values: Any) -> None:
        self._launch(self._own.repack, values)

    def lead(self, m: mjw.Model, d: mjw.Data) -> None:
        pose = self._poses.of(m, d)
        self._launch(self._own.survey, self._links, pose, d.ten_length)
        self._launch(self._own.lay)

    def pull(self, is_pending: bool, m: mjw.Model, d: mjw.Data, total: Any) -> None:
        """Add the generalised forces of the pieces to `total` (worlds, nv).

        With `is_pending` the tensions are those after the step, otherwise those before.
        """
        if not self._has_open:
            return
        given = int(is_pending), m.actuator_gear, d.subtree_com, d.cdof
        self._launch(self._own.pull, *given)
        count, worlds = self._shape
        added = worlds, count, self.rows.pulls, total
        wp.launch(add_pulls, total.shape, added, device=self._device)


def _last_dofs(model: mujoco.MjModel) -> NDArray[np.int32]:
    found = np.full(model.nbody, -1, np.int32)
    for body in range(1, model.nbody):
        found[body] = found[model.body_parentid[body]]
        if model.body_dofnum[body] > 0:
            found[body] = model.body_dofadr[body] + model.body_dofnum[body] - 1
    return found
