"""Geoms in a path that the cable never touches, compiled.

MuJoCo's tendon runs straight past a geom that is not in its way, or through one whose
axis points along it, without a warning. There is no friction there. A geom counts as
touched where the path bends around it in `qpos0`, or in one of some random poses of all
joints within their ranges.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mujoco import mjtJoint, mjtWrap

from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._warnings import begin_message

RANDOM_POSES = 200


@internal
def _mark_touched(
    model: MjModel, data: MjData, tendon: int, touched: ffi.Bytes
) -> None:
    """Mark with 1 sites in a path, and geoms that it touches in some pose."""
    start = model.tendon_adr[tendon]
    missing = 0
    for place in range(touched.size):
        kind = model.wrap_type[start + place]
        plain = kind == mjtWrap.mjWRAP_SITE or kind == mjtWrap.mjWRAP_PULLEY
        touched[place] = 1 if plain else 0
        missing += not plain
    missing -= _mark_touched_now(model, data, tendon, touched)
    if missing == 0:
        return
    present = data.qpos[: model.nq]
    ffi.mark_stack(data)
    kept = ffi.borrow_floats(data, present.size)
    kept[:] = present
    present[:] = model.qpos0[: model.nq]
    reach = model.tendon_length0[tendon]
    seed, tried = np.zeros(1, np.uint64), 0
    seed[0] = 1
    while missing > 0 and tried <= RANDOM_POSES:
        if tried > 0:
            _random_pose(model, present, reach, seed)
        ffi.evaluate_bodies(model, data)
        ffi.evaluate_tendons(model, data)
        missing -= _mark_touched_now(model, data, tendon, touched)
        tried += 1
    present[:] = kept
    ffi.free_stack(data)
    ffi.evaluate_bodies(model, data)
    ffi.evaluate_tendons(model, data)


@internal
def _mark_touched_now(
    model: MjModel, data: MjData, tendon: int, touched: ffi.Bytes
) -> int:
    """Mark the geoms that a path touches at the last position; return how many anew."""
    start, begin = model.tendon_adr[tendon], data.ten_wrapadr[tendon]
    end = begin + data.ten_wrapnum[tendon]
    found = 0
    for place in range(touched.size):
        geom = model.wrap_objid[start + place]
        at = begin
        while touched[place] == 0 and at < end:
            if data.wrap_obj[at // 2, at % 2] == geom:
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
    model: MjModel, positions: FloatArray, reach: float, seed: npt.NDArray[np.uint64]
) -> None:
    origin = model.qpos0[: positions.size]
    for joint in range(model.njnt):
        kind = model.jnt_type[joint]
        at = model.jnt_qposadr[joint]
        if kind == mjtJoint.mjJNT_FREE:
            for i in range(3):
                positions[at + i] = origin[at + i] + reach * (2.0 * _uniform(seed) - 1)
            at += 3
        if kind == mjtJoint.mjJNT_FREE or kind == mjtJoint.mjJNT_BALL:
            size = 0.0
            while not 0.01 < size <= 1.0:
                size = 0.0
                for i in range(4):
                    positions[at + i] = 2.0 * _uniform(seed) - 1.0
                    size += positions[at + i] ** 2
            for i in range(4):
                positions[at + i] /= math.sqrt(size)
            continue
        far = reach if kind == mjtJoint.mjJNT_SLIDE else math.pi
        low, high = origin[at] - far, origin[at] + far
        if model.jnt_limited[joint] != 0:
            low, high = model.jnt_range[joint, 0], model.jnt_range[joint, 1]
        positions[at] = low + (high - low) * _uniform(seed)


@internal
def warn_missed(model: MjModel, data: MjData, instance: int, tendon: int) -> None:
    """Warn, once, of each geom in a path that it never touches."""
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    message = begin_message(room.ctypes.data, model, instance)
    start = message.used
    ffi.append(message, "its geoms have been looked for")
    if ffi.warned_once(message, model.signature):
        return
    count = model.tendon_num[tendon]
    ffi.mark_stack(data)
    touched = ffi.octets(ffi.borrow(data, count), count)
    _mark_touched(model, data, tendon, touched)
    for place in range(touched.size):
        if touched[place] == 0:
            message.used = start
            geom = model.wrap_objid[model.tendon_adr[tendon] + place]
            name = ffi.name(model, model.name_geomadr[geom])
            ffi.append(message, "its path never touches geom ")
            ffi.append_label(message, name, geom)
            ffi.append(message, ", neither in `qpos0` nor in ")
            ffi.append_integer(message, RANDOM_POSES)
            ffi.append(
                message,
                " random poses of the joints, so nothing rubs there; turn or move the "
                "geom, or take it from the path",
            )
            ffi.warn(message)
    ffi.free_stack(data)
