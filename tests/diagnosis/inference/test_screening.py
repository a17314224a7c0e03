"""Tests of screening: its data, its model and its starts."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.diagnosis import BaselineFit, fit_baseline, plant_of, prepare
from cc_mujoco.diagnosis._fit.problem import (
    CrossValidation,
    Fold,
    divided_samples,
    interleaved_folds,
)
from cc_mujoco.diagnosis._search import search as rounds
from cc_mujoco.diagnosis._search.candidates import (
    Candidate,
    Changes,
    Signature,
    decide,
    screen,
    signature_cosine,
)
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.native import FloatArray
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
    crossed = base.crossed._replace(division=part)
    (sign,) = rounds._Additions().screened(crossed, list(DRAG), Changes())
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


LIKE = 0.985
"""Cosine from which two signatures differ by less than effects do in their form."""


@pytest.fixture(scope="module")
def plain() -> BaselineFit:
    """Motions of a rig that hides nothing, the baseline fitted."""
    data = dataset(duration=1.5, chosen=(0, 1, 2))
    records, filtering = prepare(data, BENCH)
    return fit_baseline(data, plant_of(data, BENCH, records), filtering, 0)


@pytest.fixture(scope="module")
def every(plain: BaselineFit) -> list[Signature]:
    """Signatures of every effect of the library, from every start."""
    masks = divided_samples(interleaved_folds(plain.problem.plant.records))
    library, changes = plain.problem.plant.library.effects, Changes()
    given, found = dict(library), list[Signature]()
    for place in range(max(len(effect.starts) for effect in given.values())):
        here = [name for name, effect in given.items() if place < len(effect.starts)]
        for name in here:
            starts = (given[name].starts[place],)
            library[name] = replace(given[name], starts=starts)  # type: ignore[index]
        found += screen(plain.problem, plain.whole.x, masks, here, (), changes)
    library.update(given)  # type: ignore[attr-defined]
    return found


def like_pairs(every: list[Signature]) -> dict[tuple[str, str], list[Signature]]:
    """Return the pairs of effects of like signatures, at their likest starts."""
    likest: dict[tuple[str, str], tuple[float, list[Signature]]] = {}
    for one, other in itertools.permutations(every, 2):
        pair, cosine = (one.id, other.id), signature_cosine(one, other)
        if one.id != other.id and cosine > max(LIKE, likest.get(pair, (0.0,))[0]):
            likest[pair] = cosine, [one, other]
    return {pair: signs for pair, (_, signs) in likest.items()}


def test_every_effect_that_another_equals_competes_with_it(
    every: list[Signature],
) -> None:
    pairs = like_pairs(every)
    assert {
        ("pulley_eccentricity", "lever_geometry"),
        ("joint_gravity", "joint_stiffness"),
        ("asymmetric_friction", "torque_sensor_gain"),
    } <= pairs.keys()
    usual = {name for name, effect in EFFECTS.items() if not effect.rare}
    for one, other in pairs:
        accepted = [Candidate(one, None, 1.0, 6.0, "")]  # type: ignore[arg-type]
        rivals = [*usual, *rounds.resembling(accepted, (one,), [other])]
        assert EFFECTS[one].rare or other in rivals, (one, other)


def test_of_two_effects_of_like_signatures_neither_is_certain(
    plain: BaselineFit, every: list[Signature]
) -> None:
    """The first acts at four noise floors, and the second is fitted in its place."""
    noise = np.sqrt(plain.crossed.noise_mse)
    for (one, other), signs in like_pairs(every).items():
        mix, _, _ = np.linalg.svd(signs[0].basis.T @ signs[1].basis)
        made = signs[0].basis @ mix[:, 0]
        left = made - signs[1].basis @ (signs[1].basis.T @ made)
        size = 4.0 * noise * np.sqrt(made.size)
        before, best, worse = (
            with_errors(plain, np.hypot(noise, size * change))
            for change in (made, 0.0 * made, left)
        )
        assert before.misfit == pytest.approx(np.sqrt(17.0), rel=0.05)
        candidates = [
            Candidate(one, best, 0.9, 6.0, ""),
            Candidate(other, worse, 0.9, 6.0, ""),
        ]
        found = decide(before, candidates, signs)
        if one not in EFFECTS[other].generalises:
            assert set(found.rivals) == {one, other}, (one, other, worse.misfit)


def with_errors(plain: BaselineFit, errors: FloatArray) -> CrossValidation:
    """Return a cross-validation of a baseline with these errors over the noise."""
    crossed, start, found = plain.crossed, 0, []
    for known in crossed.errors:
        there = np.isfinite(known)
        own = np.full_like(known, np.nan)
        own[there] = errors[start : start + there.sum()]
        start += int(there.sum())
        found.append(own)
    return crossed._replace(errors=tuple(found))
