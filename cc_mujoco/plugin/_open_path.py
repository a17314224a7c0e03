"""The open part of a cable's path in MuJoCo's model and data, compiled.

What it is and does is in `cable/_open_path.py`; here it is read and its forces applied.
"""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.cable._open_path import angles as angles
from cc_mujoco.cable._open_path import contacts as contacts
from cc_mujoco.cable._open_path import fewest_segments, measure, pull_forces
from cc_mujoco.cable._open_path import keep_conduit as keep_conduit
from cc_mujoco.cable._open_path import lay as lay
from cc_mujoco.cable._open_path import lengths as lengths
from cc_mujoco.cable._open_path import max_piece_stiffness as max_piece_stiffness
from cc_mujoco.cable._open_path import memory_size as memory_size
from cc_mujoco.cable._open_path import pack_reference as pack_reference
from cc_mujoco.cable._open_path import path_growth as path_growth
from cc_mujoco.cable._open_path import previous_lengths as previous_lengths
from cc_mujoco.cable._open_path import save_path as save_path
from cc_mujoco.cable._open_path import shape_size as shape_size
from cc_mujoco.cable._open_path import store_conduit as store_conduit
from cc_mujoco.cable._path_geometry import FIRST, KIND, LAST, PLACE_SIZE, SITE, TOUCHED
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._ffi import (
    apply_force,
    borrow_floats,
    free_stack,
    internal,
    mark_stack,
)
from cc_mujoco.plugin._path import places_size, read_places

Floats = npt.NDArray[np.float64]

_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
ARC_SEGMENTS = 4
"""Default number of segments of the arc around a geom."""


@internal
def min_segments(model: int, tendon: int, mouth: int) -> int:
    """Return the segments that the path behind a mouth takes at least.

    `mouth` is the place of a site in the path, 0 where all of it is open.
    """
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    return fewest_segments(number, mouth)


@internal
def geom_count(model: int, tendon: int, mouth: int) -> int:
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    count = 0
    for i in range(mouth, mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)):
        if mj_struct.integer(model, mj_struct.WRAP_TYPE, start + i) != _SITE:
            count += 1
    return count


@internal
def wanted_segments(model: int, tendon: int, mouth: int, arc_segments: int) -> int:
    """Return the requested segments behind a mouth, `arc_segments` for an arc."""
    more = (arc_segments - 1) * geom_count(model, tendon, mouth)
    return min_segments(model, tendon, mouth) + more


@internal
def measure_path(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    guided: int,
    n: int,
    guides: Floats,
    shape: Floats,
) -> float:
    """Measure the open part of a tendon's path at the last evaluated position.

    `tendon` is spatial and without pulleys; other arguments and result are those of
    `cable._open_path.measure`.
    """
    mark_stack(data)
    places = borrow_floats(data, places_size(model, tendon))
    read_places(model, data, tendon, places)
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    reach = measure(places, number, mouth, guided, n, guides, shape)
    free_stack(data)
    return reach


@internal
def apply_pulls(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    shape: Floats,
    n: int,
    guided: int,
    node: Floats,
    tied: float,
    aside: int,
    scratch: int,
    target: int,
) -> None:
    """Add the forces of the pieces on the degrees of freedom.

    `data` is at the position of `shape`, `scratch` the address of six numbers, of which
    the last three are 0, and `target` that of the sum (nv,); other arguments are those
    of `cable._open_path.pull_forces`.
    """
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    number = mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    mark_stack(data)
    places = borrow_floats(data, places_size(model, tendon))
    forces = borrow_floats(data, 6 * (number - 1))
    read_places(model, data, tendon, places)
    pull_forces(places, number, mouth, shape, n, guided, node, tied, aside, forces)
    points, k = places.ctypes.data, 0
    while k < number - 1:
        here = points + 8 * (PLACE_SIZE * k + FIRST)
        first = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k)
        body = mj_struct.integer(model, mj_struct.SITE_BODY, first)
        i = 6 * k
        if places[PLACE_SIZE * (k + 1) + KIND] != SITE:
            if places[PLACE_SIZE * (k + 1) + TOUCHED] != 0.0:
                geom = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k + 1)
                on = mj_struct.integer(model, mj_struct.GEOM_BODY, geom)
                there = points + 8 * (PLACE_SIZE * (k + 1) + FIRST)
                _pull_together(
                    model, data, here, body, there, on, forces, i, scratch, target
                )
                here, body, i = points + 8 * (PLACE_SIZE * (k + 1) + LAST), on, i + 3
            k += 1
        k += 1
        last = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + k)
        other = mj_struct.integer(model, mj_struct.SITE_BODY, last)
        there = points + 8 * (PLACE_SIZE * k + FIRST)
        _pull_together(
            model, data, here, body, there, other, forces, i, scratch, target
        )
    free_stack(data)


@internal
def _pull_together(
    model: int,
    data: int,
    first: int,
    first_body: int,
    second: int,
    second_body: int,
    forces: Floats,
    i: int,
    scratch: int,
    target: int,
) -> None:
    """Draw two points, at addresses, on two bodies, by the force at place i."""
    x, y, z = forces[i], forces[i + 1], forces[i + 2]
    if first_body == second_body or (x == 0.0 and y == 0.0 and z == 0.0):
        return
    if mj_struct.is_movable(model, first_body):
        apply_force(model, data, scratch, first, first_body, target, x, y, z)
    if mj_struct.is_movable(model, second_body):
        apply_force(model, data, scratch, second, second_body, target, -x, -y, -z)
