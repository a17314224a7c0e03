"""Claims of section 3.2.1 on sensors with known directions of motion."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._experiments import sensors


def test_error_follows_theory_in_number_and_noise() -> None:
    mean, weighted, expected = sensors.error_grid(simulations=1500, seed=1)
    assert mean == pytest.approx(expected, rel=0.1)
    assert np.all(np.diff(mean, axis=0) > 0.0)
    assert np.all(weighted[:, -1] < 0.75 * mean[:, -1])
    assert weighted[:, 0] == pytest.approx(mean[:, 0])


def test_mean_loses_on_the_printed_cable_only() -> None:
    assert sensors.excess_of_mean(sensors.CABLE) > 1.4
    assert sensors.excess_of_mean(sensors.CABLE.replace(friction=0.0)) == 1.0


@pytest.mark.study
def test_error_in_motion_is_white_and_at_rest_constant() -> None:
    run = sensors.ramps()
    assert sensors.ljung_box(run.scaled) > 0.01
    assert sensors.rest_drift(run) == 0.0
    assert np.std(run.scaled) == pytest.approx(1.0, abs=0.15)


def test_whiteness_test_finds_colour() -> None:
    random = np.random.default_rng(2)
    white = random.normal(size=(200, 400))
    share = np.mean([sensors.ljung_box(series) < 0.05 for series in white])
    assert 0.01 < share < 0.1
    coloured = white[0, 1:] + 0.5 * white[0, :-1]
    assert sensors.ljung_box(coloured) < 1e-4
