"""The unscented filter on a cable's parameters, from its two ends."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.runs import CABLE, DT, Run, drifting, played, rms, strokes
from thesis.estimators import UnscentedEstimator
from thesis.estimators._unscented import (
    History,
    kalman_gain,
    linearize,
    sigma_points,
    square_root,
)

NAMES = ("friction", "axial_stiffness", "pretension")
NOISE = {"tension_proximal": 1.0, "tension_distal": 1.0}
WRONG = CABLE.replace(friction=0.42, axial_stiffness=6000.0, pretension=30.0)
TRUTH = np.array([getattr(CABLE, name) for name in NAMES])


@pytest.fixture(scope="module")
def run() -> Run:
    return played(CABLE, strokes(6.0))


def ends(run: Run, seed: int, noise: float = 1.0) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    proximal, distal = run.tension[:, [0, -1]].T
    return {
        "u_proximal": run.proximal,
        "u_distal": run.distal,
        "tension_proximal": proximal + noise * random.normal(size=proximal.shape),
        "tension_distal": distal + noise * random.normal(size=distal.shape),
    }


def test_three_parameters_converge_from_a_wrong_start(run: Run) -> None:
    estimator = UnscentedEstimator(WRONG, NAMES, DT, noise=NOISE)
    assert list(estimator.value) == list(NAMES)
    found = estimator.over(ends(run, 1))
    assert found.value[0] == pytest.approx([0.42, 6000.0, 30.0])
    assert found.value[-1] == pytest.approx(TRUTH, rel=0.02)
    assert np.all(np.abs(found.value[-1] - TRUTH) < 3.5 * found.deviation[-1])


def test_error_has_the_stated_size(run: Run) -> None:
    names, truth = NAMES[:2], TRUTH[:2]
    guess = WRONG.replace(pretension=CABLE.pretension)
    noise = {"tension_proximal": 3.0, "tension_distal": 3.0}
    score = []
    for seed in range(8):
        estimator = UnscentedEstimator(guess, names, DT, noise=noise, window=100)
        recording = ends(run, seed, 3.0)
        found = estimator.over({name: c[:200] for name, c in recording.items()})
        score.append((found.value[-1] - truth) / found.deviation[-1])
    # The standard error of the RMS of 16 is 0.18.
    assert rms(np.array(score)) == pytest.approx(1.0, abs=0.45)


def test_tension_may_drive_an_end(run: Run) -> None:
    recording = ends(run, 2, 0.0)
    del recording["u_distal"]
    recording["tension_proximal"] += np.random.default_rng(2).normal(
        size=run.proximal.size
    )
    estimator = UnscentedEstimator(
        CABLE.replace(friction=0.4),
        ["friction"],
        DT,
        noise={"tension_proximal": 1.0},
        inputs=("u_proximal", "tension_distal"),
    )
    found = estimator.over(recording)
    assert found.value[-1, 0] == pytest.approx(CABLE.friction, rel=0.02)


def test_nothing_is_learnt_of_friction_at_rest() -> None:
    still = played(CABLE, np.zeros((2, 200)))
    names = ("friction", "pretension")
    estimator = UnscentedEstimator(WRONG, names, DT, noise=NOISE)
    estimator.over(ends(still, 3))
    assert estimator.value["friction"] == pytest.approx(0.42)
    assert estimator.deviation["friction"] == pytest.approx(0.21)
    assert estimator.value["pretension"] == pytest.approx(40.0, rel=0.01)


def test_drift_is_followed_to_within_what_is_stated() -> None:
    values = CABLE.friction * np.linspace(1.0, 1.1, 60)
    run = drifting(CABLE, strokes(6.0), "friction", values)
    truth = np.repeat(values, 10)
    estimator = UnscentedEstimator(
        CABLE.replace(friction=0.42), ["friction"], DT, noise=NOISE, drift=0.03
    )
    found = estimator.over(ends(run, 4))
    error = (found.value[:, 0] - truth)[200:]
    assert rms(error / truth[200:]) < 0.015
    # What drifts within windows and strokes, below a second, comes on top.
    held = truth[100] - truth[0]
    assert rms(error) < rms(found.deviation[200:, 0]) + held


def test_replays_begin_at_the_last_slip_of_the_whole_cable(run: Run) -> None:
    """From the anchor on, the true cable does what it did from the first sample on."""
    history = History(CABLE, DT, ("u_proximal", "u_distal"), tuple(NOISE), limit=10**6)
    recording = ends(run, 0, 0.0)
    kept = []
    for row in range(run.proximal.size):
        history.add({name: float(column[row]) for name, column in recording.items()})
        if row % 50 == 49:
            again = history.replay(CABLE)
            count = again.tension_distal.size
            kept.append(count)
            truth = run.tension[row + 1 - count : row + 1]
            assert again.tension_distal == pytest.approx(truth[:, -1], rel=1e-6)
            assert again.tension_proximal == pytest.approx(truth[:, 0], rel=1e-6)
            history.drop_old_samples([CABLE], [again])
    assert max(kept[1:]) < 200


def test_without_anchor_replays_stay_short_and_are_right_after_the_next() -> None:
    small, wide = strokes(4.0, 0.002, 0.0), strokes(2.0)
    motion = np.concatenate([small, small[:, -1:] + wide], axis=1)
    true = played(CABLE, motion)
    history = History(CABLE, DT, ("u_proximal", "u_distal"), tuple(NOISE), limit=100)
    recording = ends(true, 0, 0.0)
    for row in range(motion.shape[1]):
        history.add({name: float(column[row]) for name, column in recording.items()})
        again = history.replay(CABLE)
        assert again.u_distal.size <= 101
        history.drop_old_samples([CABLE], [again])
    assert again.tension_proximal[-1] == pytest.approx(true.tension[-1, 0], rel=1e-6)
    assert again.tension_distal[-1] == pytest.approx(true.tension[-1, -1], rel=1e-6)


@pytest.mark.parametrize("factor", [3.0, 1.0 / 3.0])
def test_estimates_stay_within_the_bounds_of_the_parameter(
    run: Run, factor: float
) -> None:
    cable = CABLE.replace(stribeck_friction=0.1, stribeck_speed=9.9)
    estimator = UnscentedEstimator(
        cable, ["stribeck_speed"], DT, noise=NOISE, spread=factor
    )
    recording = {name: column[:60] for name, column in ends(run, 6).items()}
    assert 0.0 < estimator.over(recording).value[-1, 0] <= 10.0 * (1.0 + 1e-12)


def test_breakaway_friction_is_kept_at_or_above_kinetic(run: Run) -> None:
    cable = CABLE.replace(friction=0.3, static_friction=0.3)
    estimator = UnscentedEstimator(cable, ["friction"], DT, noise=NOISE)
    recording = {name: column[:60] for name, column in ends(run, 7).items()}
    estimator.over(recording)
    found = estimator._cable(estimator.mean)
    assert found.static_friction >= found.friction


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
