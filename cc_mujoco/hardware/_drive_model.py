"""Knowledge of a controller about a rig: the device, one of its axes, and its drive."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from cc_mujoco.assets import SCENES
from cc_mujoco.device._derivation import known_torque_noise
from cc_mujoco.device._device import Device, bare_model, find_device
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import AxisModel, DeviceModel
from cc_mujoco.device._moment_arm import MeasuredWinding


def device_of(scene: str | Device, folder: Path) -> Device:
    """Return the device of a rig.

    Args:
        scene: Name of a built-in scene, a file (`knee.xml`, `knee.device.toml`), or the
            device itself.
        folder: That a file is relative to.

    Raises:
        CableError: There is no such scene, or it is no device.
    """
    if isinstance(scene, Device):
        return scene
    place = folder / scene
    return find_device(scene if scene in SCENES or not place.is_file() else place)


def axis_model(device: Device, axis: str | None = None) -> AxisModel:
    """Return an axis of a device on its model.

    Args:
        device: The device.
        axis: Name of the axis; the only one by default.

    Raises:
        CableError: There is no such axis, or none is named and there are several.
    """
    description = device.description
    place = description.axes.index(description.axis(axis))
    return DeviceModel(description, bare_model(device).compile()).axes[place]


def drive_of(
    scene: str | Device,
    folder: Path,
    period: float,
    torque: float,
    *,
    axis: str | None = None,
    joint_torque: float = math.inf,
    torque_rate: float = math.inf,
    motor_lag: float | None = None,
) -> Drive:
    """Return the drive of an axis of a device.

    Args:
        scene: Name of a built-in scene, a file, or a device; see `device_of`.
        folder: That a file is relative to.
        period: Of the loop [s].
        torque: Limit of the motor's, either way [N m].
        axis: Name of the axis; the only one by default.
        joint_torque: Limit of the joint's; that which is safe for the device is one
            too.
        torque_rate: Limit of its rate [N m/s].
        motor_lag: Time constant of the motor's torque [s]; that of the scene's motor by
            default.

    Returns:
        The drive, readings a period late and without tension sensors.

    Raises:
        CableError: There is no such scene or axis, or the scene is no device.
    """
    device = device_of(scene, folder)
    description = device.description
    drive = axis_model(device, axis).drive(device.cables, device.name, period)
    return dataclasses.replace(
        drive,
        low=-torque,
        high=torque,
        delay=1,
        torque_noise=known_torque_noise(description),
        safe_torque=min(drive.safe_torque, joint_torque),
        torque_rate=torque_rate,
        motor_lag=drive.motor_lag if motor_lag is None else motor_lag,
    )


def winding_of(axis: AxisModel) -> MeasuredWinding | None:
    """Return the winding of the cables by the joint, for a controller with a model.

    Returns:
        None where a round pulley does, or where joints wind the cables that a rig of
        this axis does not measure; then `Drive.crossed` names them.
    """
    if axis.winding is None:
        return None
    found = MeasuredWinding(axis.model, axis.winding)
    return found if found.joints == (axis.axis.joint,) else None
