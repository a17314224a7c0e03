"""Controllers with a model: friction taken over, stiction crossed, errors corrected."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.control import (
    Controller,
    DisturbanceObserver,
    FusedFeedback,
    ModelBased,
    ProportionalIntegral,
    StictionCompensation,
)
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control._controller import motor_limits
from cc_mujoco.control._law_steps import model_memory
from cc_mujoco.device import MEASURED_COLUMNS, TENSION_COLUMN, Drive, Sensors
from cc_mujoco.errors import CableError, CableWarning
from control.devices import growth, pull_pull, single, there_and_back
from study_marks import study_but
from thesis._experiments.simulations import InertiaFree


def errors(drive: Drive, law: Controller, angle: Any, desired: Any) -> Any:
    """Error of the joint torque in every sample [N m]."""
    log = InertiaFree(drive).run(law, angle, desired)
    return log["joint_torque_nm"] - desired


@given(friction=st.floats(0.02, 0.4), level=st.floats(15.0, 60.0))
@settings(max_examples=3)
def test_feed_forward_alone_is_right_once_the_cable_moves(
    friction: float, level: float
) -> None:
    drive = single(friction)
    law = ModelBased(drive, proportional=0.0, integral=0.0, settling=0.0)
    device, desired = InertiaFree(drive), np.full(1500, level)
    log = device.run(law, 0.1 * np.arange(1500) / 1000.0, desired)
    assert model_memory(law._memory[0], law._shape).direction[0] == -1.0
    assert log["joint_torque_nm"][-1] == pytest.approx(level, rel=1e-6)
    assert log["motor_torque_nm"][-1] == pytest.approx(
        level * growth(friction), rel=1e-6
    )


def test_wrong_friction_leaves_the_error_that_the_capstan_law_says() -> None:
    drive, desired = single(0.2), np.full(1000, 30.0)
    angle = 0.4 * np.arange(1000) / 1000.0
    for mismatch in (-0.3, 0.1):
        law = ModelBased(drive, 0.0, 0.0, mismatch=mismatch, settling=0.0)
        error = errors(drive, law, angle, desired)[-1]
        assert error == pytest.approx(30.0 * (growth(0.2 * mismatch) - 1.0), rel=1e-6)


def test_mismatch_may_vary_with_time() -> None:
    drive, desired = single(0.2), np.full(3000, 30.0)
    angle = 0.2 * np.arange(3000) / 1000.0
    law = ModelBased(
        drive, 0.0, 0.0, mismatch=lambda time: 0.1 * np.cos(time), settling=0.0
    )
    error = errors(drive, law, angle, desired)[2000:]
    expected = 30.0 * (growth(0.2 * 0.1 * np.cos(np.arange(2000, 3000) / 1000.0)) - 1)
    assert error == pytest.approx(expected, abs=0.01)


def test_moving_joint_is_tracked_far_better_than_without_a_model() -> None:
    drive, angle = pull_pull(), there_and_back(2.0)
    moving = (np.arange(angle.size) % 1000) > 500
    plain = errors(drive, ProportionalIntegral(drive), angle, -angle)[moving]
    model = errors(drive, ModelBased(drive, settling=0.0), angle, -angle)[moving]
    assert np.std(model) < 0.2 * np.std(plain)
    assert np.max(np.abs(model)) < 0.2 * np.max(np.abs(plain))


def test_stiction_compensation_crosses_a_reversal_at_once() -> None:
    drive, angle = pull_pull(), there_and_back()[:2400]
    after = slice(2000, 2400)
    lasting = []
    for kind in (ModelBased, StictionCompensation):
        law = kind(drive, settling=0.0)
        error = np.abs(errors(drive, law, angle, -angle)[after])
        lasting.append(int(np.flatnonzero(error > 0.02)[-1]) + 1)
    assert lasting[1] <= 20
    assert lasting[0] > 2 * lasting[1]


@pytest.mark.parametrize(
    ("left", "term"),
    study_but(
        3,
        [
            (0.2, {"viscous_friction": 4.0}),
            (0.2, {"grease_drag": 1.0}),
            (0.2, {"load_independent_friction": 0.5}),
            # Friction that falls with speed makes a device without inertia jump.
            (0.7, {"stribeck_friction": 0.1, "stribeck_speed": 0.05}),
            (0.2, {"friction_asymmetry": 0.3}),
            (0.2, {"tension_exponent": -0.3}),
            (0.2, {"wrap_growth": 10.0}),
            (0.2, {"friction_drift": 0.2}),
        ],
    ),
    ids=lambda given: next(iter(given)) if isinstance(given, dict) else "",
)
def test_stiction_compensation_takes_over_every_friction_that_it_knows(
    left: float, term: dict[str, float]
) -> None:
    plain, angle = pull_pull(), there_and_back(2.0)
    row = tuple(
        dataclasses.replace(drawn, cable=drawn.cable.replace(**term))
        for drawn in plain.cables
    )
    drive = dataclasses.replace(plain, cables=row)
    moving = (np.arange(angle.size) % 1000) > 300
    unaware, aware = (
        errors(drive, law, angle, -angle)[moving]
        for law in (
            StictionCompensation(believed, 0.0, 0.0, settling=0.0)
            for believed in (plain, drive)
        )
    )
    assert np.sqrt(np.mean(aware**2)) < left * np.sqrt(np.mean(unaware**2))


@given(inertia=st.floats(1e-6, 1.0), period=st.sampled_from((5e-4, 1e-3, 2e-3)))
@settings(max_examples=20)
def test_a_motor_is_not_damped_more_than_the_period_allows(
    inertia: float, period: float
) -> None:
    """A damper felt a period late is unstable beyond inertia over period.

    One that answers a quarter of a swing late drives the swing, and is off.
    """
    drive = dataclasses.replace(pull_pull(), inertia=inertia, period=period)
    law = ModelBased(drive)
    damping = law.settling * float(law.spring[guard.STIFFNESS])
    calms = guard.damper_share(motor_limits(drive), law.spring) > 0.0
    assert (law.settling > 0.0) == calms
    assert law.settling <= 0.03
    assert damping * period / inertia <= 0.8 + 1e-9
    assert law.gains["settling"] == law.settling


def test_disturbance_observer_takes_back_friction_that_the_model_lacks() -> None:
    drive, believed = single(0.2), single(0.14)
    angle, desired = 0.2 * np.arange(3000) / 1000.0, np.full(3000, 30.0)
    without = ModelBased(believed, 0.0, 0.0, settling=0.0)
    law = DisturbanceObserver(believed, 0.0, 0.0, settling=0.0)
    assert abs(errors(drive, without, angle, desired)[-1]) > 4.0
    assert abs(errors(drive, law, angle, desired)[-1]) < 0.01


class Sensed(Controller):
    """A controller of a device whose tension sensors are added to what is measured."""

    def __init__(self, law: Controller, device: InertiaFree, noise: float) -> None:
        super().__init__(law.drive)
        self.law, self.device, self.noise = law, device, noise
        self.random = np.random.default_rng(0)

    def reset(self, where: Any = None) -> None:
        self.law.reset(where)

    def torque(self, observation: Any) -> Any:
        nodes = list(self.law.drive.sensors[0].nodes)
        told = [
            self.device.tension(k)[nodes] for k in range(len(self.law.drive.cables))
        ]
        noisy = np.array(told) + self.noise * self.random.normal(size=(len(told), 3))
        return self.law.torque({**observation, TENSION_COLUMN: noisy})


def sensed(drive: Drive, deviation: float) -> Drive:
    sensors = Sensors((0, 5, 10), (deviation,) * 3)
    return dataclasses.replace(drive, sensors=(sensors,) * len(drive.cables))


def test_fused_feedback_needs_no_joint_torque_sensor() -> None:
    drive = sensed(pull_pull(), 0.3)
    device, angle = InertiaFree(drive), there_and_back()
    log = device.run(Sensed(FusedFeedback(drive), device, 0.3), angle, -angle)
    usual = InertiaFree(drive).run(ProportionalIntegral(drive), angle, -angle)
    late = slice(1000, None)
    found, known = log["joint_torque_nm"][late], usual["joint_torque_nm"][late]
    # A single sensor on each of two pulleys of 0.1 m has an error of 0.042 N m.
    assert np.sqrt(np.mean((found - known) ** 2)) < 0.035
    broken = Sensed(FusedFeedback(drive), device, 0.3).law
    with pytest.raises(CableError, match="tension sensors"):
        device.run(broken, angle, -angle)


def test_sensors_that_are_not_there_are_asked_for() -> None:
    with pytest.raises(CableError, match="tension sensors along every cable"):
        FusedFeedback(pull_pull())


def test_bad_parameters_are_refused() -> None:
    drive = pull_pull()
    with pytest.raises(CableError, match="mismatch"):
        ModelBased(drive, mismatch=-1.5)
    with pytest.raises(CableError, match="settling"):
        ModelBased(drive, settling=-1.0)
    with pytest.raises(CableError, match="tolerance"):
        StictionCompensation(drive, tolerance=-1.0)
    with pytest.raises(CableError, match="cutoff"):
        DisturbanceObserver(drive, cutoff=0.0)


def test_laws_take_soft_ends_for_the_spring_of_their_largest_torque() -> None:
    """500 N at an arm of 1 m; without friction the stretch has a closed form."""
    hard = single()
    more = {"end_compliance": 2e-4, "end_hardening": 0.01, "end_loss": 0.4}
    own = hard.cables[0].cable
    suited = dataclasses.replace(
        hard, cables=(dataclasses.replace(hard.cables[0], cable=own.replace(**more)),)
    )
    stretch = 500.0 * own.length / own.axial_stiffness
    assert ModelBased(hard).spring[guard.STIFFNESS] == pytest.approx(500.0 / stretch)
    stretch += 2e-4 / 0.01 * np.log(1.0 + 0.01 * 500.0)
    law = ModelBased(suited)
    assert law.spring[guard.STIFFNESS] == pytest.approx(500.0 / stretch)
    law.torque(dict.fromkeys(MEASURED_COLUMNS, 0.0))  # which the compiled law computes
    kept = law._memory[0, law_steps.SPRING + guard.STIFFNESS]
    assert kept == law.spring[guard.STIFFNESS]


def test_a_law_warns_of_clearance_that_makes_its_cables_soft() -> None:
    taut = pull_pull()
    play = {"clearance": 5e-3, "seating_tension": 5.0, "axial_stiffness": 4e4}
    wide = [
        dataclasses.replace(drawn, cable=drawn.cable.replace(**play))
        for drawn in taut.cables
    ]
    with pytest.warns(CableWarning, match="overrate its tension .* of 200 N"):
        ModelBased(dataclasses.replace(taut, cables=tuple(wide)))
