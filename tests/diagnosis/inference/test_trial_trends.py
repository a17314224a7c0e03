"""Trends of constants over trials: reported with their size only if significant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.cable import Parameter
from cc_mujoco.datasets import Dataset
from cc_mujoco.diagnosis import fit_baseline, plant_of, prepare
from cc_mujoco.diagnosis._fit.trials import (
    TrialConstants,
    TrialDifferences,
    trial_constants,
    trial_step,
    trial_trends,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.estimation._least_squares import Tuned
from diagnosis.recorded import BENCH, NOISE, dataset

FRICTION = Tuned(Parameter("friction", scale="log"), 0.1, 1.0, -5.0, 5.0)


def day(factors: list[float]) -> Dataset:
    """Return one trial, of strokes or fast, for each factor of the friction."""
    usual = BENCH.cables[0].friction
    trials = []
    for place, factor in enumerate(factors):
        changes = {"friction": factor * usual}
        kind = (0, 2)[place % 2]
        (trial,) = dataset(
            duration=1.6, seed=place, changes=changes, chosen=(kind,)
        ).trials
        trials.append(replace(trial, name=f"run_{place}", path=f"run_{place}.csv"))
    return Dataset(tuple(trials), noise=NOISE)


def constants_of(data: Dataset) -> tuple[TrialConstants, ...]:
    records, filtering = prepare(data, BENCH)
    base = fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)
    return trial_constants(base.problem, base.whole.x)


def test_friction_that_falls_over_the_trials_is_measured_trial_by_trial() -> None:
    factors = [1.2, 1.12, 1.04, 0.96, 0.88, 0.8]
    found = constants_of(day(factors))[0]
    assert found.parameter.name in ("friction", "pretension")
    assert found.share > 0.95
    logs = np.log(factors)
    np.testing.assert_allclose(found.change, logs - logs.mean(), atol=0.02)
    (trend,) = trial_trends(found, {"order": np.arange(6.0), "flat": np.zeros(6)})
    assert trend.slope == pytest.approx(-0.081, abs=0.005)
    assert trend.freedom == 4 and trend.chance < Limit.trend_false_alarm_rate


def test_friction_that_is_the_same_in_all_trials_has_no_trend() -> None:
    for found in constants_of(day([1.1] * 5)):
        (trend,) = trial_trends(found, {"order": np.arange(5.0)})
        assert trend.chance > Limit.trend_false_alarm_rate
        assert found.share < 0.3


@pytest.mark.parametrize("scatter", [0.3, 10.0])
def test_a_trend_is_claimed_as_often_as_its_statistic_says(scatter: float) -> None:
    """The rate holds for scatter within and far beyond the uncertainty of trials."""
    random = np.random.default_rng(0)
    order = {"order": np.arange(8.0)}
    claimed = []
    for _ in range(200):
        error = 0.01 * random.uniform(0.5, 2.0, 8)
        spread = np.hypot(error, 0.01 * scatter)
        change = spread * random.normal(size=8)
        found = TrialConstants(FRICTION, tuple("abcdefgh"), change, error, 1.0)
        claimed.append(trial_trends(found, order)[0].chance < 0.05)
        drifting = found._replace(change=change - 6.0 * spread * (order["order"] - 3.5))
        assert trial_trends(drifting, order)[0].chance < Limit.trend_false_alarm_rate
    assert 0.01 < np.mean(claimed) < 0.1


@pytest.mark.parametrize("scatter", [0.3, 10.0])
def test_a_step_between_two_trials_is_placed_and_no_scatter_is_one(
    scatter: float,
) -> None:
    random, names = np.random.default_rng(1), tuple("abcdefgh")
    claimed = []
    for _ in range(100):
        error = 0.01 * random.uniform(0.5, 2.0, 8)
        change = np.hypot(error, 0.01 * scatter) * random.normal(size=8)
        found = TrialConstants(FRICTION, names, change, error, 1.0)
        claimed.append(trial_step(found).chance < 0.05)
        k = int(random.integers(1, 8))
        small = TrialConstants(FRICTION, names, 0.01 * change, error, 1.0)
        later = np.arange(8) >= k
        step = trial_step(small._replace(change=small.change + 0.5 * later))
        assert step.ordinate == names[k] and step.chance < 1e-4
        assert step.slope == pytest.approx(0.5, abs=0.01 * scatter)
    assert np.mean(claimed) < 0.1


@pytest.mark.parametrize("place", range(1, 6))
@pytest.mark.parametrize("size", [-0.0115, 0.4])
def test_a_step_is_said_with_its_place_and_size(place: int, size: float) -> None:
    angle = Tuned(Parameter("joint_angle_offset", "rad"), 0.0, 1.0, -1.0, 1.0)
    error = np.full(6, 1e-3 * abs(size))
    off = size * ((np.arange(6) >= place) - 1.0 + place / 6.0)
    found = TrialConstants(
        angle, tuple("uvwxyz"), off + error * np.array([1, -1] * 3), error, 1.0
    )
    differences = TrialDifferences((found,), {"order of the trials": np.arange(6.0)})
    ((short, where),) = differences.described("")
    between = f"between {'uvwxyz'[place - 1]} and {'uvwxyz'[place]}"
    assert f"steps {between}, by" in short and where.axis == "trial"
    assert f"rad {between} (t = " in where.statement
    assert "follows no trend" not in where.statement
