"""The model in a controller follows a device that it cannot see into."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cc_mujoco.cable import Transmission
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.control import CableModel
from cc_mujoco.control._cable_model import pack
from cc_mujoco.device import CableDrive, Drive
from cc_mujoco.errors import CableError
from control.devices import cable, pull_pull, single, there_and_back

PERIOD = 0.001


def test_motor_angle_and_joint_torque_tell_everything_of_a_pull_pull_pair() -> None:
    angle = there_and_back()
    torque = 1.2 * np.sin(np.arange(angle.size) / 700.0)
    plant = Transmission.pull_pull(cable(), 0.1, 0.1)
    truth = plant.replay(PERIOD, motor_torque=torque, joint_angle=angle)
    model = CableModel(pull_pull())
    worst = np.zeros(2)
    for i in range(angle.size):
        model.follow(truth.motor_angle[i], truth.joint_torque[i])
        found = np.array([model.joint[0], model.motor_torque()[0]])
        known = [truth.joint_angle[i], truth.motor_torque[i]]
        worst = np.maximum(worst, np.abs(found - known))
    assert worst[0] < 1e-6
    assert worst[1] < 1e-4
    for k in range(2):
        assert model.tension(k)[0, 0] == pytest.approx(
            truth.tension_proximal[k, -1], rel=1e-4
        )


def test_a_pulley_that_is_not_round_is_known_to_the_model() -> None:
    own = cable().replace(eccentricity=2e-3, eccentricity_phase=0.6, ovality=5e-4)
    angle = there_and_back()
    plant = Transmission.pull_pull(own, 0.02, 0.1)
    motor = 5.0 * angle + 0.1 * np.sin(np.arange(angle.size) / 300.0)
    truth = plant.replay(PERIOD, motor_angle=motor, joint_angle=angle)
    pair = (CableDrive(own, -0.02, -0.1), CableDrive(own, 0.02, 0.1))
    model = CableModel(dataclasses.replace(pull_pull(), cables=pair))
    found = np.empty(angle.size)
    for i in range(angle.size):
        model.follow(motor[i], truth.joint_torque[i])
        found[i] = model.motor_torque()[0]
    assert np.abs(model.joint[0] - (angle[-1] - angle[0])) < 1e-6
    assert np.abs(found - truth.motor_torque).max() < 1e-4
    assert np.ptp(truth.motor_torque) > 0.1


@pytest.mark.parametrize("bristle_length", [0.0, 1e-3])
def test_friction_that_falls_is_left_out_of_a_cable_without_weakening(
    bristle_length: float,
) -> None:
    plain = cable().replace(bristle_length=bristle_length)
    falls = plain.replace(
        static_friction=1.5 * plain.friction if bristle_length else 0.0,
        critical_slip_distance=1e-3,
        stribeck_friction=0.1,
        ageing_friction=0.1,
    )
    packed = []
    for own, weakening in ((plain, True), (falls, False), (falls, True)):
        values, conduit = np.array(own.scalars), np.array(own.conduit, float)
        prm = np.zeros(kernel.parameter_size(own.segments))
        pack(values, conduit, own.segments, 1.0, weakening, np.empty_like(values), prm)
        packed.append(prm.tolist())
    assert packed[0] == packed[1] != packed[2]


def test_gain_is_that_of_the_capstan_and_stays_during_partial_motion() -> None:
    plant = Transmission.single(cable(), 1.0, 1.0)
    time = np.arange(0.0, 1.2, PERIOD)
    pulled = np.where(time < 1.0, 0.02 * time, 0.04 - 0.02 * time)
    drawn = plant.replay(
        PERIOD, motor_angle=pulled, joint_torque=np.full(time.size, 15.0)
    )
    model = CableModel(single())
    for i in range(time.size):
        model.follow(pulled[i], drawn.joint_torque[i])
        if i == 999:
            assert model.slip_direction[0, 0] == -1.0
            assert model.gain[0, 0] == pytest.approx(np.exp(0.3), rel=1e-9)
        if i == 1002:  # turned back: part of the cable has not noticed
            assert np.any(model.slip(0) == 0)
            assert model.slip_direction[0, 0] == -1.0
    assert model.slip_direction[0, 0] == 1.0
    assert model.gain[0, 0] == pytest.approx(np.exp(-0.3), rel=1e-9)


def test_only_the_environments_that_start_anew_forget() -> None:
    model = CableModel(single())
    for pulled in np.linspace(0.0, 0.05, 200):
        model.follow(np.full(2, pulled), np.full(2, 12.0))
    model.reset(np.array([True, False]))
    model.follow(np.full(2, 0.05), np.full(2, 12.0))
    assert model.tension(0)[0] == pytest.approx(12.0)
    assert model.tension(0)[1, 0] == pytest.approx(12.0 * np.exp(0.3))


def test_a_drive_without_cables_is_refused() -> None:
    with pytest.raises(CableError, match="needs to know the cables"):
        CableModel(Drive(1.0, -1.0, 1.0, 0.001))
