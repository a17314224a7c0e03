"""Search for the effects that explain the error, and its test on parts of the data.

Where a model stays far from the noise whatever is added, every part of the data rewards
effects that mend its own form errors, and resampling samples does not show it: the
error is the same at every repetition. So the search is repeated on parts that differ in
load, speed or pose, and an effect that only some of them name is not accepted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.baseline import BaselineFit, Held, Holdout
from cc_mujoco.diagnosis._fit.fit import Options
from cc_mujoco.diagnosis._fit.fitting import Masks, Problem, fit, fit_until_settled
from cc_mujoco.diagnosis._fit.folds import Fold, cross_validate, interleaved_folds
from cc_mujoco.diagnosis._fit.intervals import (
    Spread,
    estimates,
    fit_covariance,
    noise_covariance,
)
from cc_mujoco.diagnosis._fit.plausibility import doubtful_effects, is_ordinary
from cc_mujoco.diagnosis._fit.trial_constants import (
    agreement_shares,
    compare_occasions,
    random_constants,
    trial_constants,
    trial_ordinates,
)
from cc_mujoco.diagnosis._phrases import Progress, no_progress, part_of
from cc_mujoco.diagnosis._rig.occasions import occasions_of
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._search.rounds import (
    Search,
    gap_shares,
    names_found,
    search,
    search_rare,
)
from cc_mujoco.diagnosis._thresholds import MAX_EXPLAINED_ERROR, Limit, Thresholds
from cc_mujoco.diagnosis._verdict import FoundEffect, Occasions
from cc_mujoco.diagnosis.effects import EFFECTS, usual_effects
from cc_mujoco.estimation._least_squares import Estimate, Fit
from cc_mujoco.native import FloatArray


@dataclass(frozen=True)
class Found:
    """Effects that explain the error, and the model that all data support.

    Attributes:
        search: the rounds, ending with the model.
        problem: the model.
        x: where it was fitted to all data.
        held: its predictions of held-out data.
        estimated: value and interval of every parameter.
        effects: of the model, in the order in which they were added.
        ties: groups of ids that the data do not distinguish, of missing effects.
        occasions: comparison of occasions, None where there is one.
        by_trial: sentence on what constants by trial explain, or ""; effects are not
            searched then.
    """

    search: Search
    problem: Problem
    x: FloatArray
    held: Held
    estimated: Mapping[str, Estimate]
    effects: tuple[FoundEffect, ...]
    ties: tuple[tuple[str, ...], ...]
    occasions: Occasions | None
    by_trial: str

    @property
    def missing(self) -> tuple[str, ...]:
        """Ids of the effects that are called missing."""
        return tuple(effect.id for effect in self.effects if effect.missing)


def search_effects(fitted: BaselineFit, settings: Options, progress: Progress) -> Found:
    """Find the effects that explain the error, and fit their model to all data."""
    limits = settings.thresholds
    records = fitted.problem.plant.records
    several = len(occasions_of(records)) > 1
    by_trial = "" if several else _random_by_trial(fitted)
    found = (
        Search.without_effects(fitted.crossed)
        if by_trial
        else _search(fitted, settings, progress)
    )
    # Occasions are better parts than halves, see `compare_occasions`.
    agreed = Agreement({}, {})
    if not (found.interrupted or several):
        agreed = check_agreement(fitted, found, limits, part_of(progress, 0.7, 0.12))
    if agreed.interrupted:
        found = found._replace(interrupted=True)
    progress(0.82, "fitting the result to all data")
    model = _drop_doubtful(fitted, found, settings.seed, progress)
    problem, x = model.problem, model.x
    estimated = estimates(problem, x, model.spread)
    compared = compare_occasions(problem, x, estimated)
    shares = agreement_shares(compared) if compared else agreed.shares
    found = final_search(found, fitted, model)
    added = [step.added for step in found.rounds if step.added]
    groups = {
        rivals[0]: rivals
        for step in found.rounds
        for rivals in [_extend_tie(step.tied(problem.effects, added), agreed.rivals)]
        if len(rivals) > 1
    }
    effects = _found_effects(found, problem, x, estimated, shares, groups)
    missing = [effect.id for effect in effects if effect.missing]
    ties = tuple(rivals for name, rivals in groups.items() if name in missing)
    return Found(
        found, problem, x, model.held, estimated, effects, ties, compared, by_trial
    )


def _random_by_trial(fitted: BaselineFit) -> str:
    """Return the constant that differs at random by trial and explains all, or ""."""
    misfit = fitted.crossed.misfit
    if misfit <= MAX_EXPLAINED_ERROR:
        return ""
    constants = trial_constants(fitted.problem, fitted.whole.x)
    names = constants[0].trials if constants else ()
    along = trial_ordinates(fitted.problem, names, fitted.temperatures)
    return random_constants(constants, along, misfit)


def _search(fitted: BaselineFit, settings: Options, progress: Progress) -> Search:
    able = fitted.problem.plant.library.effects
    wanted = settings.ids or dict.fromkeys([*usual_effects(), *settings.requested])
    names = tuple(name for name in wanted if name in able)
    rare = () if settings.ids else tuple(name for name in able if name not in names)
    division = interleaved_folds(fitted.problem.plant.records)
    limits = settings.thresholds
    usual, of_rare = part_of(progress, 0.2, 0.4), part_of(progress, 0.6, 0.1)
    found = search(fitted.crossed, division, names, limits, usual, rare)
    return search_rare(found, division, rare, limits, of_rare)


def _extend_tie(
    rivals: tuple[str, ...], others: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """Return the tie, with the effects that parts of the data name instead."""
    more = others.get(rivals[0], ()) if rivals else ()
    return (*rivals, *(name for name in more if name not in rivals))


class CheckedModel(NamedTuple):
    """Result of a search once it has been fitted to all data.

    Attributes:
        problem: the model.
        x: where it was fitted to all data.
        spread: of that place.
        held: its predictions of held-out data.
    """

    problem: Problem
    x: FloatArray
    spread: Spread
    held: Held


def _drop_doubtful(
    baseline_fit: BaselineFit, found: Search, seed: int, progress: Progress
) -> CheckedModel:
    """Return the model of the search without effects that may be absent.

    An effect may be absent if its interval contains 0. Where several can replace each
    other, the one without which the rest explain most is dropped. All are dropped where
    held-out data do not support them.
    """
    problem = found.after.problem
    counts = [record.counts for record in problem.plant.records]
    start = np.mean([f.x for f in found.after.fits], axis=0)
    holding = Holdout(baseline_fit, seed)
    while problem.effects:
        x = fit_until_settled(problem, start, counts).x
        idle = doubtful_effects(problem, x, *noise_covariance(problem, x, counts))
        if not idle:
            wide = fit_covariance(problem, x, counts)
            idle = doubtful_effects(problem, x, *wide)
        if not idle:
            progress(0.86, "predicting trials that were held out")
            held = holding.out(problem, x)
            if held is None:
                break
            return CheckedModel(problem, x, wide, held)
        slimmer = [_fit_without(found, problem, x, name, counts) for name in idle]
        problem, (start, _) = min(slimmer, key=lambda model: model[1].cost)
    problem = baseline_fit.problem
    x = fit_until_settled(problem, baseline_fit.whole.x, counts).x
    held = holding.out(problem, x)
    assert held is not None
    return CheckedModel(problem, x, fit_covariance(problem, x, counts), held)


def _fit_without(
    found: Search, problem: Problem, x: FloatArray, name: str, counts: Masks
) -> tuple[Problem, Fit]:
    slim = problem.without(name).sharing([c.problem for c in found.known])
    start = x[[k for k, p in enumerate(problem.tuned) if p in slim.tuned]]
    return slim, fit(slim, start, counts)


def final_search(
    found: Search, baseline_fit: BaselineFit, model: CheckedModel
) -> Search:
    """Return a search that ends with the rest of its model.

    Three effects may each be redundant given the two others. Once one of them is
    dropped, the shares and the error are computed again.
    """
    problem, x = model.problem, model.x
    if problem.effects == found.after.problem.effects:
        return found
    if not problem.effects:
        return found._replace(after=found.before, shares={})
    division = interleaved_folds(problem.plant.records)
    now = cross_validate(problem, division, [x] * len(division))
    shares = gap_shares(baseline_fit.crossed, now, division, [*found.known])
    return found._replace(after=now, shares=shares)


def _found_effects(
    found: Search,
    problem: Problem,
    x: FloatArray,
    estimated: Mapping[str, Estimate],
    agreed: Mapping[str, float],
    groups: Mapping[str, tuple[str, ...]],
) -> tuple[FoundEffect, ...]:
    sure = {step.added: step.confidence for step in found.rounds}
    shares = found.shares
    beyond = max(found.before.misfit**2 - 1.0, 0.0)
    own = {name: math.sqrt(max(shares[name], 0.0) * beyond) for name in problem.effects}
    left = found.after.misfit_by(found.before.problem.inflation)
    return tuple(
        FoundEffect(
            name,
            {
                parameter.name: estimated[parameter.name]
                for parameter in problem.plant.library.effects[name].parameters
            },
            sure.get(name, 0.0),
            share=shares[name],
            refinement=only_refines(name, shares, own, left),
            agreement=agreed.get(name, 1.0),
            disputed=agreed.get(name, 1.0) < Limit.agreement_share,
            ordinary=is_ordinary(problem, x, name),
            own=own[name],
            rivals=tuple(rival for rival in groups.get(name, ()) if rival != name),
            form=problem.form(name),
        )
        for name in problem.effects
    )


class Agreement(NamedTuple):
    """Support that parts of the data give to the effects of the whole.

    Attributes:
        shares: share of the parts that name an effect or one it is tied with, by id;
            empty where the data are explained, or too few to be divided.
        rivals: effects that many parts name in its place or as well as it, by id.
        interrupted: True if the user stopped it before all parts were searched.
    """

    shares: Mapping[str, float]
    rivals: Mapping[str, tuple[str, ...]]
    interrupted: bool = False


def only_refines(
    name: str, shares: Mapping[str, float], own: Mapping[str, float], left: float
) -> bool:
    """Return whether an effect of a model only refines the others.

    An effect that closes little of the gap is a finding nevertheless where it explains
    half of the squared error that the model would have without it, and that is clearly
    more than noise; unless a larger effect is easily confused with it, whose form it
    may mend.
    """
    if shares[name] >= min(Limit.max_refinement_share, max(shares.values())):
        return False
    mends = any(
        shares[other] > shares[name] and EFFECTS[name].confused(EFFECTS[other])
        for other in shares
    )
    return mends or own[name] < max(Limit.finding_error, left)


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
    """Return the agreement of the parts with the effects of the whole.

    `own` has the effects each is tied with there, by id; `named` the groups that a part
    cannot distinguish, for each effect that it names.
    """
    shares, rivals = {}, {}
    for name in effects:
        votes: Counter[str] = Counter()
        instead: set[str] = set()
        confused = set(EFFECTS[name].confounded_with)
        for groups in named:
            with_it = [group for group in groups if name in group]
            # Two effects that are easily confused, of which the whole needs only one.
            matching = [group for group in groups if group & confused]
            votes.update(set().union(*(with_it or groups), *matching) - set(effects))
            if not with_it:  # even where the whole has both, this part has that one
                instead |= confused & set().union(*matching)
        often = {
            r for r, count in votes.items() if count >= Limit.tie_share * len(named)
        }
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
    """Return the effects that a part of the data names, each with its ties."""
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

    Trials are in the order of their names, which usually follow load and speed;
    repetitions stay together. Only the tilt of the rig distinguishes a weight from a
    spring, so a half without any trial of a tilt has them all.
    """
    tilts = {r.group: r.tilt for r in records if r.free.any()}
    groups = sorted(tilts)
    if len(groups) < Limit.min_split_trials:
        return []
    middle = len(groups) // 2
    halves = (groups[:middle], groups[middle:], groups[::2], groups[1::2])
    parts: list[Masks] = []
    for half in halves:
        there = {tilts[group] for group in half}
        wanted = {*half, *(g for g, tilt in tilts.items() if tilt not in there)}
        parts.append(tuple(r.free & (r.group in wanted) for r in records))
    return parts
