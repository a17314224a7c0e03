"""From checked trials to a verdict: baseline, search, and what follows from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.data.trials import Dataset
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.evidence import Evidence, Isolability
from cc_mujoco.diagnosis.inference.baseline import NUMERICS, BaselineFit, fit_baseline
from cc_mujoco.diagnosis.inference.experiment import propose
from cc_mujoco.diagnosis.inference.fitting import Problem, fit
from cc_mujoco.diagnosis.inference.folds import (
    excess,
    interleaved_folds,
    trial_folds,
)
from cc_mujoco.diagnosis.inference.gap import (
    Predicted,
    gaps,
    overall,
    predicted,
    traces,
)
from cc_mujoco.diagnosis.inference.intervals import estimates, undetermined
from cc_mujoco.diagnosis.inference.per_trial import odd_trial, trial_errors
from cc_mujoco.diagnosis.inference.records import Record, prepare
from cc_mujoco.diagnosis.inference.residual_maps import maps, ranked
from cc_mujoco.diagnosis.inference.result import Result
from cc_mujoco.diagnosis.inference.screen import Signature, signature_cosine
from cc_mujoco.diagnosis.inference.search import Round, Search, Thresholds, search
from cc_mujoco.diagnosis.verdict import (
    Baseline,
    Diagnosis,
    Found,
    Gap,
    NotTestable,
    RunnerUp,
    Verdict,
)
from cc_mujoco.diagnosis.wording import capital, listed
from cc_mujoco.estimation.least_squares import Estimate

Progress = Callable[[float, str], None]

SEEN = 3.0
"""Size over its uncertainty with which a plausible effect would show."""

EXPLAINED = 0.6
"""Share of the error beyond the floor that named effects have to take, or else the gap.

In the search large errors count less, since few moments must not decide what is named;
an effect that shows in few moments only closes the gap without taking that share.
"""

CLOSED = 0.75
"""Share of the gap that an effect has to close which takes less than `EXPLAINED`."""

LEAST = 100
"""Samples that must count."""


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
    if useless := _insufficient_excitation(records):
        return _empty(bench, useless, notes)
    progress(0.02, "fitting the baseline")
    baseline_fit = fit_baseline(dataset, bench, records, filtering, seed)
    if baseline_fit.change > NUMERICS:
        return _numerics(bench, baseline_fit, notes)
    names = tuple(ids or EFFECTS)

    def told(share: float, doing: str) -> None:
        progress(0.2 + 0.6 * share, doing)

    found = search(
        baseline_fit.crossed, interleaved_folds(records), names, limits, told
    )
    return _concluded(baseline_fit, found, bench, limits, notes, seed, progress)


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
    limits: Thresholds,
    notes: Sequence[str],
    seed: int,
    progress: Progress,
) -> Result:
    problem = found.after.problem
    counts = [record.counts for record in problem.plant.records]
    progress(0.82, "fitting the result to all data")
    start = np.mean([f.x for f in found.after.fits], axis=0)
    x = fit(problem, start, counts).x if problem.effects else baseline_fit.whole.x
    progress(0.86, "predicting trials that were held out")
    held = _held_out(baseline_fit, problem, x, seed)
    if held is None:
        problem, x = baseline_fit.problem, baseline_fit.whole.x
        held = _held_out(baseline_fit, problem, x, seed)
        assert held is not None
    before, after, measures = held
    shown = traces(problem, before.torques, after.torques)
    drawn = maps(shown, seed)
    evidence = Evidence(shown, drawn, isolability(found.signatures))
    kind, statement = judged(found, problem, measures, limits)
    # What is added where nothing explains the error only stands in for it.
    asked = (
        (baseline_fit.problem, baseline_fit.whole.x)
        if kind == "unknown"
        else (problem, x)
    )
    odd = odd_trial(*asked)
    progress(0.95, "writing it down")
    estimated = estimates(problem, x, counts, after.places)
    ties = tuple(step.rivals for step in found.rounds if len(step.rivals) > 1)
    if not problem.effects:
        ties = ()
    rivals = [
        (c.crossed.problem, np.mean([f.x for f in c.crossed.fits], axis=0))
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
        untestable(found.signatures, baseline_fit),
        propose(rivals, ties[0]) if ties else None,
        ranked(drawn),
        measures,
        Baseline(
            {p.name: estimated[p.name] for p in baseline_fit.problem.tuned},
            undetermined(baseline_fit.problem, baseline_fit.whole.x, counts),
        ),
        {},
        tuple(_runner_ups(step) for step in found.rounds),
        tuple(notes),
        trial_errors(problem, before.torques, after.torques),
        odd.question if odd else "",
    )
    return Result(diagnosis, evidence, problem, x, bench, baseline_fit)


class Held(NamedTuple):
    """Held-out data predicted without and with what was added."""

    before: Predicted
    after: Predicted
    gap: dict[str, Gap]


def _held_out(
    baseline_fit: BaselineFit, problem: Problem, x: FloatArray, seed: int
) -> Held | None:
    """Predict what was held out; None where that does not bear the effects out.

    Whole trials are held out. An effect that a single trial shows, say the only one at
    low pretension, is not to be had from the others: then it is stretches of all.
    """
    records = problem.plant.records
    for division in (trial_folds(records), interleaved_folds(records)):
        before = predicted(baseline_fit.problem, baseline_fit.whole.x, division)
        after = predicted(problem, x, division) if problem.effects else before
        gap = gaps(baseline_fit.problem, before.torques, after.torques, division, seed)
        if not problem.effects or any(
            g.rmse_after <= g.rmse_before for g in gap.values()
        ):
            return Held(before, after, gap)
    return None


def judged(
    found: Search, problem: Problem, gap: Mapping[str, Gap], limits: Thresholds
) -> tuple[Verdict, str]:
    """The verdict in one word and in a sentence."""
    misfit, left = found.before.misfit, found.after.misfit
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
    table = np.array([[signature_cosine(a, b) for b in signatures] for a in signatures])
    return Isolability(
        tuple(s.id for s in signatures),
        table.reshape(len(signatures), len(signatures)),
        np.array([s.visible for s in signatures]),
    )


def untestable(
    signatures: Sequence[Signature], baseline_fit: BaselineFit
) -> tuple[NotTestable, ...]:
    """Effects that would not show at a plausible size."""
    size = sum(2 * int(r.counts.sum()) for r in baseline_fit.problem.plant.records)
    independent = max(size * baseline_fit.problem.weight**2, 1.0)
    found = []
    for s in signatures:
        clarity = s.visible * float(np.sqrt(independent))
        if clarity < SEEN:
            typical = ", ".join(
                f"{k.name} {k.typical:g} {k.unit}".removesuffix(" 1")
                for k in EFFECTS[s.id].parameters[:1]
            )
            found.append(
                NotTestable(
                    s.id,
                    f"a plausible size ({typical}) would stand out by {clarity:.1f} "
                    "standard deviations only; it takes "
                    f"{EFFECTS[s.id].required_excitation}",
                )
            )
    return tuple(found)


def _found(
    rounds: Sequence[Round], problem: Problem, estimated: Mapping[str, Estimate]
) -> tuple[Found, ...]:
    sure = {step.added: step.confidence for step in rounds}
    return tuple(
        Found(
            name,
            {
                parameter.name: estimated[parameter.name]
                for parameter in EFFECTS[name].parameters
            },
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
                parameter.name: c.crossed.problem.values(c.crossed.fits[0].x).get(
                    parameter.name, 0.0
                )
                for parameter in EFFECTS[c.id].parameters
            },
        )
        for c in step.candidates
    )


def unanswered(
    diagnosis: Diagnosis, bench: Bench, baseline_fit: BaselineFit | None = None
) -> Result:
    """A diagnosis that got no further than what is wrong, without evidence."""
    nothing = Evidence((), (), Isolability((), np.zeros((0, 0)), np.zeros(0)))
    return Result(diagnosis, nothing, None, np.zeros(0), bench, baseline_fit)


def _empty(bench: Bench, statement: str, notes: Sequence[str]) -> Result:
    diagnosis = Diagnosis("fix-data", statement, problems=(statement, *notes))
    return unanswered(diagnosis, bench)


def _numerics(bench: Bench, baseline_fit: BaselineFit, notes: Sequence[str]) -> Result:
    plant = baseline_fit.problem.plant
    statement = (
        f"A simulation with {2 * plant.segments} segments or half the time step "
        f"differs by {baseline_fit.change:.2f} times the noise floor, more "
        f"than {NUMERICS:g}: what would be named could be the numerics. Record faster "
        f"than {1.0 / plant.records[0].dt:.0f} Hz, or reduce the wrap."
    )
    diagnosis = Diagnosis("fix-numerics", statement, problems=(statement, *notes))
    return unanswered(diagnosis, bench, baseline_fit)
