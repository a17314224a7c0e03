"""Friction from tension sensors along a cable that runs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.cable import Cable
from cc_mujoco.device import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._tension_slope import wrap_angles
from estimation.runs import (
    CABLE,
    Run,
    drifting,
    moving_runs,
    played,
    rms,
    strokes,
)
from thesis._estimators import FrictionEstimator

EVERY = Sensors.everywhere(CABLE, 1.0)
MU = CABLE.friction


@pytest.fixture(scope="module")
def run() -> Run:
    return played(CABLE, strokes(6.0))


def noisy(run: Run, seed: int, noise: float = 1.0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return run.tension + noise * random.normal(size=run.tension.shape)


@pytest.mark.parametrize("factor", [0.3, 2.0, 5.0])
def test_converges_from_a_wrong_start(run: Run, factor: float) -> None:
    estimator = FrictionEstimator(CABLE, EVERY, start=factor * MU, spread=1.0)
    found = estimator.over(noisy(run, 1), run.direction)
    assert abs(found.value[0] - MU) > 0.1  # at rest in the first sample
    assert found.value[-1] == pytest.approx(MU, rel=0.005)
    assert abs(found.value[-1] - MU) < 3.0 * found.deviation[-1]


def test_a_path_that_was_measured_tells_friction_from_bend(run: Run) -> None:
    """With wrap angles half as large the same tensions are twice the friction."""
    estimator = FrictionEstimator(CABLE, Sensors.everywhere(CABLE, 1e-5), start=MU)
    whole = np.diff(wrap_angles(CABLE))
    estimator.rebend(0.5 * whole)
    estimator.over(run.tension, run.direction)
    assert estimator.friction == pytest.approx(2.0 * MU, rel=1e-6)


def test_is_exact_without_noise_whatever_stiffness_and_pretension() -> None:
    cable = CABLE.replace(axial_stiffness=900.0, pretension=25.0, static_friction=0.3)
    run = played(cable, strokes(4.0, 0.08, 0.06))
    estimator = FrictionEstimator(CABLE, Sensors.everywhere(CABLE, 1e-5), start=0.4)
    estimator.over(run.tension, run.direction)
    assert estimator.friction == pytest.approx(MU, rel=1e-6)


@pytest.mark.parametrize(
    "nodes", [pytest.param((0, 10), marks=pytest.mark.study), (1, 4, 5, 9)]
)
def test_error_has_the_stated_size(run: Run, nodes: tuple[int, ...]) -> None:
    """Spread over runs with new noise, from the truth so that only noise counts."""
    sensors = Sensors(nodes, (1.0,) * len(nodes))
    score = []
    for seed in range(20):
        estimator = FrictionEstimator(CABLE, sensors, start=MU, memory=50.0)
        reading = noisy(run, seed)[:600:6, nodes]
        for row in zip(reading, run.direction[:600:6], strict=True):
            estimator.update(*row)
        score.append((estimator.friction - MU) / estimator.deviation)
    # The standard error of an RMS of 20 is 0.16, of their mean 0.22.
    assert rms(np.array(score)) == pytest.approx(1.0, abs=0.35)
    assert abs(np.mean(score)) < 0.5


def test_nothing_is_learnt_at_rest_or_by_a_lone_sensor(run: Run) -> None:
    estimator = FrictionEstimator(CABLE, EVERY, start=0.5, spread=0.1)
    estimator.over(noisy(run, 2), np.zeros_like(run.direction))
    assert (estimator.friction, estimator.deviation) == (0.5, 0.1)
    assert np.isnan(estimator.misfit)
    ends = FrictionEstimator(CABLE, Sensors((0, 10), (1.0, 1.0)), start=0.5, spread=0.1)
    partial = run.direction.copy()
    partial[:, 5:] = 0
    ends.over(noisy(run, 2)[:, [0, 10]], partial)
    assert (ends.friction, ends.deviation) == (0.5, 0.1)


def test_slack_cable_teaches_nothing() -> None:
    estimator = FrictionEstimator(CABLE, EVERY, start=0.5)
    reading = np.random.default_rng(3).normal(size=(200, 11))
    estimator.over(reading, np.ones((200, 10)))
    assert estimator.friction == 0.5


def test_drift_is_followed_to_within_what_is_stated() -> None:
    """Friction grows by 40 %; an estimator told of no drift believes too much."""
    truth = MU * np.linspace(1.0, 1.4, 120)
    run = drifting(CABLE, strokes(12.0), "friction", truth)
    each = np.repeat(truth, 10)
    rate = float(truth[1] - truth[0]) / 10.0
    settings = {"start": 2.0 * MU, "memory": 150.0}
    told = FrictionEstimator(CABLE, EVERY, drift=rate, **settings)
    found = told.over(noisy(run, 4), run.direction)
    error = (found.value - each)[400:]
    assert rms(error / each[400:]) < 0.05
    assert rms(error) == pytest.approx(rms(found.deviation[400:]), rel=0.3)
    naive = FrictionEstimator(CABLE, EVERY, **settings)
    stated = naive.over(noisy(run, 4), run.direction).deviation[400:]
    assert rms(error) > 3.0 * rms(stated)


def test_misfit_tells_wrong_noise(run: Run) -> None:
    estimator = FrictionEstimator(CABLE, EVERY, start=MU)
    estimator.over(noisy(run, 5), run.direction)
    assert estimator.misfit == pytest.approx(1.0, abs=0.1)
    estimator.reset()
    estimator.noise = np.full(11, 0.5)
    estimator.over(noisy(run, 5), run.direction)
    assert estimator.misfit == pytest.approx(2.0, abs=0.2)


def test_reset_and_empty_recording(run: Run) -> None:
    estimator = FrictionEstimator(CABLE, EVERY, start=0.4)
    first = estimator.over(noisy(run, 6), run.direction)
    estimator.reset()
    assert estimator.friction == 0.4
    assert estimator.over(np.empty((0, 11)), np.empty((0, 10))).value.shape == (0,)
    again = estimator.over(noisy(run, 6), run.direction)
    assert np.array_equal(first.value, again.value)


@given(st.lists(st.sampled_from([-1, 0, 1]), min_size=1, max_size=20))
def test_moving_runs_leave_out_rest_and_both_sides_of_a_turn(signs: list[int]) -> None:
    taken = np.zeros(len(signs), dtype=int)
    for first, last, sign in moving_runs(np.array(signs)):
        assert set(signs[first:last]) == {int(sign)}
        taken[first:last] += 1
    for i, sign in enumerate(signs):
        beside = [*signs[max(i - 1, 0) : i], *signs[i + 1 : i + 2]]
        assert taken[i] == int(sign != 0 and -sign not in beside)


def test_cables_without_a_slope_are_refused() -> None:
    with pytest.raises(CableError, match="at least two different"):
        FrictionEstimator(CABLE, Sensors((3, 3), (1.0, 1.0)), start=MU)
    with pytest.raises(CableError, match="straight between the sensors"):
        FrictionEstimator(Cable(), Sensors((0, 1), (1.0, 1.0)), start=MU)
    with pytest.raises(CableError, match="`viscous_friction` is 1"):
        FrictionEstimator(CABLE.replace(viscous_friction=1.0), EVERY, start=MU)
