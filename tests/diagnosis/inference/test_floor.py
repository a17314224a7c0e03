"""The noise floor equals the error of the readings for every motion of the rig."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cc_mujoco.cable import Transmission
from cc_mujoco.datasets import Dataset, Noise, Trial, TrialFacts
from cc_mujoco.diagnosis import CrossValidation, Problem, Record, prepare
from cc_mujoco.diagnosis._fit.noise_floor import likely, noise_floor, resample_angles
from cc_mujoco.diagnosis._fit.problem import excess
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig
from diagnosis.recorded import BENCH

STEP = 2e-3
SEGMENTS = 6
FINE = {"motor_angle_rad": 6e-5, "joint_angle_rad": 3e-4}
"""Standard deviation of the white noise of encoders [rad]."""
TORQUE = 0.02

Array = NDArray[np.float64]


def dataset(motor: Array, joint: Array, digit: float = 0.0, seed: int = 0) -> Dataset:
    """Return a trial of the bench, with white noise or only rounded encoders."""
    cables = tuple(cable.replace(segments=SEGMENTS) for cable in BENCH.cables)
    drive = Transmission(cables, BENCH.motor_radius, BENCH.joint_radius)
    played = drive.replay(STEP, motor_angle=motor, joint_angle=joint)
    random = np.random.default_rng(seed)
    noise = {"motor_torque_nm": Noise(TORQUE, 0.0, "declared")}
    noise["joint_torque_nm"] = noise["motor_torque_nm"]
    read = {}
    for name, angle in zip(FINE, (motor, joint), strict=True):
        if digit:
            first = random.uniform(0.0, digit)
            read[name] = first + digit * np.round((angle - first) / digit)
            noise[name] = Noise(digit / math.sqrt(12.0), digit, "declared")
        else:
            read[name] = angle + random.normal(0.0, FINE[name], angle.size)
            noise[name] = Noise(FINE[name], 0.0, "declared")
    torques = [
        torque + random.normal(0.0, TORQUE, motor.size)
        for torque in (played.motor_torque, played.joint_torque)
    ]
    trial = Trial(
        "one",
        STEP * np.arange(motor.size),
        read["motor_angle_rad"],
        torques[0],
        read["joint_angle_rad"],
        torques[1],
        (slice(0, motor.size),),
        STEP,
        path="one.csv",
    )
    return Dataset(trials=(trial,), noise=noise)


TIME = STEP * np.arange(3500)


def strokes() -> tuple[Array, Array]:
    """Return motions in which both ends move."""
    motor = 0.6 * np.sin(2.5 * TIME) + 0.2 * np.sin(5.1 * TIME)
    return motor, 0.95 * motor + 0.05 * np.sin(7.3 * TIME)


def rests() -> tuple[Array, Array]:
    """Return a motion of moves with rests between them."""
    motor = np.interp(TIME % 4.0, [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.8, 0.8, 0.0, 0.0])
    return motor, 0.95 * motor


def trembles() -> tuple[Array, Array]:
    """Return motions whose rests contain movements below the encoder resolution."""
    motor, joint = rests()
    return motor + 5e-5 * np.sin(10.0 * TIME), joint + 3e-4 * np.sin(10.0 * TIME + 1.0)


def off(motion: tuple[Array, Array], digit: float, seed: int) -> tuple[float, float]:
    """Return the sums of squared errors and of the squared floor, by the tolerance."""
    data = dataset(*motion, digit, seed)
    records, filtering = prepare(data, BENCH)
    plant = SimulatedRig(BENCH, records, SEGMENTS)
    floor = noise_floor(data, plant, filtering, {}, seed=seed)
    (played,) = plant.simulate({})
    error = records[0].measured - played
    parts = np.array([error, floor.noise[0]]) / floor.tolerance[0]
    squares = np.sum(parts[:, :, records[0].counts] ** 2, axis=(1, 2))
    return float(squares[0]), float(squares[1])


def over_floor(motion: Callable[[], tuple[Array, Array]], digit: float) -> float:
    """Return the ratio of squared errors to the squared floor."""
    errors, floor = np.sum([off(motion(), digit, seed) for seed in range(6)], axis=0)
    return float(errors / floor)


@pytest.mark.parametrize("motion", [strokes, rests])
@pytest.mark.parametrize("digit", [0.0, 8e-4])
def test_readings_are_off_by_the_floor_however_the_rig_moves(
    motion: Callable[[], tuple[Array, Array]], digit: float
) -> None:
    assert 0.7 < over_floor(motion, digit) < 1.3


def test_the_floor_knows_of_movements_that_readings_hide() -> None:
    """The floor covers most of their effect, since their amplitude is unknown."""
    assert over_floor(trembles, 0.0) < 5.0


def still(digit: float) -> tuple[Record, Any, dict[str, Noise]]:
    """Return a record of ends at rest, its filtering and its noise."""
    data = dataset(*rests(), digit)
    records, filtering = prepare(data, BENCH)
    rest = np.full_like(records[0].motor_angle, 0.3 * digit)
    both = np.array([rest, rest])
    record = replace(records[0], motor_angle=rest, joint_angle=rest, read=both)
    return record, filtering, dict(data.noise)


def test_a_rest_is_read_off_by_a_digit_that_no_filter_takes_out() -> None:
    digit = 8e-4
    record, filtering, noise = still(digit)
    random = np.random.default_rng(0)
    read = [resample_angles(record, noise, filtering, random) for _ in range(300)]
    off_by = np.array([each.motor_angle - record.motor_angle for each in read])
    assert np.ptp(off_by, axis=1).max() < 1e-3 * digit
    assert np.std(off_by[:, 0]) == pytest.approx(digit / math.sqrt(12.0), rel=0.1)
    assert np.abs(off_by).max() <= 0.5 * digit * (1.0 + 1e-9)


def test_where_an_angle_rests_the_likely_motion_does() -> None:
    record, filtering, _ = still(8e-4)
    found = likely(record, filtering)
    np.testing.assert_allclose(found.motor_angle, record.motor_angle, atol=1e-12)


def test_part_of_what_was_stilled_is_likely() -> None:
    record, filtering, _ = still(8e-4)
    slow = 0.5 * filtering.still[0] * np.sin(3.0 * record.time)
    seen = np.array([record.motor_angle + slow, record.joint_angle])
    moved = likely(replace(record, read=seen), filtering).motor_angle
    share = float((moved - record.motor_angle) @ slow / (slow @ slow))
    assert share == pytest.approx(0.5, abs=0.05)


def test_ripple_of_digits_is_not_in_the_likely_motion() -> None:
    digit = 8e-4
    data = dataset(*strokes(), digit)
    records, filtering = prepare(data, BENCH)
    true = np.interp(records[0].time, TIME, strokes()[0])
    clear = slice(100, -100)
    played, meant = records[0].motor_angle, likely(records[0], filtering).motor_angle
    before, after = (np.diff((a - true)[clear]).std() for a in (played, meant))
    assert after < 0.7 * before


@pytest.mark.parametrize("inflation", [1.0, 3.0])
def test_misfit_is_over_noise_whatever_errors_are_divided_by(inflation: float) -> None:
    """The tolerance of errors during rests is several times the noise."""
    random = np.random.default_rng(0)
    noise = [np.full((2, 400), 0.1), np.full((2, 400), 0.1)]
    floor = [inflation * np.full((2, 400), wide) for wide in (0.1, 0.4)]
    errors = [
        2.0 * n * random.choice([-1.0, 1.0], n.shape) / f
        for n, f in zip(noise, floor, strict=True)
    ]
    errors[0][:, :50] = np.nan
    records = tuple(SimpleNamespace(dt=0.01) for _ in noise)
    problem: Any = SimpleNamespace(
        noise_over_floor=[n / f for n, f in zip(noise, floor, strict=True)],
        inflation=inflation,
        plant=SimpleNamespace(records=records),
    )
    crossed = CrossValidation(problem, (), tuple(errors))
    assert crossed.misfit == pytest.approx(2.0)
    level = CrossValidation(problem, (), tuple(0.5 * error for error in errors))
    assert level.misfit == pytest.approx(1.0)
    assert excess(crossed) > 2.0


def test_what_repetitions_differ_by_is_not_in_the_noise_of_the_sensors() -> None:
    """A wrong model causes part of the scatter, which would mask the model error."""
    flat = (np.full((2, 5), 0.5),)
    problem = Problem(
        SimulatedRig(BENCH, (), SEGMENTS),
        (),
        (),
        flat,
        flat,
        scatter=np.array([[0.3], [0.4]]),
    )
    np.testing.assert_allclose(problem.sensed[0][:, 0], [0.4, 0.3])


@pytest.mark.parametrize("apart", [0.0, 0.3])
def test_repetitions_differ_by_no_more_than_their_readings_do(apart: float) -> None:
    """Different rest positions of the joint add no scatter through a wrong model."""
    motor, joint = rests()
    data = dataset(motor, joint)
    (one,) = data.trials
    assert one.joint_torque is not None
    again = replace(
        one,
        name="two",
        path="two.csv",
        joint_angle=one.joint_angle + 2e-3 * np.sin(3.0 * TIME),
        joint_torque=one.joint_torque + apart * np.sin(3.0 * TIME),
        facts=TrialFacts(repeat_of="one"),
    )
    data = replace(data, trials=(one, again))
    records, filtering = prepare(data, BENCH)
    floor = noise_floor(data, SimulatedRig(BENCH, records, SEGMENTS), filtering, {})
    assert float(floor.scatter[1, 0]) <= 0.5 * apart
    assert apart == 0.0 or float(floor.scatter[1, 0]) > 0.2 * apart


def test_repetitions_that_do_not_count_say_nothing_of_noise() -> None:
    data = dataset(*rests())
    (one,) = data.trials
    again = replace(one, name="two", path="two.csv", facts=TrialFacts(repeat_of="one"))
    records, filtering = prepare(replace(data, trials=(one, again)), BENCH)
    idle = [replace(r, counts=np.zeros(r.counts.size, dtype=bool)) for r in records]
    floor = noise_floor(data, SimulatedRig(BENCH, tuple(idle), SEGMENTS), filtering, {})
    assert not floor.scatter.any()
    assert all(np.isfinite(noise).all() for noise in floor.noise)
