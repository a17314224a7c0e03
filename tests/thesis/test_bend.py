"""mu/R along a cable from tension sensors, while it runs."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.cable import Section
from cc_mujoco.device import Sensors
from estimation.runs import CABLE, Run, drifting, played, rms, strokes
from thesis._experiments.online import BendEstimator

MIDDLE = (np.arange(20) + 0.5) / 20
CURVATURE = 3.5 * (1.0 + 0.6 * np.cos(2.0 * np.pi * MIDDLE))
WINDING = CABLE.replace(
    conduit=tuple(Section(0.1, 1.0 / float(c)) for c in CURVATURE), segments=20
)
TRUTH = CABLE.friction * CURVATURE
MEAN = float(np.mean(TRUTH))
EVERY = Sensors.everywhere(WINDING, 1.0)


@pytest.fixture(scope="module")
def run() -> Run:
    return played(WINDING, strokes(6.0))


def noisy(run: Run, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return run.tension + random.normal(size=run.tension.shape)


def test_smooth_bend_is_found_from_a_uniform_start(run: Run) -> None:
    estimator = BendEstimator(WINDING, EVERY, start=2.0 * MEAN)
    found = estimator.over(noisy(run, 2), run.direction, 2.0 * MIDDLE)
    assert found.value[0] == pytest.approx(np.full(20, 2.0 * MEAN), rel=1e-6)
    assert rms(found.value[-1] - TRUTH) < 0.03 * MEAN
    assert estimator.misfit == pytest.approx(1.0, abs=0.1)


def test_nothing_is_learnt_at_rest_nor_where_no_sensors_are(run: Run) -> None:
    estimator = BendEstimator(WINDING, EVERY, start=2.0 * MEAN)
    found = estimator.over(noisy(run, 3)[:50], np.zeros((50, 20)), 2.0 * MIDDLE)
    assert np.all(np.ptp(found.value, axis=0) == 0.0)
    half = Sensors(tuple(range(11)), (1.0,) * 11)
    estimator = BendEstimator(WINDING, half, start=2.0 * MEAN)
    found = estimator.over(noisy(run, 3)[:, :11], run.direction, [0.5, 2.0])
    assert found.value[-1, 0] == pytest.approx(TRUTH[5], rel=0.2)
    assert found.value[-1, 1] == pytest.approx(2.0 * MEAN)
    assert found.deviation[-1, 1] == pytest.approx(found.deviation[0, 1])


def test_drift_is_followed_to_within_what_is_stated() -> None:
    """Follow a uniform bend, which the spline can hold; its misfit is not stated."""
    even = CABLE.replace(segments=20)
    factor = np.linspace(1.0, 1.5, 160)
    run = drifting(even, strokes(16.0), "friction", CABLE.friction * factor)
    mean = CABLE.friction / 0.28
    truth = mean * np.repeat(factor, 10)[:, None]
    estimator = BendEstimator(
        even, EVERY, start=2.0 * mean, memory=150.0, drift=mean * 0.5 / 1600.0
    )
    found = estimator.over(noisy(run, 4), run.direction, 2.0 * MIDDLE)
    error = (found.value - truth)[400:]
    assert rms(error) < 0.07 * mean
    assert rms(error) < 2.0 * rms(found.deviation[400:])
