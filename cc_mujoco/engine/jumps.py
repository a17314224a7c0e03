"""Ends that someone moved by hand: further within a step than their velocity tells.

After `qpos` is set, or a keyframe is loaded, the cable still lies where it lay. It is
pulled to the new pose within one step, with forces that no motion would make, which is
seldom meant: `settle` is what was left out.
"""

from __future__ import annotations

from cc_mujoco.engine import fields
from cc_mujoco.engine.config import constant
from cc_mujoco.engine.memory import Bytes, append, append_millimetres, internal

_LEAST = 2e-3
"""What a step may move an end by whatever its velocity is [m]."""
_TIMES = 3.0
"""By how much the velocity may change within a step, for impacts."""

_ENDS = constant("its proximal end"), constant("its distal end")
_JUMPED = constant(
    " jumped, without the velocity for it: after `qpos` is set, or a keyframe is "
    "loaded, `cc_mujoco.engine.settle(model, data)` lays the cable at rest there; "
    "without it one step pulls it by "
)


@internal
def jumped(model: int, data: int, out: int, moved: float) -> bool:
    """Whether an end moved further within a step than its velocity tells.

    Args:
        model: address.
        data: address; its velocities are those of the position moved to.
        out: index of the end in `actuator_velocity`.
        moved: by how much [m].
    """
    speed = abs(fields.real(data, fields.VELOCITY, out))
    return abs(moved) > _LEAST + _TIMES * speed * fields.timestep(model)


@internal
def explain(message: Bytes, used: int, end: int) -> int:
    """Add that the proximal (0) or the distal end (1) jumped, but not how far.

    Returns:
        The new length.
    """
    used = append(message, used, _ENDS[end])
    return append(message, used, _JUMPED)


@internal
def add_size(message: Bytes, used: int, moved: float) -> int:
    """Add how far it jumped [m].

    Returns:
        The new length.
    """
    return append_millimetres(message, used, abs(moved))
