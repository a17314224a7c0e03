"""Classes of physical causes that make the same torques at the same angles.

A verdict that names an effect, or a tuned parameter that deviates, means any of them.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CauseClass:
    """Physical causes for which an effect or a tuned parameter stands."""

    name: str  # id of the effect, or name of the parameter
    causes: tuple[str, ...]  # in words
    separated_by: str  # what tells them apart


_LATE_OR_DRAG = (
    "a sensor that reads late; drag that needs no tension",
    "the trials again at half the speed, with which the effect of a delay halves",
)
_TABLE = {
    "friction": (
        "another coefficient of friction; another wrap angle",
        "a photograph of the route, from which its bends are measured",
    ),
    "axial_stiffness": (
        "another stiffness of the rope; a conduit that is compressed",
        "a dial gauge at the end of the conduit while the cable is pulled",
    ),
    "tension_dependent_friction": (
        "a coefficient of friction that changes with pressure; bends that open or "
        "close under tension",
        "photographs of the bends, slack and taut, or the trials again with the "
        "conduit held fast in its bends",
    ),
    "configuration_dependent_wrap": (
        "bends that change with the joint; a liner that is worn in places",
        "photographs of the route at both ends of the joint's range",
    ),
    "cable_stiffening": (
        "strands that settle; clearance, slack cable at the outer wall of a bend and "
        "taut cable at the inner one",
        "photographs of a bend, slack and taut, or the trials again with the conduit "
        "laid straighter, with which clearance vanishes",
    ),
    "end_compliance": (
        "a soft end fitting; a stop or bracket of the conduit that gives",
        "a dial gauge at the stop of the conduit while the cable is pulled",
    ),
    "torque_sensor_gain": (
        "a wrong gain of the sensor; a wrong lever arm or torque constant",
        "a known weight on the shaft, or a second sensor",
    ),
    "sensor_delay": _LATE_OR_DRAG,
    "load_independent_friction": _LATE_OR_DRAG,
}
CLASSES = {
    name: CauseClass(name, tuple(causes.split("; ")), separated_by)
    for name, (causes, separated_by) in _TABLE.items()
}
"""Class by id of an effect or name of a tuned parameter. Two effects with the same
causes mean them where the data do not decide between them."""
