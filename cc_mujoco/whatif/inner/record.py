"""Record of a simulation for the plugin: words and addresses, in the order of `Word`.

`userdata[0]` of a simulation holds the address of its record; 0 is none, which is also
what MuJoCo makes of it when a simulation diverges.
"""

from __future__ import annotations

from enum import IntEnum, auto


class Law(IntEnum):
    """Law that drives the motor."""

    UNPOWERED = 0
    FEED_FORWARD = auto()
    FEEDBACK = auto()
    MODEL = auto()
    STICTION = auto()


class Asked(IntEnum):
    """Task that is asked of the device, see `human.tasks`."""

    OF_PHASE = 0
    TUNNEL = auto()
    SPRING = auto()


class Word(IntEnum):
    """Places in a record; an address is that of numbers or words of 8 bytes."""

    LAW = 0
    ASKED = auto()
    SKIP = auto()
    """Physics steps in a control step."""
    STEPS = auto()
    """Control steps in the episode."""
    COUNT = auto()
    """Physics steps that have been done."""
    REFUSED = auto()
    """1 where the controller gave no finite torque at the control step it stands at."""
    MOTOR_CONTROL = auto()
    SCRIPTED = auto()
    """Number of controls that follow the script."""
    SCRIPT_CONTROLS = auto()
    """Address of their places."""
    COMMANDS = auto()
    """Address of (physics steps + 1, controls)."""
    DESIRED = auto()
    """Address of what a task of the phase asks for at every control step [Nm]."""
    MOTOR_Q = auto()
    MOTOR_V = auto()
    JOINT_Q = auto()
    JOINT_V = auto()
    MOTOR_OUT = auto()
    WEARER_OUT = auto()
    CABLES = auto()
    READINGS = auto()
    """Address of five words of each cable: its first node in `plugin_state`, nodes,
    energy, and its ends in `actuator_force`."""
    WOUND = auto()
    """Number of arms of the winding, see `envs.winding`; 0 for a round pulley."""
    ARMS = auto()
    """Address of the places of the arms, then of their velocities."""
    WOUND_OWN = auto()
    NUMBERS = auto()
    """Address of the numbers of `Number`."""
    COLUMNS = auto()
    """Address of what is kept, (columns, control steps + 1)."""
    GAINS = auto()
    """Address of `laws.GAINS`; likewise the arrays of `CableModel`, those of one
    device, that follow."""
    MEMORY = auto()
    SEEN = auto()
    MODEL_CABLES = auto()
    SEGMENTS = auto()
    PROXIMAL = auto()
    DISTAL = auto()
    PACKED = auto()
    PACKED_SIZE = auto()
    STATE = auto()
    STATE_SIZE = auto()
    JOINT = auto()
    SLIP_DIRECTION = auto()
    GAIN = auto()
    ARM = auto()
    NEW = auto()
    WORK = auto()
    WORK_SIZE = auto()
    SCRATCH = auto()


class Number(IntEnum):
    """Places among the numbers of a record."""

    MOTOR_GEAR = 0
    SCALE = auto()
    """Control of the motor at its largest torque."""
    LIMIT = auto()
    """Largest torque of the motor [Nm]."""
    HALF_WIDTH = auto()
    STIFFNESS = auto()
    MOST = auto()
    """Largest torque of the task [Nm]; as those above, see `Tunnel` and `Spring`."""
    LEVERAGE_ARM = auto()
    """Leverage arm of the winding, see there [m/rad]."""
    CABLE_STIFFNESS = auto()
    """Stiffness of all cables at the joint [Nm/rad]."""


KEPT = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "motor_torque_nm",
    "joint_angle_rad",
    "joint_velocity_rad_s",
    "joint_torque_nm",
    "wearer_torque_nm",
    "desired_torque_nm",
)
"""Columns that are kept of every control step, before those of each cable: tension at
both ends, energy that friction took, least tension."""
PER_CABLE = 4
