"""Search for effects to add one after another, by their gain on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Literal, NamedTuple

import numpy as np

from cc_mujoco._utils.compilation import FloatArray
from cc_mujoco.diagnosis._inference.folds import (
    CrossValidation,
    Fold,
    blocks,
    cross_validate,
)
from cc_mujoco.diagnosis._inference.numerics import refine_simulation
from cc_mujoco.diagnosis._inference.plausibility import (
    amplitude_indices,
    implausibility,
)
from cc_mujoco.diagnosis._inference.screening import (
    Changes,
    Signature,
    screen,
    signature_cosine,
)
from cc_mujoco.diagnosis._phrases import format_number
from cc_mujoco.diagnosis.effects import EFFECTS, EffectError, form_key
from cc_mujoco.errors import CableError

MAX_REFITTED = 6
"""Most candidates that are refitted by simulation in one round."""
MIN_LEADER_SHARE = 0.15
"""Share of the leader's explained error that a candidate needs to be refitted."""
MIN_PREDICTED_SHARE = 0.3
"""Least predicted reduction of a candidate, relative to the acceptance threshold."""
LOOKALIKE_COSINE = 0.9
"""Cosine beyond which screening cannot distinguish two signatures."""
FORM_ERROR_SHARE = 0.05
"""Share of what an effect explains, in every trial, that its form may be off by: right
names leave that much on rigs of other forms. Less does not part it from a lookalike."""
MAX_EXPLAINED_ERROR = 2.4
"""Error over the floor up to which a model explains the data, part by part."""
MAX_EFFECTS = 4
"""Most effects that are added."""
BOOTSTRAP_DRAWS = 400
"""Block bootstraps."""


@dataclass(frozen=True)
class Thresholds:
    """Thresholds for naming an effect; calibrated on rigs without any.

    How often the verdicts are right then: `validation.md` of `cc_mujoco.diagnosis`.

    Attributes:
        reduction: least relative reduction of the held-out squared error.
        misfit: RMS held-out error over the floor below which nothing is missing.
        floor: the same at which a model is at the floor, as far as that is known.
        certainty: least reduction over its standard error.
        agreement: largest spread of the amplitude between the folds over its mean.
        rival: a rival within this many standard errors of the winner is a tie.
    """

    reduction: float = 0.10
    misfit: float = 1.5
    floor: float = 1.15
    certainty: float = 2.0
    agreement: float = 1.0
    rival: float = 2.0


class Candidate(NamedTuple):
    """An effect refitted on top of the model so far.

    Attributes:
        id: of the effect.
        crossed: the wider model.
        reduction: of the held-out squared error, relative.
        certainty: the reduction over its standard error.
        reason: why it may not be named, or empty.
    """

    id: str
    crossed: CrossValidation
    reduction: float
    certainty: float
    reason: str


class Round(NamedTuple):
    """One step of the search.

    Attributes:
        candidates: refitted, the best first.
        added: the one that was added, or None.
        rivals: ids that do as well as the one added, itself first.
        confidence: share of bootstraps that the added one wins.
        before: the model that it was added to.
        parted: rivals that still helped when it had been added.
    """

    candidates: tuple[Candidate, ...]
    added: str | None
    rivals: tuple[str, ...]
    confidence: float
    before: CrossValidation
    parted: tuple[str, ...] = ()

    def tied(self, effects: Sequence[str], added: Sequence[str]) -> tuple[str, ...]:
        """Return tied ids, that of the model first; empty without it.

        A rival that still helped, so that it was added, too, is none; but of two that
        were and one of which had to go again, either may be the one that stayed.

        Args:
            effects: ids that are in the model.
            added: ids that were added at any time.
        """
        both = [name for name in added if name in (self.added, *self.parted)]
        kept = [name for name in both if name in effects]
        gone = [name for name in both if name not in effects]
        return (kept[0], *gone, *self.rivals[1:]) if kept else ()


class Search(NamedTuple):
    """Course of the search.

    Attributes:
        before: the baseline.
        after: the model with all effects that were added.
        rounds: steps.
        signatures: of every effect, on top of the baseline.
        shares: of the baseline's held-out squared error beyond the floor, what is left
            of it where an effect is taken out again and all else is refitted.
        changes: of torques by effects, kept.
        interrupted: True if the user stopped it, so that fewer effects were tried.
    """

    before: CrossValidation
    after: CrossValidation
    rounds: tuple[Round, ...]
    signatures: tuple[Signature, ...]
    shares: Mapping[str, float]
    changes: Changes
    interrupted: bool = False


class _Course(NamedTuple):
    """Effects that were added, before those that became redundant are dropped.

    Attributes:
        after: the model with all of them.
        rounds: steps.
        signatures: of every effect, on top of the baseline.
        known: models that have been fitted.
        changes: of torques by effects, kept.
        interrupted: True if the user stopped it.
    """

    after: CrossValidation
    rounds: tuple[Round, ...]
    signatures: tuple[Signature, ...]
    known: list[CrossValidation]
    changes: Changes
    interrupted: bool

    def drop_redundant(
        self,
        baseline: CrossValidation,
        division: Sequence[Fold],
        thresholds: Thresholds,
    ) -> Search:
        """Return the search, without the effects that later ones made redundant."""
        now, known = self.after, self.known
        if not self.interrupted:
            now = _prune(now, division, thresholds, known)
        shares = gap_shares(baseline, now, division, known)
        steps = _split_rivals(self.rounds)
        return Search(
            baseline, now, steps, self.signatures, shares, self.changes,
            self.interrupted,
        )  # fmt: skip


def search(
    baseline: CrossValidation,
    division: Sequence[Fold],
    ids: Sequence[str],
    thresholds: Thresholds,
    progress: Callable[[float, str], None] = lambda share, doing: None,
) -> Search:
    """Add effects while each is accepted, then drop those that became redundant.

    Where the user interrupts it, it ends with what was added until then.
    """
    course = _add_effects(baseline, division, ids, thresholds, progress)
    return course.drop_redundant(baseline, division, thresholds)


def names_found(
    baseline: CrossValidation,
    division: Sequence[Fold],
    ids: Sequence[str],
    thresholds: Thresholds,
) -> list[set[str]]:
    """Return the effects that a search finds, each with those it is in a tie with."""
    course = _add_effects(
        baseline, division, ids, thresholds, lambda share, doing: None
    )
    if course.interrupted:
        raise KeyboardInterrupt
    now = _prune(course.after, division, thresholds, course.known)
    tied = {step.added: set(step.rivals) for step in _split_rivals(course.rounds)}
    return [{name, *tied.get(name, ())} for name in now.problem.effects]


def _add_effects(
    baseline: CrossValidation,
    division: Sequence[Fold],
    ids: Sequence[str],
    thresholds: Thresholds,
    progress: Callable[[float, str], None],
    earlier: Sequence[Round] = (),
) -> _Course:
    """Add effects while each is accepted.

    Args:
        baseline: the model to begin with.
        division: of its data into folds.
        ids: of the effects.
        thresholds: of decisions.
        progress: called with the share done and what is being done.
        earlier: steps of a search for other effects; what was fitted in them is taken
            over as long as both add the same effects.
    """
    now, rounds, changes = baseline, [], Changes()
    known = [baseline]
    first: tuple[Signature, ...] = ()
    interrupted = False
    try:
        for count in range(MAX_EFFECTS):
            left = [name for name in ids if name not in now.problem.effects]
            # At the floor there is nothing to explain, and chance rewards anything; one
            # torque alone does not contradict what fits it a little better.
            both = len(now.problem.plant.instruments.rows) > 1
            hopeful = now.misfit > (thresholds.floor if both else thresholds.misfit)
            if first and not hopeful:
                break
            progress(count / MAX_EFFECTS, f"screening {len(left)} effects")
            signatures = _screen_folds(now, division, left, changes)
            first = first or tuple(signatures)
            place = next(
                (k for k, step in enumerate(earlier) if step.before is now),
                len(earlier),
            )
            same, following = earlier[place : place + 1], earlier[place + 1 :]
            candidates = _refit_candidates(
                now,
                division,
                signatures if hopeful else [],
                thresholds,
                _part_of(progress, count / MAX_EFFECTS, 1.0 / MAX_EFFECTS),
                {c.id: c for past in same for c in past.candidates},
            )
            step = _decide(now, candidates, signatures, thresholds)
            rounds.append(step)
            for candidate in candidates:  # derivatives take more room than the data
                if candidate.id not in step.rivals and candidate.crossed is not now:
                    candidate.crossed.problem.slopes.forget()
            if step.added is None:
                break
            known += [c.crossed for c in candidates if c.crossed is not now]
            if following and same[0].added == step.added:
                now = following[0].before
            else:
                now = with_own_noise_floor(
                    next(c.crossed for c in candidates if c.id == step.added), division
                )
            known.append(now)
    except KeyboardInterrupt:
        interrupted = True
        for crossed in known:  # their derivatives may be half taken
            crossed.problem.slopes.forget()
    return _Course(now, tuple(rounds), first, known, changes, interrupted)


def _part_of(
    progress: Callable[[float, str], None], start: float, length: float
) -> Callable[[float, str], None]:
    """Return a report of progress that covers a part of another one."""
    return lambda share, doing: progress(start + length * share, doing)


def _refit_candidates(
    now: CrossValidation,
    division: Sequence[Fold],
    signatures: Sequence[Signature],
    thresholds: Thresholds,
    progress: Callable[[float, str], None],
    refitted: Mapping[str, Candidate],
) -> list[Candidate]:
    """Return the effects that screening recommends, refitted, with their lookalikes.

    Those in `refitted` are not fitted again.
    """
    chosen = _choose_candidates(signatures, MIN_PREDICTED_SHARE * thresholds.reduction)
    candidates: list[Candidate] = []
    while chosen:
        for place, signature in enumerate(chosen):
            if _is_redundant(signature.id, candidates, thresholds):
                continue
            progress(place / len(chosen), f"refitting {signature.id}")
            candidates.append(
                refitted.get(signature.id)
                or _refit_forms(now, division, signature, thresholds)
            )
        chosen = _unrefitted_lookalikes(signatures, candidates, thresholds)
    return candidates


def search_rare(
    found: Search,
    division: Sequence[Fold],
    rare: Sequence[str],
    thresholds: Thresholds,
    progress: Callable[[float, str], None] = lambda share, doing: None,
) -> Search:
    """Return the search repeated with rare effects, where they explain more.

    They compete with the effects that were refitted before. They are searched only
    where the error is not explained without them.

    Args:
        found: search for the other effects.
        division: of its data into folds.
        rare: ids of the rare effects.
        thresholds: of decisions.
        progress: called with the share done and what is being done.
    """
    if not rare or found.interrupted or found.after.misfit <= MAX_EXPLAINED_ERROR:
        return found
    tried = {c.id for step in found.rounds for c in step.candidates}
    ids = [*sorted(tried), *rare]
    course = _add_effects(
        found.before, division, ids, thresholds, progress, found.rounds
    )
    if not set(rare) & {step.added for step in course.rounds}:
        return found._replace(interrupted=course.interrupted)
    wider = course.drop_redundant(found.before, division, thresholds)
    used = set(rare) & set(wider.after.problem.effects)
    if not used or wider.after.misfit >= found.after.misfit:
        return found
    again = {signature.id for signature in wider.signatures}
    others = tuple(sign for sign in found.signatures if sign.id not in again)
    return wider._replace(signatures=(*wider.signatures, *others))


def gap_shares(
    baseline: CrossValidation,
    now: CrossValidation,
    division: Sequence[Fold],
    known: Sequence[CrossValidation] = (),
) -> dict[str, float]:
    """Return the share of the gap that reopens without each effect, by id.

    Args:
        baseline: the model without any.
        now: the model.
        division: of both.
        known: models that have been fitted already.
    """
    inflation = baseline.problem.inflation
    beyond = max(baseline.misfit**2 - 1.0, 1e-12)
    left = now.misfit_by(inflation) ** 2
    slim = _reduced_models(now, division, known)
    return {
        name: (crossed.misfit_by(inflation) ** 2 - left) / beyond
        for name, crossed in slim.items()
    }


def with_own_noise_floor(
    crossed: CrossValidation, division: Sequence[Fold]
) -> CrossValidation:
    """Return the same by its own floor and weight, simulated finely enough for it."""
    masks = [record.free for record in crossed.problem.plant.records]
    place = np.mean([fit.x for fit in crossed.fits], axis=0)
    problem = crossed.problem.with_updated_floor(place, masks)
    while True:
        # A refit at every step between would cost as much as all that follows.
        while finer := refine_simulation(problem, place):
            problem = finer
        starts = [fit.x for fit in crossed.fits]
        crossed = cross_validate(problem, division, starts)
        place = np.mean([fit.x for fit in crossed.fits], axis=0)
        finer = refine_simulation(problem, place)
        if finer is None:
            return crossed
        problem = finer


def _split_rivals(rounds: Sequence[Round]) -> tuple[Round, ...]:
    """Return the rounds without the rivals that still help once the leader is added.

    They explain something else; only what the leader made useless is tied with it.
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
    """Return the signatures on the training data, at the mean of the folds' fits."""
    masks = [record.free for record in now.problem.plant.records]
    x = np.mean([fit.x for fit in now.fits], axis=0)
    return screen(now.problem, x, masks, ids, division, changes)


def _choose_candidates(
    signatures: Sequence[Signature], hopeful: float
) -> list[Signature]:
    """Return the candidates for a refit; `hopeful` is their least predicted share."""
    if not signatures:
        return []
    least = max(MIN_LEADER_SHARE * signatures[0].explained, hopeful)
    return [
        s
        for s in signatures
        if s.explained > 0.0 and max(s.explained, s.foreseen) >= least
    ][:MAX_REFITTED]


def _is_redundant(
    name: str, candidates: Sequence[Candidate], thresholds: Thresholds
) -> bool:
    """Return whether a special case of an effect has left nothing to explain."""
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
        and max(s.explained, s.foreseen) >= MIN_LEADER_SHARE * leader.reduction
        and s.explained > 0.0
        and not _is_redundant(s.id, candidates, thresholds)
        and are_confusable(sign, s)
    ]


def are_confusable(one: Signature, other: Signature) -> bool:
    """Return whether an effect is easily confused with another."""
    return (
        signature_cosine(one, other) > LOOKALIKE_COSINE
        or other.id in EFFECTS[one.id].confounded_with
    )


def _refit_forms(
    now: CrossValidation,
    division: Sequence[Fold],
    signature: Signature,
    thresholds: Thresholds,
) -> Candidate:
    """Return the effect refitted in the form that does best on held-out data.

    Forms other than the one that screens best are tried where that one is accepted.
    """
    best = _refit(now, division, signature, thresholds)
    key = form_key(signature.id)
    forms = range(len(now.problem.plant.library.effects[signature.id].forms))
    for form in forms:
        if best.reason or form == signature.start.get(key, 0.0):
            continue
        other = signature._replace(start={**signature.start, key: float(form)})
        candidate = _refit(now, division, other, thresholds)
        if not candidate.reason and candidate.reduction > best.reduction:
            best = candidate
    return best


def _refit(
    now: CrossValidation,
    division: Sequence[Fold],
    signature: Signature,
    thresholds: Thresholds,
) -> Candidate:
    wider = now.problem.with_effect(signature.id, signature.start)
    starts = [wider.placed(fit.x, signature.start) for fit in now.fits]
    try:
        crossed = cross_validate(wider, division, starts)
    except EffectError:
        raise
    except CableError as error:
        return Candidate(signature.id, now, 0.0, 0.0, str(error))
    old, better = blocks(now).sum(axis=1), blocks(crossed).sum(axis=1)
    gain = old - better
    reduction = float(gain.sum() / old.sum())
    scatter = float(np.std(gain) * np.sqrt(gain.size) / old.sum())
    certainty = reduction / max(scatter, 1e-12)
    reason = _rejection_reason(crossed, signature.id, reduction, certainty, thresholds)
    return Candidate(signature.id, crossed, reduction, certainty, reason)


def _rejection_reason(
    crossed: CrossValidation,
    name: str,
    reduction: float,
    certainty: float,
    thresholds: Thresholds,
) -> str:
    if reduction < thresholds.reduction:
        taken = round(reduction, 2) + 0.0  # no minus before a zero
        return f"takes {taken:.0%} of the error, less than {thresholds.reduction:.0%}"
    if certainty < thresholds.certainty:
        return f"its gain is {format_number(certainty, 1.0)} standard errors"
    effect = crossed.problem.plant.library.effects[name]
    parameters = {parameter.name: parameter for parameter in effect.parameters}
    spread, mean = amplitude_statistics(crossed, name)
    # Where more than a size is fitted, one parameter may stand in for another.
    alone = sum(not parameter.beside for parameter in parameters.values()) == 1
    if alone and spread > thresholds.agreement * mean:
        return "its size differs between the halves of the data"
    for tuned, x in zip(crossed.problem.tuned, crossed.fits[0].x, strict=True):
        if tuned.name in parameters and parameters[tuned.name].linear:
            if x >= tuned.high * 0.999:
                return f"{tuned.name} runs to its bound"
    return implausibility(
        crossed.problem, np.mean([fit.x for fit in crossed.fits], axis=0)
    )


def amplitude_statistics(crossed: CrossValidation, name: str) -> tuple[float, float]:
    """Return spread over folds and mean of an effect's amplitude, in scales."""
    index = amplitude_indices(crossed.problem, [name])
    found = np.array([fit.x[index] for fit in crossed.fits])
    if found.shape[0] < 2:
        return 0.0, float(np.linalg.norm(found[0]))
    spread = float(np.linalg.norm(found[0] - found[1]))
    return spread, float(np.linalg.norm(found.mean(axis=0)))


def _decide(
    now: CrossValidation,
    candidates: list[Candidate],
    signatures: Sequence[Signature],
    thresholds: Thresholds,
) -> Round:
    candidates.sort(key=lambda candidate: -candidate.reduction)
    able = [candidate for candidate in candidates if not candidate.reason]
    if not able:
        return Round(tuple(candidates), None, (), 0.0, now)
    sums = {c.id: blocks(c.crossed).sum(axis=1) for c in able}
    best = able[0]
    rivals, lookalikes = [best], []
    sign = {signature.id: signature for signature in signatures}
    for other in able[1:]:
        confused = are_confusable(sign[best.id], sign[other.id])
        pair = best.id, other.id
        why = tie_reason(now, best.crossed, other.crossed, pair, confused, thresholds)
        if why == "noise":
            rivals.append(other)
        elif why == "form":
            lookalikes.append(other)
    # Where the data do not tell, the one with fewer parameters comes first; the error
    # of a form is no reason to have the worse one in the model.
    rivals.sort(key=lambda rival: len(EFFECTS[rival.id].parameters))
    rivals += lookalikes
    leader = rivals[0].id
    wider = {c.id for c in rivals if leader in EFFECTS[c.id].generalises}
    rivals = [rival for rival in rivals if rival.id not in wider]
    sums = {name: own for name, own in sums.items() if name not in wider}
    names = tuple(rival.id for rival in rivals)
    sure = confidence(sums, leader)
    return Round(tuple(candidates), leader, names, sure, now)


def tie_reason(
    now: CrossValidation,
    best: CrossValidation,
    other: CrossValidation,
    names: tuple[str, str],
    confused: bool,
    thresholds: Thresholds,
) -> Literal["", "noise", "form"]:
    """Return why two effects are tied; "" if the data distinguish them.

    They do where one explains the data and the other does not, even if few moments
    show it, say those of little tension; but not of effects whose forms meet.

    Args:
        now: the model without either.
        best: with the one that does better.
        other: with the other one.
        names: their ids.
        confused: whether they are easily confused.
        thresholds: of decisions.
    """
    one, two = names
    meet = one in EFFECTS[two].form_of or two in EFFECTS[one].form_of
    if (
        best.misfit <= thresholds.misfit
        and other.misfit > MAX_EXPLAINED_ERROR
        and not meet
    ):
        return ""
    difference = blocks(other).sum(axis=1) - blocks(best).sum(axis=1)
    error = np.std(difference) * np.sqrt(difference.size)
    if difference.sum() < thresholds.rival * error:
        return "noise"
    return "form" if confused and parted_by_form(now, best, other) else ""


def parted_by_form(
    now: CrossValidation, best: CrossValidation, other: CrossValidation
) -> bool:
    """Decide whether two effects differ by no more than forms do, in every trial.

    No noise makes such a difference, so it may be sure; but what is called a spring
    softens, and what pulls like a weight is a rubber band.
    """
    sums: dict[str, FloatArray] = {}
    for place, record in enumerate(now.problem.plant.records):
        left = [float(np.nansum(c.errors[place] ** 2)) for c in (now, best, other)]
        sums[record.group] = sums.get(record.group, np.zeros(3)) + left
    table = np.array(list(sums.values()))
    taken, difference = table[:, 0] - table[:, 1], table[:, 2] - table[:, 1]
    # A trial in which little shows has next to nothing to be off by.
    usual = FORM_ERROR_SHARE * np.maximum(taken, taken.mean())
    return bool(np.all(difference <= usual))


def confidence(sums: dict[str, FloatArray], name: str, seed: int = 0) -> float:
    """Return the share of block bootstraps in which this candidate is the best."""
    random = np.random.default_rng(seed)
    table = np.array(list(sums.values()))
    place = list(sums).index(name)
    draws = random.integers(0, table.shape[1], (BOOTSTRAP_DRAWS, table.shape[1]))
    totals = table[:, draws].sum(axis=2)
    return float(np.mean(np.argmin(totals, axis=0) == place))


def _prune(
    now: CrossValidation,
    division: Sequence[Fold],
    thresholds: Thresholds,
    known: list[CrossValidation],
) -> CrossValidation:
    """Remove the effects that later ones have made redundant.

    What is fitted for that joins `known`, models that have been fitted already.
    """
    while True:
        slim = _reduced_models(now, division, known)
        known += slim.values()
        useless = (1.0 + 0.5 * thresholds.reduction) * now.held_out_mse
        idle = [
            name
            for name in now.problem.effects[:-1]
            if slim[name].held_out_mse <= useless
        ]
        if not idle:
            return now
        now = slim[idle[0]]


def _reduced_models(
    now: CrossValidation, division: Sequence[Fold], known: Sequence[CrossValidation]
) -> dict[str, CrossValidation]:
    """Return the model cross-validated without each of its effects, by id."""
    return {
        name: _without_effect(now, name, division, known)
        for name in now.problem.effects
    }


def _without_effect(
    now: CrossValidation,
    name: str,
    division: Sequence[Fold],
    known: Sequence[CrossValidation],
) -> CrossValidation:
    slim = now.problem.without(name)
    for crossed in known:
        same = crossed.problem.plant is slim.plant
        same = same and crossed.problem.floor is slim.floor
        same = same and crossed.problem.forms == slim.forms
        if same and set(crossed.problem.effects) == set(slim.effects):
            return crossed
    kept = [i for i, p in enumerate(now.problem.tuned) if p in slim.tuned]
    return cross_validate(slim, division, [fit.x[kept] for fit in now.fits])
