"""Columns of an episode log: one table of names, units and meanings.

They hold the truth, not the measurements of a controller (`cc_mujoco.device._sensors`).
The dictionary that an environment returns as `info` has exactly these keys, so the
table is the documentation of both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product


@dataclass(frozen=True)
class LogColumn:
    name: str
    """Name, ending in the unit; `{cable}` stands for the name of a cable."""
    unit: str
    """SI unit, `1` for a pure number, `mixed` where entries differ."""
    meaning: str
    """One line for a reader who sees only the file."""
    listed: bool = False
    """True when every row holds a list of values instead of one."""
    dtype: str = "float64"
    """NumPy name of the element type."""


MODEL_XML, AXES = "model_xml", "axes"
"""Metadata keys: the MJCF of the model, and the facts of each axis by name, of a device
with several."""

TIME_COLUMN, POSE_COLUMN = (
    LogColumn("time_s", "s", "simulated time"),
    LogColumn("qpos", "mixed", "generalized coordinates (rad, m)", listed=True),
)

AXIS_COLUMNS = (
    LogColumn("motor_angle_rad", "rad", "angle of the motor pulley"),
    LogColumn("motor_velocity_rad_s", "rad/s", "angular velocity of the motor pulley"),
    LogColumn("motor_torque_nm", "N m", "torque that the motor puts into its pulley"),
    LogColumn("joint_angle_rad", "rad", "angle of the wearer's joint"),
    LogColumn(
        "joint_velocity_rad_s", "rad/s", "angular velocity of the wearer's joint",
    ),
    LogColumn("joint_torque_nm", "N m", "torque that the cables put into the joint"),
    LogColumn(
        "winding_angle_rad", "rad",
        "angle of a round pulley of the neutral arm that the cable is wound on",
    ),
    LogColumn("winding_velocity_rad_s", "rad/s", "angular velocity of that pulley"),
    LogColumn("leverage_ratio", "1", "arm of the joint over that of the pulley"),
    LogColumn("desired_torque_nm", "N m", "torque that the task asks for at the joint"),
    LogColumn("wearer_torque_nm", "N m", "torque that the wearer puts into the joint"),
    LogColumn("reference_angle_rad", "rad", "angle that the wearer aims for"),
    LogColumn("phase_sine", "1", "sine of the phase of the wearer's cycle"),
    LogColumn("phase_cosine", "1", "cosine of the phase of the wearer's cycle"),
)  # fmt: skip
"""Columns that every log has for each axis; of several they begin with its name."""

CABLE_COLUMNS = (
    LogColumn("tension_{cable}_proximal_n", "N", "tension at the motor end"),
    LogColumn("tension_{cable}_distal_n", "N", "tension at the joint end"),
    LogColumn("moving_{cable}_fraction", "1", "part of the cable that slips"),
    LogColumn("slack_{cable}_m", "m", "cable length that hangs slack"),
    LogColumn("dissipated_{cable}_j", "J", "energy lost to friction since the start"),
    LogColumn(
        "tension_{cable}_nodes_n", "N",
        "tension at the nodes, from the motor end to the joint end", True,
    ),
    LogColumn(
        "slip_{cable}_direction", "1",
        "slip of the segments: 1 towards the joint, -1 towards the motor, 0 stuck",
        True, "int8",
    ),
)  # fmt: skip
"""Columns that every log has for each cable."""


def columns_for(
    cables: Iterable[str], prefixes: Iterable[str] = ("",)
) -> tuple[LogColumn, ...]:
    """Return the columns of a log with these cables and axes, in file order."""
    axes, own = product(prefixes, AXIS_COLUMNS), product(cables, CABLE_COLUMNS)
    return (
        TIME_COLUMN,
        *(replace(column, name=prefix + column.name) for prefix, column in axes),
        POSE_COLUMN,
        *(replace(column, name=column.name.format(cable=c)) for c, column in own),
    )


def prefixes_in(names: Iterable[str]) -> tuple[str, ...]:
    """Return the beginnings of the columns of each axis among these names, in order."""
    end = AXIS_COLUMNS[0].name
    return tuple(name[: -len(end)] for name in names if name.endswith(end))


def cables_in(names: Iterable[str]) -> tuple[str, ...]:
    """Return the cables whose columns are among these names, in order."""
    start, end = CABLE_COLUMNS[-2].name.split("{cable}")
    own = [name for name in names if name.startswith(start) and name.endswith(end)]
    return tuple(name[len(start) : -len(end)] for name in own)
