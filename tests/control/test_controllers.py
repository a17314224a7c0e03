"""The controllers: their formulas, what they read, scalars and arrays, anti-windup."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from cc_mujoco.cable import Cable, Section
from cc_mujoco.control import (
    CONTROLLERS,
    Controller,
    ProportionalIntegral,
    as_round_pulley,
    controller,
)
from cc_mujoco.device import TENSION_COLUMN, CableDrive, Drive, Sensors
from cc_mujoco.device._sensors import MEASURED_COLUMNS, WINDING_COLUMNS
from cc_mujoco.errors import CableError

CABLE = Cable(friction=0.1, segments=8, conduit=(Section(1.0, 0.3),))
SENSORS = Sensors((0, 4, 8), (0.2, 0.2, 0.2))
PAIR = (CableDrive(CABLE, -0.02, -0.104), CableDrive(CABLE, 0.02, 0.104))
WRIST = Drive(
    5.2,
    -1.0,
    1.0,
    0.001,
    cables=PAIR,
    sensors=(SENSORS, SENSORS),
    inertia=7e-5,
    delay=1,
    torque_noise=0.01,
)
ANKLE = Drive(
    ratio=-4.8,
    low=-50.0,
    high=50.0,
    period=0.001,
    one_way=True,
    cables=(CableDrive(CABLE.replace(axial_stiffness=6e4), -0.025, 0.12),),
    sensors=(SENSORS,),
    inertia=5.65e-3,
    torque_noise=0.3,
)


def reading(desired: Any, torque: Any, drive: Drive = WRIST) -> dict[str, Any]:
    """Everything that may be measured, and nothing else."""
    everything: dict[str, Any] = dict.fromkeys(MEASURED_COLUMNS, 0.0 * desired)
    shape = (*np.shape(desired), len(drive.cables), 3)
    tension = 10.0 + 0.5 * np.sin(np.asarray(desired))[..., None, None] * np.ones(shape)
    everything |= {"motor_angle_rad": 0.05 * desired, TENSION_COLUMN: tension}
    return everything | {"desired_torque_nm": desired, "joint_torque_nm": torque}


def test_none_is_the_desired_torque_through_the_ideal_ratio() -> None:
    law = controller("none", WRIST)
    assert law.torque(reading(2.6, 99.0)) == 0.5
    assert law.torque(reading(-26.0, 99.0)) == -1.0
    assert controller("none", ANKLE).torque(reading(-48.0, 0.0)) == 10.0


def test_pi_follows_its_formula_step_by_step() -> None:
    law = ProportionalIntegral(WRIST, proportional=0.5, integral=3.0)
    integral = 0.0
    for step in range(50):
        desired, torque = math.sin(step / 9), math.sin(step / 9 - 0.4)
        error = desired - torque
        integral += 3.0 * 0.001 * error
        expected = (desired + 0.5 * error + integral) / 5.2
        assert law.torque(reading(desired, torque)) == pytest.approx(
            expected, rel=1e-12
        )


def test_the_default_gains_are_those_of_the_thesis() -> None:
    law = ProportionalIntegral(WRIST)
    assert (law.proportional, law.integral, law.feed_forward) == (1.0, 2.0, True)


def test_feed_forward_can_be_left_out() -> None:
    law = ProportionalIntegral(WRIST, feed_forward=False)
    assert law.torque(reading(2.0, 2.0)) == 0.0
    assert ProportionalIntegral(WRIST).torque(reading(2.0, 2.0)) == 2.0 / 5.2


def test_the_integral_removes_a_constant_loss() -> None:
    law = ProportionalIntegral(WRIST)
    torque = 0.0
    for _ in range(20_000):  # 20 s with a plant that delivers 60 %
        torque = 0.6 * 5.2 * law.torque(reading(1.0, torque))
    assert torque == pytest.approx(1.0, rel=1e-3)


def test_reset_forgets() -> None:
    law = controller("pi", WRIST)
    fresh = law.torque(reading(0.3, 0.1))
    for _ in range(10):
        assert law.torque(reading(0.3, 0.1)) > fresh
    law.reset()
    assert law.torque(reading(0.3, 0.1)) == fresh


def test_the_integral_does_not_wind_up_at_a_limit() -> None:
    law = ProportionalIntegral(WRIST)
    for _ in range(5_000):
        assert law.torque(reading(50.0, 0.0)) == 1.0
    # As soon as the error turns, the torque leaves the limit.
    assert law.torque(reading(0.0, 1.0)) < 0.0


def test_where_cables_only_pull_the_integral_pays_nothing_out() -> None:
    law = ProportionalIntegral(ANKLE)
    for _ in range(5_000):
        law.torque(reading(0.0, -2.0))
    assert law.torque(reading(-10.0, -10.0)) == 10.0 / 4.8


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("drive", [WRIST, ANKLE])
def test_scalars_and_arrays_give_the_same_bits(name: str, drive: Drive) -> None:
    random = np.random.default_rng(1)
    desired, torque = random.normal(scale=4.0, size=(2, 80, 5))
    many = controller(name, drive)
    single = [controller(name, drive) for _ in range(5)]
    for step in range(80):
        if step == 40:
            where = np.array([True, False, False, True, False])
            many.reset(where)
            for law, ended in zip(single, where, strict=True):
                if ended:
                    law.reset()
        together = many.torque(reading(desired[step], torque[step], drive))
        apart = [
            law.torque(reading(float(desired[step, i]), float(torque[step, i]), drive))
            for i, law in enumerate(single)
        ]
        assert all(type(value) is float for value in apart)
        assert np.array_equal(together, apart)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_is_made_from_a_drive_and_documented(name: str) -> None:
    law = CONTROLLERS[name](WRIST)
    assert isinstance(law, Controller)
    assert type(law).__doc__


def test_unknown_names_are_refused_with_the_nearest() -> None:
    with pytest.raises(CableError, match=r"did you mean 'pi'\?"):
        controller("pid", WRIST)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("ratio", 0.0),
        ("ratio", math.nan),
        ("low", 1.0),
        ("high", math.nan),
        ("period", 0.0),
        ("period", math.inf),
        ("motor_lag", -1e-3),
        ("motor_lag", 3.0),
        ("motor_lag", math.nan),
        ("torque_rate", 0.0),
        ("torque_rate", math.nan),
    ],
)
def test_a_drive_that_cannot_be_is_refused(field: str, value: float) -> None:
    given = {"ratio": 5.2, "low": -1.0, "high": 1.0, "period": 0.001, field: value}
    with pytest.raises(CableError, match="Drive"):
        Drive(**given)


@pytest.mark.parametrize("gain", [-1.0, math.nan, math.inf])
def test_gains_that_cannot_be_are_refused(gain: float) -> None:
    with pytest.raises(CableError, match="proportional"):
        ProportionalIntegral(WRIST, proportional=gain)
    with pytest.raises(CableError, match="integral"):
        ProportionalIntegral(WRIST, integral=gain)


def test_a_lever_is_not_taken_for_a_pulley() -> None:
    """Refuse one that its drive declares where nobody measures its arm."""
    seen = dict.fromkeys(MEASURED_COLUMNS, 0.1)
    drive = dataclasses.replace(ANKLE, lever=True)
    assert as_round_pulley(seen, ANKLE) is seen
    with pytest.raises(CableError, match="pull a lever, whose arm changes"):
        as_round_pulley(seen, drive)
    told = as_round_pulley({**seen, **dict.fromkeys(WINDING_COLUMNS, 2.0)}, drive)
    assert told["joint_torque_nm"] == 0.05
