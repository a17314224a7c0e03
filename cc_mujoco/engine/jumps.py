"""Ends and paths that jump: further within a step than their velocity tells.

After `qpos` is set, a keyframe is loaded or a state is restored without its
`plugin_state`, the cable still lies where it lay. It is pulled to the new pose within
one step, with forces that no motion would make: `settle` is what was left out. A
checksum of the pose to which the last step led, in the state of the cable, tells that
`qpos` has been touched since; then a motion without velocity counts that changes the
tension by 1 %. A path jumps, too, where MuJoCo leads its tendon the other way around a
geom; what that pulls is energy from nowhere. A mocap body has no velocity, so what it
moves is measured by its pose.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.engine import fields
from cc_mujoco.engine.block import MOCAPS
from cc_mujoco.engine.config import constant
from cc_mujoco.engine.memory import (
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

_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)

_LEAST = 2e-3
"""Motion that a step allows an end whatever its velocity is [m]."""
_TIMES, _TIMES_TOUCHED = 3.0, 1.5
"""Factors by which the velocity may change within a step, for impacts."""
_SHARE = 0.01
"""Change of tension from which a motion by hand counts, as a part of the tension."""
_EQUAL = 1e-9
"""Difference of poses that rounding makes, as a part of them."""
_GOLDEN = 0.6180339887498949

PATH = 2
"""The path of an open cable; 0 and 1 are the proximal and the distal end."""
_WHAT = constant("its proximal end"), constant("its distal end"), constant("its path")
_JUMPED = constant(
    " jumped, without the velocity for it: after `qpos` is set, or a keyframe is "
    "loaded, `cc_mujoco.engine.settle(model, data)` lays the cable at rest there, and "
    "a state is restored with its `plugin_state`; without that one step pulls it by "
)
_SWITCHED = constant(
    " jumped, without the velocity for it: a side site that turns lets MuJoCo lead a "
    "tendon another way around a geom, and after `qpos` is set, or a keyframe is "
    "loaded, `cc_mujoco.engine.settle(model, data)` lays the cable at rest there; one "
    "step pulls it by "
)


@internal
def checksum(model: int, positions: int) -> float:
    """Return a checksum of generalised coordinates at an address."""
    q = floats(positions, fields.positions(model))
    total, weight = 0.0, 0.0
    for i in range(q.size):
        weight = (weight + _GOLDEN) % 1.0
        total += (1.0 + weight) * q[i]
    return total


@internal
def pose(model: int, data: int) -> float:
    """Return the checksum of `qpos`."""
    return checksum(model, load_word(data + fields.POSITION))


@internal
def touched(model: int, data: int, led: float) -> bool:
    """Return whether `qpos` is another than that to which the last step led.

    `led` is the checksum of that.
    """
    positions = load_word(data + fields.POSITION)
    size = 1.0
    for value in floats(positions, fields.positions(model)):
        size += abs(value)
    return not abs(checksum(model, positions) - led) <= _EQUAL * size


@internal
def poses_size(model: int) -> int:
    """Bytes that the first cable of a model keeps for poses of mocap bodies."""
    return 2 * 7 * 8 * fields.mocaps(model)


@internal
def _poses(model: int, lead: int, before: int) -> npt.NDArray[np.float64]:
    """Positions, then orientations of mocap bodies, at the last step or before it."""
    size = 7 * fields.mocaps(model)
    return floats(lead + load_word(lead + MOCAPS) + 8 * size * before, size)


@internal
def forget_poses(model: int, block: int) -> None:
    """Forget where mocap bodies were."""
    if load_word(block + MOCAPS) != 0:
        fill(_poses(model, block, 0), 0.0)
        fill(_poses(model, block, 1), 0.0)


@internal
def note_poses(model: int, data: int, block: int) -> None:
    """Note where mocap bodies are, if this is the first cable of its model."""
    if load_word(block + MOCAPS) == 0:
        return
    count, now = fields.mocaps(model), _poses(model, block, 0)
    assign(_poses(model, block, 1), now)
    assign(now[: 3 * count], floats(load_word(data + fields.MOCAP_POS), 3 * count))
    assign(now[3 * count :], floats(load_word(data + fields.MOCAP_QUAT), 4 * count))


@internal
def _mocap(model: int, body: int) -> int:
    """The mocap body that carries a body, by its place among them, or -1."""
    while body > 0:
        place = fields.integer(model, fields.BODY_MOCAP, body)
        if place >= 0:
            return place
        body = fields.integer(model, fields.BODY_PARENT, body)
    return -1


@internal
def carried(model: int, data: int, lead: int, tendon: int) -> float:
    """Return by how much mocap bodies can have moved a tendon since the last step [m].

    `lead` is the block of the first cable of the model.
    """
    if load_word(lead + MOCAPS) == 0:
        return 0.0
    count, total = fields.mocaps(model), 0.0
    before, now = _poses(model, lead, 1), _poses(model, lead, 0)
    start = fields.integer(model, fields.TENDON_ADR, tendon)
    for i in range(start, start + fields.integer(model, fields.TENDON_NUM, tendon)):
        kind = fields.integer(model, fields.WRAP_TYPE, i)
        if kind == _PULLEY:
            continue
        thing = fields.integer(model, fields.WRAP_OBJID, i)
        owner = fields.SITE_BODY if kind == _SITE else fields.GEOM_BODY
        place = _mocap(model, fields.integer(model, owner, thing))
        if place < 0:
            continue
        at = load_word(data + (fields.SITE_XPOS if kind == _SITE else fields.GEOM_XPOS))
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
def jumped(
    model: int, speed: float, moved: float, by_hand: bool, carried: float, soft: float
) -> bool:
    """Return whether something moved further within a step than its velocity makes it.

    Args:
        model: address.
        speed: its velocity at the position moved to [m/s].
        moved: by how much [m].
        by_hand: whether `qpos` has been touched since the last step.
        carried: by how much mocap bodies can have moved it [m].
        soft: stretch of the cable at its present tension [m].
    """
    step = fields.timestep(model)
    if by_hand:
        least = min(_SHARE * soft, _LEAST)
        return abs(moved) > least + _TIMES_TOUCHED * abs(speed) * step + carried
    return abs(moved) > _LEAST + _TIMES * abs(speed) * step + carried


@internal
def explain(message: Bytes, used: int, what: int) -> int:
    """Add that an end or the path jumped, but not how far.

    Returns:
        The new length.
    """
    used = append(message, used, _WHAT[what])
    return append(message, used, _SWITCHED if what == PATH else _JUMPED)


@internal
def add_size(message: Bytes, used: int, moved: float) -> int:
    """Add how far it jumped [m].

    Returns:
        The new length.
    """
    return append_millimetres(message, used, abs(moved))
