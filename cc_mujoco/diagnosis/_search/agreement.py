"""Check that parts of the data name the same effects as the whole.

Where a model stays far from the noise whatever is added, every part of the data rewards
what mends its own form errors, and resampling samples does not show it: the error is
the same at every repetition. So the search is repeated on parts that differ in load,
speed or pose, and what only some of them name is no finding.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.baseline import BaselineFit
from cc_mujoco.diagnosis._fit.fitting import Masks
from cc_mujoco.diagnosis._fit.folds import Fold, cross_validate, interleaved_folds
from cc_mujoco.diagnosis._progress import Progress, no_progress
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._search.acceptance import MAX_EXPLAINED_ERROR, Thresholds
from cc_mujoco.diagnosis._search.search import Search, names_found
from cc_mujoco.diagnosis.effects import EFFECTS

MIN_SPLIT_TRIALS = 4
"""Trials that can be parted."""
AGREEMENT_SHARE = 0.9
"""Share of the parts that must name what is called missing."""
TIE_SHARE = 0.5
"""Share of the parts from which on what they name in its place is tied with it."""


class Agreement(NamedTuple):
    """Support that parts of the data give to the effects the whole names.

    Attributes:
        shares: of the parts that name an effect or one it is in a tie with, by id;
            empty where the data are explained, or too few to be parted.
        rivals: what many parts name in its place or as well as it, by id.
        interrupted: True if the user stopped it before all parts were searched.
    """

    shares: Mapping[str, float]
    rivals: Mapping[str, tuple[str, ...]]
    interrupted: bool = False


def check_agreement(
    baseline_fit: BaselineFit,
    found: Search,
    limits: Thresholds,
    progress: Progress = no_progress,
) -> Agreement:
    """Repeat the search on parts of the data, with the candidates of the whole.

    Fits begin where those of the whole end, with their floor and numerical resolution.
    """
    effects = found.after.problem.effects
    if not effects or found.after.misfit <= MAX_EXPLAINED_ERROR:
        return Agreement({}, {})
    records = baseline_fit.problem.plant.records
    parts = split_trials(records)
    tried = {c.id for step in found.rounds for c in step.candidates if not c.reason}
    named: list[list[set[str]]] = []
    try:
        for place, part in enumerate(parts):
            progress(place / len(parts), f"searching part {place + 1} of {len(parts)}")
            named.append(
                _named_effects(baseline_fit, part, sorted(tried), limits, found)
            )
    except KeyboardInterrupt:
        baseline_fit.problem.slopes.forget()  # they may be half taken
    own = {step.added: set(step.rivals) for step in found.rounds if step.added}
    votes = count_votes(effects, own, named)
    return votes._replace(interrupted=len(named) < len(parts))


def count_votes(
    effects: Sequence[str],
    own: Mapping[str, set[str]],
    named: Sequence[Sequence[set[str]]],
) -> Agreement:
    """Return the agreement of the parts.

    Args:
        effects: that the whole names.
        own: what each was in a tie with there, by id.
        named: groups that a part cannot distinguish, for each effect that it names.
    """
    shares, rivals = {}, {}
    for name in effects:
        votes: Counter[str] = Counter()
        instead: set[str] = set()
        confused = set(EFFECTS[name].confounded_with)
        for groups in named:
            with_it = [group for group in groups if name in group]
            # Two that are easily confused, and of which the whole needs one only.
            matching = [group for group in groups if group & confused]
            votes.update(set().union(*(with_it or groups), *matching) - set(effects))
            if not with_it:  # even where the whole has both, this part has that one
                instead |= confused & set().union(*matching)
        often = {r for r, count in votes.items() if count >= TIE_SHARE * len(named)}
        rivals[name] = tuple(sorted(often | instead))
        either = {name, *own.get(name, ()), *rivals[name]}
        agreed = [groups for groups in named if either & set().union(*groups)]
        if named:
            shares[name] = len(agreed) / len(named)
    return Agreement(shares, rivals)


def _named_effects(
    baseline_fit: BaselineFit,
    part: Masks,
    ids: Sequence[str],
    limits: Thresholds,
    whole: Search,
) -> list[set[str]]:
    """Return the effects a part of the data names, each with its ties."""
    problem = baseline_fit.problem
    division = tuple(
        Fold(_intersect_masks(fold.train, part), _intersect_masks(fold.test, part))
        for fold in interleaved_folds(problem.plant.records)
    )
    start = [baseline_fit.whole.x] * len(division)
    crossed = cross_validate(problem, division, start)
    return names_found(crossed, division, ids, limits, whole)


def _intersect_masks(one: Masks, other: Masks) -> tuple[NDArray[np.bool_], ...]:
    return tuple(a & b for a, b in zip(one, other, strict=True))


def split_trials(records: Sequence[Record]) -> list[Masks]:
    """Return halves of the trials that are not reserved: first and last, every other.

    Trials in the order of their names, which tell load and speed as a rule; repetitions
    stay together. How the rig stood tells a weight from a spring and nothing else does,
    so a half without any trial of a tilt has them all.
    """
    tilts = {r.group: r.tilt for r in records if r.free.any()}
    groups = sorted(tilts)
    if len(groups) < MIN_SPLIT_TRIALS:
        return []
    middle = len(groups) // 2
    halves = (groups[:middle], groups[middle:], groups[::2], groups[1::2])
    parts: list[Masks] = []
    for half in halves:
        there = {tilts[group] for group in half}
        wanted = {*half, *(g for g, tilt in tilts.items() if tilt not in there)}
        parts.append(tuple(r.free & (r.group in wanted) for r in records))
    return parts
