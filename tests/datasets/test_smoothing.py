"""Speeds of sampled angles, and their noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from cc_mujoco.datasets import velocity
from cc_mujoco.datasets._smoothing import velocity_noise

STEP = 0.002
TIME = np.arange(0.0, 20.0, STEP)


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
def test_noise_of_the_speed_is_as_stated(step: float) -> None:
    noise = 1e-3 * np.random.default_rng(0).standard_normal(200_000)
    spread = float(np.std(velocity(noise, step)))
    assert spread == pytest.approx(velocity_noise(1e-3, step), rel=0.02)
