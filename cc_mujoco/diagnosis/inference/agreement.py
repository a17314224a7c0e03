"""Whether parts of the data name what the whole does.

Where a model stays far from the noise whatever is added, every part of the data rewards
what mends its own form errors, and resampling samples does not show it: the error is
the same at every repetition. So the search is repeated on parts that differ in load,
speed or pose, and what only some of them name is no finding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis.inference.baseline import BaselineFit
from cc_mujoco.diagnosis.inference.fitting import Masks
from cc_mujoco.diagnosis.inference.folds import Fold, cross_validate, interleaved_folds
from cc_mujoco.diagnosis.inference.records import Record
from cc_mujoco.diagnosis.inference.search import Search, Thresholds, search

REACHED = 2.0
"""Error over the floor up to which a model explains the data, part by part."""
LEAST = 4
"""Trials that can be parted."""
AGREED = 0.9
"""Share of the parts that must name what is called missing."""


def agreement(
    baseline_fit: BaselineFit,
    found: Search,
    limits: Thresholds,
    progress: Callable[[float, str], None] = lambda share, doing: None,
) -> Mapping[str, float]:
    """Share of the parts that name an effect or one it is in a tie with.

    Args:
        baseline_fit: of all data.
        found: on all data.
        limits: of decisions.
        progress: called with the share done and what is being done.

    Returns:
        By id; empty where the data are explained, or too few to be parted.
    """
    if not found.after.problem.effects or found.after.misfit <= REACHED:
        return {}
    records = baseline_fit.problem.plant.records
    parts = parted(records)
    tried = {c.id for step in found.rounds for c in step.candidates if not c.reason}
    rivals = {step.added: set(step.rivals) for step in found.rounds if step.added}
    votes = dict.fromkeys(found.after.problem.effects, 0)
    for place, part in enumerate(parts):
        progress(place / len(parts), f"searching part {place + 1} of {len(parts)}")
        named = _named(baseline_fit, part, sorted(tried), limits)
        for name in votes:
            votes[name] += bool(named & ({name} | rivals.get(name, set())))
    return {name: count / len(parts) for name, count in votes.items()} if parts else {}


def _named(
    baseline_fit: BaselineFit, part: Masks, ids: Sequence[str], limits: Thresholds
) -> set[str]:
    """What a part of the data names, ties included."""
    problem = baseline_fit.problem
    division = tuple(
        Fold(_both(fold.train, part), _both(fold.test, part))
        for fold in interleaved_folds(problem.plant.records)
    )
    start = [baseline_fit.whole.x] * len(division)
    found = search(cross_validate(problem, division, start), division, ids, limits)
    named = set(found.after.problem.effects)
    for step in found.rounds:
        if step.added in named:
            named |= set(step.rivals)
    return named


def _both(one: Masks, other: Masks) -> tuple[NDArray[np.bool_], ...]:
    return tuple(a & b for a, b in zip(one, other, strict=True))


def parted(records: Sequence[Record]) -> list[Masks]:
    """Halves of the trials that are not reserved, first and last, every other.

    Trials in the order of their names, which tell load and speed as a rule; repetitions
    stay together.
    """
    groups = sorted({r.group for r in records if r.free.any()})
    if len(groups) < LEAST:
        return []
    middle = len(groups) // 2
    halves = (groups[:middle], groups[middle:], groups[::2], groups[1::2])
    return [tuple(r.free & (r.group in half) for r in records) for half in halves]
