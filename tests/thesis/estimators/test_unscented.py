"""The unscented filter on a cable's parameters, from its two ends."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.runs import CABLE, DT, Run, drifting, played, rms, strokes
from thesis.estimators._unscented import (
    History,
    UnscentedEstimator,
    kalman_gain,
    linearize,
    sigma_points,
    square_root,
)

NAMES = ("friction", "axial_stiffness", "pretension")
WRONG = CABLE.replace(friction=0.42, axial_stiffness=6000.0, pretension=30.0)
TRUTH = np.array([getattr(CABLE, name) for name in NAMES])


@pytest.fixture(scope="module")
def run() -> Run:
    return played(CABLE, strokes(6.0))


def ends(run: Run, seed: int, noise: float = 1.0) -> np.ndarray:
    """Return displacements and noisy tensions of both ends (4, samples)."""
    random = np.random.default_rng(seed)
    loud = run.tension[:, [0, -1]].T
    loud = loud + noise * random.normal(size=loud.shape)
    return np.array([run.proximal, run.distal, *loud])


def test_three_parameters_converge_from_a_wrong_start(run: Run) -> None:
    estimator = UnscentedEstimator(WRONG, NAMES, DT, noise=1.0)
    found = estimator.over(*ends(run, 1))
    assert found.value[0] == pytest.approx([0.42, 6000.0, 30.0])
    assert found.value[-1] == pytest.approx(TRUTH, rel=0.02)
    assert np.all(np.abs(found.value[-1] - TRUTH) < 3.5 * found.deviation[-1])


def test_error_has_the_stated_size(run: Run) -> None:
    names, truth = NAMES[:2], TRUTH[:2]
    guess = WRONG.replace(pretension=CABLE.pretension)
    score = []
    for seed in range(8):
        estimator = UnscentedEstimator(guess, names, DT, noise=3.0, window=100)
        found = estimator.over(*ends(run, seed, 3.0)[:, :200])
        score.append((found.value[-1] - truth) / found.deviation[-1])
    # The standard error of the RMS of 16 is 0.18.
    assert rms(np.array(score)) == pytest.approx(1.0, abs=0.45)


def test_nothing_is_learnt_of_friction_at_rest() -> None:
    still = played(CABLE, np.zeros((2, 200)))
    names = ("friction", "pretension")
    estimator = UnscentedEstimator(WRONG, names, DT, noise=1.0)
    estimator.over(*ends(still, 3))
    assert estimator.value == pytest.approx([0.42, 40.0], rel=0.01)
    assert estimator.deviation[0] == pytest.approx(0.21)


def test_drift_is_followed_to_within_what_is_stated() -> None:
    values = CABLE.friction * np.linspace(1.0, 1.1, 60)
    run = drifting(CABLE, strokes(6.0), "friction", values)
    truth = np.repeat(values, 10)
    estimator = UnscentedEstimator(
        CABLE.replace(friction=0.42), ["friction"], DT, noise=1.0, drift=0.03
    )
    found = estimator.over(*ends(run, 4))
    error = (found.value[:, 0] - truth)[200:]
    assert rms(error / truth[200:]) < 0.015
    # What drifts within windows and strokes, below a second, comes on top.
    held = truth[100] - truth[0]
    assert rms(error) < rms(found.deviation[200:, 0]) + held


def test_replays_begin_at_the_last_slip_of_the_whole_cable(run: Run) -> None:
    """From the anchor on, the true cable does what it did from the first sample on."""
    history, recording = History(CABLE, DT), ends(run, 0, 0.0)
    kept = []
    for row in range(run.proximal.size):
        history.add(*recording[:, row])
        if row % 50 == 49:
            again = history.replay(CABLE)
            count = again.tension_distal.size
            kept.append(count)
            truth = run.tension[row + 1 - count : row + 1]
            assert again.tension_distal == pytest.approx(truth[:, -1], rel=1e-6)
            assert again.tension_proximal == pytest.approx(truth[:, 0], rel=1e-6)
            history.drop_old_samples([CABLE], [again])
    assert max(kept[1:]) < 200


def test_estimates_stay_within_the_bounds_of_the_parameter(run: Run) -> None:
    cable = CABLE.replace(stribeck_friction=0.1, stribeck_speed=9.9)
    estimator = UnscentedEstimator(cable, ["stribeck_speed"], DT, noise=1.0)
    found = estimator.over(*ends(run, 6)[:, :60])
    assert 0.0 < found.value[-1, 0] <= 10.0 * (1.0 + 1e-12)


def test_moments_lines_and_gains_are_those_of_linear_algebra() -> None:
    random = np.random.default_rng(8)
    root, slope = random.normal(size=(3, 3)), random.normal(size=(5, 3))
    mean, covariance = random.normal(size=3), root @ root.T
    points = sigma_points(mean, covariance)
    assert np.mean(points, axis=0) == pytest.approx(mean)
    apart = points[1:] - mean
    assert apart.T @ apart / 6.0 == pytest.approx(covariance)
    line = linearize(points, points @ slope.T + 7.0)
    assert line.slope == pytest.approx(slope)
    assert line.offset == pytest.approx(np.full(5, 7.0))
    assert line.root == pytest.approx(np.zeros((5, 7)), abs=1e-9)
    bent = linearize(points, points**2)
    variance = np.array([0.5, 1.0, 2.0])
    total = bent.slope @ covariance @ bent.slope.T + bent.root @ bent.root.T
    total += np.diag(variance)
    gain = covariance @ bent.slope.T @ np.linalg.inv(total)
    assert np.max(np.abs(bent.root)) > 0.1
    assert kalman_gain(bent, covariance, variance) == pytest.approx(gain)


def test_square_root_of_a_covariance_that_rounding_spoilt() -> None:
    covariance = np.array([[1.0, 1.0], [1.0, 1.0 - 1e-16]]) - 1e-17 * np.eye(2)
    for matrix in (covariance, np.diag([4.0, -1e-15])):
        root = square_root(matrix)
        assert root @ root.T == pytest.approx(matrix, abs=1e-12)
