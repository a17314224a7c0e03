"""Simulations 1 and 2: the plant without inertia, and what the claims rest on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cc_mujoco.cable import Transmission
from cc_mujoco.control import Controller, ProportionalIntegral
from thesis._experiments import simulations
from thesis._experiments.simulations import InertiaFree


class Given(Controller):
    """Torques of a recording."""

    def __init__(self, drive: Any, torques: np.ndarray) -> None:
        super().__init__(drive)
        self.torques = torques

    def reset(self, where: Any = None) -> None:
        self.rest = iter([*self.torques, 0.0])

    def torque(self, observation: Any) -> Any:
        return next(self.rest)


def test_plant_is_the_transmission_driven_by_torque_and_angle() -> None:
    drive = simulations.pull_pull()
    cable_drive = drive.cables[0]
    time = np.arange(0.0, 1.0, simulations.PERIOD)
    torque, angle = np.sin(7.0 * time), 0.2 * np.sin(3.0 * time)
    known = Transmission.pull_pull(cable_drive.cable, 0.1, 0.1).replay(
        simulations.PERIOD, motor_torque=torque, joint_angle=angle
    )
    log = InertiaFree(drive).run(Given(drive, torque[1:]), angle, torque)
    assert log["joint_torque_nm"][1:] == pytest.approx(known.joint_torque[1:], abs=1e-6)
    assert log["motor_angle_rad"][1:] == pytest.approx(known.motor_angle[1:], abs=1e-8)


def test_friction_implied_makes_the_error_that_is_printed() -> None:
    device = simulations.one_cable(simulations.TENSION_RATIO)
    own = device.cables[0].cable
    assert math.exp(own.friction * own.wrap) == pytest.approx(simulations.TENSION_RATIO)
    assert (1.0 + 1.0) / (simulations.TENSION_RATIO + 1.0) == pytest.approx(0.9)


def test_desired_tension_grows_with_a_slope_that_swings() -> None:
    time, wanted = simulations.desired_tension()
    assert wanted[-1] > wanted[0] > 0.0
    slope = np.gradient(wanted, time)
    assert slope.min() < 0.0 < slope.max()


@pytest.mark.study
def test_without_a_model_the_reversal_takes_many_degrees(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(simulations, "DEFLECTION", 0.3)  # at the same rate
    monkeypatch.setattr(simulations, "DEFLECTION_TIME", 3.0)
    _, angle = simulations.motion()
    assert angle.max() == simulations.DEFLECTION
    assert np.ptp(np.abs(np.diff(angle))) < 1e-12
    free = simulations.render(
        simulations.pull_pull(), ProportionalIntegral(simulations.pull_pull())
    )
    assert free.lost > np.radians(5.0)
