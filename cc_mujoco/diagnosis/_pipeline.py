"""Pipeline from trials to a verdict: baseline, search and inference."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.baseline import BaselineFit, fit_baseline, plant_of
from cc_mujoco.diagnosis._fit.effect_check import check_effects
from cc_mujoco.diagnosis._fit.fitting import Masks, Problem, fit, fit_until_settled
from cc_mujoco.diagnosis._fit.folds import (
    CrossValidation,
    cross_validate,
    interleaved_folds,
)
from cc_mujoco.diagnosis._fit.heldout_error import Held, Holdout, floor_ratios, traces
from cc_mujoco.diagnosis._fit.intervals import (
    Spread,
    estimates,
    fit_covariance,
    noise_covariance,
    undetermined,
)
from cc_mujoco.diagnosis._fit.numerics import MAX_NUMERICAL_ERROR
from cc_mujoco.diagnosis._fit.plausibility import doubtful_effects, is_ordinary
from cc_mujoco.diagnosis._fit.start_values import prepare_start
from cc_mujoco.diagnosis._fit.stretches import worst_stretch
from cc_mujoco.diagnosis._fit.unit_check import unit_or_sign_error
from cc_mujoco.diagnosis._locate.location import (
    Fitted,
    Trials,
    locate_error,
    random_constants,
    trial_ordinates,
)
from cc_mujoco.diagnosis._locate.occasion_report import (
    agreement_shares,
    compare_occasions,
)
from cc_mujoco.diagnosis._locate.outlier_trials import (
    exchanged_torques,
    find_outlier_trial,
    misfits,
    trial_errors,
)
from cc_mujoco.diagnosis._locate.residual_maps import error_maps
from cc_mujoco.diagnosis._locate.trial_trends import trial_constants
from cc_mujoco.diagnosis._partial.measurement_mode import describe_mode
from cc_mujoco.diagnosis._phrases import capitalise, format_number
from cc_mujoco.diagnosis._progress import Progress, no_progress, part_of
from cc_mujoco.diagnosis._propose.experiment import Rivals, propose
from cc_mujoco.diagnosis._propose.identifiability import (
    confounded_effects,
    detectability,
    deviating_parameters,
    untestable_effects,
)
from cc_mujoco.diagnosis._report_data import Evidence, Isolability
from cc_mujoco.diagnosis._result import DiagnosisResult, Options
from cc_mujoco.diagnosis._rig.occasions import occasions_of
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._search.acceptance import (
    MAX_EXPLAINED_ERROR,
    Round,
    are_confusable,
)
from cc_mujoco.diagnosis._search.agreement import (
    AGREEMENT_SHARE,
    Agreement,
    check_agreement,
)
from cc_mujoco.diagnosis._search.belief import belief_in_verdict
from cc_mujoco.diagnosis._search.elimination import gap_shares
from cc_mujoco.diagnosis._search.screening import Signature, signature_cosine
from cc_mujoco.diagnosis._search.search import Search, search, search_rare
from cc_mujoco.diagnosis._search.verdict_rules import (
    Judgement,
    declared_sentence,
    judge,
    only_refines,
    undecidable_sentence,
)
from cc_mujoco.diagnosis._verdict import Baseline, Diagnosis, FoundEffect, RunnerUp
from cc_mujoco.diagnosis.effects import EFFECTS, usual_effects
from cc_mujoco.estimation._least_squares import Estimate, Fit
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

MIN_COUNTED_SAMPLES = 100
"""Samples that must count."""


def run_inference(
    dataset: Dataset,
    bench: Bench,
    settings: Options = Options(),  # noqa: B008
    progress: Progress = no_progress,
) -> DiagnosisResult:
    """Return the verdict on checked trials, without any file.

    Args:
        dataset: trials of `_loading.load`, without anything to fix.
        bench: rig as the scene has it.
        settings: choices besides data and scene.
        progress: called with the share done and what is being done.
    """
    limits, seed = settings.thresholds, settings.seed
    bench = replace(bench.known(dataset.constants), ends_held=dataset.ends_held)
    start, records, filtering = prepare_start(dataset, bench)
    if useless := _excitation_problem(records):
        return _empty_diagnosis(bench, useless)
    plant = plant_of(dataset, start.bench, records, start.given)
    # Without a pretension a scene foretells nothing.
    given = bench if bench.cables[0].pretension > 0.0 else start.bench
    if wrong := unit_or_sign_error(replace(plant, bench=given), plant, start.values):
        return _empty_diagnosis(bench, wrong)
    progress(0.01, "checking the effects")
    notes = check_effects(plant, start.values, settings.requested)
    progress(0.02, "fitting the baseline")
    baseline_fit = fit_baseline(dataset, plant, filtering, seed)
    if baseline_fit.change > MAX_NUMERICAL_ERROR:
        return _numerics_diagnosis(bench, baseline_fit)
    if wrong := exchanged_torques(baseline_fit.problem, baseline_fit.whole.x):
        return _empty_diagnosis(bench, wrong)
    able = baseline_fit.problem.plant.library.effects
    wanted = settings.ids or dict.fromkeys([*usual_effects(), *settings.requested])
    names = tuple(name for name in wanted if name in able)
    rare = () if settings.ids else tuple(name for name in able if name not in names)

    temperatures = {
        trial.name: float(np.nanmean(trial.temperature))
        for trial in dataset.trials
        if trial.temperature is not None and np.any(np.isfinite(trial.temperature))
    }
    division = interleaved_folds(records)
    by_trial = _differs_by_trial(baseline_fit, temperatures)
    if by_trial:
        found = Search.without_effects(baseline_fit.crossed)
    else:
        searching, of_rare = part_of(progress, 0.2, 0.4), part_of(progress, 0.6, 0.1)
        common = [name for name in rare if EFFECTS[name].common]
        found = search(baseline_fit.crossed, division, names, limits, searching, common)
        found = search_rare(found, division, rare, limits, of_rare)
    result = _conclude(
        baseline_fit, found, bench, settings, progress, temperatures, by_trial
    )
    mode = describe_mode(dataset.instruments, dataset.ends_held, bool(bench.arm))
    problems = (*result.diagnosis.problems, *notes)
    diagnosis = replace(result.diagnosis, problems=problems, instruments=mode)
    return replace(result, diagnosis=diagnosis)


def _excitation_problem(records: Sequence[Record]) -> str:
    """Return why nothing can be compared or tested, or ""."""
    still = "the motor never moves enough to carry the whole cable along"
    if sum(int(r.counts.sum()) for r in records) < MIN_COUNTED_SAMPLES:
        return (
            f"{capitalise(still)}, so nothing can be compared; record larger motions."
        )
    if sum(int(r.free.sum()) for r in records) < MIN_COUNTED_SAMPLES:
        return (
            f"In the trials that are not reserved (split = 'test') {still}; leave "
            "some of those that move for fitting."
        )
    tests = [r for r in records if r.split == "test"]
    if tests and sum(int(r.reserved.sum()) for r in tests) < MIN_COUNTED_SAMPLES:
        names = list_words(sorted({r.trial for r in tests}))
        return (
            f"In what is reserved (split = 'test': {names}) {still}; reserve trials "
            "that move, or none."
        )
    return ""


def _differs_by_trial(
    baseline_fit: BaselineFit, temperatures: Mapping[str, float]
) -> str:
    """Return what differs at random between trials and takes all error, or ""."""
    misfit = baseline_fit.crossed.misfit
    several = len(occasions_of(baseline_fit.problem.plant.records)) > 1
    if misfit <= MAX_EXPLAINED_ERROR or several:
        return ""
    problem = baseline_fit.problem
    constants = trial_constants(problem, baseline_fit.whole.x)
    names = constants[0].trials if constants else ()
    along = trial_ordinates(problem, names, temperatures)
    return random_constants(Trials(constants, along), misfit)


def _conclude(
    baseline_fit: BaselineFit,
    found: Search,
    bench: Bench,
    settings: Options,
    progress: Progress,
    temperatures: Mapping[str, float],
    by_trial: str,
) -> DiagnosisResult:
    limits, seed = settings.thresholds, settings.seed
    # Occasions are better parts than halves, see `compare_occasions`.
    several = len(occasions_of(baseline_fit.problem.plant.records)) > 1
    agreed = (
        Agreement({}, {})
        if found.interrupted or several
        else check_agreement(baseline_fit, found, limits, part_of(progress, 0.7, 0.12))
    )
    if agreed.interrupted:
        found = found._replace(interrupted=True)
    progress(0.82, "fitting the result to all data")
    model = _drop_doubtful(baseline_fit, found, seed, progress)
    problem, x = model.problem, model.x
    shown = traces(problem, model.held.before, model.held.after)
    drawn = error_maps(shown, seed)
    evidence = Evidence(shown, drawn, effect_isolability(found.signatures))
    estimated = estimates(problem, x, model.spread)
    compared = compare_occasions(problem, x, estimated)
    shares = agreement_shares(compared) if compared else agreed.shares
    found = final_search(found, baseline_fit, model)
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
    beside = {*problem.effects, *chain.from_iterable(groups.values())}
    others = [sign.id for sign in found.signatures if sign.id not in beside]
    shown_by = detectability(problem, x, others, found.changes)
    hidden = confounded_effects(shown_by)
    beyond = deviating_parameters(problem, x, estimated, hidden)
    stretch = worst_stretch(problem, x, model.held.after)
    off = misfits(problem, x)
    unhooked = {r.trial for r in problem.plant.records if r.unhooked} & set(off)
    outcome = Judgement(
        effects,
        ties,
        model.held.gap,
        beyond,
        stretch,
        by_trial,
        max((off[name] for name in unhooked), default=0.0),
    )
    kind, statement = judge(found, outcome, limits)
    statement += declared_sentence(problem.plant.library.declared)
    if found.interrupted:
        if not effects:
            kind = "unknown"
            statement = (
                "the error of the tuned scene is "
                f"{format_number(found.before.misfit)} times the noise floor, and no "
                "effect had been added."
            )
        statement = f"Stopped before all effects were tried: {statement}"
    proposal = propose(_tied_refits(found, ties[0]), limits) if ties else None
    if ties and proposal is None:
        statement += undecidable_sentence(ties[0])
    belief = None
    if not found.interrupted:
        left = floor_ratios(model.held.gap)[1]
        belief = belief_in_verdict(found, kind, missing, ties, left)
    # What is added where nothing explains the error only stands in for it.
    arguments = (
        (baseline_fit.problem, baseline_fit.whole.x)
        if kind == "unknown"
        else (problem, x)
    )
    odd = find_outlier_trial(
        *arguments, misfits(baseline_fit.problem, baseline_fit.whole.x)
    )
    question = odd.question if odd else ""
    if by_trial and odd and odd.rest > MAX_EXPLAINED_ERROR:
        question = ""  # no single trial contradicts the others
    explained = stretch is not None and stretch.rest <= MAX_EXPLAINED_ERROR
    if stretch and explained and not odd and kind == "unknown":
        question = stretch.question
    constants = trial_constants(*arguments)
    along = trial_ordinates(
        problem, constants[0].trials if constants else (), temperatures
    )
    progress(0.95, "writing it down")
    counts = [record.counts for record in problem.plant.records]
    diagnosis = Diagnosis(
        kind,
        statement,
        effects=effects,
        ties=ties,
        not_testable=untestable_effects(shown_by, hidden),
        next_experiment=proposal.experiment if proposal else None,
        where=locate_error(
            Fitted(baseline_fit.problem, baseline_fit.whole.x),
            Fitted(problem, x),
            drawn,
            Trials(constants, along),
        ),
        gap=model.held.gap,
        problems=_never_held_out_note(model.held.never),
        baseline=Baseline(
            {p.name: estimated[p.name] for p in baseline_fit.problem.tuned},
            undetermined(baseline_fit.problem, baseline_fit.whole.x, counts),
        ),
        runner_ups=tuple(_runner_ups(step) for step in found.rounds),
        trials=trial_errors(
            baseline_fit.problem, model.held.before, model.held.after, (problem, x)
        ),
        question=question,
        strayed=beyond,
        confounded=hidden,
        remaining=floor_ratios(model.held.gap)[1],
        occasions=compared,
        interrupted=found.interrupted,
        belief=belief,
    )
    motion = proposal.motion if proposal else None
    return DiagnosisResult(diagnosis, evidence, problem, x, bench, baseline_fit, motion)


def _never_held_out_note(trials: Sequence[str]) -> tuple[str, ...]:
    """Return a note on the trials that no held-out error is of."""
    if not trials:
        return ()
    one = len(trials) == 1
    return (
        f"{list_words(trials)} {'is the only trial' if one else 'are the only trials'} "
        f"of {'its' if one else 'their'} kind (side held, pretension, tilt, weights), "
        f"so {'it is' if one else 'they are'} in every fit and the held-out error is "
        "that of the others; record more like it to check it.",
    )


def _extend_tie(
    rivals: tuple[str, ...], others: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """Return the tie, with the effects that parts of the data name instead."""
    more = others.get(rivals[0], ()) if rivals else ()
    return (*rivals, *(name for name in more if name not in rivals))


def _tied_refits(found: Search, tie: Sequence[str]) -> Rivals:
    """Return the first two effects of a tie, as they were refitted to one model."""
    rounds = [
        (step.before, {c.id: c.crossed for c in step.candidates})
        for step in found.rounds
    ]
    # The last round that has both; parts of the data may name what none had with it.
    both = [each for each in rounds if all(name in each[1] for name in tie[:2])]
    before, models = both[-1] if both else (found.before, _first_refits(rounds))
    one, two = tie[0], tie[1]
    confused = EFFECTS[one].confused(EFFECTS[two]) or any(
        are_confusable(first, second)
        for first in found.signatures
        for second in found.signatures
        if (first.id, second.id) == (one, two)
    )
    return Rivals((one, two), before, (models[one], models[two]), confused)


def _first_refits(
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


def _drop_doubtful(
    baseline_fit: BaselineFit, found: Search, seed: int, progress: Progress
) -> CheckedModel:
    """Return the model that was found, less effects that may as well not be there.

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
    """Return a model of a search without an effect, fitted to all data."""
    slim = problem.without(name).sharing([c.problem for c in found.known])
    start = x[[k for k, p in enumerate(problem.tuned) if p in slim.tuned]]
    return slim, fit(slim, start, counts)


def effect_isolability(signatures: Sequence[Signature]) -> Isolability:
    """Compute the similarity of the effects' signatures."""
    table = np.array([[signature_cosine(a, b) for b in signatures] for a in signatures])
    return Isolability(
        tuple(s.id for s in signatures),
        table.reshape(len(signatures), len(signatures)),
        np.array([s.visible for s in signatures]),
    )


def final_search(
    found: Search, baseline_fit: BaselineFit, model: CheckedModel
) -> Search:
    """Return a search that ends with what is left of its model.

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
            disputed=agreed.get(name, 1.0) < AGREEMENT_SHARE,
            ordinary=is_ordinary(problem, x, name),
            own=own[name],
            rivals=tuple(rival for rival in groups.get(name, ()) if rival != name),
            form=problem.form(name),
        )
        for name in problem.effects
    )


def _runner_ups(step: Round) -> tuple[RunnerUp, ...]:
    return tuple(
        RunnerUp(
            c.id,
            c.reduction,
            c.z,
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


def unanswered_diagnosis(
    diagnosis: Diagnosis, bench: Bench, baseline_fit: BaselineFit | None = None
) -> DiagnosisResult:
    """Return a result without evidence, for a diagnosis that stopped early."""
    nothing = Evidence((), (), Isolability((), np.zeros((0, 0)), np.zeros(0)))
    return DiagnosisResult(diagnosis, nothing, None, np.zeros(0), bench, baseline_fit)


def _empty_diagnosis(bench: Bench, statement: str) -> DiagnosisResult:
    diagnosis = Diagnosis("fix-data", statement, problems=(statement,))
    return unanswered_diagnosis(diagnosis, bench)


def _numerics_diagnosis(bench: Bench, baseline_fit: BaselineFit) -> DiagnosisResult:
    plant = baseline_fit.problem.plant
    statement = (
        f"A simulation with {2 * plant.segments} segments or {2 * plant.substeps} "
        "steps per sample "
        f"differs by {format_number(baseline_fit.change)} times the noise floor, more "
        f"than {MAX_NUMERICAL_ERROR:g}: what would be named could be the numerics. "
        f"Record faster than {1.0 / plant.records[0].dt:.0f} Hz, or reduce the wrap."
    )
    diagnosis = Diagnosis("fix-numerics", statement, problems=(statement,))
    return unanswered_diagnosis(diagnosis, bench, baseline_fit)
