"""Knowledge of a controller about a rig: its scene's drive, at the loop's period."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

from cc_mujoco.assets import SCENES, scene_path
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._registry import DEVICES, motor_lag
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._limits import Limits


def drive_of(
    scene: str,
    folder: Path,
    period: float,
    torque: float,
    *,
    joint_torque: float = math.inf,
    torque_rate: float = math.inf,
    motor_lag: float | None = None,
) -> Drive:
    """Return the drive of a scene.

    Args:
        scene: Name of a device or of the bench, or a file such as a diagnosis takes.
        folder: That a file is relative to.
        period: Of the loop [s].
        torque: Limit of the motor's, either way [N m].
        joint_torque: Limit of the joint's; of a device, that which is safe is one too.
        torque_rate: Limit of its rate [N m/s].
        motor_lag: Time constant of the motor's torque [s]; that of the scene's motor by
            default.

    Returns:
        The drive, readings a period late and without tension sensors.

    Raises:
        CableError: There is no such scene, or it is not one that has such a drive.
    """
    if scene in DEVICES:
        import gymnasium

        identity = DEVICES[scene].environment
        env = gymnasium.make(identity, disable_env_checker=True)
        inner: Any = env.unwrapped
        drive: Drive = inner.exo.device.drive(period)
        # No rig measures `device.WINDING_COLUMNS`; `run` warns of a lever.
        drive = dataclasses.replace(drive, lever=False)
        env.close()
    else:
        path = scene_path(scene) if scene in SCENES else folder / scene
        if not path.is_file():
            raise CableError.unknown("scene", scene, SCENES)
        drive = bench_drive(path, period)
    return dataclasses.replace(
        drive,
        low=-torque,
        high=torque,
        period=period,
        sensors=(),
        delay=1,
        safe_torque=min(drive.safe_torque, joint_torque),
        torque_rate=torque_rate,
        motor_lag=drive.motor_lag if motor_lag is None else motor_lag,
    )


def require_tension_limit(scene: str, limits: Limits) -> None:
    """Require a possible limit of the tension.

    Raises:
        CableError: The cable pulls a lever, whose arm changes with its angle.
    """
    if math.isfinite(limits.tension) and scene in DEVICES and DEVICES[scene].lever:
        raise CableError(
            f"[limits] tension cannot be kept with scene {scene}: its cable pulls a "
            "lever, whose arm changes with the angle, and the model is of a round "
            "pulley; leave it out."
        )


def bench_drive(path: Path, period: float) -> Drive:
    """Return the drive of a scene: one cable or a pair on pulleys, torques up to 1 N m.

    Args:
        path: Of the scene.
        period: Of the loop [s].

    Raises:
        CableError: It has other cables, or one that pulls a lever.
    """
    import mujoco

    bench = Bench.of(path)
    if bench.lever is not None:
        raise CableError(
            f"scene {path}: its cable pulls a lever; give the name of the device, or a "
            "scene whose cables run on pulleys."
        )
    model = mujoco.MjModel.from_xml_path(str(path))
    motor, joint = (
        int(model.joint(name).dofadr[0]) for name in (bench.motor, bench.joint)
    )
    # The agonist's displacements fall where motor and joint turn positive.
    sides = (-1.0, 1.0)[: len(bench.cables)]
    cables = tuple(
        CableDrive(cable, side * bench.motor_radius, side * bench.joint_radius)
        for cable, side in zip(bench.cables, sides, strict=True)
    )
    return Drive(
        bench.joint_radius / bench.motor_radius,
        -1.0,
        1.0,
        period,
        one_way=len(cables) == 1,
        cable_drives=(cables,),
        inertia=float(model.dof_M0[motor]),
        damping=float(model.dof_damping[motor]),
        joint_inertia=float(model.dof_M0[joint]),
        motor_lag=max(
            (
                motor_lag(model, k)
                for k in range(model.nu)
                if int(model.actuator_trntype[k]) == int(mujoco.mjtTrn.mjTRN_JOINT)
                and model.actuator_trnid[k, 0] == model.joint(bench.motor).id
            ),
            default=0.0,
        ),
    )
