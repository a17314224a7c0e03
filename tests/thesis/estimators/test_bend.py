"""mu/R along a cable from tension sensors, while it runs."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.cable import Section
from cc_mujoco.device import Sensors
from cc_mujoco.errors import CableError
from estimation.runs import CABLE, Run, drifting, played, rms, strokes
from thesis.estimators._parameters import BendEstimator

PATH = (Section(0.5, 0.2), Section(0.5, 0.8), Section(0.5, 0.3), Section(0.5, 0.5))
WINDING = CABLE.replace(conduit=PATH, segments=20)
TRUTH = CABLE.friction / np.array([section.radius for section in PATH])
MIDDLES = np.array([0.25, 0.75, 1.25, 1.75])
MEAN = float(np.mean(TRUTH))
EVERY = Sensors.everywhere(WINDING, 1.0)


@pytest.fixture(scope="module")
def run() -> Run:
    return played(WINDING, strokes(6.0))


def noisy(run: Run, seed: int, noise: float = 1.0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return run.tension + noise * random.normal(size=run.tension.shape)


def blocks(**settings: float) -> BendEstimator:
    """One value per section, from twice the mean everywhere."""
    start = settings.pop("start", 2.0 * MEAN)
    return BendEstimator(WINDING, EVERY, pieces=4, degree=0, start=start, **settings)


def test_converges_from_a_uniform_start_twice_the_mean(run: Run) -> None:
    found = blocks().over(noisy(run, 1), run.direction, MIDDLES)
    assert found.value[-1] == pytest.approx(TRUTH, rel=0.03)
    assert np.all(np.abs(found.value[-1] - TRUTH) < 3.5 * found.deviation[-1])


def test_smooth_bend_is_found_by_the_cubic_spline() -> None:
    middle = (np.arange(20) + 0.5) / 20
    curvature = 3.5 * (1.0 + 0.6 * np.cos(2.0 * np.pi * middle))
    path = tuple(Section(0.1, 1.0 / float(c)) for c in curvature)
    cable = WINDING.replace(conduit=path)
    run = played(cable, strokes(6.0))
    estimator = BendEstimator(cable, EVERY, start=1.5)
    found = estimator.over(noisy(run, 2), run.direction, 2.0 * middle)
    truth = CABLE.friction * curvature
    assert rms(found.value[-1] - truth) < 0.03 * np.mean(truth)


@pytest.mark.parametrize(("degree", "pieces"), [(0, 4), (1, 7), (3, 30)])
def test_starts_from_the_cable_or_from_the_guess(degree: int, pieces: int) -> None:
    settings = {"degree": degree, "pieces": pieces}
    even = BendEstimator(CABLE, Sensors.everywhere(CABLE, 1.0), **settings)
    assert even.at(MIDDLES).value == pytest.approx(np.full(4, CABLE.friction / 0.28))
    guess = BendEstimator(WINDING, EVERY, start=0.7, **settings)
    assert guess.at([0.0, 2.0]).value == pytest.approx([0.7, 0.7])


def test_error_has_the_stated_size(run: Run) -> None:
    score = []
    for seed in range(20):
        estimator = blocks(start=np.repeat(TRUTH, 5), memory=50.0)
        reading = noisy(run, seed)[:600:6]
        for row in zip(reading, run.direction[:600:6], strict=True):
            estimator.update(*row)
        found = estimator.at(MIDDLES)
        score.append((found.value - TRUTH) / found.deviation)
    # 80 scores: the standard error of their RMS is about 0.08.
    assert rms(np.array(score)) == pytest.approx(1.0, abs=0.25)


def test_nothing_is_learnt_at_rest_nor_where_no_sensors_are(run: Run) -> None:
    estimator = blocks()
    before = estimator.at(MIDDLES)
    estimator.over(noisy(run, 3)[:50], np.zeros((50, 20)), MIDDLES)
    for new, old in zip(estimator.at(MIDDLES), before, strict=True):
        assert np.array_equal(new, old)
    half = Sensors(tuple(range(11)), (1.0,) * 11)
    proximal = BendEstimator(WINDING, half, degree=0, start=2.0 * MEAN)
    found = proximal.over(noisy(run, 3)[:, :11], run.direction, MIDDLES)
    assert found.value[-1, :2] == pytest.approx(TRUTH[:2], rel=0.1)
    assert found.value[-1, 2:] == pytest.approx(before.value[2:])
    assert found.deviation[-1, 2:] == pytest.approx(before.deviation[2:])


def test_drift_is_followed_to_within_what_is_stated() -> None:
    factor = np.linspace(1.0, 1.5, 160)
    motion = strokes(16.0)
    run = drifting(WINDING, motion, "friction", CABLE.friction * factor)
    truth = np.repeat(factor, 10)[:, None] * TRUTH
    rate = MEAN * 0.5 / 1600.0
    estimator = blocks(memory=150.0, drift=rate)
    found = estimator.over(noisy(run, 4), run.direction, MIDDLES)
    error = (found.value - truth)[400:]
    assert rms(error) < 0.07 * MEAN
    assert rms(error) == pytest.approx(rms(found.deviation[400:]), rel=0.4)


def test_misfit_tells_a_spline_that_does_not_suffice(run: Run) -> None:
    estimator = blocks()
    estimator.over(noisy(run, 5), run.direction, MIDDLES)
    assert estimator.misfit == pytest.approx(1.0, abs=0.1)
    flat = BendEstimator(WINDING, EVERY, pieces=1, degree=0)
    flat.over(noisy(run, 5), run.direction, MIDDLES)
    assert flat.misfit > 2.0


def test_places_off_the_cable_are_refused() -> None:
    with pytest.raises(CableError, match="the cable has 2 m"):
        blocks().at([0.0, 2.1])
