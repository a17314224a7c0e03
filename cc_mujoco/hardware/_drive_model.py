"""Model of a rig that its controller has: the device, an axis of it, its drive."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

from cc_mujoco.assets import SCENES
from cc_mujoco.device._derivation import known_torque_noise
from cc_mujoco.device._device import Device, find_device
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import AxisModel, DeviceModel
from cc_mujoco.device._moment_arm import MeasuredWinding


def device_of(scene: str | Device, folder: Path) -> Device:
    """Return the device: a built-in name, a file relative to `folder`, or itself."""
    if isinstance(scene, Device):
        return scene
    place = folder / scene
    return find_device(scene if scene in SCENES or not place.is_file() else place)


def axis_model(device: Device, axis: str | None = None) -> AxisModel:
    """Return an axis of a device on its compiled model; a single axis needs no name."""
    description = device.description
    place = description.axes.index(description.axis(axis))
    return DeviceModel.of(device).axes[place]


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
    """Return the drive of an axis on a rig, without tension sensors.

    The delay of its measurements is one period.

    Args:
        scene: Device, see `device_of`.
        folder: Folder that a file is relative to.
        period: Period of the loop [s].
        torque: Limit of the absolute motor torque [N m].
        axis: Name of the axis; a single axis needs none.
        joint_torque: Limit of the joint torque [N m], besides the device's safe one.
        torque_rate: Limit of the motor torque's rate [N m/s].
        motor_lag: Time constant of the motor torque [s]; by default the scene's.
    """
    device = device_of(scene, folder)
    drive = axis_model(device, axis).drive(device.cables, device.name, period)
    return dataclasses.replace(
        drive,
        low=-torque,
        high=torque,
        delay=1,
        torque_noise=known_torque_noise(device.description),
        safe_torque=min(drive.safe_torque, joint_torque),
        torque_rate=torque_rate,
        motor_lag=drive.motor_lag if motor_lag is None else motor_lag,
    )


class Windings:
    """Winding angles of cables without round pulleys, from the measured joints."""

    def __init__(self, axes: Sequence[AxisModel]) -> None:
        """Find the joints that move the distal end of the cable of each axis."""
        measured = {axis.axis.joint: place for place, axis in enumerate(axes)}
        self._windings: list[tuple[MeasuredWinding, list[int]] | None] = []
        self.unmeasured: list[tuple[str, ...]] = []
        """Joints that wind the cables of each axis and that the rig does not measure.
        Controllers with a model cannot drive such an axis."""
        for axis in axes:
            winding = axis.winding
            found = None if winding is None else MeasuredWinding(axis.model, winding)
            joints = () if found is None else found.joints
            missing = tuple(joint for joint in joints if joint not in measured)
            self.unmeasured.append(missing)
            places = [measured[joint] for joint in joints if not missing]
            self._windings.append((found, places) if found and not missing else None)

    def read(
        self, angles: Sequence[float], velocities: Sequence[float]
    ) -> list[dict[str, float]]:
        """Return each axis's `WINDING_COLUMNS`, {} on a round pulley or if unknown."""
        found: list[dict[str, float]] = [{} for _ in self._windings]
        for own, each in zip(found, self._windings, strict=True):
            if each is not None:
                winding, joints = each
                seen = [angles[k] for k in joints], [velocities[k] for k in joints]
                own.update(winding.read(*seen))
        return found
