"""Table of the channels that a trial may hold, and the units of their readings.

A channel has the name of its column, which ends in the unit: `motor_angle_rad`. A file
may hold it in another unit under that unit's name: `motor_angle_deg`.
"""

import re

from cc_mujoco._utils.units import ANGLE as ANGLE
from cc_mujoco._utils.units import CLOCK as CLOCK
from cc_mujoco._utils.units import FORCE as FORCE
from cc_mujoco._utils.units import TORQUE as TORQUE
from cc_mujoco._utils.units import Kind, last_word
from cc_mujoco._utils.units import unit_of as unit_of
from cc_mujoco.errors import CableError

TIME, VALID, TEMPERATURE = "time_s", "valid", "temperature_c"
MOTOR_ANGLE, JOINT_ANGLE = ANGLES = "motor_angle_rad", "joint_angle_rad"
MOTOR_TORQUE, JOINT_TORQUE = TORQUES = "motor_torque_nm", "joint_torque_nm"
MOTOR_CURRENT = "motor_current_a"

MAIN_CHANNELS = (MOTOR_ANGLE, MOTOR_TORQUE, JOINT_ANGLE, JOINT_TORQUE)
REQUIRED_CHANNELS = (TIME, *MAIN_CHANNELS)

CURRENT = Kind("current", "A", {"A": 1.0, "mA": 1e-3})
_KINDS = {
    TIME: CLOCK,
    MOTOR_ANGLE: ANGLE,
    MOTOR_TORQUE: TORQUE,
    MOTOR_CURRENT: CURRENT,
    JOINT_ANGLE: ANGLE,
    JOINT_TORQUE: TORQUE,
    TEMPERATURE: Kind("temperature", "degC", {"degC": 1.0}),
    VALID: Kind("mask", "1", {"1": 1.0}),
}


def kind_of(channel: str) -> Kind:
    if is_further(channel):
        return Kind("reading", "1", {"1": 1.0})
    if is_tension(channel):
        return FORCE
    if is_other_angle(channel):
        return ANGLE
    if channel not in _KINDS:
        raise CableError.unknown(
            "channel", channel, [*_KINDS, "tension_<cable>_<proximal|distal>_n"]
        )
    return _KINDS[channel]


def _tension(column: str) -> re.Match[str] | None:
    return re.fullmatch(r"tension_(?:(.+)_)?(proximal|distal)_n", column)


def is_tension(column: str) -> bool:
    return _tension(column) is not None


def other_angle(joint: str) -> str:
    """Return the channel of the angle of a joint other than the driven one."""
    return f"{joint}_angle_rad"


def is_other_angle(channel: str) -> bool:
    """Return whether a channel is the angle of a joint other than the driven one."""
    return channel not in ANGLES and bool(re.fullmatch(r".+_angle_rad", channel))


def cable_end(tension: str) -> tuple[str, str]:
    """Return cable ("" for the only one) and end of `tension_<cable>_<end>_n`."""
    found = _tension(tension)
    assert found is not None
    return found[1] or "", found[2]


def further(column: str) -> str:
    """Return the channel of a column outside the table that a custom effect reads."""
    return f"column {column}"


def is_further(channel: str) -> bool:
    return channel.startswith("column ")


def further_column(channel: str) -> str:
    return channel.removeprefix("column ")


def bare_name(column: str) -> str:
    """Return the last part of a column's name: `q` of `data.q` or `/topic/q`."""
    return re.split(r"[./]", column)[-1]


def spellings(channel: str) -> dict[str, str]:
    measured = kind_of(channel)
    if len(measured.factors) == 1:
        return {channel: measured.unit}
    stem = channel[: channel.rindex("_")]
    return {f"{stem}_{unit.lower()}": unit for unit in measured.factors}


def tension_channel(column: str) -> str:
    """Return the channel of a tension column, "" if none; raise if it is no force."""
    name = r"(tension_(?:.+_)?(?:proximal|distal)_)[a-z]+"
    if (found := re.fullmatch(name, column)) is None:
        return ""
    if unit_of(column, FORCE):
        return f"{found[1]}n"
    if other := explain_unknown_column(column):
        raise CableError(f"column {column} is {other}.")
    return ""


def explain_unknown_column(column: str) -> str:
    """Return advice on a column that is no channel, by its unit; "" if unknown."""
    hints = {
        "mm cm": "a length; over the radius of its pulley it is an angle in rad",
        "rpm rps": "a speed; its integral over time is an angle",
        "kg lb lbs": "a mass; its weight is a force, in kgf or in lbf",
        "ma amp": "a current; times the torque constant it is a motor's torque: call "
        "it motor_current_a or motor_current_ma and declare [rig] torque_constant",
        "mv volt": "a voltage; apply the calibration of its sensor first",
        " ".join(FORCE.factors).lower(): "a force; times the radius of its pulley it "
        "is a torque",
    }
    unit = last_word(column)
    return next((hint for units, hint in hints.items() if unit in units.split()), "")
