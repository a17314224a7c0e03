"""Path from trials to a verdict: baseline, search, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.trials import Dataset
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.evidence import Evidence, Isolability
from cc_mujoco.diagnosis.inference.agreement import AGREED, agreement
from cc_mujoco.diagnosis.inference.baseline import BaselineFit, fit_baseline, plant_of
from cc_mujoco.diagnosis.inference.experiment import Rivals, propose
from cc_mujoco.diagnosis.inference.fitting import Masks, Problem, fit, settled
from cc_mujoco.diagnosis.inference.folds import (
    CrossValidation,
    cross_validate,
    interleaved_folds,
    trial_folds,
)
from cc_mujoco.diagnosis.inference.foretold import misread
from cc_mujoco.diagnosis.inference.gap import gaps, off, predicted, traces
from cc_mujoco.diagnosis.inference.intervals import (
    Spread,
    estimates,
    narrowest,
    spread,
    undetermined,
)
from cc_mujoco.diagnosis.inference.judgement import Judgement, judged, refines
from cc_mujoco.diagnosis.inference.location import Fitted, Trials, located, ordinates
from cc_mujoco.diagnosis.inference.numerics import HARMLESS
from cc_mujoco.diagnosis.inference.per_trial import misfits, odd_trial, trial_errors
from cc_mujoco.diagnosis.inference.plausibility import doubtful, ordinary
from cc_mujoco.diagnosis.inference.records import Record
from cc_mujoco.diagnosis.inference.residual_maps import maps
from cc_mujoco.diagnosis.inference.result import DiagnosisResult, Settings
from cc_mujoco.diagnosis.inference.screen import Signature, signature_cosine
from cc_mujoco.diagnosis.inference.search import (
    Round,
    Search,
    resemble,
    search,
    shares_of,
)
from cc_mujoco.diagnosis.inference.starting import prepared
from cc_mujoco.diagnosis.inference.testable import (
    confounded,
    reach,
    strayed,
    untestable,
)
from cc_mujoco.diagnosis.inference.trial_trends import trial_constants
from cc_mujoco.diagnosis.verdict import (
    Baseline,
    Diagnosis,
    FoundEffect,
    Gap,
    RunnerUp,
)
from cc_mujoco.diagnosis.wording import capital, number
from cc_mujoco.estimation.least_squares import Estimate, Fit
from cc_mujoco.page import listed

Progress = Callable[[float, str], None]

LEAST = 100
"""Samples that must count."""


def reason(
    dataset: Dataset,
    bench: Bench,
    settings: Settings = Settings(),  # noqa: B008
    progress: Progress = lambda share, doing: None,
) -> DiagnosisResult:
    """Return the verdict on checked trials, without any file.

    Args:
        dataset: trials of `intake.load`, without anything to fix.
        bench: rig as the scene has it.
        settings: choices besides data and scene.
        progress: called with the share done and what is being done.
    """
    limits, seed = settings.thresholds, settings.seed
    bench = bench.known(dataset.constants)
    start, records, filtering = prepared(dataset, bench)
    if useless := _insufficient_excitation(records):
        return _empty(bench, useless)
    plant = plant_of(dataset, start.bench, records, start.given)
    # Without a pretension a scene foretells nothing.
    given = bench if bench.cables[0].pretension > 0.0 else start.bench
    if wrong := misread(replace(plant, bench=given), plant, start.values):
        return _empty(bench, wrong)
    progress(0.02, "fitting the baseline")
    baseline_fit = fit_baseline(dataset, plant, filtering, seed)
    if baseline_fit.change > HARMLESS:
        return _numerics(bench, baseline_fit)
    able = baseline_fit.problem.plant.library.effects
    names = tuple(name for name in settings.ids or EFFECTS if name in able)

    def told(share: float, doing: str) -> None:
        progress(0.2 + 0.5 * share, doing)

    found = search(
        baseline_fit.crossed, interleaved_folds(records), names, limits, told
    )
    warmth = {
        trial.name: float(np.nanmean(trial.temperature))
        for trial in dataset.trials
        if trial.temperature is not None and np.any(np.isfinite(trial.temperature))
    }
    return _concluded(baseline_fit, found, bench, settings, progress, warmth)


def _insufficient_excitation(records: Sequence[Record]) -> str:
    """Why nothing can be compared, or nothing tested; else empty."""
    still = "the motor never moves enough to carry the whole cable along"
    if sum(int(r.counts.sum()) for r in records) < LEAST:
        return f"{capital(still)}, so nothing can be compared; record larger motions."
    if sum(int(r.free.sum()) for r in records) < LEAST:
        return (
            f"In the trials that are not reserved (split = 'test') {still}; leave "
            "some of those that move for fitting."
        )
    tests = [r for r in records if r.split == "test"]
    if tests and sum(int(r.reserved.sum()) for r in tests) < LEAST:
        names = listed(sorted({r.trial for r in tests}))
        return (
            f"In what is reserved (split = 'test': {names}) {still}; reserve trials "
            "that move, or none."
        )
    return ""


def _concluded(
    baseline_fit: BaselineFit,
    found: Search,
    bench: Bench,
    settings: Settings,
    progress: Progress,
    warmth: Mapping[str, float],
) -> DiagnosisResult:
    limits, seed = settings.thresholds, settings.seed
    agreed = agreement(
        baseline_fit,
        found,
        limits,
        lambda share, doing: progress(0.7 + 0.12 * share, doing),
    )
    progress(0.82, "fitting the result to all data")
    model = _borne_out(baseline_fit, found, seed, progress)
    problem, x = model.problem, model.x
    shown = traces(problem, model.held.before, model.held.after)
    drawn = maps(shown, seed)
    evidence = Evidence(shown, drawn, isolability(found.signatures))
    estimated = estimates(problem, x, model.spread)
    found = kept(found, baseline_fit, model)
    added = [step.added for step in found.rounds if step.added]
    groups = {
        rivals[0]: rivals
        for step in found.rounds
        for rivals in [_tied(step.tied(problem.effects, added), agreed.rivals)]
        if len(rivals) > 1
    }
    effects = _found(found, problem, x, estimated, agreed.shares, groups)
    missing = [effect.id for effect in effects if effect.missing]
    ties = tuple(rivals for name, rivals in groups.items() if name in missing)
    beside = {*problem.effects, *chain.from_iterable(groups.values())}
    others = [sign.id for sign in found.signatures if sign.id not in beside]
    shown_by = reach(problem, x, others, found.changes)
    hidden = confounded(shown_by)
    beyond = strayed(problem, x, estimated, hidden)
    outcome = Judgement(effects, ties, model.held.gap, beyond)
    kind, statement = judged(found, outcome, limits)
    # What is added where nothing explains the error only stands in for it.
    asked = (
        (baseline_fit.problem, baseline_fit.whole.x)
        if kind == "unknown"
        else (problem, x)
    )
    odd = odd_trial(*asked, misfits(baseline_fit.problem, baseline_fit.whole.x))
    constants = trial_constants(*asked)
    along = ordinates(problem, constants[0].trials if constants else (), warmth)
    progress(0.95, "writing it down")
    counts = [record.counts for record in problem.plant.records]
    diagnosis = Diagnosis(
        kind,
        statement,
        effects=effects,
        ties=ties,
        not_testable=untestable(shown_by, hidden),
        next_experiment=propose(_rivals(found, ties[0]), limits) if ties else None,
        where=located(
            Fitted(baseline_fit.problem, baseline_fit.whole.x),
            Fitted(problem, x),
            drawn,
            Trials(constants, along),
        ),
        gap=model.held.gap,
        baseline=Baseline(
            {p.name: estimated[p.name] for p in baseline_fit.problem.tuned},
            undetermined(baseline_fit.problem, baseline_fit.whole.x, counts),
        ),
        runner_ups=tuple(_runner_ups(step) for step in found.rounds),
        trials=trial_errors(baseline_fit.problem, model.held.before, model.held.after),
        question=odd.question if odd else "",
        strayed=beyond,
        confounded=hidden,
        remaining=off(model.held.gap)[1],
    )
    return DiagnosisResult(diagnosis, evidence, problem, x, bench, baseline_fit)


def _tied(
    rivals: tuple[str, ...], others: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """Return the tie, with what parts of the data name in place of the first."""
    more = others.get(rivals[0], ()) if rivals else ()
    return (*rivals, *(name for name in more if name not in rivals))


def _rivals(found: Search, tie: Sequence[str]) -> Rivals:
    """Return the first two effects of a tie, as they were refitted to one model."""
    rounds = [
        (step.before, {c.id: c.crossed for c in step.candidates})
        for step in found.rounds
    ]
    # The last round that has both; parts of the data may name what none had with it.
    both = [each for each in rounds if all(name in each[1] for name in tie[:2])]
    before, models = both[-1] if both else (found.before, _first(rounds))
    one, two = tie[0], tie[1]
    confused = EFFECTS[one].confused(EFFECTS[two]) or any(
        resemble(first, second)
        for first in found.signatures
        for second in found.signatures
        if (first.id, second.id) == (one, two)
    )
    return Rivals((one, two), before, (models[one], models[two]), confused)


def _first(
    rounds: Sequence[tuple[CrossValidation, Mapping[str, CrossValidation]]],
) -> dict[str, CrossValidation]:
    """Return every effect as it was refitted first."""
    found: dict[str, CrossValidation] = {}
    for _, models in rounds:
        found = {**models, **found}
    return found


class CheckedModel(NamedTuple):
    """Result of a search once it has been held against all data.

    Attributes:
        problem: the model.
        x: where it was fitted to all data.
        spread: of that.
        held: what it predicts of held-out data.
    """

    problem: Problem
    x: FloatArray
    spread: Spread
    held: Held


def _borne_out(
    baseline_fit: BaselineFit, found: Search, seed: int, progress: Progress
) -> CheckedModel:
    """The model that was found, less effects that may as well not be there.

    That is, of which the interval contains 0. Where several stand in for each other,
    that one goes without which the rest explain most; all go where held-out data do
    not bear them out.
    """
    problem = found.after.problem
    counts = [record.counts for record in problem.plant.records]
    start = np.mean([f.x for f in found.after.fits], axis=0)
    holding = _Holding(baseline_fit, seed)
    while problem.effects:
        x = settled(problem, start, counts).x
        idle = doubtful(problem, x, *narrowest(problem, x, counts))
        if not idle:
            progress(0.86, "predicting trials that were held out")
            held = holding.out(problem, x)
            if held is None:
                break
            wide = spread(problem, x, counts)
            idle = doubtful(problem, x, *wide)
            if not idle:
                return CheckedModel(problem, x, wide, held)
        slimmer = [_less(problem, x, name, counts) for name in idle]
        problem, (start, _) = min(slimmer, key=lambda model: model[1].cost)
    problem = baseline_fit.problem
    x = settled(problem, baseline_fit.whole.x, counts).x
    held = holding.out(problem, x)
    assert held is not None
    return CheckedModel(problem, x, spread(problem, x, counts), held)


def _less(
    problem: Problem, x: FloatArray, name: str, counts: Masks
) -> tuple[Problem, Fit]:
    """A model without an effect, fitted to all data."""
    slim = problem.without(name)
    start = x[[k for k, p in enumerate(problem.tuned) if p in slim.tuned]]
    return slim, fit(slim, start, counts)


class Held(NamedTuple):
    """Torques (2, samples) of every record without and with what was added.

    Those that are held out, predicted by the others; and the gap of them.
    """

    before: tuple[FloatArray, ...]
    after: tuple[FloatArray, ...]
    gap: dict[str, Gap]


class _Holding:
    """Holds trials out; of the baseline, once."""

    def __init__(self, baseline_fit: BaselineFit, seed: int) -> None:
        problem = baseline_fit.problem
        records = problem.plant.records
        self._problem, self._x, self._seed = problem, baseline_fit.whole.x, seed
        # Whole trials. An effect that a single trial shows, say the only one at low
        # pretension, is not to be had from the others: then it is stretches of all.
        self._divisions = trial_folds(records), interleaved_folds(records)
        self._before: dict[int, tuple[FloatArray, ...]] = {}

    def out(self, problem: Problem, x: FloatArray) -> Held | None:
        """Predict what is held out; None where that does not bear the effects out."""
        for place, division in enumerate(self._divisions):
            if place not in self._before:
                self._before[place] = predicted(self._problem, self._x, division)
            before = self._before[place]
            after = predicted(problem, x, division) if problem.effects else before
            gap = gaps(self._problem, before, after, division, self._seed)
            better = sum(
                (g.rmse_before**2 - g.rmse_after**2) / g.noise_floor**2
                for g in gap.values()
            )
            if not problem.effects or better >= 0.0:
                return Held(before, after, gap)
        return None


def isolability(signatures: Sequence[Signature]) -> Isolability:
    """Compute the similarity of the effects' signatures."""
    table = np.array([[signature_cosine(a, b) for b in signatures] for a in signatures])
    return Isolability(
        tuple(s.id for s in signatures),
        table.reshape(len(signatures), len(signatures)),
        np.array([s.visible for s in signatures]),
    )


def kept(found: Search, baseline_fit: BaselineFit, model: CheckedModel) -> Search:
    """A search that ends with what is left of its model.

    Three effects may each be idle beside the two others: once one of them has gone, the
    shares count anew, and so does the error.
    """
    problem, x = model.problem, model.x
    if problem.effects == found.after.problem.effects:
        return found
    if not problem.effects:
        return found._replace(after=found.before, shares={})
    division = interleaved_folds(problem.plant.records)
    now = cross_validate(problem, division, [x] * len(division))
    shares = shares_of(baseline_fit.crossed, now, division)
    return found._replace(after=now, shares=shares)


def _found(
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
            refinement=refines(name, shares, own, left),
            agreement=agreed.get(name, 1.0),
            disputed=agreed.get(name, 1.0) < AGREED,
            ordinary=ordinary(problem, x, name),
            own=own[name],
            rivals=tuple(rival for rival in groups.get(name, ()) if rival != name),
        )
        for name in problem.effects
    )


def _runner_ups(step: Round) -> tuple[RunnerUp, ...]:
    return tuple(
        RunnerUp(
            c.id,
            c.reduction,
            not c.reason,
            c.reason,
            {
                parameter.name: c.crossed.problem.values(c.crossed.fits[0].x).get(
                    parameter.name, 0.0
                )
                for parameter in c.crossed.problem.plant.library.effects[
                    c.id
                ].parameters
            },
        )
        for c in step.candidates
    )


def unanswered(
    diagnosis: Diagnosis, bench: Bench, baseline_fit: BaselineFit | None = None
) -> DiagnosisResult:
    """A diagnosis that got no further than what is wrong, without evidence."""
    nothing = Evidence((), (), Isolability((), np.zeros((0, 0)), np.zeros(0)))
    return DiagnosisResult(diagnosis, nothing, None, np.zeros(0), bench, baseline_fit)


def _empty(bench: Bench, statement: str) -> DiagnosisResult:
    diagnosis = Diagnosis("fix-data", statement, problems=(statement,))
    return unanswered(diagnosis, bench)


def _numerics(bench: Bench, baseline_fit: BaselineFit) -> DiagnosisResult:
    plant = baseline_fit.problem.plant
    statement = (
        f"A simulation with {2 * plant.segments} segments or {2 * plant.substeps} "
        "steps per sample "
        f"differs by {number(baseline_fit.change)} times the noise floor, more "
        f"than {HARMLESS:g}: what would be named could be the numerics. Record faster "
        f"than {1.0 / plant.records[0].dt:.0f} Hz, or reduce the wrap."
    )
    diagnosis = Diagnosis("fix-numerics", statement, problems=(statement,))
    return unanswered(diagnosis, bench, baseline_fit)
