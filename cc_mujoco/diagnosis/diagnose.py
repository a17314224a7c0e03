"""The whole workflow: data and a scene in, a verdict, a report and a better scene out.

from cc_mujoco.diagnosis import diagnose

diagnosis = diagnose(["data"], "bench.xml", "out")
diagnosis.verdict, diagnosis.effects, diagnosis.gap
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.atlas import maps, ranked
from cc_mujoco.diagnosis.bench import Bench
from cc_mujoco.diagnosis.checks import check_bench
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.evidence import Evidence, Isolability, Trace
from cc_mujoco.diagnosis.experiment import propose
from cc_mujoco.diagnosis.findings import to_fix
from cc_mujoco.diagnosis.fitting import Fit, Problem, fit, tamed, weight
from cc_mujoco.diagnosis.floor import noise_floor
from cc_mujoco.diagnosis.folds import Crossed, cross, excess, stretches, trials
from cc_mujoco.diagnosis.gap import Predicted, gaps, overall, predicted, traces
from cc_mujoco.diagnosis.intake import load
from cc_mujoco.diagnosis.intervals import estimates, undetermined
from cc_mujoco.diagnosis.per_trial import odd_trial, trial_errors
from cc_mujoco.diagnosis.plant import Plant, Tuned, tuned
from cc_mujoco.diagnosis.records import Filtering, Record, prepare
from cc_mujoco.diagnosis.repair import added
from cc_mujoco.diagnosis.requirements import require_repairable
from cc_mujoco.diagnosis.screen import Signature, alike
from cc_mujoco.diagnosis.search import Round, Search, Thresholds, search
from cc_mujoco.diagnosis.trials import Dataset
from cc_mujoco.diagnosis.verdict import (
    Baseline,
    Diagnosis,
    Found,
    Gap,
    NotTestable,
    RunnerUp,
    Value,
    Verdict,
)
from cc_mujoco.diagnosis.wording import capital, listed
from cc_mujoco.errors import CableError

Progress = Callable[[float, str], None]

SEGMENTS = (8, 16, 32)
"""Segments per cable, coarse first; finer where the coarse ones are not enough."""
NUMERICS = 0.35
"""RMS change by a finer simulation, over the noise floor, that is harmless."""
SEEN = 3.0
"""Size over its uncertainty with which a plausible effect would show."""
EXPLAINED = 0.6
"""Share of the error beyond the floor that named effects have to take, or else the gap.

In the search large errors count less, since few moments must not decide what is named;
an effect that shows in few moments only closes the gap without taking that share.
"""
CLOSED = 0.75
"""Share of the gap that an effect has to close which takes less than `EXPLAINED`."""
GUESSED = 0.3
"""Relative uncertainty of a pretension from which more than one start is tried."""
OTHERS = (0.1, 0.3, 3.0)
"""Such starts, over the value that was given."""
LEAST = 100
"""Samples that must count."""


@dataclass(frozen=True)
class Tuning:
    """The baseline, ready for the search."""

    problem: Problem
    whole: Fit
    crossed: Crossed
    change: float
    """RMS change by a finer simulation, over the floor."""


@dataclass(frozen=True)
class Result:
    """A diagnosis with everything that belongs to it.

    Attributes:
        diagnosis: what is said.
        evidence: what is drawn.
        problem: the final model, or None where there is none.
        at: its parameters.
        bench: of the scene.
        tuning: the baseline, or None where there is none.
    """

    diagnosis: Diagnosis
    evidence: Evidence
    problem: Problem | None
    at: FloatArray
    bench: Bench
    tuning: Tuning | None = None


def reason(
    dataset: Dataset,
    bench: Bench,
    notes: Sequence[str] = (),
    *,
    ids: Sequence[str] | None = None,
    thresholds: Thresholds | None = None,
    seed: int = 0,
    progress: Progress = lambda share, doing: None,
) -> Result:
    """Everything but files: from checked trials to a verdict.

    Args:
        dataset: of `intake.load`, without anything to fix.
        bench: of the scene.
        notes: sentences about the data, passed on.
        ids: effects to consider; default all.
        thresholds: of decisions.
        seed: of bootstraps and noise draws.
        progress: called with the share done and what is being done.
    """
    limits = thresholds or Thresholds()
    bench = bench.known(dataset.constants)
    records, filtering = prepare(dataset, bench)
    if useless := _useless(records):
        return _empty(bench, useless, notes)
    progress(0.02, "fitting the baseline")
    tuning = tune(dataset, bench, records, filtering, seed)
    if tuning.change > NUMERICS:
        return _numerics(bench, tuning, notes)
    names = tuple(ids or EFFECTS)

    def told(share: float, doing: str) -> None:
        progress(0.2 + 0.6 * share, doing)

    found = search(tuning.crossed, stretches(records), names, limits, told)
    return _concluded(tuning, found, bench, limits, notes, seed, progress)


def _useless(records: Sequence[Record]) -> str:
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


def tune(
    dataset: Dataset,
    bench: Bench,
    records: tuple[Record, ...],
    filtering: Filtering,
    seed: int,
) -> Tuning:
    """Fit the baseline, with as many segments as it needs."""
    free = tuned(bench, records, dataset.constants)
    counts = [record.free for record in records]
    at = np.zeros(len(free))
    for segments in SEGMENTS:
        plant = Plant(bench, records, segments)
        flat = tuple(
            np.full(r.measured.shape, 0.02 * float(np.std(r.measured)) + 1e-9)
            for r in records
        )
        problem = Problem(plant, free, (), flat, flat, 0.2)
        tried = [fit(problem, start, counts) for start in _starts(free, at)]
        at = min(tried, key=lambda found: found.cost).at
        floor = noise_floor(dataset, plant, filtering, problem.values(at), seed=seed)
        problem = replace(problem, noise=floor.noise, floor=floor.tolerance)
        problem = problem.widened(at, counts)
        at = fit(problem, at, counts).at
        problem = replace(problem, weight=weight(problem.errors(at), counts))
        whole = fit(problem, at, counts)
        change = numerics(problem, whole.at)
        if change <= NUMERICS:
            break
    division = stretches(records)
    crossed = cross(problem, division, [whole.at] * len(division))
    return Tuning(problem, whole, crossed, change)


def _starts(free: Sequence[Tuned], at: FloatArray) -> list[FloatArray]:
    """Places to fit from: several pretensions where it is anybody's guess.

    Whether the slack side of a pair goes slack makes fits end in one valley or another.
    """
    starts = [at]
    for index, parameter in enumerate(free):
        if parameter.name == "pretension" and parameter.scale > GUESSED:
            for factor in OTHERS:
                start = at.copy()
                start[index] = math.log(factor) / parameter.scale
                starts.append(start)
    return starts


def numerics(problem: Problem, at: FloatArray) -> float:
    """RMS change of the torques over the floor by finer segments and steps, the larger.

    The finer simulation is that of the same parameters; errors are tamed as in fits.
    """
    values = problem.values(at)
    plant = problem.plant
    here = plant.simulate(values, problem.effects)
    worst = 0.0
    for finer in (plant.finer(segments=2), plant.finer(substeps=2)):
        there = finer.simulate(values, problem.effects)
        changes = [
            tamed((a - b) / floor)[:, record.counts].ravel()
            for a, b, floor, record in zip(
                here, there, problem.floor, plant.records, strict=True
            )
        ]
        worst = max(worst, float(np.sqrt(np.mean(np.concatenate(changes) ** 2))))
    return worst


def _concluded(
    tuning: Tuning,
    found: Search,
    bench: Bench,
    limits: Thresholds,
    notes: Sequence[str],
    seed: int,
    progress: Progress,
) -> Result:
    problem = found.after.problem
    counts = [record.counts for record in problem.plant.records]
    progress(0.82, "fitting the result to all data")
    start = np.mean([f.at for f in found.after.fits], axis=0)
    at = fit(problem, start, counts).at if problem.effects else tuning.whole.at
    progress(0.86, "predicting trials that were held out")
    held = _held_out(tuning, problem, at, seed)
    if held is None:
        problem, at = tuning.problem, tuning.whole.at
        held = _held_out(tuning, problem, at, seed)
        assert held is not None
    before, after, measures = held
    shown = traces(problem, before.torques, after.torques)
    drawn = maps(shown, seed)
    evidence = Evidence(shown, drawn, isolability(found.signatures))
    kind, statement = judged(found, problem, measures, limits)
    # What is added where nothing explains the error only stands in for it.
    asked = (tuning.problem, tuning.whole.at) if kind == "unknown" else (problem, at)
    odd = odd_trial(*asked)
    progress(0.95, "writing it down")
    estimated = estimates(problem, at, counts, after.places)
    ties = tuple(step.rivals for step in found.rounds if len(step.rivals) > 1)
    if not problem.effects:
        ties = ()
    rivals = [
        (c.crossed.problem, np.mean([f.at for f in c.crossed.fits], axis=0))
        for step in found.rounds
        if len(step.rivals) > 1
        for name in step.rivals
        for c in step.candidates
        if c.id == name
    ]
    diagnosis = Diagnosis(
        kind,
        statement,
        _found(found.rounds, problem, estimated),
        ties,
        untestable(found.signatures, tuning),
        propose(rivals, ties[0]) if ties else None,
        ranked(drawn),
        measures,
        Baseline(
            {p.name: estimated[p.name] for p in tuning.problem.tuned},
            undetermined(tuning.problem, tuning.whole.at, counts),
        ),
        {},
        tuple(_runner_ups(step) for step in found.rounds),
        tuple(notes),
        trial_errors(problem, before.torques, after.torques),
        odd.question if odd else "",
    )
    return Result(diagnosis, evidence, problem, at, bench, tuning)


class Held(NamedTuple):
    """Held-out data predicted without and with what was added."""

    before: Predicted
    after: Predicted
    gap: dict[str, Gap]


def _held_out(
    tuning: Tuning, problem: Problem, at: FloatArray, seed: int
) -> Held | None:
    """Predict what was held out; None where that does not bear the effects out.

    Whole trials are held out. An effect that a single trial shows, say the only one at
    low pretension, is not to be had from the others: then it is stretches of all.
    """
    records = problem.plant.records
    for division in (trials(records), stretches(records)):
        before = predicted(tuning.problem, tuning.whole.at, division)
        after = predicted(problem, at, division) if problem.effects else before
        gap = gaps(tuning.problem, before.torques, after.torques, division, seed)
        if not problem.effects or any(
            g.rmse_after <= g.rmse_before for g in gap.values()
        ):
            return Held(before, after, gap)
    return None


def judged(
    found: Search, problem: Problem, gap: Mapping[str, Gap], limits: Thresholds
) -> tuple[Verdict, str]:
    """The verdict in one word and in a sentence."""
    misfit = problem.raised * float(np.sqrt(found.before.squares))
    left = problem.raised * float(np.sqrt(found.after.squares))
    if not problem.effects:
        off = (
            "on data it has not seen the tuned scene is "
            f"{misfit:.2f} times the noise floor off"
        )
        usual = f"rigs without any hidden effect reach up to {limits.misfit:g}"
        if misfit <= limits.misfit:
            return "none", f"Nothing is missing: {off}; {usual}."
        if excess(found.before) < limits.certainty:
            return "none", (
                f"Nothing is missing that these data could show: {off}. "
                f"{capital(usual)}, but here a few moments make that error, which is "
                "no evidence."
            )
        return "unknown", (
            f"Something is missing (error {misfit:.2f} times the noise floor) and it "
            "is none of the effects in the library; see where the error lies."
        )
    names = " and ".join(EFFECTS[name].title for name in problem.effects)
    told = ", ".join(
        f"{channel}: {g.rmse_before:.3g} to {g.rmse_after:.3g} Nm (floor "
        f"{g.noise_floor:.3g})"
        for channel, g in gap.items()
    )
    explained = 1.0 - (left**2 - 1.0) / (misfit**2 - 1.0) if misfit > 1.0 else 1.0
    little = explained < EXPLAINED and overall(gap) < CLOSED
    if left > limits.misfit and little:
        return "unknown", (
            f"Something is missing; {names} explains {explained:.0%} of it, and the "
            f"rest is none of the effects in the library. {told}."
        )
    tie = next((s.rivals for s in found.rounds if len(s.rivals) > 1), ())
    if tie:
        either = " or ".join(EFFECTS[name].title for name in tie)
        sure = "".join(
            f"{EFFECTS[name].title}, and "
            for name in problem.effects
            if name not in tie
        )
        return (
            "tie",
            f"Missing is {sure}{either}; these data cannot tell which. {told}.",
        )
    return "named", f"Missing is {names}. Held-out, weighted RMS error of {told}."


def isolability(signatures: Sequence[Signature]) -> Isolability:
    """How alike the signatures of the effects are."""
    table = np.array([[alike(a, b) for b in signatures] for a in signatures])
    return Isolability(
        tuple(s.id for s in signatures),
        table.reshape(len(signatures), len(signatures)),
        np.array([s.visible for s in signatures]),
    )


def untestable(
    signatures: Sequence[Signature], tuning: Tuning
) -> tuple[NotTestable, ...]:
    """Effects that would not show at a plausible size."""
    size = sum(2 * int(r.counts.sum()) for r in tuning.problem.plant.records)
    independent = max(size * tuning.problem.weight**2, 1.0)
    found = []
    for s in signatures:
        clarity = s.visible * float(np.sqrt(independent))
        if clarity < SEEN:
            typical = ", ".join(
                f"{k.name} {k.typical:g} {k.unit}".removesuffix(" 1")
                for k in EFFECTS[s.id].knobs[:1]
            )
            found.append(
                NotTestable(
                    s.id,
                    f"a plausible size ({typical}) would stand out by {clarity:.1f} "
                    f"standard deviations only; it takes {EFFECTS[s.id].shows}",
                )
            )
    return tuple(found)


def _found(
    rounds: Sequence[Round], problem: Problem, estimated: Mapping[str, Value]
) -> tuple[Found, ...]:
    sure = {step.added: step.confidence for step in rounds}
    return tuple(
        Found(
            name,
            {knob.name: estimated[knob.name] for knob in EFFECTS[name].knobs},
            sure.get(name, 0.0),
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
                knob.name: c.crossed.problem.values(c.crossed.fits[0].at).get(
                    knob.name, 0.0
                )
                for knob in EFFECTS[c.id].knobs
            },
        )
        for c in step.candidates
    )


def _nothing() -> Evidence:
    return Evidence((), (), Isolability((), np.zeros((0, 0)), np.zeros(0)))


def _empty(bench: Bench, statement: str, notes: Sequence[str]) -> Result:
    diagnosis = Diagnosis("fix-data", statement, problems=(statement, *notes))
    return Result(diagnosis, _nothing(), None, np.zeros(0), bench)


def _numerics(bench: Bench, tuning: Tuning, notes: Sequence[str]) -> Result:
    statement = (
        f"A simulation with {2 * tuning.problem.plant.segments} segments or half the "
        f"time step differs by {tuning.change:.2f} times the noise floor, more than "
        f"{NUMERICS:g}: what would be named could be the numerics. Record faster than "
        f"{1.0 / tuning.problem.plant.records[0].dt:.0f} Hz, or reduce the wrap."
    )
    diagnosis = Diagnosis("fix-numerics", statement, problems=(statement, *notes))
    return Result(diagnosis, _nothing(), None, np.zeros(0), bench, tuning)


def diagnose(
    data: Iterable[str | os.PathLike[str]],
    scene: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    dataset_toml: str | os.PathLike[str] | None = None,
    command: str = "",
    seed: int = 0,
    progress: Progress = lambda share, doing: None,
) -> Diagnosis:
    """Diagnose trials against a scene and write report, verdict, scene and recording.

    Args:
        data: CSV or Parquet files or folders of trials.
        scene: MJCF file of the rig.
        out: folder for what is found; written whole or not at all.
        dataset_toml: what the columns mean and what is known, see `dataset_file`.
        command: how it was called, for the report.
        seed: of bootstraps and noise draws.
        progress: called with the share done and what is being done.

    Raises:
        CableError: no data, a wrong dataset file, a scene that is no bench or
            cannot be repaired (see `requirements`), or a folder with the scene or with
            other files that would be replaced.
    """
    from cc_mujoco.diagnosis.output import require_ours, write

    bench = Bench.of(Path(scene))
    require_ours(Path(out), Path(scene))
    if present := added(scene):
        raise CableError(
            f"scene {scene} has {', '.join(present)} outside its cables from an "
            "earlier diagnosis, which no baseline tunes; give the scene before it"
        )
    require_repairable(bench)
    progress(0.0, "reading the data")
    dataset, findings = load(list(data), dataset_toml)
    findings += check_bench(dataset.trials, bench.known(dataset.constants))
    notes = [finding.statement for finding in findings]
    wrong = to_fix(findings)
    if wrong or not dataset.trials:
        said = [finding.statement for finding in wrong] or ["No trial can be read."]
        more = len(said) - 1
        statement = f"The data must be put right first: {said[0]}"
        if more:
            statement += f" The report lists {more} more."
        diagnosis = Diagnosis("fix-data", statement, problems=tuple(notes or said))
        result = Result(diagnosis, _nothing(), None, np.zeros(0), bench)
    else:
        result = reason(dataset, bench, notes, seed=seed, progress=progress)
    return write(result, dataset, Path(out), command, seed)


__all__ = ["Result", "Trace", "diagnose", "reason"]
