"""Ends and paths that jump: they move further in a step than their velocity allows.

After `qpos` is set, a keyframe is loaded or a state is restored without its
`plugin_state`, the cable still lies where it lay. It is pulled to the new pose within
one step, with forces that no motion would cause: `settle` was not called. The state of
the cable holds a checksum of the pose after the last step, which shows that `qpos` has
been changed since. Then a motion without velocity counts if it changes the tension by
1 %. A joint that is led by hand in every step moves by its velocity: allowed is the
larger of those before and after the step, as the latter is zero where it reverses.
A path also jumps where MuJoCo leads its tendon the other way around a geom; this
creates energy. A mocap body has no velocity, so its motion is measured by its pose.
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
    append_millimetres,
    assign,
    fill,
    floats,
    internal,
    load_real,
    load_word,
)
from cc_mujoco.plugin._instance_data import MOCAP_POSES

_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)

_MIN_JUMP = 2e-3
"""Motion that a step allows an end whatever its velocity is [m]."""
_VELOCITY_FACTOR, _VELOCITY_FACTOR_TOUCHED = 3.0, 1.5
"""Factors by which the velocity may change within a step, for impacts."""
_MIN_TENSION_CHANGE = 0.01
"""Change of tension from which a motion by hand counts, as a part of the tension."""
_POSE_TOLERANCE = 1e-9
"""Difference of poses that rounding makes, as a part of them."""
_GOLDEN = 0.6180339887498949

PATH = 2
"""The path of an open cable; 0 and 1 are the proximal and the distal end."""
_JUMPING_PARTS = (
    constant("its proximal end"),
    constant("its distal end"),
    constant("its path"),
)
_JUMPED = constant(" jumped, without the velocity for it: ")
_SIDE_SITE_ADVICE = constant(
    "a side site that turns lets MuJoCo lead a tendon another way around a geom, and "
)
_REMEDIES = constant(
    "after `qpos` is set, or a keyframe is loaded, call `cc_mujoco.plugin.settle("
    'model, data, rope="keep")` for the same rope in another pose, or with '
    '`rope="remount"` for a rope that is mounted there with its pretension; restore a '
    "state with its `plugin_state`; without that one step pulls it by "
)


@internal
def checksum(model: int, positions: int) -> float:
    """Return a checksum of generalised coordinates at an address."""
    q = floats(positions, mj_struct.positions(model))
    total, weight = 0.0, 0.0
    for i in range(q.size):
        weight += _GOLDEN
        weight = weight - 1.0 if weight >= 1.0 else weight
        total += (1.0 + weight) * q[i]
    return total


@internal
def pose_checksum(model: int, data: int) -> float:
    """Return the checksum of `qpos`."""
    return checksum(model, load_word(data + mj_struct.QPOS))


@internal
def position_changed(model: int, data: int, led: float) -> bool:
    """Return whether `qpos` is another than that to which the last step led.

    `led` is the checksum of that.
    """
    positions = load_word(data + mj_struct.QPOS)
    size = 1.0
    for k in range(mj_struct.positions(model)):
        size += abs(load_real(positions + 8 * k))
    return not abs(checksum(model, positions) - led) <= _POSE_TOLERANCE * size


@internal
def poses_size(model: int) -> int:
    """Return the bytes that a model's first cable keeps for poses of mocap bodies."""
    return 2 * 7 * 8 * mj_struct.mocaps(model)


@internal
def _poses(model: int, lead: int, before: int) -> npt.NDArray[np.float64]:
    """Return positions and orientations of mocap bodies, at or before the last step."""
    size = 7 * mj_struct.mocaps(model)
    return floats(lead + load_word(lead + MOCAP_POSES) + 8 * size * before, size)


@internal
def forget_poses(model: int, block: int) -> None:
    """Invalidate the saved poses of mocap bodies."""
    if load_word(block + MOCAP_POSES) != 0:
        fill(_poses(model, block, 0), 0.0)
        fill(_poses(model, block, 1), 0.0)


@internal
def save_poses(model: int, data: int, block: int) -> None:
    """Save the poses of mocap bodies, if this is the first cable of its model."""
    if load_word(block + MOCAP_POSES) == 0:
        return
    count, now = mj_struct.mocaps(model), _poses(model, block, 0)
    assign(_poses(model, block, 1), now)
    assign(now[: 3 * count], floats(load_word(data + mj_struct.MOCAP_POS), 3 * count))
    assign(now[3 * count :], floats(load_word(data + mj_struct.MOCAP_QUAT), 4 * count))


@internal
def _mocap(model: int, body: int) -> int:
    """Return the index of the mocap body that carries a body, or -1."""
    while body > 0:
        place = mj_struct.integer(model, mj_struct.BODY_MOCAP, body)
        if place >= 0:
            return place
        body = mj_struct.integer(model, mj_struct.BODY_PARENT, body)
    return -1


@internal
def mocap_motion(model: int, data: int, lead: int, tendon: int) -> float:
    """Return by how much mocap bodies can have moved a tendon since the last step [m].

    `lead` is the block of the first cable of the model.
    """
    if load_word(lead + MOCAP_POSES) == 0:
        return 0.0
    count, total = mj_struct.mocaps(model), 0.0
    before, now = _poses(model, lead, 1), _poses(model, lead, 0)
    start = mj_struct.integer(model, mj_struct.TENDON_ADR, tendon)
    for i in range(
        start, start + mj_struct.integer(model, mj_struct.TENDON_NUM, tendon)
    ):
        kind = mj_struct.integer(model, mj_struct.WRAP_TYPE, i)
        if kind == _PULLEY:
            continue
        thing = mj_struct.integer(model, mj_struct.WRAP_OBJID, i)
        owner = mj_struct.SITE_BODY if kind == _SITE else mj_struct.GEOM_BODY
        place = _mocap(model, mj_struct.integer(model, owner, thing))
        if place < 0:
            continue
        at = load_word(
            data + (mj_struct.SITE_XPOS if kind == _SITE else mj_struct.GEOM_XPOS)
        )
        shifted = reach = aligned = known = 0.0
        for k in range(3):
            own = now[3 * place + k]
            shifted += (own - before[3 * place + k]) ** 2
            reach += (load_real(at + 24 * thing + 8 * k) - own) ** 2
        for k in range(4):
            own, old = now[3 * count + 4 * place + k], before[3 * count + 4 * place + k]
            aligned += own * old
            known += abs(old)
        if known == 0.0:
            return math.inf
        turned = 2.0 * math.acos(min(abs(aligned), 1.0))
        # It moves the pieces on both sides.
        total += 2.0 * (math.sqrt(shifted) + turned * math.sqrt(reach))
    return total


@internal
def has_jumped(
    model: int, speed: float, moved: float, by_hand: bool, carried: float, soft: float
) -> bool:
    """Return whether something moved further within a step than its velocity makes it.

    `speed` is the larger of those before and after the step [m/s]. It `moved` so far,
    mocap bodies can have `carried` it so far, and `soft` is the stretch of the cable at
    its present tension [m]. `by_hand`: `qpos` was touched since the last step.
    """
    step = mj_struct.timestep(model)
    if by_hand:
        least = min(_MIN_TENSION_CHANGE * soft, _MIN_JUMP)
        return abs(moved) > least + _VELOCITY_FACTOR_TOUCHED * speed * step + carried
    return abs(moved) > _MIN_JUMP + _VELOCITY_FACTOR * speed * step + carried


@internal
def explain(message: Bytes, used: int, what: int) -> int:
    """Add that an end or the path jumped, but not how far."""
    used = append(message, used, _JUMPING_PARTS[what])
    used = append(message, used, _JUMPED)
    if what == PATH:
        used = append(message, used, _SIDE_SITE_ADVICE)
    return append(message, used, _REMEDIES)


@internal
def append_distance(message: Bytes, used: int, moved: float) -> int:
    """Append the distance of the jump [m]."""
    return append_millimetres(message, used, abs(moved))
