"""Reference rows of every table, which give the scores of controllers a scale."""

from __future__ import annotations

from dataclasses import dataclass, field

from cc_mujoco.benchmark._plant import Belief
from cc_mujoco.device import UNPLUGGED
from cc_mujoco.device._variables import Value
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Reference:
    """Device or controller that is no entry of a benchmark."""

    meaning: str
    controller: str | None = None
    """Name of the controller; without one the motor gives no torque."""
    changes: dict[str, Value] = field(default_factory=dict)
    """Changes to every cable of the plant."""
    ideal: bool = False
    """True if the desired torque reaches the joint whatever the cables do."""
    belief: Belief | None = None
    """Belief of the controller; that of the condition by default."""


SCALE_CONTROLLER = "none"
"""The controller whose mean error in a condition is an error of 1."""

REFERENCES = {
    "unplugged": Reference(
        "the device without its cables: the joint feels nothing",
        changes=UNPLUGGED,
    ),
    "motor-off": Reference("the cables are there and the motor gives no torque"),
    "ideal-transmission": Reference(
        "what the motor can give of the desired torque, as late as it is measured, "
        "reaches the joint of the unplugged device",
        changes=UNPLUGGED,
        ideal=True,
    ),
    "perfect-model": Reference(
        "`stiction` that knows the cables as they are; sensors as usual",
        "stiction",
        belief=Belief(0.0),
    ),
}
"""Every reference by name; `none` is one too, and a controller."""


def require_unused_name(controller: str) -> None:
    """Refuse a controller with the name of a reference."""
    if controller in REFERENCES:
        raise CableError(
            f"{controller!r} is a reference, which every table has; it is no controller"
        )
