"""Noise from data, and what weights from it are worth."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._experiments import noise


def test_unbiased_until_kept_nonnegative() -> None:
    free, bounded = noise.statistics(lengths=(300,), runs=40)
    error = free[0].mean(axis=0) - noise.DEVIATION**2
    scatter = free[0].std(axis=0) / np.sqrt(40)
    assert np.all(np.abs(error) < 4.0 * scatter)
    assert np.min(bounded) >= 0.0
    assert bounded[:, -1].mean() > free[0, :, -1].mean() + scatter[-1]


@pytest.mark.study
def test_learnt_weights_beat_the_mean_on_drifting_sensors() -> None:
    found = noise.drift(seconds=16.0)
    assert found.rms["learnt noise"] < 0.7 * found.rms["plain mean"]
    assert found.rms["learnt noise"] < 1.1 * found.rms["true noise"]


def test_weights_need_both_noise_and_extrapolation() -> None:
    found = noise.weighted_errors(samples=500)
    both = found["both, extrapolation at learnt noise"]
    assert np.all(both < 0.5 * found["plain mean"])
    assert np.all(both < 1.05 * found["noise"])
    assert np.all(both < 1.05 * found["extrapolation"])
