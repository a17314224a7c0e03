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
    trial_constants,
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
