"""Reconstruction of an angle from rounded readings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.datasets import Noise
from cc_mujoco.datasets._quantization import (
    interpolate_readings,
    reconstruct_angle,
    resolution,
)

DIGIT = 1e-3
ROUNDED = Noise(DIGIT / math.sqrt(12.0), DIGIT, "holds")
TIME = np.arange(0.0, 8.0, 0.002)


def rounded(angle: np.ndarray) -> np.ndarray:
    """Return the reading of an encoder [rad]."""
    return DIGIT * np.round(angle / DIGIT)


@given(
    step=st.floats(1e-5, 1e-1),
    offset=st.floats(-1.0, 1.0),
    seed=st.integers(0, 99),
)
def test_quantisation_step_is_found(step: float, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    levels = np.cumsum(rng.integers(-2, 3, 2000))
    assert resolution(offset + step * levels) == pytest.approx(step, rel=1e-3)
    assert resolution(rng.standard_normal(2000)) == 0.0


@given(
    bits=st.integers(10, 15),
    speed=st.floats(0.1, 8.0),
    decimals=st.integers(6, 9),
    size=st.integers(2000, 6000),
)
def test_an_encoder_is_known_however_fast_it_is_and_however_it_is_written(
    bits: int, speed: float, decimals: int, size: int
) -> None:
    digit = 2.0 * math.pi / 2**bits
    angle = 0.8 * np.sin(speed * 0.002 * np.arange(size))
    read = np.round(digit * np.round(angle / digit), decimals)
    assert resolution(read) == pytest.approx(digit, rel=2e-2)


@given(st.integers(3, 3000), st.integers(0, 99))
def test_numbers_that_are_not_rounded_have_no_digit(size: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    assert resolution(random.normal(size=size)) == 0.0
    assert resolution(np.sin(np.arange(size) + random.normal())) == 0.0


def test_what_is_read_between_two_times_is_a_digit_in_creep_and_on_the_line_else() -> (
    None
):
    jitter = np.random.default_rng(3).uniform(-3e-4, 3e-4, TIME.size)
    clock = TIME + jitter
    creep = rounded(2.3e-3 * clock)
    found = interpolate_readings(TIME[1:-1], clock, creep, DIGIT)
    assert np.all(np.isin(found, creep))
    stroke = np.sin(2.0 * clock)
    plain = np.interp(TIME[1:-1], clock, stroke)
    assert np.array_equal(interpolate_readings(TIME[1:-1], clock, stroke), plain)
    fast = np.abs(np.gradient(rounded(stroke)))[1:-1] > 3.0 * DIGIT
    found = interpolate_readings(TIME[1:-1], clock, rounded(stroke), DIGIT)
    plain = np.interp(TIME[1:-1], clock, rounded(stroke))
    assert np.array_equal(found[fast], plain[fast])
    outside = interpolate_readings(np.array([-1.0, 9.0]), clock, creep, DIGIT)
    assert np.isnan(outside).all()


@pytest.mark.parametrize(
    ("angle", "better"),
    [
        (2.3e-3 * TIME, 0.05),
        (0.3 * np.sin(2.0 * TIME), 1.0),
        (5.2e-3 * np.sin(0.9 * TIME + 0.3), 0.5),
        (3.0 * np.sin(40.0 * TIME), 1.05),
    ],
    ids=["creep", "strokes", "slow turns", "5 digits of acceleration"],
)
def test_it_is_closer_to_the_angle_than_its_digits(
    angle: np.ndarray, better: float
) -> None:
    read = rounded(angle)
    whole = reconstruct_angle(read, ROUNDED)
    inside = slice(500, -500)
    off, usual = (float(np.std((each - angle)[inside])) for each in (whole, read))
    assert off < better * usual
    assert np.max(np.abs(whole - read)) <= 0.5 * DIGIT * (1.0 + 1e-9)


def test_a_rest_stays_a_rest() -> None:
    angle = np.interp(TIME, [0.0, 2.0, 6.0, 8.0], [0.0, 0.5003, 0.5003, 0.0])
    whole = reconstruct_angle(rounded(angle), ROUNDED)
    assert np.ptp(whole[(TIME > 2.1) & (TIME < 5.9)]) == 0.0


def test_noise_that_says_more_than_digits_is_left_alone() -> None:
    random = np.random.default_rng(0)
    read = rounded(2e-3 * TIME + DIGIT * random.normal(size=TIME.size))
    noisy = Noise(1.1 * DIGIT, DIGIT, "holds")
    assert reconstruct_angle(read, noisy) is read
    assert reconstruct_angle(read, None) is read
    assert reconstruct_angle(read, Noise(DIGIT, 0.0, "declared")) is read
