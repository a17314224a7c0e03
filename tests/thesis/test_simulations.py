"""Simulations 1 and 2: the plant without inertia, and what the claims rest on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.cable import Transmission
from cc_mujoco.control import ProportionalIntegral
from thesis._experiments import spring, tracking
from thesis._inertia_free import InertiaFree


def test_plant_is_the_transmission_driven_by_torque_and_angle() -> None:
    drive = spring.drive()
    cable_drive = drive.cables[0]
    time = np.arange(0.0, 1.0, tracking.PERIOD)
    torque, angle = np.sin(7.0 * time), 0.2 * np.sin(3.0 * time)
    known = Transmission.pull_pull(cable_drive.cable, 0.1, 0.1).replay(
        tracking.PERIOD, motor_torque=torque, joint_angle=angle
    )
    device = InertiaFree(drive)
    for i in range(time.size):
        device.step(float(torque[i]), float(angle[i]))
        assert device.motor_torque == pytest.approx(torque[i], abs=1e-7)
        assert device.joint_torque == pytest.approx(known.joint_torque[i], abs=1e-6)
        assert device.motor_angle == pytest.approx(known.motor_angle[i], abs=1e-8)


def test_friction_implied_makes_the_error_that_is_printed() -> None:
    device = tracking.drive(tracking.TENSION_RATIO)
    own = device.cables[0].cable
    assert math.exp(own.friction * own.wrap) == pytest.approx(tracking.TENSION_RATIO)
    assert (1.0 + 1.0) / (tracking.TENSION_RATIO + 1.0) == pytest.approx(0.9)


def test_desired_tension_grows_with_a_slope_that_swings() -> None:
    time, wanted = tracking.desired_tension()
    assert wanted[-1] > wanted[0] > 0.0
    slope = np.gradient(wanted, time)
    assert slope.min() < 0.0 < slope.max()


@pytest.mark.study
def test_without_a_model_the_reversal_takes_many_degrees(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spring, "DEFLECTION", 0.3)  # at the same rate
    monkeypatch.setattr(spring, "DEFLECTION_TIME", 3.0)
    time, angle = spring.motion()
    assert angle.max() == spring.DEFLECTION
    assert np.ptp(np.abs(np.diff(angle))) < 1e-12
    free = spring.render(spring.drive(), ProportionalIntegral(spring.drive()))
    assert free.lost > np.radians(5.0)
    assert free.torque.shape == time.shape
