"""Geoms in a path that the cable never touches, compiled.

MuJoCo's tendon runs straight past a geom that is not in its way, or through one whose
axis points along it, without a warning. There is no friction there. A geom counts as
touched where the path bends around it in `qpos0`, or in one of some random poses of all
joints within their ranges.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin._config import constant
from cc_mujoco.plugin._ffi import (
    Bytes,
    append,
    append_integer,
    assign,
    borrow_floats,
    evaluate_bodies,
    evaluate_tendons,
    floats,
    free_stack,
    internal,
    load_word,
    mark_stack,
    quote,
)

Floats = npt.NDArray[np.float64]

_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_BALL = int(mujoco.mjtJoint.mjJNT_BALL)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)

RANDOM_POSES = 200
GEOMS_SEARCHED = constant("its geoms have been looked for")
_NEVER_TOUCHED = constant("its path never touches geom ")
_NEVER_TOUCHED_END = constant(
    f", neither in `qpos0` nor in {RANDOM_POSES} random poses of the joints, so "
    "nothing rubs there; turn or move the geom, or take it from the path"
)


@internal
def mark_touched(model: int, data: int, tendon: int, touched: Bytes) -> None:
    """Mark the places of a path that are sites, or geoms that it touches in some pose.

    `touched` is 1 there, in and out. The data are left as they were.
    """
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    missing = 0
    for place in range(touched.size):
        kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, start + place)
        touched[place] = 1 if kind == _SITE or kind == _PULLEY else 0
        missing += touched[place] == 0
    if missing == 0:
        return
    missing -= _mark_touched_now(model, data, tendon, touched)
    if missing == 0:
        return
    present = floats(load_word(data + mj_struct.QPOS), mj_struct.positions(model))
    mark_stack(data)
    kept = borrow_floats(data, present.size)
    rest = load_word(model + mj_struct.QPOS0)
    assign(kept, present)
    assign(present, floats(rest, present.size))
    reach = mj_struct.real(model, mj_struct.TENDON_LENGTH0, tendon)
    seed, tried = np.zeros(1, np.uint64), 0
    seed[0] = 1
    while missing > 0 and tried <= RANDOM_POSES:
        if tried > 0:
            _random_pose(model, present, reach, seed)
        evaluate_bodies(model, data)
        evaluate_tendons(model, data)
        missing -= _mark_touched_now(model, data, tendon, touched)
        tried += 1
    assign(present, kept)
    free_stack(data)
    evaluate_bodies(model, data)
    evaluate_tendons(model, data)


@internal
def _mark_touched_now(model: int, data: int, tendon: int, touched: Bytes) -> int:
    """Mark the geoms that a path touches at the last position; return how many anew."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    begin = mj_struct.integer(data, mj_struct.TEN_WRAPADR, tendon)
    end = begin + mj_struct.integer(data, mj_struct.TEN_WRAPNUM, tendon)
    found = 0
    for place in range(touched.size):
        geom = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + place)
        at = begin
        while touched[place] == 0 and at < end:
            if mj_struct.integer(data, mj_struct.WRAP_OBJ, at) == geom:
                touched[place] = 1
                found += 1
            at += 1
    return found


@internal
def _uniform(seed: npt.NDArray[np.uint64]) -> float:
    """Return a random number in [0, 1): a linear congruential generator (Knuth)."""
    seed[0] = seed[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return float(seed[0] >> np.uint64(11)) / 9007199254740992.0


@internal
def _random_pose(
    model: int, positions: Floats, reach: float, seed: npt.NDArray[np.uint64]
) -> None:
    """Draw a pose: within ranges, else any angle, and places within `reach` [m]."""
    rest = load_word(model + mj_struct.QPOS0)
    origin = floats(rest, positions.size)
    for joint in range(mj_struct.joints(model)):
        kind = mj_struct.integer(model, mj_struct.JNT_TYPE, joint)
        at = mj_struct.integer(model, mj_struct.JNT_POSITION, joint)
        if kind == _FREE:
            for i in range(3):
                positions[at + i] = origin[at + i] + reach * (2.0 * _uniform(seed) - 1)
            at += 3
        if kind == _FREE or kind == _BALL:
            size = 0.0
            while not 0.01 < size <= 1.0:
                size = 0.0
                for i in range(4):
                    positions[at + i] = 2.0 * _uniform(seed) - 1.0
                    size += positions[at + i] ** 2
            for i in range(4):
                positions[at + i] /= math.sqrt(size)
            continue
        low = origin[at] - (reach if kind == _SLIDE else math.pi)
        high = origin[at] + (reach if kind == _SLIDE else math.pi)
        if mj_struct.byte(model, mj_struct.JNT_LIMITED, joint) != 0:
            low = mj_struct.real(model, mj_struct.JNT_RANGE, 2 * joint)
            high = mj_struct.real(model, mj_struct.JNT_RANGE, 2 * joint + 1)
        positions[at] = low + (high - low) * _uniform(seed)


@internal
def explain(message: Bytes, used: int, model: int, tendon: int, place: int) -> int:
    """Add that a path never touches the geom at a place of it."""
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    geom = mj_struct.integer(model, mj_struct.WRAP_OBJID, start + place)
    used = append(message, used, _NEVER_TOUCHED)
    name = mj_struct.geom_name(model, geom)
    if name.size == 0:
        used = append_integer(message, used, geom)
    else:
        used = quote(message, used, name)
    return append(message, used, _NEVER_TOUCHED_END)
