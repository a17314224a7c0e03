"""Forward selection: add effects one after another, by their gain on held-out data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit.baseline import refine_simulation
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.folds import (
    CrossValidation,
    Fold,
    blocks,
    cross_validate,
    divided_samples,
)
from cc_mujoco.diagnosis._phrases import Progress, no_progress, part_of
from cc_mujoco.diagnosis._search.acceptance import (
    Candidate,
    Round,
    are_confusable,
    comparison_z,
    decide,
    rejection_reason,
)
from cc_mujoco.diagnosis._search.screening import Changes, Signature, screen
from cc_mujoco.diagnosis._thresholds import (
    FORM_ERROR_SHARE,
    MAX_EXPLAINED_ERROR,
    Limit,
    Thresholds,
)
from cc_mujoco.diagnosis.effects import EFFECTS, EffectError, form_key
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


def gap_shares(
    baseline: CrossValidation,
    now: CrossValidation,
    division: Sequence[Fold],
    known: list[CrossValidation],
) -> dict[str, float]:
    """Return the share of the gap that reopens without each effect, by id.

    Models that are fitted for that are added to `known`.
    """
    inflation = baseline.problem.inflation
    beyond = max(baseline.misfit**2 - 1.0, 1e-12)
    left = now.misfit_by(inflation) ** 2
    slim = {
        name: _without_effect(now, name, division, known)
        for name in now.problem.effects
    }
    known += slim.values()
    return {
        name: (crossed.misfit_by(inflation) ** 2 - left) / beyond
        for name, crossed in slim.items()
    }


def eliminate(
    now: CrossValidation,
    division: Sequence[Fold],
    known: list[CrossValidation],
) -> CrossValidation:
    """Remove the effects that later ones have made redundant.

    Models that are fitted for that are added to `known`.
    """
    while True:
        # The effect that was added last is needed: it was accepted on top of the rest.
        earlier = now.problem.effects[:-1]
        slim = [_without_effect(now, name, division, known) for name in earlier]
        known += slim
        useless = (1.0 + FORM_ERROR_SHARE) * now.held_out_mse
        redundant = [model for model in slim if model.held_out_mse <= useless]
        if not redundant:
            return now
        now = redundant[0]


def _without_effect(
    now: CrossValidation,
    name: str,
    division: Sequence[Fold],
    known: Sequence[CrossValidation],
) -> CrossValidation:
    slim = now.problem.without(name)
    kept = [i for i, p in enumerate(now.problem.tuned) if p in slim.tuned]
    starts = [fit.x[kept] for fit in now.fits]
    for crossed in known:
        old = crossed.problem
        if set(old.effects) != set(slim.effects) or old.forms != slim.forms:
            continue
        if old.plant is slim.plant and old.floor is slim.floor:
            return crossed
        starts = [slim.place(old.values(fit.x)) for fit in crossed.fits]
    slim = slim.sharing([crossed.problem for crossed in known])
    return cross_validate(slim, division, starts)


class Search(NamedTuple):
    """Course of the search.

    Attributes:
        before: the baseline.
        after: the model with all effects that were added.
        rounds: steps.
        signatures: of every effect, on top of the baseline.
        shares: share of the baseline's held-out squared error beyond the floor that
            remains where an effect is taken out again and all else is refitted.
        changes: cache of torque changes by effects.
        known: models that have been fitted.
        interrupted: True if the user stopped it, so that fewer effects were tried.
    """

    before: CrossValidation
    after: CrossValidation
    rounds: tuple[Round, ...]
    signatures: tuple[Signature, ...]
    shares: Mapping[str, float]
    changes: Changes
    known: tuple[CrossValidation, ...] = ()
    interrupted: bool = False

    @classmethod
    def without_effects(cls, baseline: CrossValidation) -> Search:
        return cls(baseline, baseline, (), (), {}, Changes(), (baseline,))


def drop_redundant(course: Search, division: Sequence[Fold]) -> Search:
    """Return the search without the effects that later ones made redundant.

    If it was or is interrupted, all effects stay.
    """
    baseline, now, known = course.before, course.after, list(course.known)
    interrupted = course.interrupted
    shares: Mapping[str, float] | None = None
    if not interrupted:
        try:
            left = eliminate(now, division, known)
            shares = gap_shares(baseline, left, division, known)
            now = left
        except KeyboardInterrupt:
            interrupted = True
            _forget_derivatives(known)
    if shares is None:
        shares = gap_shares(baseline, now, division, known)
    return course._replace(
        after=now,
        rounds=_split_rivals(course.rounds),
        shares=shares,
        known=tuple(known),
        interrupted=interrupted,
    )


def search(
    baseline: CrossValidation,
    division: Sequence[Fold],
    ids: Sequence[str],
    thresholds: Thresholds,
    progress: Progress = no_progress,
    rare: Sequence[str] = (),
) -> Search:
    """Add effects while each is accepted, then drop those that became redundant.

    If the user interrupts it, it ends with the effects added until then. Effects that
    are `rare` compete where an effect of `ids` is accepted that they resemble.
    """
    course = _add_effects(baseline, division, ids, thresholds, progress, rare=rare)
    return drop_redundant(course, division)


def names_found(
    baseline: CrossValidation,
    division: Sequence[Fold],
    ids: Sequence[str],
    thresholds: Thresholds,
    whole: Search | None = None,
) -> list[set[str]]:
    """Return the effects that a search finds, each with those it is tied with.

    `division` is that of part of the data into folds. A model of `whole`, the search in
    all data, gives the same model of a part its floor, numerical resolution and start
    values.
    """
    course = _add_effects(
        baseline,
        division,
        ids,
        thresholds,
        no_progress,
        whole=whole,
        changes=whole.changes if whole else None,
    )
    if course.interrupted:
        raise KeyboardInterrupt
    now = eliminate(course.after, division, list(course.known))
    tied = {step.added: set(step.rivals) for step in _split_rivals(course.rounds)}
    return [{name, *tied.get(name, ())} for name in now.problem.effects]


def _add_effects(
    baseline: CrossValidation,
    division: Sequence[Fold],
    ids: Sequence[str],
    thresholds: Thresholds,
    progress: Progress,
    earlier: Sequence[Round] = (),
    whole: Search | None = None,
    changes: Changes | None = None,
    rare: Sequence[str] = (),
) -> Search:
    now, rounds = baseline, []
    changes = changes or Changes()
    known = [baseline]
    first: tuple[Signature, ...] = ()
    interrupted = False
    try:
        for count in range(Limit.max_effects):
            left = [name for name in ids if name not in now.problem.effects]
            # At the floor there is nothing to explain, and chance rewards any effect;
            # one torque alone does not contradict an effect that fits it a little
            # better.
            both = len(now.problem.plant.instruments.rows) > 1
            hopeful = now.misfit > (thresholds.floor if both else thresholds.misfit)
            if first and not hopeful:
                break
            progress(count / Limit.max_effects, f"screening {len(left)} effects")
            signatures = _screen_folds(now, division, left, changes)
            first = first or tuple(signatures)
            place = next(
                (k for k, step in enumerate(earlier) if step.before is now),
                len(earlier),
            )
            same, following = earlier[place : place + 1], earlier[place + 1 :]
            part = part_of(progress, count / Limit.max_effects, 1.0 / Limit.max_effects)
            refitted = {c.id: c for past in same for c in past.candidates}
            candidates = _refit_candidates(
                now, division, signatures if hopeful else [], thresholds, part,
                refitted, whole,
            )  # fmt: skip
            if names := resembling(candidates, (*left, *now.problem.effects), rare):
                more = _screen_folds(now, division, names, changes)
                least = Limit.min_rival_share * signatures[0].explained
                more = [
                    sign
                    for sign in more
                    if max(sign.explained, sign.foreseen) >= least
                    and not _is_redundant(sign.id, candidates, thresholds)
                ]
                candidates += _refit_candidates(
                    now, division, more, thresholds, part, refitted, whole
                )
                signatures = [*signatures, *more]
            step = decide(now, candidates, signatures, thresholds)
            rounds.append(step)
            for candidate in candidates:  # derivatives take more room than the data
                if candidate.id not in step.rivals and candidate.crossed is not now:
                    candidate.crossed.problem.slopes.forget()
            known += [c.crossed for c in candidates if c.crossed is not now]
            if step.added is None:
                break
            if following and same[0].added == step.added:
                now = following[0].before
            else:
                wider = next(c.crossed for c in candidates if c.id == step.added)
                now = _begin_round(wider, division, whole)
            known.append(now)
    except KeyboardInterrupt:
        interrupted = True
        _forget_derivatives(known)
    return Search(
        baseline, now, tuple(rounds), first, {}, changes, tuple(known), interrupted
    )


def resembling(
    candidates: Sequence[Candidate], present: Sequence[str], rare: Sequence[str]
) -> list[str]:
    """Return the rare effects, none of them `present`, that accepted ones equal."""
    accepted = {c.id for c in candidates if not c.reason}
    return [
        name
        for name in rare
        if name not in present and accepted.intersection(EFFECTS[name].resembles)
    ]


def _forget_derivatives(known: Sequence[CrossValidation]) -> None:
    """Drop the derivatives of models: an interruption may have left them half taken."""
    for crossed in known:
        crossed.problem.slopes.forget()


def _refit_candidates(
    now: CrossValidation,
    division: Sequence[Fold],
    signatures: Sequence[Signature],
    thresholds: Thresholds,
    progress: Progress,
    refitted: Mapping[str, Candidate],
    whole: Search | None,
) -> list[Candidate]:
    """Return the effects that screening recommends, refitted, with their lookalikes.

    Effects in `refitted` are not fitted again; for `whole` see `names_found`.
    """
    chosen = _choose_candidates(
        signatures, Limit.min_predicted_share * thresholds.reduction
    )
    candidates: list[Candidate] = []
    while chosen:
        for place, signature in enumerate(chosen):
            if _is_redundant(signature.id, candidates, thresholds):
                continue
            progress(place / len(chosen), f"refitting {signature.id}")
            candidates.append(
                refitted.get(signature.id)
                or _refit_like(now, division, signature.id, thresholds, whole)
                or _refit_forms(now, division, signature, thresholds)
            )
        chosen = _unrefitted_lookalikes(signatures, candidates, thresholds)
    return candidates


def search_rare(
    found: Search,
    division: Sequence[Fold],
    rare: Sequence[str],
    thresholds: Thresholds,
    progress: Progress = no_progress,
) -> Search:
    """Return the search repeated with rare effects, where they explain more.

    They compete with the effects that were refitted before. They are searched only
    where the error is not explained without them.
    """
    if not rare or found.interrupted or found.after.misfit <= MAX_EXPLAINED_ERROR:
        return found
    tried = {c.id for step in found.rounds for c in step.candidates}
    ids = list(dict.fromkeys([*sorted(tried), *rare]))
    course = _add_effects(
        found.before,
        division,
        ids,
        thresholds,
        progress,
        found.rounds,
        changes=found.changes,
    )
    if not set(rare) & {step.added for step in course.rounds}:
        return found._replace(interrupted=course.interrupted)
    wider = drop_redundant(course, division)
    used = set(rare) & set(wider.after.problem.effects)
    if not used or wider.after.misfit >= found.after.misfit:
        return found._replace(interrupted=wider.interrupted)
    again = {signature.id for signature in wider.signatures}
    others = tuple(sign for sign in found.signatures if sign.id not in again)
    return wider._replace(signatures=(*wider.signatures, *others))


def with_own_noise_floor(
    crossed: CrossValidation, division: Sequence[Fold]
) -> CrossValidation:
    """Return the model by its own floor and weight, simulated finely enough for it."""
    masks = divided_samples(division)
    place = np.mean([fit.x for fit in crossed.fits], axis=0)
    problem = crossed.problem.with_updated_floor(place, masks)
    # Trials that are reserved are predicted by the same simulation.
    reserved = [record.reserved for record in problem.plant.records]
    counts = [a | b for a, b in zip(masks, reserved, strict=True)]
    while True:
        # A refit at every step between would cost as much as the rest of the search.
        while finer := refine_simulation(problem, place, counts):
            problem = finer
        starts = [fit.x for fit in crossed.fits]
        crossed = cross_validate(problem, division, starts)
        place = np.mean([fit.x for fit in crossed.fits], axis=0)
        finer = refine_simulation(problem, place, counts)
        if finer is None:
            return crossed
        problem = finer


def _begin_round(
    crossed: CrossValidation, division: Sequence[Fold], whole: Search | None
) -> CrossValidation:
    """Return `with_own_noise_floor`, or by the floor of the same model of all data."""
    models = [whole.after, *(step.before for step in whole.rounds)] if whole else []
    for model in models:
        if model.problem.tuned == crossed.problem.tuned:
            problem = model.problem.sharing([model.problem])
            return cross_validate(problem, division, [fit.x for fit in crossed.fits])
    return with_own_noise_floor(crossed, division)


def _split_rivals(rounds: Sequence[Round]) -> tuple[Round, ...]:
    """Return the rounds without the rivals that still help once the leader is added.

    They explain something else; only effects that the leader made useless are tied with
    it.
    """
    found = []
    for step, after in zip_longest(rounds, rounds[1:]):
        helpful = {c.id for c in after.candidates if not c.reason} if after else set()
        rivals = tuple(name for name in step.rivals if name not in helpful)
        parted = tuple(name for name in step.rivals if name in helpful)
        found.append(step._replace(rivals=rivals, parted=parted))
    return tuple(found)


def _screen_folds(
    now: CrossValidation, division: Sequence[Fold], ids: Sequence[str], changes: Changes
) -> list[Signature]:
    """Return the signatures on the divided data, at the mean of the folds' fits."""
    masks = divided_samples(division)
    x = np.mean([fit.x for fit in now.fits], axis=0)
    return screen(now.problem, x, masks, ids, division, changes)


def _choose_candidates(
    signatures: Sequence[Signature], hopeful: float
) -> list[Signature]:
    """Return the candidates for a refit; `hopeful` is their least predicted share."""
    if not signatures:
        return []
    least = max(Limit.min_leader_share * signatures[0].explained, hopeful)
    return [
        s
        for s in signatures
        if s.explained > 0.0 and max(s.explained, s.foreseen) >= least
    ][: Limit.max_refitted]


def _is_redundant(
    name: str, candidates: Sequence[Candidate], thresholds: Thresholds
) -> bool:
    return any(
        c.id in EFFECTS[name].generalises
        and not c.reason
        and c.crossed.misfit <= thresholds.misfit
        for c in candidates
    )


def _unrefitted_lookalikes(
    signatures: Sequence[Signature],
    candidates: Sequence[Candidate],
    thresholds: Thresholds,
) -> list[Signature]:
    """Return the effects that resemble the best candidate and were not refitted.

    Signatures are of first order, and screening by them may rank lookalikes wrongly.
    """
    leader = max(candidates, key=lambda candidate: candidate.reduction)
    if leader.reduction < thresholds.reduction:
        return []
    sign = next(s for s in signatures if s.id == leader.id)
    done = {candidate.id for candidate in candidates}
    return [
        s
        for s in signatures
        if s.id not in done
        and max(s.explained, s.foreseen) >= Limit.min_leader_share * leader.reduction
        and s.explained > 0.0
        and not _is_redundant(s.id, candidates, thresholds)
        and are_confusable(sign, s)
    ]


def _refit_forms(
    now: CrossValidation,
    division: Sequence[Fold],
    signature: Signature,
    thresholds: Thresholds,
) -> Candidate:
    """Return the effect refitted in the form that does best on held-out data.

    Other forms are tried where the one that screens best is accepted. Where that leaves
    the error unexplained, so are the sizes that the effect starts with, if they are
    several: far from the truth a size by first order may lead to another minimum.
    """
    best = _refit_signature(now, division, signature, thresholds)
    if best.reason:
        return best
    effect = now.problem.plant.library.effects[signature.id]
    key, given = form_key(signature.id), signature.start
    others = [
        {**given, key: float(form)}
        for form in range(len(effect.forms))
        if form != given.get(key, 0.0)
    ]
    if best.crossed.misfit > MAX_EXPLAINED_ERROR:
        sizes = [parameter.name for parameter in effect.parameters if parameter.linear]
        own = {tuple(start[name] for name in sizes) for start in effect.starts}
        if len(own) > 1:
            others += [
                given | dict(zip(sizes, each, strict=True)) for each in sorted(own)
            ]
    for start in others:
        other = signature._replace(start=start)
        candidate = _refit_signature(now, division, other, thresholds)
        if not candidate.reason and candidate.reduction > best.reduction:
            best = candidate
    return best


def _refit_signature(
    now: CrossValidation,
    division: Sequence[Fold],
    signature: Signature,
    thresholds: Thresholds,
) -> Candidate:
    wider = now.problem.with_effect(signature.id, signature.start)
    starts = [wider.placed(fit.x, signature.start) for fit in now.fits]
    return _refit(now, division, wider, starts, thresholds)


def _refit_like(
    now: CrossValidation,
    division: Sequence[Fold],
    name: str,
    thresholds: Thresholds,
    whole: Search | None,
) -> Candidate | None:
    """Return the effect refitted from its place in a model of all data, if any."""
    for model in whole.known if whole else ():
        known = model.problem
        if known.effects != (*now.problem.effects, name):
            continue
        if known.tuned[: len(now.problem.tuned)] == now.problem.tuned:
            wider = replace(
                now.problem,
                tuned=known.tuned,
                effects=known.effects,
                forms=known.forms,
            ).sharing([known])
            start = np.mean([fit.x for fit in model.fits], axis=0)
            starts = [start] * len(division)
            return _refit(now, division, wider, starts, thresholds)
    return None


def _refit(
    now: CrossValidation,
    division: Sequence[Fold],
    wider: Problem,
    starts: Sequence[FloatArray],
    thresholds: Thresholds,
) -> Candidate:
    """Return the last effect of a wider model, refitted."""
    name = wider.effects[-1]
    try:
        crossed = cross_validate(wider, division, starts)
    except EffectError:
        raise
    except CableError as error:
        return Candidate(name, now, 0.0, 0.0, str(error))
    old, better = blocks(now).sum(axis=1), blocks(crossed).sum(axis=1)
    whole = float(old.sum())
    reduction = 1.0 - float(better.sum()) / whole
    z = comparison_z(better, old, whole)
    reason = rejection_reason(crossed, name, reduction, z, thresholds)
    return Candidate(name, crossed, reduction, z, reason)
