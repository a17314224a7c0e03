"""Channels that a trial may hold, in one table, and the units their readings come in.

A channel is called by its column, whose name ends in the unit: `motor_angle_rad`. The
same column in another unit may be called by that unit: `motor_angle_deg`.
"""

from __future__ import annotations

import re

from cc_mujoco.errors import CableError
from cc_mujoco.units import ANGLE as ANGLE
from cc_mujoco.units import CLOCK as CLOCK
from cc_mujoco.units import FORCE as FORCE
from cc_mujoco.units import TORQUE as TORQUE
from cc_mujoco.units import Kind, last_word
from cc_mujoco.units import unit_of as unit_of

TIME = "time_s"
VALID = "valid"
TEMPERATURE = "temperature_c"
MOTOR_ANGLE, MOTOR_TORQUE = "motor_angle_rad", "motor_torque_nm"
MOTOR_CURRENT = "motor_current_a"
JOINT_ANGLE, JOINT_TORQUE = "joint_angle_rad", "joint_torque_nm"

ANGLES = (MOTOR_ANGLE, JOINT_ANGLE)
TORQUES = (MOTOR_TORQUE, JOINT_TORQUE)
DRIVE = (MOTOR_ANGLE, MOTOR_TORQUE, JOINT_ANGLE, JOINT_TORQUE)
"""Motion of both ends, which every trial has, and what drives it."""
REQUIRED = (TIME, *DRIVE)
PLAIN = (*DRIVE, MOTOR_CURRENT, TEMPERATURE)
"""Channels of a trial that are no tension."""

TENSION = "tension_<cable>_<proximal|distal>_n"
_TENSION = re.compile(r"tension_(?:(.+)_)?(proximal|distal)_n")
_TENSION_IN = re.compile(r"(tension_(?:.+_)?(?:proximal|distal)_)([a-z]+)")


CURRENT = Kind("current", "A", {"A": 1.0, "mA": 1e-3})
WARMTH = Kind("temperature", "degC", {"degC": 1.0})
MASK = Kind("mask", "1", {"1": 1.0})

_KINDS = {
    TIME: CLOCK,
    MOTOR_ANGLE: ANGLE,
    MOTOR_TORQUE: TORQUE,
    MOTOR_CURRENT: CURRENT,
    JOINT_ANGLE: ANGLE,
    JOINT_TORQUE: TORQUE,
    TEMPERATURE: WARMTH,
    VALID: MASK,
}

_ELSE = {
    **dict.fromkeys(
        ("mm", "cm"), "a length; over the radius of its pulley it is an angle in rad"
    ),
    **dict.fromkeys(("rpm", "rps"), "a speed; its integral over time is an angle"),
    **dict.fromkeys(
        ("kg", "lb", "lbs"), "a mass; its weight is a force, in kgf or in lbf"
    ),
    **dict.fromkeys(
        ("ma", "amp"),
        "a current; times the torque constant it is a motor's torque: call it "
        "motor_current_a or motor_current_ma and declare [rig] torque_constant",
    ),
    **dict.fromkeys(
        ("mv", "volt"), "a voltage; apply the calibration of its sensor first"
    ),
    **dict.fromkeys(
        map(str.lower, FORCE.factors),
        "a force; times the radius of its pulley it is a torque",
    ),
}
"""What readings in other units are, and how to make a channel of them."""


def kind(channel: str) -> Kind:
    """Return what the channel of this name measures.

    Raises:
        CableError: there is no such channel.
    """
    if is_tension(channel):
        return FORCE
    if channel not in _KINDS:
        raise CableError.unknown("channel", channel, [*_KINDS, TENSION])
    return _KINDS[channel]


def is_tension(column: str) -> bool:
    """Return whether a column is a measured end tension by its name."""
    return _TENSION.fullmatch(column) is not None


def cable_end(tension: str) -> tuple[str, str]:
    """Cable and end of the channel of a tension; "" of a cable that is the only one."""
    found = _TENSION.fullmatch(tension)
    assert found is not None
    return found[1] or "", found[2]


def bare(column: str) -> str:
    """Name of a column without the struct, group, topic or file that it is in."""
    return re.split(r"[./]", column)[-1]


def spellings(channel: str) -> dict[str, str]:
    """Names that a column of this channel may have by itself, with their units."""
    measured = kind(channel)
    if measured in (WARMTH, MASK):
        return {channel: measured.unit}
    stem = channel[: channel.rindex("_")]
    return {f"{stem}_{unit.lower()}": unit for unit in measured.factors}


def tension(column: str) -> str:
    """Channel of a column that is a tension by its name, whatever its unit; else "".

    Raises:
        CableError: the unit is one of something else.
    """
    found = _TENSION_IN.fullmatch(column)
    if found is None:
        return ""
    if unit_of(column, FORCE):
        return f"{found[1]}n"
    if other := no_channel(column):
        raise CableError(f"column {column} is {other}.")
    return ""


def no_channel(column: str) -> str:
    """Return what a column that is no channel's measures by its unit; what to do."""
    return _ELSE.get(last_word(column), "")
