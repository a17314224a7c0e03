"""Tests of screening: its data, its model and its starts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cc_mujoco.diagnosis import BaselineFit, fit_baseline, plant_of, prepare
from cc_mujoco.diagnosis._fit.folds import Fold, divided_samples, interleaved_folds
from cc_mujoco.diagnosis._search import rounds
from cc_mujoco.diagnosis._search.screening import Changes, screen
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
    (sign,) = rounds._screen_folds(base.crossed, part, list(DRAG), Changes())
    assert len(sign.changes) == 2 * kept.sum() + priors
    assert sign.explained > 0.5


def test_changes_hold_for_models_of_like_torques() -> None:
    changes = Changes()
    record: Any = object()  # of which only the identity counts
    torque = np.ones((2, 50))
    known = changes.at(record, torque)
    known["effect", (1.0,), "size"] = torque
    assert changes.at(record, 1.05 * torque) is known
    other = changes.at(record, 2.0 * torque)
    assert other is not known and not other
    assert changes.at(record, 0.95 * torque) is known
    for factor in (3.0, 4.0, 5.0):
        changes.at(record, factor * torque)
    assert changes.at(record, torque) is not known


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
