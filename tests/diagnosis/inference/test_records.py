"""Filtering of angles removes noise and preserves the times of reversals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.cable import Transmission
from cc_mujoco.datasets import Dataset, Noise, Trial, TrialFacts
from cc_mujoco.diagnosis import Problem, fit, prepare
from cc_mujoco.diagnosis._checks.content import repeat_scatter
from cc_mujoco.diagnosis._fit.noise_floor import noise_floor
from cc_mujoco.diagnosis._rig.records import play_filter
from cc_mujoco.diagnosis._rig.simulation import (
    CLOCK_PARAMETERS,
    SimulatedRig,
    baseline_parameters,
)
from diagnosis.recorded import BENCH
from study_marks import study_but

FINE = 1.0 / 8000.0
RATE = 500.0
SEGMENTS = 32
_ANGLES = st.lists(st.floats(-3.0, 3.0, width=32), min_size=2, max_size=60)


@given(_ANGLES, st.floats(0.01, 1.0))
def test_it_is_the_same_backwards_and_upside_down(
    angles: list[float], width: float
) -> None:
    angle = np.array(angles)
    found = play_filter(angle, width)
    np.testing.assert_allclose(play_filter(angle[::-1], width)[::-1], found, atol=1e-12)
    np.testing.assert_allclose(play_filter(-angle, width), -found, atol=1e-12)
    assert np.all(np.abs(found - angle) <= 2.0 * width + 1e-9)


def test_turns_keep_their_height_and_rests_are_still() -> None:
    random = np.random.default_rng(0)
    time = np.arange(0.0, 4.0, 0.004)
    width = 1e-3
    noise = width / 3.0 * random.normal(size=time.size)
    wave = 0.5 * np.sin(2.5 * time)
    turned = play_filter(wave + noise, width)
    assert turned.max() == pytest.approx(0.5, abs=0.8 * width)
    near = np.abs(time - math.pi / 5.0) < 0.1
    assert np.sqrt(np.mean((turned - wave)[near] ** 2)) < 0.4 * width
    held = np.interp(time, [0, 1, 2, 3, 4], [-0.5, 0.5, 0.5, -0.5, -0.5])
    kept = play_filter(held + noise, width)
    rest = (time > 1.05) & (time < 1.95)
    assert np.ptp(kept[rest]) < 0.1 * width
    assert np.mean(kept[rest]) == pytest.approx(0.5, abs=0.3 * width)


def recorded(
    bits: tuple[int, int],
    motion: str = "strokes",
    first: float = 0.0,
    size: float = 1.0,
) -> Dataset:
    """Return a trial read at 500 Hz by encoders that round, torques without delay.

    Args:
        bits: resolution of the encoders of motor and joint.
        motion: name of the motion.
        first: offset of the encoder steps, as a fraction of a step.
        size: scale of the motion.
    """
    time = np.arange(0.0, 6.0, FINE)
    stroke = {
        "strokes": 0.6 * np.sin(2.5 * time) + 0.2 * np.sin(5.1 * time),
        "rests": np.interp(time % 4.0, [0, 1, 2, 3, 4], [0.0, 0.8, 0.8, 0.0, 0.0]),
        "creeps": np.interp(time, [0.0, 1.0], [0.0, 0.8])
        + np.where(time > 1.0, 6e-3 * np.sin(time - 1.0), 0.0),
    }[motion]
    stroke = size * stroke
    joint = 0.95 * stroke
    if motion == "strokes":  # else a late torque looks like a late angle
        joint += 0.05 * np.sin(7.3 * time)
    cables = tuple(cable.replace(segments=SEGMENTS) for cable in BENCH.cables)
    drive = Transmission(cables, BENCH.motor_radius, BENCH.joint_radius)
    played = drive.replay(FINE, motor_angle=stroke, joint_angle=joint)
    read = slice(0, None, round(1.0 / RATE / FINE))
    digits = [2.0 * np.pi / 2**bit for bit in bits]
    random = np.random.default_rng(1)
    noisy = random.normal(0.0, 3e-3, (2, time[read].size))
    trial = Trial(
        "stroke",
        time[read],
        digits[0] * np.round(stroke[read] / digits[0] + first),
        played.motor_torque[read] + noisy[0],
        digits[1] * np.round(joint[read] / digits[1] - first),
        played.joint_torque[read] + noisy[1],
        (slice(0, time[read].size),),
        1.0 / RATE,
        path="stroke.csv",
    )
    noise = {
        name: Noise(digit / math.sqrt(12.0), digit, "declared")
        for name, digit in zip(
            ("motor_angle_rad", "joint_angle_rad"), digits, strict=True
        )
    }
    torque = Noise(3e-3, 0.0, "declared")
    noise |= {"motor_torque_nm": torque, "joint_torque_nm": torque}
    return Dataset(trials=(trial,), noise=noise)


def fitted(
    data: Dataset, names: tuple[str, ...]
) -> tuple[dict[str, float], Problem, np.ndarray]:
    """Return parameters fitted to a recording, the problem and its solution."""
    records, filtering = prepare(data, BENCH)
    plant = SimulatedRig(BENCH, records, SEGMENTS)
    free = tuple(
        p._replace(prior=math.inf)
        for p in baseline_parameters(BENCH, records, {})
        if p.name in names
    )
    floor = noise_floor(data, plant, filtering, {})
    problem = Problem(plant, free, (), floor.noise, floor.tolerance)
    x = fit(problem, np.zeros(len(free)), [r.counts for r in records]).x
    return problem.values(x), problem, x


def test_rounded_angles_make_no_torque_early() -> None:
    every = [
        fitted(recorded(bits, first=first), (*CLOCK_PARAMETERS, "joint_angle_offset"))[
            0
        ]
        for bits in ((15, 13), (13, 15))
        for first in (0.0, 0.25, 0.5)
    ]
    for name in CLOCK_PARAMETERS:
        assert abs(np.mean([found[name] for found in every])) < 5e-5, name


@pytest.mark.parametrize("motion", study_but(3, ["creeps", "strokes", "rests"]))
def test_the_floor_of_rounded_angles_is_what_they_are_off_by(motion: str) -> None:
    squares = np.zeros(2)
    for bits in ((13, 13), (15, 13)):
        for first in (0.0, 0.25, 0.5):
            data = recorded(bits, motion, first)
            _, problem, x = fitted(data, ("joint_angle_offset",))
            (record,) = problem.plant.records
            error = record.measured - problem.torques(x)[0]
            parts = np.array([error, problem.noise[0]]) / problem.floor[0]
            squares += np.sum(parts[:, :, record.counts] ** 2, axis=(1, 2))
    assert squares[0] == pytest.approx(squares[1], rel=0.5)


def test_a_servo_that_repeats_badly_raises_no_floor() -> None:
    """Torque differences explained by a different motion do not count as scatter."""
    first, second = (recorded((17, 17), size=size) for size in (1.0, 1.08))
    again = replace(
        second.trials[0], name="again", facts=TrialFacts(repeat_of=first.trials[0].name)
    )
    floors = {}
    for trials in (first.trials, (*first.trials, again)):
        data = replace(first, trials=trials)
        records, filtering = prepare(data, BENCH)
        floor = noise_floor(data, SimulatedRig(BENCH, records, SEGMENTS), filtering, {})
        floors[len(trials)] = np.sqrt(np.mean(floor.noise[0] ** 2, axis=1))
    both = (*first.trials, again)
    raw = repeat_scatter(both, ("motor_torque_nm", "joint_torque_nm")).deviation
    assert np.all(floors[2] < 1.2 * floors[1])
    assert np.all(raw > 5.0 * floors[1])


def test_only_what_noise_does_not_explain_raises_the_floor() -> None:
    """Rounding causes larger errors during rests, for any number of repetitions."""
    (moves,), (rests,), (later,) = (
        recorded((13, 13), motion, first=first).trials
        for motion, first in (("strokes", 0.0), ("rests", 0.0), ("rests", 0.5))
    )
    data = recorded((13, 13))
    moves, rests = replace(moves, name="moves"), replace(rests, name="rests")
    shaken = np.random.default_rng(0).normal(0.0, 0.5, later.joint_torque.size)
    floors = []
    for repeat_of, more in ((None, 0.0), ("rests", 0.0), ("rests", shaken)):
        again = replace(
            later,
            name="again",
            joint_torque=later.joint_torque + more,
            facts=TrialFacts(repeat_of=repeat_of),
        )
        trials = (moves, replace(moves, name="too"), rests, again)
        records, filtering = prepare(replace(data, trials=trials), BENCH)
        plant = SimulatedRig(BENCH, records, SEGMENTS)
        floor = noise_floor(replace(data, trials=trials), plant, filtering, {})
        floors.append(np.sqrt(np.mean(floor.noise[0] ** 2, axis=1)))
    alone, repeated, scattered = floors
    assert repeated == pytest.approx(alone, rel=0.2)
    assert scattered[1] > 1.5 * alone[1]
    assert scattered[0] == pytest.approx(alone[0], rel=0.2)
