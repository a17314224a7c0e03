"""The path of a tendon in MuJoCo's model and data: bends, pieces, forces, compiled.

MuJoCo computes the path at every evaluation: sites, and the two points at which it
touches and leaves a geom that it wraps. What an open path is and does is in
`cable/_open_path.py`; here it is read and its forces applied.
"""

from typing import NamedTuple

import numpy as np
from mujoco import mjtWrap

from cc_mujoco.cable import _open_path as open_path
from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin._ffi import MjData, MjModel

ARC_SEGMENTS = 4
"""Default number of segments of the arc around a geom."""


class OpenPath(NamedTuple):
    """A cable along a spatial tendon without pulleys, with no conduit after `mouth`."""

    tendon: int  # index of the tendon
    mouth: int  # index of a site in its path, 0 where all of it is open
    guided: int  # number of segments in the conduit before the mouth
    n: int  # number of all segments
    guides: FloatArray  # guides, see `cable._open_path.measure` (n,)
    measured: FloatArray  # shape, the result of `measure_path`


@internal
def has_branches(model: MjModel, tendon: int) -> bool:
    """Return whether a spatial tendon has pulleys, which divide it into branches."""
    for i in range(model.tendon_adr[tendon], ffi.path_end(model, tendon)):
        if model.wrap_type[i] == mjtWrap.mjWRAP_PULLEY:
            return True
    return False


@internal
def digest(model: MjModel, tendon: int) -> int:
    if tendon < 0:
        return 0
    if tendon >= model.ntendon:
        return -1
    found = tendon + model.tendon_num[tendon]
    for i in range(model.tendon_adr[tendon], ffi.path_end(model, tendon)):
        found = 1099511628211 * found + model.wrap_type[i] + 16 * model.wrap_objid[i]
    return int(found)


@internal
def places_size(model: MjModel, tendon: int) -> int:
    return int(geometry.PLACE_SIZE * model.tendon_num[tendon])


@internal
def read_places(model: MjModel, data: MjData, tendon: int, places: FloatArray) -> None:
    """Write the `places` of a path as last evaluated, see `cable/_path_geometry.py`."""
    start, at = model.tendon_adr[tendon], data.ten_wrapadr[tendon]
    number, first = model.tendon_num[tendon], data.wrap_xpos.ctypes.data
    for k in range(number):
        place = places[geometry.PLACE_SIZE * k :]
        points = ffi.floats(first + 24 * at, 6)
        kind, thing = model.wrap_type[start + k], model.wrap_objid[start + k]
        place[geometry.KIND] = geometry.SITE
        if kind != mjtWrap.mjWRAP_SPHERE and kind != mjtWrap.mjWRAP_CYLINDER:
            for i in range(3):
                place[geometry.FIRST + i] = points[i]
            at += 1
            continue
        is_sphere = kind == mjtWrap.mjWRAP_SPHERE
        place[geometry.KIND] = geometry.SPHERE if is_sphere else geometry.CYLINDER
        place[geometry.TOUCHED] = 0.0
        if data.wrap_obj[at // 2, at % 2] == thing:
            place[geometry.TOUCHED] = 1.0
            place[geometry.FIRST : geometry.FIRST + 3] = points[:3]
            place[geometry.LAST : geometry.LAST + 3] = points[3:]
            at += 2
            place[geometry.CENTRE : geometry.CENTRE + 3] = data.geom_xpos[thing]
            for axis in range(3):
                for i in range(3):
                    cell = data.geom_xmat[thing, 3 * i + axis]
                    place[geometry.AXES + 3 * axis + i] = cell


@internal
def bend(
    model: MjModel, data: MjData, tendon: int, count: int, total: float,
    segments: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Compute the wrap angle of each segment of a conduit along a tendon [rad].

    The conduit follows the first `count` places of the path, all if 0. Other arguments
    are those of `cable._path_geometry.bend`.
    """
    if count == 0:
        count = model.tendon_num[tendon]
    ffi.mark_stack(data)
    places = ffi.borrow_floats(data, places_size(model, tendon))
    read_places(model, data, tendon, places)
    geometry.bend(places, count, total, segments, out.size, out)
    ffi.free_stack(data)


@internal
def min_segments(model: MjModel, tendon: int, mouth: int) -> int:
    return open_path.fewest_segments(model.tendon_num[tendon], mouth)


@internal
def default_segments(model: MjModel, tendon: int, mouth: int) -> int:
    """Return the default segments behind a mouth: `ARC_SEGMENTS` a geom, 1 a site."""
    count = min_segments(model, tendon, mouth)
    for i in range(model.tendon_adr[tendon] + mouth, ffi.path_end(model, tendon)):
        if model.wrap_type[i] != mjtWrap.mjWRAP_SITE:
            count += ARC_SEGMENTS - 1
    return count


@internal
def measure_path(model: MjModel, data: MjData, path: OpenPath) -> float:
    """Measure an open path as last evaluated; return its length from the mouth [m]."""
    ffi.mark_stack(data)
    places = ffi.borrow_floats(data, places_size(model, path.tendon))
    read_places(model, data, path.tendon, places)
    number = model.tendon_num[path.tendon]
    reach = open_path.measure(
        places, number, path.mouth, path.guided, path.n, path.guides, path.measured
    )
    ffi.free_stack(data)
    return float(reach)


@internal
def apply_pulls(
    model: MjModel, data: MjData, path: OpenPath, node: FloatArray, tied: float,
    aside: int, target: int,
) -> None:  # fmt: skip
    """Add the generalized forces of a path's pieces to the sum (nv,) at `target`.

    `data` is at the position where the path was measured. Other arguments are those of
    `cable._open_path.pull_forces`.
    """
    start, number = model.tendon_adr[path.tendon], model.tendon_num[path.tendon]
    ffi.mark_stack(data)
    places = ffi.borrow_floats(data, places_size(model, path.tendon))
    forces = ffi.borrow_floats(data, 6 * (number - 1))
    read_places(model, data, path.tendon, places)
    open_path.pull_forces(
        places, number, path.mouth, path.measured, path.n, path.guided, node, tied,
        aside, forces,
    )  # fmt: skip
    points, stride, k = places.ctypes.data + 8 * geometry.FIRST, geometry.PLACE_SIZE, 0
    while k < number - 1:
        body, i = ffi.wrap_body(model, start + k), 6 * k
        here = _Anchor(points + 8 * stride * k, body)
        if places[stride * (k + 1) + geometry.KIND] != geometry.SITE:
            k += 1
            if places[stride * k + geometry.TOUCHED] != 0.0:
                body = ffi.wrap_body(model, start + k)
                there = _Anchor(points + 8 * stride * k, body)
                _pull_together(model, data, here, there, forces[i : i + 3], target)
                leaves = there.point + 8 * (geometry.LAST - geometry.FIRST)
                here, i = _Anchor(leaves, body), i + 3
        k += 1
        body = ffi.wrap_body(model, start + k)
        there = _Anchor(points + 8 * stride * k, body)
        _pull_together(model, data, here, there, forces[i : i + 3], target)
    ffi.free_stack(data)


class _Anchor(NamedTuple):
    """An end of a piece of a path."""

    point: int  # address of its position in the world
    body: int  # index of the body that it is on


@internal
def _pull_together(
    model: MjModel, data: MjData, one: _Anchor, other: _Anchor, force: FloatArray,
    target: int,
) -> None:  # fmt: skip
    if one.body == other.body or ffi.is_zero(force):
        return
    own, torque = np.empty(3), np.zeros(3)
    at, none = own.ctypes.data, torque.ctypes.data
    if model.body_weldid[one.body] != 0:
        own[:] = force
        ffi.apply_wrench(model, data, at, none, one.point, one.body, target)
    if model.body_weldid[other.body] != 0:
        for i in range(3):
            own[i] = -force[i]
        ffi.apply_wrench(model, data, at, none, other.point, other.body, target)
