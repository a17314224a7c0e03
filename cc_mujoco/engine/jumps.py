"""Ends and paths that jump: further within a step than their velocity tells.

After `qpos` is set, or a keyframe is loaded, the cable still lies where it lay. It is
pulled to the new pose within one step, with forces that no motion would make, which is
seldom meant: `settle` is what was left out. A path jumps, too, where MuJoCo leads its
tendon the other way around a geom; what that pulls is energy from nowhere.
"""

from __future__ import annotations

from cc_mujoco.engine import fields
from cc_mujoco.engine.config import constant
from cc_mujoco.engine.memory import Bytes, append, append_millimetres, internal

_LEAST = 2e-3
"""What a step may move an end by whatever its velocity is [m]."""
_TIMES = 3.0
"""By how much the velocity may change within a step, for impacts."""

PATH = 2
"""The path of an open cable; 0 and 1 are the proximal and the distal end."""
_WHAT = constant("its proximal end"), constant("its distal end"), constant("its path")
_JUMPED = constant(
    " jumped, without the velocity for it: after `qpos` is set, or a keyframe is "
    "loaded, `cc_mujoco.engine.settle(model, data)` lays the cable at rest there; "
    "without it one step pulls it by "
)
_SWITCHED = constant(
    " jumped, without the velocity for it: a side site that turns lets MuJoCo lead a "
    "tendon another way around a geom, and after `qpos` is set, or a keyframe is "
    "loaded, `cc_mujoco.engine.settle(model, data)` lays the cable at rest there; one "
    "step pulls it by "
)


@internal
def jumped(model: int, speed: float, moved: float) -> bool:
    """Whether something moved further within a step than its velocity tells.

    Args:
        model: address.
        speed: its velocity at the position moved to [m/s].
        moved: by how much [m].
    """
    return abs(moved) > _LEAST + _TIMES * abs(speed) * fields.timestep(model)


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
