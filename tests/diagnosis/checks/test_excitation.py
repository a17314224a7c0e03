"""Excitation of a dataset: counts and coverage of known motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from cc_mujoco.datasets import Dataset, Noise, Trial, TrialFacts, velocity
from cc_mujoco.datasets._smoothing import velocity_noise
from cc_mujoco.diagnosis import excitation
from cc_mujoco.diagnosis._checks.content import count_reversals
from diagnosis.bench import recording

STEP = 0.002
TIME = np.arange(0.0, 20.0, STEP)


def trial(angle: np.ndarray, **more: object) -> Trial:
    made = Trial(
        "run",
        TIME,
        angle,
        np.cos(TIME),
        0.25 * angle,
        2.0 * np.cos(TIME),
        (slice(0, len(TIME)),),
        STEP,
    )
    return replace(made, **more)  # type: ignore[arg-type]


def dataset(*trials: Trial) -> Dataset:
    return Dataset(trials, noise={"motor_angle_rad": Noise(1e-5, 0.0, "declared")})


@given(
    frequency=st.floats(0.2, 4.0), amplitude=st.floats(0.01, 10.0), seed=st.integers(0)
)
def test_reversals_are_counted_through_noise(
    frequency: float, amplitude: float, seed: int
) -> None:
    angle = amplitude * np.sin(2.0 * np.pi * frequency * TIME)
    rng = np.random.default_rng(seed)
    angle += 0.003 * amplitude * rng.standard_normal(len(TIME))
    expected = 2.0 * frequency * 20.0
    assert count_reversals(angle) == pytest.approx(expected, abs=1.0)


def test_still_and_one_way_motions_have_no_reversals() -> None:
    assert count_reversals(np.zeros(0)) == 0
    assert count_reversals(np.zeros(50)) == 0
    assert count_reversals(np.linspace(0.0, 1.0, 50)) == 0
    assert count_reversals(np.array([0.0, 1.0, 0.0])) == 1


def test_a_sine_covers_what_it_covers() -> None:
    card = excitation(dataset(trial(np.pi * np.sin(2.0 * np.pi * 1.5 * TIME))))
    assert card.duration == pytest.approx(20.0)
    assert card.turns == pytest.approx(1.0, rel=1e-3)
    assert card.joint_turns == pytest.approx(0.25, rel=1e-3)
    assert card.bandwidth == pytest.approx(1.5, abs=0.3)
    assert card.speed[1] == pytest.approx(np.pi * 2.0 * np.pi * 1.5, rel=0.02)
    assert card.torque == pytest.approx((-2.0, 2.0), rel=0.01)
    assert card.dwell_count == 0
    assert any("no rests" in told for told in card.statements)


def test_decades_grow_with_the_slowest_motion() -> None:
    slow = np.where(TIME < 10.0, 0.01 * TIME, 0.1 + 5.0 * (TIME - 10.0))
    card = excitation(dataset(trial(slow)))
    assert card.speed_decades == pytest.approx(np.log10(500.0), abs=0.05)


def test_rests_are_found_with_their_durations() -> None:
    phase = TIME % 5.0
    length = 1.0 + TIME // 5.0 * 0.5
    moving = phase > length
    angle = np.cumsum(np.where(moving, np.sin(2.0 * np.pi * phase), 0.0)) * STEP
    card = excitation(dataset(trial(angle)))
    assert card.dwell_count >= 4
    assert card.dwells[1] == pytest.approx(2.5, abs=0.1)


def test_repeats_pretensions_tensions_and_temperature() -> None:
    angle = np.sin(TIME)
    tensions = {"tension_a_distal_n": np.full(len(TIME), 9.0)}
    first = trial(angle, facts=TrialFacts(pretension=10.0))
    again = trial(angle, name="b", facts=TrialFacts(pretension=30.0, repeat_of="run"))
    card = excitation(dataset(first, again))
    assert card.repeats == 1 and card.pretensions == (10.0, 30.0)
    assert "2 pretensions, 10 to 30 N." in card.statements
    assert "1 repeat." in card.statements
    warm = trial(angle, tensions=tensions, temperature=20.0 + TIME)
    card = excitation(dataset(warm))
    assert card.tensions == 1
    assert card.temperature == pytest.approx((20.0, 40.0), abs=0.01)
    assert "Tension is measured at 1 cable end." in card.statements


def test_an_empty_dataset_shows_nothing() -> None:
    card = excitation(Dataset(()))
    assert card.duration == 0.0 and card.reversals == 0 and card.speed_decades == 0.0
    assert all(told.endswith(".") for told in card.statements)


# --- smoothing --------------------------------------------------------------------


@given(a=st.floats(-3.0, 3.0), b=st.floats(-3.0, 3.0), step=st.floats(1e-4, 0.05))
def test_speed_of_a_parabola_is_exact_up_to_the_ends(
    a: float, b: float, step: float
) -> None:
    time = step * np.arange(300)
    speed = velocity(a * time + b * time**2, step)
    assert speed == pytest.approx(a + 2.0 * b * time, abs=1e-6)


@given(samples=st.integers(5, 200), seed=st.integers(0, 99))
def test_speed_is_that_of_a_savitzky_golay_filter(samples: int, seed: int) -> None:
    angle = np.cumsum(np.random.default_rng(seed).standard_normal(samples))
    window = min(11, samples - 1 + samples % 2)
    expected = savgol_filter(angle, window, 2, deriv=1, delta=0.005, mode="interp")
    assert velocity(angle, 0.005) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_speed_does_not_lag_and_stays_inside_its_segment() -> None:
    angle = np.sin(2.0 * np.pi * TIME)
    truth = 2.0 * np.pi * np.cos(2.0 * np.pi * TIME)
    assert velocity(angle, STEP) == pytest.approx(truth, abs=0.06)
    jump = np.where(TIME < 10.0, angle, angle + 100.0)
    half = len(TIME) // 2
    parts = (slice(0, half), slice(half + 10, len(TIME)))
    speed = velocity(jump, STEP, parts)
    assert np.isnan(speed[half : half + 10]).all()
    for part in parts:
        assert speed[part] == pytest.approx(truth[part], abs=0.06)


@pytest.mark.parametrize("step", [0.001, 0.005, 0.02])
def test_noise_of_the_speed_is_as_told(step: float) -> None:
    noise = 1e-3 * np.random.default_rng(0).standard_normal(200_000)
    spread = float(np.std(velocity(noise, step)))
    assert spread == pytest.approx(velocity_noise(1e-3, step), rel=0.02)


def test_recordings_of_the_bench_are_rich() -> None:
    columns = recording()
    made = trial(columns["motor_angle_rad"])
    assert excitation(dataset(made)).speed_decades > 1.0
