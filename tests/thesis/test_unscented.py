"""The unscented filter on a cable's parameters, from its two ends."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.runs import CABLE, DT, Run, drifting, played, rms, strokes
from thesis._unscented import follow_parameters, linearize, sigma_points

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
    found = follow_parameters(WRONG, NAMES, DT, ends(run, 1), noise=1.0)
    assert found.value[0] == pytest.approx([0.42, 6000.0, 30.0])
    assert found.value[-1] == pytest.approx(TRUTH, rel=0.02)
    assert np.all(np.abs(found.value[-1] - TRUTH) < 3.5 * found.deviation[-1])


def test_error_has_the_stated_size(run: Run) -> None:
    names, truth = NAMES[:2], TRUTH[:2]
    guess = WRONG.replace(pretension=CABLE.pretension)
    score = []
    for seed in range(8):
        recording = ends(run, seed, 3.0)[:, :200]
        found = follow_parameters(guess, names, DT, recording, noise=3.0, window=100)
        score.append((found.value[-1] - truth) / found.deviation[-1])
    # The standard error of the RMS of 16 is 0.18.
    assert rms(np.array(score)) == pytest.approx(1.0, abs=0.45)


def test_nothing_is_learnt_of_friction_at_rest() -> None:
    still = played(CABLE, np.zeros((2, 200)))
    names = ("friction", "pretension")
    found = follow_parameters(WRONG, names, DT, ends(still, 3), noise=1.0)
    assert found.value[-1] == pytest.approx([0.42, 40.0], rel=0.01)
    assert found.deviation[-1, 0] == pytest.approx(0.21)


def test_drift_is_followed_to_within_what_is_stated() -> None:
    values = CABLE.friction * np.linspace(1.0, 1.1, 60)
    run = drifting(CABLE, strokes(6.0), "friction", values)
    truth = np.repeat(values, 10)
    guess = CABLE.replace(friction=0.42)
    found = follow_parameters(
        guess, ["friction"], DT, ends(run, 4), noise=1.0, drift=0.03
    )
    error = (found.value[:, 0] - truth)[200:]
    assert rms(error / truth[200:]) < 0.015
    # What drifts within windows and strokes, below a second, comes on top.
    held = truth[100] - truth[0]
    assert rms(error) < rms(found.deviation[200:, 0]) + held


def test_moments_and_lines_are_those_of_linear_algebra() -> None:
    random = np.random.default_rng(8)
    root, slope = random.normal(size=(3, 3)), random.normal(size=(5, 3))
    mean, covariance = random.normal(size=3), root @ root.T
    points = sigma_points(mean, covariance)
    assert np.mean(points, axis=0) == pytest.approx(mean)
    shifts = points[1:] - mean
    assert shifts.T @ shifts / 6.0 == pytest.approx(covariance)
    found, offset, residual = linearize(points, points @ slope.T + 7.0)
    assert found == pytest.approx(slope)
    assert offset == pytest.approx(np.full(5, 7.0))
    assert residual == pytest.approx(np.zeros((5, 5)), abs=1e-9)
    assert np.min(np.linalg.eigvalsh(linearize(points, points**2)[2])) > -1e-9
