"""Simulated calibration trials for hysteresis compensation, as on a bench.

    trial = calibration_trials(["endoscope"])[0]
    found = fit_hysteresis(trial, drive)

On a bench a camera, for example, measures the joint although the device has no sensor
there; the simulated trial has the joint angle too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cc_mujoco.control import DistalFeedback, HysteresisTrial
from cc_mujoco.device import Device, DeviceModel, Drive, Plant
from cc_mujoco.device._model import joint_range
from cc_mujoco.errors import CableError
from cc_mujoco.human import Loops, Position
from cc_mujoco.simulation._simulate import simulate


def calibration_trials(
    plants: Sequence[str | Path | Device | Plant], duration: float = 12.0
) -> list[HysteresisTrial]:
    """Simulate a slow motion of the joint in loops of many sizes, for each plant.

    Args:
        plants: Plants of one device with one axis, see `simulate`.
        duration: Length of the trial [s].

    Returns:
        The trial of each plant.

    Raises:
        CableError: The device has several axes, its wearer moves the joint, or a
            plant cannot be simulated.
    """
    made = [one if isinstance(one, Plant) else Plant(one) for one in plants]
    description = made[0].description
    axis = description.axis()
    if axis.limb in description.movers:
        raise CableError(
            f"a wearer moves joint {axis.limb!r} of {description.scene!r}; hysteresis "
            "is calibrated where cables and springs alone move the joint."
        )
    model = DeviceModel(description, made[0].model())
    low, high = joint_range(model.model, axis.joint)
    # The swing is 15 % beyond the reach of the device, and 5 % short of the stops.
    room = 0.95 * min(high - axis.centre, axis.centre - low)
    course = Loops(min(1.15 * axis.reach, room), axis.centre)
    sensing = dataclasses.replace(description.sensing, joint_sensor=True)
    played: Any = {"trajectory": course, "task": Position(), "duration": duration}

    def uncalibrated(drive: Drive) -> DistalFeedback:
        # Integral gain of the feedback that leads the joint through the trial [1/s]
        return DistalFeedback(dataclasses.replace(drive, hysteresis={}), gain=30.0)

    logs = simulate(made, uncalibrated, sensing=sensing, **played)
    ratio = model.axes[0].ratio
    return [
        HysteresisTrial.of(log["motor_angle_rad"], log["joint_angle_rad"], ratio)
        for log in logs
    ]
