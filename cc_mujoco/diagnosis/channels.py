"""What a trial may hold: one table of channels, and the units their readings come in.

A channel is called by its column, whose name ends in the unit: `motor_angle_rad`. The
same column in another unit may be called by that unit: `motor_angle_deg`.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from cc_mujoco.errors import CableError

TIME = "time_s"
VALID = "valid"
TEMPERATURE = "temperature_c"
MOTOR_ANGLE, MOTOR_TORQUE = "motor_angle_rad", "motor_torque_nm"
JOINT_ANGLE, JOINT_TORQUE = "joint_angle_rad", "joint_torque_nm"

ANGLES = (MOTOR_ANGLE, JOINT_ANGLE)
TORQUES = (MOTOR_TORQUE, JOINT_TORQUE)
DRIVE = (MOTOR_ANGLE, MOTOR_TORQUE, JOINT_ANGLE, JOINT_TORQUE)
"""Channels that every trial has."""
REQUIRED = (TIME, *DRIVE)

TENSION = "tension_<cable>_<proximal|distal>_n"
_TENSION = re.compile(r"tension_.+_(proximal|distal)_n")


class Kind(NamedTuple):
    """What a channel measures.

    Attributes:
        name: the word for it.
        unit: the unit it has inside the program.
        factors: that unit in every unit that a file may use.
    """

    name: str
    unit: str
    factors: dict[str, float]


_TURN = 2.0 * math.pi
CLOCK = Kind("time", "s", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})
ANGLE = Kind(
    "angle", "rad", {"rad": 1.0, "mrad": 1e-3, "deg": _TURN / 360, "rev": _TURN}
)
TORQUE = Kind("torque", "Nm", {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2})
FORCE = Kind("force", "N", {"N": 1.0, "mN": 1e-3, "kN": 1e3})
WARMTH = Kind("temperature", "degC", {"degC": 1.0})
MASK = Kind("mask", "1", {"1": 1.0})

_KINDS = {
    TIME: CLOCK,
    MOTOR_ANGLE: ANGLE,
    MOTOR_TORQUE: TORQUE,
    JOINT_ANGLE: ANGLE,
    JOINT_TORQUE: TORQUE,
    TEMPERATURE: WARMTH,
    VALID: MASK,
}


def kind(channel: str) -> Kind:
    """What the channel of this name measures.

    Raises:
        CableError: there is no such channel.
    """
    if is_tension(channel):
        return FORCE
    if channel not in _KINDS:
        raise CableError.unknown("channel", channel, [*_KINDS, TENSION])
    return _KINDS[channel]


def is_tension(column: str) -> bool:
    """Whether a column is a measured end tension by its name."""
    return _TENSION.fullmatch(column) is not None


def spellings(channel: str) -> dict[str, str]:
    """Names that a column of this channel may have by itself, with their units."""
    measured = kind(channel)
    if measured in (WARMTH, MASK):
        return {channel: measured.unit}
    stem = channel[: channel.rindex("_")]
    return {f"{stem}_{unit.lower()}": unit for unit in measured.factors}
