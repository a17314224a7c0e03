"""Search for the effects that explain the error, and its test on parts of the data.

Effects are added one after another, by their gain on held-out data.

Where every model stays far from the noise, every part of the data rewards effects that
compensate the model's own form errors. Bootstraps do not show it, as the error is the
same at every repetition. So the search is repeated on parts that differ in load, speed
or pose, and an effect that only some parts name is not accepted.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit import intervals, trials
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.fit import BaselineFit
from cc_mujoco.diagnosis._fit.intervals import Spread
from cc_mujoco.diagnosis._fit.problem import CrossValidation, Fold, Masks, Problem
from cc_mujoco.diagnosis._fit.trials import TrialDifferences
from cc_mujoco.diagnosis._phrases import Progress, no_progress, part_of
from cc_mujoco.diagnosis._rig.records import Arrays, Record
from cc_mujoco.diagnosis._search import candidates as screening
from cc_mujoco.diagnosis._search.candidates import Candidate, Changes, Round, Signature
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import FoundEffect, Occasions
from cc_mujoco.diagnosis.effects import EFFECTS, usual_effects
from cc_mujoco.diagnosis.effects._effect import EffectError, form_key
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._least_squares import Estimate
from cc_mujoco.native import FloatArray


def gap_shares(
    baseline: CrossValidation, now: CrossValidation, known: list[CrossValidation]
) -> dict[str, float]:
    """Return the share of the gap that removing each effect opens; extend `known`."""
    inflation, names = baseline.problem.inflation, now.problem.effects
    beyond = max(baseline.misfit**2 - 1.0, 1e-12)
    left = now.misfit_by(inflation) ** 2
    slim = [_without_effect(now, name, known) for name in names]
    known += slim
    shares = [(each.misfit_by(inflation) ** 2 - left) / beyond for each in slim]
    return dict(zip(names, shares, strict=True))


def eliminate(now: CrossValidation, known: list[CrossValidation]) -> CrossValidation:
    """Return the model without redundant effects; append fitted models to `known`."""
    while True:
        # The effect that was added last is needed: it was accepted on top of the rest.
        earlier = now.problem.effects[:-1]
        slim = [_without_effect(now, name, known) for name in earlier]
        known += slim
        useless = (1.0 + Limit.form_error_share) * now.held_out_mse
        redundant = [model for model in slim if model.held_out_mse <= useless]
        if not redundant:
            return now
        now = redundant[0]


def _without_effect(
    now: CrossValidation, name: str, known: Sequence[CrossValidation]
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
    return fitting.cross_validate(slim, now.division, starts)


class Search(NamedTuple):
    before: CrossValidation  # the baseline
    after: CrossValidation  # the model with all effects that were added
    rounds: tuple[Round, ...]  # steps
    signatures: tuple[Signature, ...]  # of every effect, on top of the baseline
    # Share of the squared error beyond the floor that returns without each effect
    shares: Mapping[str, float]
    changes: Changes  # cache of torque changes by effects
    known: tuple[CrossValidation, ...] = ()  # models that have been fitted
    # True if the user stopped it, so that fewer effects were tried
    interrupted: bool = False


def drop_redundant(course: Search) -> Search:
    """Return the search without redundant effects, unless it was interrupted."""
    known = list(course.known)
    shares: Mapping[str, float] = {}
    now, interrupted = course.after, course.interrupted
    try:
        if not interrupted:
            now = eliminate(course.after, known)
            shares = gap_shares(course.before, now, known)
    except KeyboardInterrupt:
        now, interrupted = course.after, True
        _forget_derivatives(known)
    shares = shares or gap_shares(course.before, now, known)
    course = course._replace(after=now, shares=shares, known=tuple(known))
    rounds = _split_rivals(course.rounds)
    return course._replace(rounds=rounds, interrupted=interrupted)


def search(
    baseline: CrossValidation,
    ids: Sequence[str],
    progress: Progress = no_progress,
    rare: Sequence[str] = (),
) -> Search:
    """Add effects while each is accepted, then drop those that became redundant.

    An interrupted search ends with the effects added until then. A `rare` effect
    competes where an effect of `ids` that it resembles is accepted.
    """
    return drop_redundant(_Additions(progress).made(baseline, ids, rare))


def names_found(
    baseline: CrossValidation, ids: Sequence[str], whole: Search
) -> list[set[str]]:
    """Return effects found in a part, each with ties; `whole` is the search in all."""
    course = _Additions(whole=whole).made(baseline, ids)
    if course.interrupted:
        raise KeyboardInterrupt
    now = eliminate(course.after, list(course.known))
    tied = {step.added: set(step.rivals) for step in _split_rivals(course.rounds)}
    return [{name, *tied.get(name, ())} for name in now.problem.effects]


@dataclass(frozen=True)
class _Additions:
    progress: Progress = no_progress
    # Search in all data; models of a part take floor, plant and start from its own
    whole: Search | None = None
    earlier: Search | None = None  # search whose candidates are not fitted again

    def made(
        self, baseline: CrossValidation, ids: Sequence[str], rare: Sequence[str] = ()
    ) -> Search:
        now, rounds, known = baseline, [], [baseline]
        before = self.whole or self.earlier
        changes = before.changes if before else Changes()
        past = self.earlier.rounds if self.earlier else ()
        first: tuple[Signature, ...] = ()
        interrupted = False
        try:
            for count in range(Limit.max_effects):
                left = [name for name in ids if name not in now.problem.effects]
                # At the floor chance rewards any effect, and one torque alone does not
                # contradict an effect that fits it a little better.
                both = len(now.problem.plant.instruments.rows) > 1
                least = Limit.floor_misfit if both else Limit.max_misfit
                hopeful = now.misfit > least
                if first and not hopeful:
                    break
                done, part = count / Limit.max_effects, 1.0 / Limit.max_effects
                progress = part_of(self.progress, done, part)
                self.progress(done, f"screening {len(left)} effects")
                signatures = self.screened(now, left, changes)
                first = first or tuple(signatures)
                same = [k for k, step in enumerate(past) if step.before is now][:1]
                refitted = {c.id: c for k in same for c in past[k].candidates}
                hoped = signatures if hopeful else []
                candidates = self._candidates(now, hoped, refitted, progress)
                if names := resembling(candidates, (*left, *now.problem.effects), rare):
                    least = Limit.min_rival_share * signatures[0].explained
                    more = self.screened(now, names, changes)
                    more = [s for s in more if max(s.explained, s.foreseen) >= least]
                    more = [s for s in more if not _is_redundant(s.id, candidates)]
                    candidates += self._candidates(now, more, refitted, progress)
                    signatures = [*signatures, *more]
                steps = [screening.decide(now, candidates, signatures)]
                few = len(now.problem.effects) + 1 < Limit.max_effects
                if steps[0].added is None and now.misfit > Limit.max_misfit and few:
                    steps += self._masked(steps[0], left, changes, progress)
                rounds += steps
                step = steps[-1]
                tried = [(c, each.before) for each in steps for c in each.candidates]
                new = [c for c, before in tried if c.crossed is not before]
                # Derivatives take more room than the data; parts of the data start
                # from those of accepted effects.
                for candidate in filter(lambda each: each.reason, new):
                    candidate.crossed.problem.slopes.forget()
                known += [candidate.crossed for candidate in new]
                if step.added is None:
                    break
                following = past[same[0] + 1 :] if same else ()
                if following and past[same[0]].added == step.added:
                    now = following[0].before
                else:
                    wider = next(c.crossed for c in new if c.id == step.added)
                    now = with_own_noise_floor(wider, self.whole)
                known.append(now)
        except KeyboardInterrupt:
            interrupted = True
            _forget_derivatives(known)
        return Search(
            baseline, now, tuple(rounds), first, {}, changes, tuple(known), interrupted
        )

    def screened(
        self, now: CrossValidation, ids: Sequence[str], changes: Changes
    ) -> list[Signature]:
        """Return the signatures of effects on top of `now`, at its mean fit."""
        masks = fitting.divided_samples(now.division)
        return screening.screen(now.problem, now.x, masks, ids, now.division, changes)

    def _candidates(
        self, now: CrossValidation, signatures: Sequence[Signature],
        refitted: Mapping[str, Candidate], progress: Progress,
    ) -> list[Candidate]:  # fmt: skip
        """Return refitted effects that screening recommends, and their lookalikes."""
        chosen: list[Signature] = []
        if signatures:
            hopeful = Limit.min_predicted_share * Limit.min_reduction
            least = max(Limit.min_leader_share * signatures[0].explained, hopeful)
            chosen = [s for s in signatures if s.explained > 0.0]
            chosen = [s for s in chosen if max(s.explained, s.foreseen) >= least]
            chosen = chosen[: Limit.max_refitted]
        candidates: list[Candidate] = []
        while chosen:
            for place, signature in enumerate(chosen):
                if _is_redundant(signature.id, candidates):
                    continue
                progress(place / len(chosen), f"refitting {signature.id}")
                known = refitted.get(signature.id) or self._like(now, signature.id)
                candidates.append(known or self._best_form(now, signature))
            chosen = _unrefitted_lookalikes(signatures, candidates)
        return candidates

    def _masked(
        self, refused: Round, ids: Sequence[str], changes: Changes, progress: Progress
    ) -> list[Round]:
        """Return rounds that add two effects of which neither helps alone, or none.

        Friction that falls with speed and one that rises hide each other. Either has to
        be accepted beside the other.
        """
        first = next((c for c in refused.candidates if c.reduction > 0.0), None)
        if first is None:
            return []
        now, left = first.crossed, [name for name in ids if name != first.id]
        signatures = self.screened(now, left, changes)
        candidates = self._candidates(now, signatures, {}, progress)
        step = screening.decide(now, candidates, signatures)
        both = next((c.crossed for c in candidates if c.id == step.added), None)
        if both is None:
            return []
        known = [now, both, *(c.crossed for c in refused.candidates)]
        other = _without_effect(both, first.id, known)
        back = self._candidate(other, both, first.id)
        alone = Round((back,), first.id, (first.id,), 1.0, other)
        return [] if back.reason else [alone, step]

    def _best_form(self, now: CrossValidation, signature: Signature) -> Candidate:
        """Return the effect, refitted in the form that does best on held-out data.

        Other forms are tried if the first is accepted; other initial sizes if it leaves
        an error, as those estimated to first order may mislead far from the truth.
        """

        def refitted(start: dict[str, float]) -> Candidate:
            wider = now.problem.with_effect(signature.id, start)
            return self._refit(now, wider, [wider.placed(f.x, start) for f in now.fits])

        key, given = form_key(signature.id), signature.start
        best = refitted(given)
        if best.reason:
            return best
        effect = now.problem.plant.library.effects[signature.id]
        forms = [k for k in range(len(effect.forms)) if k != given.get(key, 0.0)]
        others = [{**given, key: float(form)} for form in forms]
        if best.crossed.misfit > Limit.max_explained_error:
            sizes = [each.name for each in effect.parameters if each.linear]
            own = {tuple(start[name] for name in sizes) for start in effect.starts}
            if len(own) > 1:
                each = (dict(zip(sizes, values, strict=True)) for values in sorted(own))
                others += [given | start for start in each]
        for start in others:
            candidate = refitted(start)
            if not candidate.reason and candidate.reduction > best.reduction:
                best = candidate
        return best

    def _like(self, now: CrossValidation, name: str) -> Candidate | None:
        """Return an effect refitted from a model of all data; None if not in any."""
        for model in self.whole.known if self.whole else ():
            known = model.problem
            if known.effects != (*now.problem.effects, name):
                continue
            if known.tuned[: len(now.problem.tuned)] == now.problem.tuned:
                wider = replace(now.problem, tuned=known.tuned, effects=known.effects)
                wider = replace(wider, forms=known.forms).sharing([known])
                return self._refit(now, wider, [model.x] * len(now.division))
        return None

    def _refit(self, now: CrossValidation, wider: Problem, starts: Arrays) -> Candidate:
        """Refit the model `wider`; return its last effect as a candidate."""
        name = wider.effects[-1]
        try:
            crossed = fitting.cross_validate(wider, now.division, starts)
        except EffectError:
            raise
        except CableError as error:
            return Candidate(name, now, 0.0, 0.0, str(error))
        return self._candidate(now, crossed, name)

    def _candidate(
        self, now: CrossValidation, crossed: CrossValidation, name: str
    ) -> Candidate:
        """Return the effect `name` of the model `crossed`, which `now` lacks."""
        old, better = fitting.blocks(now), fitting.blocks(crossed)
        whole = float(old.sum())
        reduction = 1.0 - float(better.sum()) / whole
        z = screening.comparison_z(better, old, whole)
        reason = screening.rejection_reason(crossed, name, reduction, z)
        return Candidate(name, crossed, reduction, z, reason)


def resembling(
    candidates: Sequence[Candidate], present: Sequence[str], rare: Sequence[str]
) -> list[str]:
    accepted = {c.id for c in candidates if not c.reason}
    new = [name for name in rare if name not in present]
    return [name for name in new if accepted.intersection(EFFECTS[name].resembles)]


def _forget_derivatives(known: Sequence[CrossValidation]) -> None:
    for crossed in known:
        crossed.problem.slopes.forget()


def search_rare(
    found: Search, rare: Sequence[str], progress: Progress = no_progress
) -> Search:
    """Repeat the search with rare effects if the usual ones explain too little."""
    explained = found.after.misfit <= Limit.max_explained_error
    if not rare or found.interrupted or explained:
        return found
    tried = {c.id for step in found.rounds for c in step.candidates}
    ids = list(dict.fromkeys([*sorted(tried), *rare]))
    course = _Additions(progress, earlier=found).made(found.before, ids)
    if not set(rare) & {step.added for step in course.rounds}:
        return found._replace(interrupted=course.interrupted)
    wider = drop_redundant(course)
    used = set(rare) & set(wider.after.problem.effects)
    if not used or wider.after.misfit >= found.after.misfit:
        return found._replace(interrupted=wider.interrupted)
    again = {signature.id for signature in wider.signatures}
    others = tuple(sign for sign in found.signatures if sign.id not in again)
    return wider._replace(signatures=(*wider.signatures, *others))


def with_own_noise_floor(
    crossed: CrossValidation, whole: Search | None = None
) -> CrossValidation:
    """Return the model with the floor and weight of its own errors.

    With the floor of a much worse model priors would outweigh the data. Floor and
    resolution are updated by refits, or taken from the `whole` search if it has the
    same model.
    """
    division = crossed.division
    for model in [whole.after, *(s.before for s in whole.rounds)] if whole else []:
        if model.problem.tuned == crossed.problem.tuned:
            problem = model.problem.sharing([model.problem])
            starts = [fit.x for fit in crossed.fits]
            return fitting.cross_validate(problem, division, starts)
    masks = fitting.divided_samples(division)
    place = crossed.x
    problem = crossed.problem.with_updated_floor(place, masks)
    # Trials that are reserved are predicted by the same simulation.
    reserved = [record.reserved for record in problem.plant.records]
    counts = [a | b for a, b in zip(masks, reserved, strict=True)]
    while True:
        # A refit at every step between would cost as much as the rest of the search.
        while finer := fitting.refine_simulation(problem, place, counts):
            problem = finer
        starts = [fit.x for fit in crossed.fits]
        crossed = fitting.cross_validate(problem, division, starts)
        place = crossed.x
        lower = problem.with_updated_floor(place, masks)
        if lower.inflation < 0.5 * problem.inflation:
            problem = lower
            continue
        finer = fitting.refine_simulation(problem, place, counts)
        if finer is None:
            return crossed
        problem = finer


def _split_rivals(rounds: Sequence[Round]) -> tuple[Round, ...]:
    """Return the rounds; rivals that also help beside the leader are no ties."""
    found = []
    for step, after in zip_longest(rounds, rounds[1:]):
        helpful = {c.id for c in after.candidates if not c.reason} if after else set()
        rivals = tuple(name for name in step.rivals if name not in helpful)
        parted = tuple(name for name in step.rivals if name in helpful)
        found.append(step._replace(rivals=rivals, parted=parted))
    return tuple(found)


def _is_redundant(name: str, candidates: Sequence[Candidate]) -> bool:
    able = [c for c in candidates if c.id in EFFECTS[name].generalises and not c.reason]
    return any(c.crossed.misfit <= Limit.max_misfit for c in able)


def _unrefitted_lookalikes(
    signatures: Sequence[Signature], candidates: Sequence[Candidate]
) -> list[Signature]:
    """Return effects easily confused with the best candidate, not refitted yet."""
    leader = max(candidates, key=lambda candidate: candidate.reduction)
    if leader.reduction < Limit.min_reduction:
        return []
    sign = next(s for s in signatures if s.id == leader.id)
    done = {candidate.id for candidate in candidates}
    least = Limit.min_leader_share * leader.reduction
    able = [s for s in signatures if s.id not in done and s.explained > 0.0]
    able = [s for s in able if max(s.explained, s.foreseen) >= least]
    able = [s for s in able if not _is_redundant(s.id, candidates)]
    return [s for s in able if screening.are_confusable(sign, s)]


@dataclass(frozen=True)
class Found:
    fitted: BaselineFit  # the baseline
    search: Search  # the rounds, ending with the model
    problem: Problem  # the model
    x: FloatArray  # where it was fitted to all data
    held: fitting.Held  # its predictions of held-out data
    estimated: Mapping[str, Estimate]  # value and interval of every parameter
    effects: tuple[FoundEffect, ...]  # in the order in which they were added
    # Groups of ids that the data do not distinguish, of missing effects
    ties: tuple[tuple[str, ...], ...]
    occasions: Occasions | None  # comparison of occasions, None where there is one
    # Sentence on what constants by trial explain, or ""; effects are not searched then
    by_trial: str
    misfits: Mapping[str, float]  # RMS error of every trial over that of noise

    @property
    def missing(self) -> tuple[str, ...]:
        """Ids of the effects that the verdict calls missing."""
        return tuple(effect.id for effect in self.effects if effect.missing)


def search_effects(fitted: BaselineFit, progress: Progress) -> Found:
    """Find the effects that explain the error, and fit their model to all data."""
    crossed, by_trial = fitted.crossed, ""
    several = len(fitted.problem.plant.occasions) > 1
    if not several and crossed.misfit > Limit.max_explained_error:
        constants = fitted.problem, fitted.whole.x, fitted.temperatures
        by_trial = TrialDifferences.of(*constants).at_random(crossed.misfit)
    if by_trial:
        found = Search(crossed, crossed, (), (), {}, Changes(), (crossed,))
    else:
        able, settings = fitted.problem.plant.library.effects, fitted.settings
        wanted = settings.ids or dict.fromkeys([*usual_effects(), *settings.requested])
        names = tuple(name for name in wanted if name in able)
        rare = () if settings.ids else tuple(n for n in able if n not in names)
        usual, of_rare = part_of(progress, 0.2, 0.4), part_of(progress, 0.6, 0.1)
        found = search(crossed, names, usual, rare)
        found = search_rare(found, rare, of_rare)
    # Occasions are better parts than halves, see `compare_occasions`.
    agreed = Agreement({}, {})
    if not (found.interrupted or several):
        agreed = check_agreement(fitted, found, part_of(progress, 0.7, 0.12))
        found = found._replace(interrupted=agreed.interrupted)
    progress(0.82, "fitting the result to all data")
    problem, x, spread, held = _drop_doubtful(fitted, found, progress)
    estimated = intervals.estimates(problem, x, spread)
    compared = trials.compare_occasions(problem, x, estimated)
    shares = agreed.shares
    if compared:
        effects = {size.effect for size in compared.sizes}
        agree = {e: [s.agree for s in compared.sizes if s.effect == e] for e in effects}
        shares = {effect: sum(own) / len(own) for effect, own in agree.items()}
    found = final_search(found, problem, x)
    added = [step.added for step in found.rounds if step.added]
    groups = {}
    for step in found.rounds:
        rivals = step.tied(problem.effects, added)
        # Effects that parts of the data name instead are tied, too.
        more = agreed.rivals.get(rivals[0], ()) if rivals else ()
        rivals = tuple(dict.fromkeys((*rivals, *more)))
        if len(rivals) > 1:
            groups[rivals[0]] = rivals
    named = _found_effects(found, problem, x, spread, estimated, shares, groups)
    missing = [effect.id for effect in named if effect.missing]
    ties = tuple(rivals for name, rivals in groups.items() if name in missing)
    model, off = (problem, x, held, estimated), trials.misfits(problem, x)
    return Found(fitted, found, *model, named, ties, compared, by_trial, off)


def _drop_doubtful(
    baseline_fit: BaselineFit, found: Search, progress: Progress
) -> tuple[Problem, FloatArray, Spread, fitting.Held]:
    """Return the final model, its parameters, spread and held-out predictions.

    Effects whose interval contains 0 go, the one whose removal costs least first. Where
    disagreement or form errors make it wide, those that the trials need stay. All go
    if held-out data do not support them.
    """
    problem = found.after.problem
    counts = [record.counts for record in problem.plant.records]
    start = found.after.x
    baseline, home = baseline_fit.problem, baseline_fit.whole.x
    holding = fitting.Holdout(baseline, home, baseline_fit.settings.seed)
    while problem.effects:
        x = fitting.fit_until_settled(problem, start, counts).x
        least = intervals.noise_covariance(problem, x, counts)
        idle, wide = intervals.doubtful_effects(problem, x, *least[:2]), None
        if not idle:
            wide = intervals.fit_covariance(problem, x, counts)
            idle = intervals.doubtful_effects(problem, x, *wide[:2])
        slimmer = []
        for name in idle:
            slim = problem.without(name).sharing([c.problem for c in found.known])
            left = x[[k for k, p in enumerate(problem.tuned) if p in slim.tuned]]
            fitted = fitting.fit(slim, left, counts)
            # Trials may disagree about a size that a tuned parameter can replace, and
            # still need it.
            if wide is None or not is_needed(
                trials.misfits(slim, fitted.x), trials.misfits(problem, x)
            ):
                slimmer.append((slim, fitted))
        if wide is not None and not slimmer:
            progress(0.86, "predicting trials that were held out")
            held = holding.out(problem, x)
            if held is None:
                break
            return problem, x, wide, held
        problem, (start, _) = min(slimmer, key=lambda model: model[1].cost)
    x = fitting.fit_until_settled(baseline, home, counts).x
    held = holding.out(baseline, x)
    assert held is not None
    return baseline, x, intervals.fit_covariance(baseline, x, counts), held


def is_needed(more: Mapping[str, float], less: Mapping[str, float]) -> bool:
    """Return whether trials err more without an effect than with it.

    `more` and `less` are errors over the floor by trial, without it and with it. Most
    trials err more, and all that do not fit without it; one at rest shows no delay.
    """
    share = 1.0 + Limit.form_error_share
    worse = {name for name, size in less.items() if more[name] > share * size}
    unfit = {name for name, size in more.items() if size > Limit.max_misfit}
    return unfit <= worse and 2 * len(worse) > len(less)


def final_search(found: Search, problem: Problem, x: FloatArray) -> Search:
    """Return the search as if it had ended with the model `problem`."""
    if problem.effects == found.after.problem.effects:
        return found
    if not problem.effects:
        return found._replace(after=found.before, shares={})
    division = found.before.division
    now = fitting.cross_validate(problem, division, [x] * len(division))
    shares = gap_shares(found.before, now, [*found.known])
    return found._replace(after=now, shares=shares)


def _found_effects(
    found: Search, problem: Problem, x: FloatArray, spread: Spread,
    estimated: Mapping[str, Estimate], agreed: Mapping[str, float],
    groups: Mapping[str, tuple[str, ...]],
) -> tuple[FoundEffect, ...]:  # fmt: skip
    sure = {step.added: step.confidence for step in found.rounds}
    shares, library = found.shares, problem.plant.library.effects
    beyond = max(found.before.misfit**2 - 1.0, 0.0)
    own = {name: math.sqrt(max(shares[name], 0.0) * beyond) for name in problem.effects}
    left = found.after.misfit_by(found.before.problem.inflation)
    return tuple(
        FoundEffect(
            name,
            {p.name: estimated[p.name] for p in library[name].parameters},
            sure.get(name, 0.0),
            share=shares[name],
            refinement=only_refines(name, shares, own, left),
            agreement=agreed.get(name, 1.0),
            disputed=agreed.get(name, 1.0) < Limit.agreement_share,
            ordinary=intervals.is_ordinary(problem, x, name, spread),
            own=own[name],
            rivals=tuple(rival for rival in groups.get(name, ()) if rival != name),
            form=problem.form(name),
        )
        for name in problem.effects
    )


class Agreement(NamedTuple):
    """Support by parts of the data for the effects found in all data."""

    # Share of the parts that name an effect or one it is tied with, by id, if any
    shares: Mapping[str, float]
    # By id, effects named beside or for it by many parts, or by any if confusable
    rivals: Mapping[str, tuple[str, ...]]
    # True if the user stopped it before all parts were searched
    interrupted: bool = False


def only_refines(
    name: str, shares: Mapping[str, float], own: Mapping[str, float], left: float
) -> bool:
    """Return whether an effect of a model only refines the others.

    An effect that explains little is a finding if its own error is large and half of
    the squared error left without it, and no larger effect is confused with it.
    """
    if shares[name] >= min(Limit.max_refinement_share, max(shares.values())):
        return False
    larger = [other for other in shares if shares[other] > shares[name]]
    mends = any(EFFECTS[name].confused(EFFECTS[other]) for other in larger)
    return mends or own[name] < max(Limit.finding_error, left)


def check_agreement(
    baseline_fit: BaselineFit, found: Search, progress: Progress = no_progress
) -> Agreement:
    """Repeat the search on parts of the data, with effects accepted on the whole."""
    effects = found.after.problem.effects
    if not effects or found.after.misfit <= Limit.max_explained_error:
        return Agreement({}, {})
    problem, x = baseline_fit.problem, baseline_fit.whole.x
    parts = split_trials(problem.plant.records)
    tried = {c.id for step in found.rounds for c in step.candidates if not c.reason}
    named: list[list[set[str]]] = []
    try:
        for place, part in enumerate(parts):
            progress(place / len(parts), f"searching part {place + 1} of {len(parts)}")
            division = tuple(
                Fold(*(tuple(map(np.logical_and, half, part)) for half in fold))
                for fold in baseline_fit.crossed.division
            )
            crossed = fitting.cross_validate(problem, division, [x] * len(division))
            named.append(names_found(crossed, sorted(tried), found))
    except KeyboardInterrupt:
        problem.slopes.forget()  # they may be half taken
    own = {step.added: set(step.rivals) for step in found.rounds if step.added}
    votes = count_votes(effects, own, named)
    return votes._replace(interrupted=len(named) < len(parts))


def count_votes(
    effects: Sequence[str],
    own: Mapping[str, set[str]],
    named: Sequence[Sequence[set[str]]],
) -> Agreement:
    """Return the agreement of the parts with the `effects` found in all data.

    `own` has the ties of each effect there, by id; `named` has, for each part, a group
    of tied ids for each effect that it names.
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
        least = Limit.tie_share * len(named)
        often = {rival for rival, count in votes.items() if count >= least}
        rivals[name] = tuple(sorted(often | instead))
        either = {name, *own.get(name, ()), *rivals[name]}
        agreed = [groups for groups in named if either & set().union(*groups)]
        if named:
            shares[name] = len(agreed) / len(named)
    return Agreement(shares, rivals)


def split_trials(records: Sequence[Record]) -> list[Masks]:
    """Return four halves of the free trials by name: first, last, odd, even ones.

    Names usually follow load and speed; repetitions stay together. Only tilt tells a
    weight from a spring, so a half without trials of a tilt gets them all.
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
