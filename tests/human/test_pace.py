"""Walking at another speed, and that nothing changes at the measured one."""

from __future__ import annotations

import doctest
import importlib
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.errors import CableError
from cc_mujoco.human import GAIT_ANGLES, GAIT_PERIOD, TASKS, Pace, Paced, Walk
from cc_mujoco.human._motion import minimum_jerk
from cc_mujoco.human._pace import (
    MAX_SPEED,
    MEASURED_SPEED,
    MIN_SPEED,
    TOE_OFF,
    WEARER_HEIGHT,
)

PHASE = np.linspace(0.0, 1.0, 2001)
SPEEDS = st.floats(MIN_SPEED, MAX_SPEED)
# Bovi et al. 2011, adults: speed over height, stride time, stance, ranges of motion of
# hip, knee and ankle.
ADULTS = [
    (0.4926, 1.389, 65.36, 39.15, 59.03, 32.41),
    (0.6979, 1.098, 62.67, 42.74, 60.60, 32.16),
    (0.8733, 0.978, 61.71, 46.64, 62.05, 35.56),
]


def test_the_walk_is_bit_for_bit_the_measured_one() -> None:
    time = np.arange(8001) * 5e-4
    motion = Walk().sample(4.0, 5e-4, np.random.default_rng(0))
    step = minimum_jerk(time / 1.0)
    cycles = step.integral * 1.0 / GAIT_PERIOD
    rate, acceleration = step.value / GAIT_PERIOD, step.rate / 1.0 / GAIT_PERIOD
    phase = np.mod(cycles, 1.0)
    assert np.array_equal(motion.phase, phase)
    for name, profile in GAIT_ANGLES.items():
        slope = profile.derivative()
        bend = slope.derivative()
        joint = motion.companions[name]
        assert np.array_equal(joint.angle, profile(phase))
        assert np.array_equal(joint.velocity, slope(phase) * rate)
        expected = bend(phase) * rate**2 + slope(phase) * acceleration
        assert np.array_equal(joint.acceleration, expected)
    assert Walk.at(MEASURED_SPEED) == Walk()


def test_between_two_classes_numbers_have_the_ratio_of_the_source() -> None:
    for one, other in itertools.pairwise(ADULTS):
        slow, quick = Pace(one[0] * WEARER_HEIGHT), Pace(other[0] * WEARER_HEIGHT)
        found = [
            quick.stride / slow.stride,
            quick.toe_off / slow.toe_off,
            *(quick.excursion(j) / slow.excursion(j) for j in ("hip", "knee", "ankle")),
        ]
        expected = np.divide(other[1:], one[1:])
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_adults_have_the_stride_time_of_the_measured_walk_at_its_speed() -> None:
    speed, stride = ADULTS[1][:2]
    there = Walk.at(speed * WEARER_HEIGHT)
    assert there.period == pytest.approx(stride, rel=0.005)


@given(SPEEDS)
def test_heel_strikes_stay_and_toe_off_moves(speed: float) -> None:
    pace = Pace(speed)
    found = pace.phase(PHASE)
    assert found[0] == 0.0 and found[-1] == pytest.approx(1.0, abs=1e-15)
    assert np.all(np.diff(found) > 0.0)
    assert pace.phase(pace.toe_off) == pytest.approx(TOE_OFF)
    assert found[::50].tolist() == [pace.phase(float(p)) for p in PHASE[::50]]
    for value, rate in ((pace.phase, pace.slope), (pace.slope, pace.bend)):
        slope = np.gradient(value(PHASE), PHASE)[1:-1]
        np.testing.assert_allclose(slope, rate(PHASE)[1:-1], atol=1e-5)


@given(SPEEDS)
def test_velocity_and_acceleration_are_derivatives(speed: float) -> None:
    walk = Walk.at(speed)
    motion = walk.sample(3.0, 1e-3, np.random.default_rng(0))
    assert walk.period == GAIT_PERIOD * Pace(speed).stride
    for name in GAIT_ANGLES:
        joint = motion.companions[name]
        scale = np.abs(joint.velocity).max()
        rate = np.gradient(joint.angle, 1e-3)[1:-1]
        np.testing.assert_allclose(rate, joint.velocity[1:-1], atol=1e-3 * scale)
        scale = np.abs(joint.acceleration).max()
        rate = np.gradient(joint.velocity, 1e-3)[1:-1]
        np.testing.assert_allclose(rate, joint.acceleration[1:-1], atol=4e-3 * scale)


def test_faster_walking_is_quicker_further_and_shorter_in_stance() -> None:
    paces = [Pace(speed) for speed in np.linspace(MIN_SPEED, MAX_SPEED, 17)]
    assert np.all(np.diff([pace.stride for pace in paces]) < 0)
    assert np.all(np.diff([pace.toe_off for pace in paces]) < 0)
    assert np.all(np.diff([pace.excursion("hip") for pace in paces]) > 0)
    assert np.all(np.diff([pace.moment("hip") for pace in paces]) > 0)


@pytest.mark.parametrize("name", ["assist", "swing"])
def test_help_follows_the_walk(name: str) -> None:
    still, task = np.zeros_like(PHASE), TASKS[name]
    same = Paced(task, Pace(), Pace().moment("ankle"))
    expected = task.torque(still, still, PHASE)
    assert np.array_equal(same.torque(still, still, PHASE), expected)
    quick = Paced(task, Pace(1.5), 0.5).torque(still, still, PHASE)
    assert np.abs(quick).max() == pytest.approx(0.5 * np.abs(expected).max(), rel=1e-4)
    assert np.abs(quick).argmax() < np.abs(expected).argmax()


@pytest.mark.parametrize("speed", [0.79, 1.61, float("nan")])
def test_speeds_beyond_the_source_are_refused(speed: float) -> None:
    with pytest.raises(
        CableError, match=r"Pace\.speed must be a number in \[0.8, 1.6\]"
    ):
        Walk.at(speed)
    with pytest.raises(CableError, match=r"Pace\.speed"):
        Walk(speed=speed)


@pytest.mark.parametrize("module", ["pace", "profile"])
def test_examples_in_the_documentation(module: str) -> None:
    found = importlib.import_module(f"cc_mujoco.human._{module}")
    assert doctest.testmod(found).failed == 0
