"""The path of a tendon in MuJoCo's model and data, and how it bends a cable, compiled.

MuJoCo computes the path at every evaluation: sites, and the two points at which it
touches and leaves a geom that it wraps.
"""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._ffi import (
    borrow_floats,
    free_stack,
    internal,
    load_integer,
    load_real,
    load_word,
    mark_stack,
)

Floats = npt.NDArray[np.float64]

_SPHERE = int(mujoco.mjtWrap.mjWRAP_SPHERE)
_CYLINDER = int(mujoco.mjtWrap.mjWRAP_CYLINDER)
_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)


@internal
def has_branches(model: int, tendon: int) -> bool:
    """Return whether a spatial tendon has pulleys, which divide it into branches."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    for i in range(
        start, start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    ):
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, i) == _PULLEY:
            return True
    return False


@internal
def digest(model: int, tendon: int) -> int:
    """Return a digest of the places of a spatial tendon's path; 0 for tendon -1."""
    if tendon < 0:
        return 0
    if tendon >= mj_struct.tendons(model):
        return -1
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    kinds = load_word(model + mj_struct.WRAP_TYPE) + 4 * start
    things = load_word(model + mj_struct.WRAP_OBJID) + 4 * start
    found, weight = tendon + number, 1
    for i in range(number):
        weight *= 1099511628211
        place = load_integer(kinds + 4 * i) + 16 * load_integer(things + 4 * i)
        found += place * weight
    return found


@internal
def places_size(model: int, tendon: int) -> int:
    """Return how many numbers describe the places of a spatial tendon's path."""
    return geometry.PLACE_SIZE * mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)


@internal
def read_places(model: int, data: int, tendon: int, places: Floats) -> None:
    """Write the places of a spatial tendon's path, see `cable/_path_geometry.py`.

    The path is that of the last evaluated position.
    """
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    at = mj_struct.integer(data, mj_struct.TEN_WRAPADR, tendon)
    points = load_word(data + mj_struct.WRAP_XPOS)
    for k in range(number):
        place = places[geometry.PLACE_SIZE * k :]
        kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, start + k)
        place[geometry.KIND] = geometry.SITE
        if kind != _SPHERE and kind != _CYLINDER:
            _read_vector(points + 24 * at, 8, place, geometry.FIRST)
            at += 1
            continue
        place[geometry.KIND] = geometry.SPHERE if kind == _SPHERE else geometry.CYLINDER
        geom = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k)
        place[geometry.TOUCHED] = 0.0
        if mj_struct.integer(data, mj_struct.WRAP_OBJ, at) == geom:
            place[geometry.TOUCHED] = 1.0
            _read_vector(points + 24 * at, 8, place, geometry.FIRST)
            _read_vector(points + 24 * at + 24, 8, place, geometry.LAST)
            at += 2
            centre = load_word(data + mj_struct.GEOM_XPOS) + 24 * geom
            _read_vector(centre, 8, place, geometry.CENTRE)
            frame = load_word(data + mj_struct.GEOM_XMAT) + 72 * geom
            for axis in range(3):
                _read_vector(frame + 8 * axis, 24, place, geometry.AXES + 3 * axis)


@internal
def _read_vector(address: int, step: int, target: Floats, i: int) -> None:
    """Copy three numbers, some bytes apart, to the places from i on."""
    for axis in range(3):
        target[i + axis] = load_real(address + step * axis)


@internal
def bend(
    model: int,
    data: int,
    tendon: int,
    count: int,
    total: float,
    segments: Floats,
    out: Floats,
) -> None:
    """Compute the wrap of each segment of a conduit, see `_path_geometry.bend` [rad].

    `count` is the number of places that the conduit follows, 0 for all of them.
    """
    if count == 0:
        count = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    mark_stack(data)
    places = borrow_floats(data, places_size(model, tendon))
    read_places(model, data, tendon, places)
    geometry.bend(places, count, total, segments, out.size, out)
    free_stack(data)
