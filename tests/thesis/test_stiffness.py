"""Axial stiffness from one encoder and tension sensors, in partial motion."""

from __future__ import annotations

import numpy as np
import pytest

from cc_mujoco.device import Sensors
from estimation.runs import CABLE, Run, drifting, played, pulls, rms, strokes
from thesis._estimators import EstimateTrack
from thesis._experiments.online import StiffnessEstimator

FINE = CABLE.replace(segments=40, pretension=20.0)
EVERY = Sensors.everywhere(FINE, 1.0)
EA = FINE.axial_stiffness


@pytest.fixture(scope="module")
def run() -> Run:
    return played(FINE, pulls(8.0))


def over(
    estimator: StiffnessEstimator, run: Run, seed: int, noise: float = 1.0
) -> EstimateTrack:
    random = np.random.default_rng(seed)
    reading = run.tension + noise * random.normal(size=run.tension.shape)
    return estimator.over(run.proximal, reading, run.direction)


@pytest.mark.parametrize("factor", [0.4, 2.0])
def test_converges_from_a_wrong_start(run: Run, factor: float) -> None:
    found = over(StiffnessEstimator(FINE, EVERY, start=factor * EA), run, 1)
    assert found.value[0] == factor * EA
    assert found.value[-1] == pytest.approx(EA, rel=0.01)
    assert abs(found.value[-1] - EA) < 3.0 * found.deviation[-1]


def test_few_sensors_add_no_more_than_the_error_of_their_quadrature(run: Run) -> None:
    places = np.arange(0, 41, 4)
    sensors = Sensors(tuple(places.tolist()), (1e-3,) * 11)
    estimator = StiffnessEstimator(FINE, sensors, start=2.0 * EA)
    found = estimator.over(run.proximal, run.tension[:, places], run.direction)
    assert 1e-4 < abs(found.value[-1] / EA - 1.0) < 0.25 / 4.0**2


def test_error_has_the_stated_size(run: Run) -> None:
    score = []
    for seed in range(60):
        estimator = StiffnessEstimator(FINE, EVERY, start=EA, memory=50.0)
        found = over(estimator, Run(*(part[:600:6] for part in run)), seed)
        score.append((found.value[-1] - EA) / found.deviation[-1])
    # The standard error of an RMS of 60 is 0.09, of their mean 0.13.
    assert rms(np.array(score)) == pytest.approx(1.0, abs=0.28)
    assert abs(np.mean(score)) < 0.4


def test_only_changes_of_the_encoder_count(run: Run) -> None:
    here, there = (StiffnessEstimator(FINE, EVERY, start=2.0 * EA) for _ in range(2))
    moved = over(there, run._replace(proximal=run.proximal + 3.0), 2)
    for found, known in zip(moved, over(here, run, 2), strict=True):
        assert found == pytest.approx(known, rel=1e-9)


def test_mass_motion_is_refused() -> None:
    run = played(FINE, strokes(4.0))
    mass = np.all(run.direction != 0, axis=1)
    assert np.mean(mass) > 0.5
    estimator = StiffnessEstimator(FINE, EVERY, start=2.0 * EA)
    found = over(estimator, Run(*(part[mass] for part in run)), 3)
    assert np.all(np.array(found) == 2.0 * EA)


def test_output_that_moves_between_spells_of_partial_motion_does_no_harm() -> None:
    shift = 0.03 * np.repeat([0.0, 1.0, 0.0], 400)
    ramp = np.convolve(np.pad(shift, 50, mode="edge"), np.ones(101) / 101, "valid")
    run = played(FINE, pulls(12.0) - ramp)
    assert np.sum(np.all(run.direction != 0, axis=1)) > 100
    found = over(StiffnessEstimator(FINE, EVERY, start=2.0 * EA), run, 4)
    assert np.ptp(found.value[900:]) > 0.0
    assert found.value[-1] == pytest.approx(EA, rel=0.01)


def test_slip_of_the_distal_part_alone_is_refused() -> None:
    proximal, distal = pulls(4.0)
    run = played(FINE, np.array([distal, -proximal]))
    moving = np.any(run.direction != 0, axis=1)
    assert np.any(moving) and np.all(run.direction[:, 0] == 0)
    estimator = StiffnessEstimator(FINE, EVERY, start=2.0 * EA)
    drifted = run._replace(proximal=np.linspace(0.0, -0.01, run.proximal.size))
    found = over(estimator, Run(*(part[moving] for part in drifted)), 5)
    assert np.all(np.array(found) == 2.0 * EA)


def test_nothing_is_learnt_at_rest(run: Run) -> None:
    estimator = StiffnessEstimator(FINE, EVERY, start=2.0 * EA)
    found = over(estimator, run._replace(direction=np.zeros_like(run.direction)), 6)
    assert np.all(np.array(found) == 2.0 * EA)


def test_drift_is_followed_to_within_what_is_stated() -> None:
    values = EA * np.linspace(1.0, 0.7, 240)
    run = drifting(FINE, pulls(24.0), "axial_stiffness", values)
    truth = np.repeat(values, 10)
    rate = 0.3 * EA / 2400.0
    settings = {"start": 2.0 * EA, "memory": 150.0, "drift": rate}
    found = over(StiffnessEstimator(FINE, EVERY, **settings), run, 7)
    error = (found.value - truth)[400:]
    assert rms(error / truth[400:]) < 0.04
    assert rms(error) < 2.0 * rms(found.deviation[400:])
