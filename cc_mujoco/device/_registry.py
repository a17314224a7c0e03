"""Devices: one row for each, with all that its scene's file leaves out.

    DEVICES["wrist"].environment, DEVICES["wrist"].sensing

The scene defines the device: bodies, cables, motor, wearer. A row has its name, what is
measured of it, what is played on it, and how strong its parts are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cc_mujoco.assets import SCENES
from cc_mujoco.device._sensors import Sensing
from cc_mujoco.errors import CableError, look_up

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class Setup:
    """Properties that distinguish one device from another."""

    scene: str
    """Name of the scene, for `scene_path` and the command line."""
    environment: str
    """Gymnasium id."""
    meaning: str
    """Description of the device in a line."""
    joint: str
    """Joint that the cables drive and the wearer moves through `mover`."""
    reach: float
    """Largest angle of named trajectories [rad]; leaves room before the stops."""
    torque_scale: float
    """Torque error that costs a reward of 1 per second [N m]."""
    units: Mapping[str, float]
    """Observed columns by name, and the size that counts as 1; see `Observed`."""
    sensing: Sensing
    """Quality of the measurements."""
    pull_pull: bool
    """True if two cables hold each other taut, so that both slack is a failure."""
    trajectory: str
    """Default motion of the wearer."""
    task: str
    """Default task: what the wearer should feel."""
    safe_torque: float
    """Most that the cables may put into the joint of a wearer [N m]."""
    strength: float
    """Breaking load of a cable [N]."""
    diameter: float
    """Diameter of a cable [m]."""
    motor_pulley: float
    """Inertia of the motor's pulley about its axis [kg m^2]; grows as radius^4."""
    gearing: float | None = None
    """Turns of the rotor per turn of the motor's pulley; None where the scene has a
    geared motor and states no more of it."""
    joint_pulley: float = 0.0
    """Inertia of the joint's pulley [kg m^2]; 0 for a lever, which keeps its own."""
    lever: tuple[str, ...] = ()
    """Sites that move with the lever: the two ends of the free rope at the joint."""
    mover: str = "wearer"
    """Actuator by which the wearer moves the joint, as a spring and a damper."""
    companions: Mapping[str, str] = field(default_factory=dict)
    """Other joints that the wearer moves, and the actuators that do so."""
    helpers: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Other motors, which follow the gait by themselves: actuator, and its torque where
    `human.assistance` is 0 and where it is 1 [N m]."""


DEVICES = {
    "wrist": Setup(
        scene="wrist",
        environment="cc_mujoco/WristHandle-v1",
        meaning="wrist handle pulled both ways by two Bowden cables",
        joint="wrist",
        reach=1.0,
        torque_scale=1.0,
        units={
            "motor_angle_rad": 0.02,
            "motor_velocity_rad_s": 2.0,
            "joint_angle_rad": 0.5,
            "joint_velocity_rad_s": 2.0,
            "joint_torque_nm": 1.0,
            "desired_torque_nm": 1.0,
        },
        sensing=Sensing(torque_noise=0.01, tension_noise=0.3),
        pull_pull=True,
        trajectory="sweep",
        task="tunnel",
        # About the strength of a wrist (assumed).
        safe_torque=8.0,
        # The wire rope of the scene's comment: 0.15 mm^2 of metal at 1770 N/mm^2, the
        # common grade of rope wire (EN 10264-2). Its pulleys are there too.
        strength=265.0,
        diameter=0.6e-3,
        motor_pulley=1.6e-5,
        gearing=1.0,
        joint_pulley=1.1e-3,
    ),
    "ankle": Setup(
        scene="ankle",
        environment="cc_mujoco/AnkleExo-v1",
        meaning="ankle exoskeleton pulled by one Bowden cable past hip and knee",
        joint="ankle",
        reach=0.3,
        torque_scale=5.0,
        units={
            "motor_angle_rad": 0.2,
            "motor_velocity_rad_s": 2.0,
            "joint_angle_rad": 0.2,
            "joint_velocity_rad_s": 2.0,
            "joint_torque_nm": 5.0,
            "desired_torque_nm": 10.0,
            "phase_sine": 1.0,
            "phase_cosine": 1.0,
        },
        sensing=Sensing(torque_noise=0.3, tension_noise=3.0),
        pull_pull=False,
        trajectory="walk",
        task="assist",
        # Twice what `assist` demands, half the biological moment.
        safe_torque=60.0,
        # The synthetic rope and the drum of the scene's comments.
        strength=8000.0,
        diameter=3e-3,
        motor_pulley=1.5e-4,
        gearing=5.0,
        lever=("conduit_shank", "heel_lever"),
        companions={"hip": "wearer_hip", "knee": "wearer_knee"},
    ),
    "finger": Setup(
        scene="finger",
        environment="cc_mujoco/TendonFinger-v1",
        meaning="finger extended by an open tendon over post, guide and knuckle",
        joint="finger",
        reach=0.6,
        torque_scale=0.1,
        units={
            "motor_angle_rad": 0.05,
            "motor_velocity_rad_s": 2.0,
            "joint_angle_rad": 0.5,
            "joint_velocity_rad_s": 2.0,
            "joint_torque_nm": 0.1,
            "desired_torque_nm": 0.1,
        },
        sensing=Sensing(torque_noise=0.002, tension_noise=0.1),
        pull_pull=False,
        trajectory="sine",
        task="hold",
        # About a quarter of the strength of a finger (assumed).
        safe_torque=0.8,
        # Braided line of that diameter (assumed), and the drum of the scene's comment.
        strength=500.0,
        diameter=0.9e-3,
        motor_pulley=1e-6,
    ),
    "exosuit": Setup(
        scene="exosuit",
        environment="cc_mujoco/HipKneeExosuit-v1",
        meaning="soft exosuit with an open cable over hip and knee, one to the heel",
        joint="hip",
        reach=0.5,
        torque_scale=1.0,
        units={
            "motor_angle_rad": 0.5,
            "motor_velocity_rad_s": 2.0,
            "joint_angle_rad": 0.5,
            "joint_velocity_rad_s": 2.0,
            "joint_torque_nm": 1.0,
            "desired_torque_nm": 5.0,
            "phase_sine": 1.0,
            "phase_cosine": 1.0,
        },
        sensing=Sensing(torque_noise=0.1, tension_noise=1.0),
        pull_pull=False,
        trajectory="walk",
        task="swing",
        # Twice what `swing` may demand and half the biological moment.
        safe_torque=40.0,
        # Rope of that diameter (assumed), and the drum of the scene's comment.
        strength=3500.0,
        diameter=2e-3,
        motor_pulley=2e-5,
        companions={"knee": "wearer_knee", "ankle": "wearer_ankle"},
        helpers={"motor_ankle": (0.25, 8.0)},
    ),
}
"""Every device by the name of its scene."""


def find_device(name: str) -> Setup:
    """Return the row of a scene.

    Raises:
        CableError: If there is none by that name; states where a user's own file goes.
    """
    if name not in DEVICES and (name in SCENES or str(name).endswith(".xml")):
        # Devices need a wearer, sensors and safe limits, which no MJCF file defines.
        what = "That scene" if name in SCENES else "A file of your own"
        raise CableError(
            f"{CableError.unknown('device', name, DEVICES)} {what} tells of no wearer, "
            "no sensors; it is for MuJoCo itself, `cc-mujoco diagnose` and `cc-mujoco "
            "run`."
        )
    return look_up("scene", name, DEVICES)


def motor_lag(model: mujoco.MjModel, actuator: int) -> float:
    """Return the time constant of a motor's torque behind its control [s].

    Args:
        model: A scene.
        actuator: Index of the motor; one of `dyntype` filter or filterexact lags.
    """
    import mujoco

    filters = mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT
    if int(model.actuator_dyntype[actuator]) not in map(int, filters):
        return 0.0
    return float(model.actuator_dynprm[actuator, 0])
