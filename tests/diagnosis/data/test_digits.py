"""What is known of an angle whose readings are rounded."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cc_mujoco.diagnosis.data.digits import made_whole
from cc_mujoco.diagnosis.data.trials import Noise

DIGIT = 1e-3
ROUNDED = Noise(DIGIT / math.sqrt(12.0), DIGIT, "holds")
TIME = np.arange(0.0, 8.0, 0.002)


def rounded(angle: np.ndarray) -> np.ndarray:
    """As an encoder shows it."""
    return DIGIT * np.round(angle / DIGIT)


@pytest.mark.parametrize(
    ("angle", "better"),
    [
        (2.3e-3 * TIME, 0.05),
        (0.3 * np.sin(2.0 * TIME), 1.0),
        (5.2e-3 * np.sin(0.9 * TIME + 0.3), 0.5),
    ],
    ids=["creep", "strokes", "slow turns"],
)
def test_it_is_closer_to_the_angle_than_its_digits(
    angle: np.ndarray, better: float
) -> None:
    read = rounded(angle)
    whole = made_whole(read, ROUNDED)
    inside = slice(500, -500)
    off, usual = (float(np.std((each - angle)[inside])) for each in (whole, read))
    assert off < better * usual
    assert np.max(np.abs(whole - read)) <= 0.5 * DIGIT * (1.0 + 1e-9) + np.max(
        np.abs(np.diff(read))
    )


def test_a_rest_stays_a_rest() -> None:
    angle = np.interp(TIME, [0.0, 2.0, 6.0, 8.0], [0.0, 0.5003, 0.5003, 0.0])
    whole = made_whole(rounded(angle), ROUNDED)
    assert np.ptp(whole[(TIME > 2.1) & (TIME < 5.9)]) == 0.0


def test_noise_that_says_more_than_digits_is_left_alone() -> None:
    random = np.random.default_rng(0)
    read = rounded(2e-3 * TIME + DIGIT * random.normal(size=TIME.size))
    noisy = Noise(1.1 * DIGIT, DIGIT, "holds")
    assert made_whole(read, noisy) is read
    assert made_whole(read, None) is read
    assert made_whole(read, Noise(DIGIT, 0.0, "declared")) is read
