"""Bodies that carry the places of paths, and the pose in which kernels find them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import NDArray

from cc_mujoco.warp._place_kernels import Links, Pose

_FIELDS: tuple[str, ...] = tuple(vars(Pose)["vars"])
_OF_DATA = _FIELDS.index("qpos")


class Poses:
    """The `Pose` of a model and its data, made anew where an array is another one."""

    def __init__(self) -> None:
        self._arrays: list[Any] = []
        self._pose: Any = None

    def of(self, m: mjw.Model, d: mjw.Data) -> Any:
        """Return the pose of the model in the data."""
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
