"""Tests of screening: its data, its model and the starts that it predicts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.diagnosis import BaselineFit, fit_baseline, plant_of, prepare
from cc_mujoco.diagnosis._inference import search
from cc_mujoco.diagnosis._inference.folds import (
    Fold,
    divided_samples,
    interleaved_folds,
)
from cc_mujoco.diagnosis._inference.screening import Changes, screen
from diagnosis.recorded import BENCH, dataset

DRAG = {"viscous_friction": {"viscous_friction": 40.0}}
FALLING = {"stribeck_friction": 0.05, "stribeck_speed": 0.02, "stribeck_slip": 7e-4}


@pytest.fixture(scope="module")
def base() -> BaselineFit:
    """Two trials of a rig with viscous friction, the baseline fitted."""
    data = dataset(DRAG, 1.5, seed=3, chosen=(0, 2))
    records, filtering = prepare(data, BENCH)
    return fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)


def test_a_part_of_the_trials_is_screened_without_the_others(base: BaselineFit) -> None:
    first, _ = base.problem.plant.records
    whole = interleaved_folds(base.problem.plant.records)
    part = tuple(
        Fold(*((own, np.zeros_like(other)) for own, other in fold)) for fold in whole
    )
    kept, none = divided_samples(part)
    assert np.array_equal(kept, first.free) and not none.any()
    priors = sum(np.isfinite(parameter.prior) for parameter in base.problem.tuned)
    (sign,) = search._screen_folds(base.crossed, part, list(DRAG), Changes())
    assert len(sign.changes) == 2 * kept.sum() + priors
    assert sign.explained > 0.5


def test_the_predicted_start_lowers_the_error(base: BaselineFit) -> None:
    """Sizes and the tuning beside them, both to first order."""
    problem, division = base.problem, interleaved_folds(base.problem.plant.records)
    (sign,) = search._screen_folds(base.crossed, division, list(DRAG), Changes())
    assert np.any(sign.tuning != 0.0)
    wider = problem.with_effect(sign.id, sign.start)
    masks = divided_samples(division)

    def error(tuning: float) -> float:
        x = np.mean([fit.x for fit in base.crossed.fits], axis=0)
        left = wider.residual(wider.placed(x + tuning * sign.tuning, sign.start), masks)
        return float(left @ left)

    before = problem.residual(base.whole.x, masks)
    assert error(1.0) < 0.2 * float(before @ before)
    assert error(1.0) < 0.5 * error(0.0)


def test_changes_hold_for_models_of_like_torques() -> None:
    changes, record = Changes(), Any
    torque = np.ones((2, 50))
    known = changes.at(record, torque)  # type: ignore[arg-type]
    known["effect", (1.0,), "size"] = torque
    assert changes.at(record, 1.05 * torque) is known  # type: ignore[arg-type]
    other = changes.at(record, 2.0 * torque)  # type: ignore[arg-type]
    assert other is not known and not other
    assert changes.at(record, 0.95 * torque) is known  # type: ignore[arg-type]
    for factor in (3.0, 4.0, 5.0):
        changes.at(record, factor * torque)  # type: ignore[arg-type]
    assert changes.at(record, torque) is not known  # type: ignore[arg-type]


def test_an_effect_begins_with_the_length_of_slip_of_the_model(
    base: BaselineFit,
) -> None:
    """With another length, no ageing at all would change what falling friction does."""
    falls = base.problem.with_effect("stribeck_friction", dict(FALLING))
    place = falls.placed(base.whole.x, FALLING)
    slip = falls.values(place)["stribeck_slip"]
    assert slip == pytest.approx(FALLING["stribeck_slip"])
    masks = [record.free for record in falls.plant.records]
    ageing = "dwell_dependent_stiction"
    (sign,) = screen(falls, place, masks, [ageing])
    assert sign.start["critical_slip_distance"] == pytest.approx(slip)
    (alone,) = screen(base.problem, base.whole.x, masks, [ageing])
    starts = falls.plant.library.effects[ageing].starts
    lengths = [start["critical_slip_distance"] for start in starts]
    assert alone.start["critical_slip_distance"] in lengths


@pytest.mark.parametrize(
    ("best", "expected"), [(1.0, 1.0), (0.25, 0.25), (0.0, 1.0 / 16.0)]
)
def test_a_start_is_shortened_until_the_effect_does_no_harm(
    best: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "cost_at", lambda _, x, __: 1.0 + abs(x[1]) - best)
    size = SimpleNamespace(name="size", linear=True)
    effects = {"effect": SimpleNamespace(parameters=[size])}
    wider: Any = SimpleNamespace(
        plant=SimpleNamespace(library=SimpleNamespace(effects=effects)),
        placed=lambda x, start: np.append(x, start["size"]),
        inside=lambda x: x,
    )
    fits = [SimpleNamespace(x=np.array([k]), cost=1.0) for k in (2.0, 3.0)]
    now: Any = SimpleNamespace(fits=fits)
    sign: Any = SimpleNamespace(
        id="effect", start={"size": 1.0}, tuning=np.array([4.0])
    )
    starts = search._helpful_starts(now, Fold((), ()), wider, sign)
    assert [start.tolist() for start in starts] == [
        [2.0 + 4.0 * expected, expected],
        [3.0 + 4.0 * expected, expected],
    ]
