"""Benchmark of `cc-mujoco diagnose`, on rigs in which something is hidden.

    python scripts/diagnosis_study/diagnose_benchmark.py --effects named \
        --strength 4 2 --makes guides elements --first 21000 --out runs/loop

Rigs, motions and sensors come from `rig`, which shares no code with the package. Every
case is generated, written to files, diagnosed from these as the command does, and only
then compared with its label. `--protocol` selects the first trials: `bare`, motions
only, or `standard`, also the rig turned, its cables off, and known weights. If the
verdict proposes a trial, its folder (`next_trial_NN`) is written, the rig plays the
motion of that folder under the facts of its `dataset.toml`, and all trials are
diagnosed again: until no trial is proposed, or `--proposals` have been recorded.

Thresholds were set on seeds below 4000; what followed from a study was measured on
seeds that had not led to it. `cases.jsonl` has a record of each case; those that have
one are not repeated. A rig keeps its seed over strengths and protocols. `event:KIND`
lets something happen once, alone or beside effects (`event:slip+viscous_friction`), see
`rig/events.py`; no trial is proposed there. With `--naive` every case is also named in
the simpler way of `bic`, from the same tuned baseline. `--search` restricts the effects
that are considered. Where the hidden effect is of no library, a table below the fold
shows what curves learn of it.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import tyro
from event_rigs import judged as judged_event
from kept_cases import complete
from rare_effects import RARE, SESSIONS, session_of

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import (
    EFFECTS,
    BaselineFit,
    Diagnosis,
    DiagnosisResult,
    Options,
    Problem,
    fit,
    infer,
    load,
    overall_share,
    run_inference,
    screen,
    with_proposal,
)
from cc_mujoco.diagnosis._fit.problem import floor_ratios
from cc_mujoco.diagnosis._learn.residual import described
from cc_mujoco.diagnosis._report.output import write_proposed
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._references import read_plan
from cc_mujoco.native import FloatArray
from cc_mujoco.report import table
from rig.dataset import clean_dataset, make_dataset, truth_of
from rig.engine import tension_at_rest
from rig.events import KINDS, with_event
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import NOMINAL, Rig, make_rig
from rig.sensors import BASIC, logged
from rig.strength import calibrate, measure
from rig.trials import LEAD, Trial, asked

if TYPE_CHECKING:
    from cc_mujoco.hardware._references import Planned

Record = dict[str, Any]
KEYS = "make", "protocol", "hidden", "strength", "seed"  # what tells a case
MAX_PROPOSED = 2  # proposed trials that are recorded at most
EVENT = "event:"  # prefix of an event among what is hidden
STATIC = (
    "joint_gravity", "joint_stiffness", "torque_sensor_gain", "torque_sensor_offset",
    "asymmetric_friction",
)  # fmt: skip
"""Effects that motions alone cannot separate."""
NEWER = ("joint_friction",)
"""Effects that come last, so that those of earlier studies keep their seeds."""
PAIRS = (
    "viscous_friction+backlash", "viscous_friction+joint_gravity",
    "load_independent_friction+motor_inertia", "stribeck_friction+viscous_friction",
    "asymmetric_friction+joint_stiffness", "pulley_eccentricity+viscous_friction",
)  # fmt: skip
CELLS = {
    f"tension_{cable}_{end}_n": f"tension_{letter}_{end}"
    for cable, letter in (("agonist", "a"), ("antagonist", "b"))
    for end in ("proximal", "distal")
}
"""Channels of the rig by those of load cells in the scene `bench`."""
ODDS_BANDS = (0.0, 0.7, 0.85, 0.92, 1.01)
"""Limits of the bands of stated probability in which verdicts are counted."""
_FAILED = "verdicts", "named", "ties", "events", "proposed", "end"
COLUMNS = ("tie", "half", "missed", "wrong")
"""Words for diagnoses that are not right, see `judged`."""


class Case(NamedTuple):
    """A rig to be diagnosed; the fields are `KEYS` of its record."""

    make: str
    protocol: str
    hidden: str
    strength: float
    seed: int

    @property
    def kind(self) -> str:
        if self.hidden in SESSIONS:
            return "rare"
        if self.event:
            return "event"
        if self.hidden == "none":
            return "none"
        if "+" in self.hidden:
            return "pair"
        return "unknown" if self.hidden in MAKES[self.make].unknown else "named"

    @property
    def effects(self) -> tuple[str, ...]:
        names = self.hidden.split("+")[bool(self.event) :]
        return tuple(name for name in names if name != "none")

    @property
    def event(self) -> str:
        """The kind of the event (`KINDS`), "" for none."""
        head = self.hidden.split("+")[0]
        return head.removeprefix(EVENT) if head.startswith(EVENT) else ""


class Step(NamedTuple):
    """One diagnosis, and the trial that it proposes ("" for none)."""

    result: DiagnosisResult
    proposed: str

    @property
    def diagnosis(self) -> Diagnosis:
        """The `Diagnosis` of the result."""
        return self.result.diagnosis


def loop(
    rig: Rig,
    amounts: Mapping[str, float],
    data: list[dict[str, FloatArray]],
    facts: str,
    folder: Path,
    proposals: int = MAX_PROPOSED,
    ids: Sequence[str] = (),
    search: Sequence[str] = (),
) -> list[Step]:
    """Diagnose trials of a rig, record up to `proposals` proposed ones, and again.

    Effects `ids` are requested, too; those of `search` are considered alone.
    """
    bench = Bench.of(scene_path("bench"))
    steps: list[Step] = []
    while True:
        place = folder / f"data_{len(steps)}"
        write_data(place, data, facts, "%.7g" if ids else "")
        if search:
            dataset, _ = load([place], None, bench)
            result = with_proposal(run_inference(dataset, bench, Options(search)))
        else:
            result, _ = infer(bench, [place], effects=ids)
        planned = result.diagnosis.next_experiment
        steps.append(Step(result, planned.description if planned else ""))
        if planned is None or len(steps) > proposals:
            return steps
        plan = folder / planned.folder
        write_proposed(plan, planned, result.motions, str(place / "dataset.toml"))
        trials, facts = planned_trials(plan)
        for trial, cell in trials:
            names = (*BASIC, CELLS[cell]) if cell else BASIC
            (more,) = clean_dataset(rig, amounts, [trial], rig.seed, names)
            key = [rig.seed, rig.seed, len(data)]
            columns = logged(more, MAKES[rig.make].chain_of(rig), names, key)
            if cell:
                columns[cell] = columns.pop(f"{CELLS[cell]}_n")
            data.append(columns)


def planned_trials(plan: Path) -> tuple[list[tuple[Trial, str]], str]:
    """Return the trials of a folder `next_trial_NN` with load cells, and its facts."""
    text = (plan / "dataset.toml").read_text(encoding="utf-8")
    known = tomllib.loads(text)["trials"]
    every = [(planned, known[planned.name]) for planned in read_plan(plan)]
    return [(trial_of(*each), each[1].get("load_cell", "")) for each in every], text


def trial_of(planned: Planned, known: Mapping[str, Any]) -> Trial:
    """Return the rig's trial for a planned one, with its facts of `dataset.toml`."""
    time = np.arange(0.0, planned.times[-1], 1e-3)
    motor = np.interp(time, planned.times, planned.motor)
    joint = np.interp(time, planned.times, planned.joint)
    load = "human"
    if known.get("locked") == "joint":
        load = "locked"
    elif planned.notes.startswith(("joint free", "joint pulled")):
        load = "free"
    usual = NOMINAL.pretension
    return dataclasses.replace(
        asked(motor, joint, load),
        tightness=known.get("pretension", usual) / usual,
        unhooked=known.get("unhooked", False),
        tilt=known.get("tilt", 0.0),
        known_torques=(
            known.get("known_motor_torque", 0.0),
            known.get("known_joint_torque", 0.0),
        ),
        swapped=known.get("swapped", False),
    )


def run(
    *keys: Any,
    proposals: int = MAX_PROPOSED,
    with_bic: bool = False,
    search: Sequence[str] = (),
) -> Record:
    """Generate, diagnose and record a case; with `with_bic` also name it by BIC."""
    case = Case(*keys)
    rig = make_rig(case.seed, make=case.make)
    trials = MAKES[rig.make].trials(rig)
    recorded = f"{trials}_standard" if case.protocol == "standard" else trials
    amounts: dict[str, float] = {}
    event = None
    if case.kind == "rare":
        data, facts = session_of(case.hidden, rig)
        proposals = 0
    else:
        for name in case.effects:
            size = calibrate(rig, name, case.strength, trials, case.seed)
            amounts[name] = size
        if case.event:
            data, event = with_event(rig, amounts, recorded, case.seed, case.event)
            proposals = 0
        else:
            data = make_dataset(rig, amounts, recorded, case.seed)
        facts = facts_of(recorded, case.seed)
    ids = RARE if case.kind == "rare" else ()
    with tempfile.TemporaryDirectory() as folder:
        steps = loop(rig, amounts, data, facts, Path(folder), proposals, ids, search)
    first, truth = steps[0], baseline_of(rig, amounts, case.seed)
    searched, found = first.result.found, first.diagnosis
    fitted = searched.fitted if searched else None
    beliefs = [step.diagnosis.belief for step in steps]
    record = {
        **case._asdict(),
        "kind": case.kind,
        "effects": case.effects,
        "amounts": list(amounts.values()),
        "reached": measure(rig, amounts, trials, case.seed).refit if amounts else 0.0,
        "trials": recorded,
        "misfit": fitted.crossed.misfit if fitted else math.nan,
        "steps": [judgement(step.diagnosis) for step in steps],
        "proposed": [step.proposed for step in steps],
        "odds": [belief.probability if belief else None for belief in beliefs],
        "closed": overall_share(found.gap) if found.gap else math.nan,
        "intervals": {
            name: [value.value, *value.ci95, truth[name]]
            for name, value in found.baseline.parameters.items()
            if name in truth and event is None
        },
        "event": judged_event(found, event),
        "learned": learning(found),
    }
    if with_bic and fitted is not None:
        record["bic"] = bic(fitted)._asdict()
    return record


def baseline_of(rig: Rig, amounts: Mapping[str, float], seed: int) -> dict[str, float]:
    """Return the true parameters of a rig in terms of the baseline's lumped scene."""
    bench = truth_of(rig, amounts, seed).plant.bench
    # A shaft that twists is soft in series with both cables.
    pair = 2.0 * rig.motor_radius**2 * rig.axial_stiffness / rig.length
    return {
        "axial_stiffness": rig.axial_stiffness / (1.0 + bench.shaft * pair),
        # The motor moves before the recording begins.
        "pretension": tension_at_rest(bench, rig.pretension, LEAD),
        # The scene's wrap is taken for granted, so friction is scaled by the rest.
        "friction": 0.5 * (rig.friction_a + rig.friction_b) * rig.wrap / NOMINAL.wrap,
    }


def judgement(diagnosis: Diagnosis) -> Record:
    return {
        "verdict": diagnosis.verdict,
        "named": [effect.id for effect in diagnosis.missing],
        "ties": [list(tie) for tie in diagnosis.ties],
        "values": {
            name: [value.value, *value.ci95]
            for effect in diagnosis.missing
            for name, value in effect.parameters.items()
        },
        "said": diagnosis.statement,
    }


def learning(found: Diagnosis) -> Record:
    """Return errors over the floor, of the tuned scene and of all that is in a model.

    With it are the curves that were learned, and the gap that they close.
    """
    learned = found.learned
    curves = learned.curves if learned else ()
    gap = learned.gap if learned and curves else found.gap
    return {
        "before": floor_ratios(found.gap)[0],
        "after": floor_ratios(gap)[1],
        "closed": learned.gap_closed if learned and curves else 0.0,
        "curves": "; ".join(map(described, curves)),
        "formulas": "; ".join(curve.formula for curve in curves if curve.formula),
    }


def judged(
    kind: str,
    hidden: Sequence[str],
    verdict: str,
    named: Sequence[str] = (),
    ties: Sequence[Sequence[str]] = (),
) -> str:
    """Return how a diagnosis went: right, tie, half, missed or wrong.

    `kind` of the hidden effects is named, pair, unknown or none; `ties` are groups of
    ids.
    """
    tied = [set(tie) for tie in ties]
    if kind == "none":
        return "right" if verdict == "none" else "wrong"
    if kind == "unknown":
        return {"unknown": "right", "none": "missed"}.get(verdict, "wrong")
    sure = set(named).difference(*tied)
    if kind == "pair":
        if set(hidden) <= sure:
            return "right"
        either = sure.union(*(tie for tie in tied if len(tie) == 2))
        if set(hidden) <= either:
            return "tie"
        return "half" if set(hidden) & either else "wrong"
    if verdict == "unknown":
        return "missed"  # whatever it added: it reports that most of the error is left
    for tie in tied:
        if hidden[0] in tie:
            return "tie" if len(tie) == 2 else "missed"
    if named and named[0] == hidden[0]:
        return "right"
    return "missed" if not named else "wrong"


def word_of(record: Record, step: int) -> str:
    """Return how the diagnosis of number `step` went, see `judged`."""
    found, kind = record["steps"][step], record["kind"]
    if kind == "event":
        if record["event"]["found"]:
            return "right"
        return "wrong" if record["event"]["kinds"] else "missed"
    kind = {"rare": "named" if record["effects"] else "none"}.get(kind, kind)
    return judged(
        kind, record["effects"], found["verdict"], found["named"], found["ties"]
    )


def is_right(record: Record, step: int) -> bool:
    """Return whether a verdict is right in the sense of the odds that it states.

    Names are right if they are all that is hidden, a tie if one of its effects is.
    """
    found, hidden = record["steps"][step], set(record["effects"])
    if found["verdict"] == "tie":
        return any(hidden & set(tie) for tie in found["ties"])
    if record["kind"] == "unknown" or not hidden:
        right = "unknown" if record["kind"] == "unknown" else "none"
        return bool(found["verdict"] == right)
    return found["verdict"] == "named" and hidden == set(found["named"])


def is_alone(record: Record) -> bool:
    """Return whether the last verdict is right and names nothing else."""
    named = set(record["steps"][-1]["named"])
    alone = record["kind"] in ("none", "unknown") or named == set(record["effects"])
    if record["kind"] == "event":
        alone = is_right(record, -1)
    return word_of(record, -1) == "right" and alone


def end_of(record: Record) -> str:
    """Return the end of a loop: its verdict, "undecidable" or "open".

    A tie is undecidable if no trial would settle it, and open if one more is proposed
    than may be recorded.
    """
    last = record["steps"][-1]
    if last["verdict"] != "tie" and not last["ties"]:
        return str(last["verdict"])
    return "open" if record["proposed"][-1] else "undecidable"


def cases(
    hidden: Sequence[str],
    makes: Sequence[str],
    strengths: Sequence[float],
    protocols: Sequence[str],
    first: int,
    rounds: int,
) -> Iterator[Case]:
    """Yield all cases, alternating between makes so that any part is balanced.

    Every hidden effect and round has a seed of its own.
    """
    for turn in range(rounds):
        for shift in range(len(makes)):
            for place, name in enumerate(hidden):
                make = makes[(place + shift) % len(makes)]
                known = {"none", *SESSIONS, *MAKES[make].effects}
                known |= {EVENT + kind for kind in KINDS}
                if not set(name.split("+")) <= known:
                    continue
                rare = name in SESSIONS
                seed = first + turn if rare else first + 100 * turn + place
                alone = name.startswith(EVENT) and "+" not in name
                fixed = rare or alone or name == "none"
                for strength in (0.0,) if fixed else strengths:
                    for protocol in protocols:
                        yield Case(make, protocol, name, strength, seed)


def summary(records: Sequence[Record]) -> str:
    """Return a study's results as Markdown; pages take the text above the fold."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for r in records:
        size = f"{r['strength']:g}" if r["strength"] else "-"
        name = r["kind"] + (", motions alone" if r["protocol"] == "bare" else "")
        groups.setdefault((name, size), []).append(r)
    rates = [_rates(key, own) for key, own in sorted(groups.items())]
    head = [
        "hidden", "R", "rigs", "right at once", "right and alone",
        "in a tie", "one of two", "missed", "wrong",
    ]  # fmt: skip
    if any("bic" in r for r in records):
        head += ["by BIC", "wrong"]
        for row, own in zip(rates, map(groups.get, sorted(groups)), strict=True):
            guessed = [_guessed(r) for r in own or () if "bic" in r]
            wrong = [word_of(r, -1) for r in guessed].count("wrong")
            row += [str(sum(map(is_alone, guessed))), str(wrong)]
    verdicts = []
    for verdict in ("named", "none", "tie", "unknown"):
        given = [is_right(r, 0) for r in records if _first(r) == verdict]
        if given:
            share = f"{np.mean(given):.0%} ({exact(given)})"
            verdicts.append([verdict, str(len(given)), share])
    failed = []
    for r in records:
        if not is_alone(r):
            parts = ("verdict", "named", "ties")
            said = ["; ".join(str(each[part]) for each in r["steps"]) for part in parts]
            which = [str(r[key]) for key in KEYS]
            events = "; ".join(r["event"]["kinds"])
            failed.append([*which, *said, events, "; ".join(r["proposed"]), end_of(r)])
    return "\n\n".join(
        [
            table(head, rates),
            *_figures(records),
            table(("odds", "verdicts", "mean", "right"), calibration(records)),
            "<details><summary>By verdict, and what was not right and alone</summary>",
            table(("verdict", "given", "right"), verdicts),
            table((*KEYS, *_FAILED), failed),
            *_learned(records),
            "</details>\n",
        ]
    )


def _rates(key: Sequence[str], own: Sequence[Record]) -> list[str]:
    words = [word_of(r, -1) for r in own]
    once = [word_of(r, 0) for r in own].count("right")
    alone = f"{sum(map(is_alone, own))} ({exact(map(is_alone, own))} %)"
    counts = (words.count(word) for word in COLUMNS)
    return [*key, str(len(own)), str(once), alone, *map(str, counts)]


def _first(record: Record) -> str:
    return str(record["steps"][0]["verdict"])


def _guessed(record: Record) -> Record:
    """Return the record of a case as the lowest BIC names it.

    It has the limit of `none`: without it, it would name something on any rig.
    """
    guessed = record["bic"]["named"] if record["misfit"] > Limit.max_misfit else None
    named = [guessed] if guessed else []
    found = {"verdict": "named" if named else "none", "named": named, "ties": []}
    return {**record, "steps": [found], "event": {"found": False, "kinds": named}}


def exact(right: Iterable[bool]) -> str:
    """Return an exact 95 % interval [%] (Clopper, Pearson, Biometrika 26, 1934)."""
    from scipy.stats import binomtest

    found = list(right)
    low, high = binomtest(sum(found), len(found)).proportion_ci(method="exact")
    return f"{100 * low:.0f} to {100 * high:.0f}"


def _figures(records: Sequence[Record]) -> list[str]:
    """Return sentences: effect-free rigs, the gap, what intervals cover, times."""
    found = []
    free = [r for r in records if r["kind"] == "none"]
    if free:
        errors = [r["misfit"] for r in free]
        coarse = sum(r["trials"].startswith("restful") for r in free)
        found.append(
            f"Effect-free rigs are {min(errors):.2f} to {max(errors):.2f} floors off; "
            f"{coarse} of {len(free)} have coarse encoders."
        )
    calm = [r for r in records if r["kind"] != "event"]
    if calm:
        alarms = [not r["event"]["found"] for r in calm]
        found.append(
            f"Events in rigs without one: {sum(alarms)} of {len(calm)} "
            f"({exact(alarms)} %)."
        )
    late = [abs(r["event"]["late"]) for r in records if r["kind"] == "event"]
    if late := [each for each in late if math.isfinite(each)]:
        found.append(f"Times of events that are placed are off by {max(late):.3f} s.")
    right = [r for r in records if r["kind"] == "named" and word_of(r, 0) == "right"]
    shares = [
        f"{np.nanmedian([r['closed'] for r in own]):.2f} at R = {size:g} ({len(own)})"
        for size, own in _by_strength(right)
    ]
    if shares:
        found.append(f"Median gap closed: {', '.join(shares)}.")
    open_ones = [r for r in records if r["steps"][-1]["verdict"] == "unknown"]
    others = [r for r in records if r not in open_ones]
    for group, where in ((others, ""), (open_ones, " where the verdict is `unknown`")):
        if covers := _covers([r["intervals"] for r in group]):
            found.append(f"Intervals of 95 % that cover{where}: {', '.join(covers)}.")
    return found


def _covers(given: Sequence[Record]) -> list[str]:
    """Return for each parameter how many of the intervals hold the true value."""
    covers = []
    for name in dict.fromkeys(name for each in given for name in each):
        of = [each[name] for each in given if name in each]
        held = [low <= true <= high for _, low, high, true in of]
        covers.append(f"{name} {sum(held)} of {len(held)} ({exact(held)} %)")
    return covers


def _learned(records: Sequence[Record]) -> list[str]:
    """Return a table of curves learned on rigs with an unknown effect, and medians."""
    own = [r for r in records if r["kind"] == "unknown"]
    rows = [
        [
            f"{r['hidden'].removeprefix('unknown_')} ({r['make']})", f"`{_first(r)}`",
            f"{r['learned']['before']:.1f}", f"{r['learned']['after']:.1f}",
            f"{r['learned']['closed']:.2f}", r["learned"]["curves"],
            r["learned"]["formulas"],
        ]
        for r in own
    ]  # fmt: skip
    unknown = [r["learned"] for r in own if _first(r) == "unknown"]
    if not unknown:
        return []
    found = [each["closed"] for each in unknown if each["curves"]]
    whole = [1.0 - (e["after"] - 1.0) / (e["before"] - 1.0) for e in unknown]
    head = "hidden", "verdict", "scene", "model", "by curves", "curves", "formulas"
    return [
        table(head, rows),
        f"Of {len(unknown)} `unknown` rigs {len(found)} have curves, which close "
        f"{np.median(found or [0.0]):.2f} (median) of what is left; model and curves "
        f"close {np.median(whole):.2f} (median of all of them).",
    ]


def _by_strength(records: Sequence[Record]) -> list[tuple[float, list[Record]]]:
    sizes = sorted({r["strength"] for r in records})
    return [(size, [r for r in records if r["strength"] == size]) for size in sizes]


def calibration(records: Sequence[Record]) -> list[list[str]]:
    """Return the share of right verdicts in bands of the odds that they stated.

    The last verdict of every rig counts, and the first where a trial followed it.
    """
    stated, right = [], []
    for record in records:
        for place in {0, len(record["steps"]) - 1}:
            if (odds := record["odds"][place]) is not None:
                stated.append(odds)
                right.append(is_right(record, place))
    found = []
    for low, high in pairwise(ODDS_BANDS):
        here = [k for k, odds in enumerate(stated) if low <= odds < high]
        if here:
            given = [right[k] for k in here]
            mean = sum(stated[k] for k in here) / len(here)
            found.append(
                [
                    f"{low:.2f} to {min(high, 1.0):.2f}", str(len(here)), f"{mean:.3f}",
                    f"{sum(given) / len(here):.3f} ({exact(given)} %)",
                ]
            )  # fmt: skip
    return found


class Guess(NamedTuple):
    """The effect that the comparison method `bic` names, and its criterion."""

    named: str | None  # id of the effect, or None where nothing is found missing
    ranking: tuple[str, ...]  # ids, the likeliest first; named or not
    share: float  # of the squared residual that the first of the ranking explains


def bic(
    baseline_fit: BaselineFit,
    evaluations: int = 12,  # with new parameters; screening has found a start
    ids: Sequence[str] = tuple(EFFECTS),
) -> Guess:
    """Return the effect with the lowest BIC, named if that is below the baseline's.

    A simpler way to name a missing effect, to compare `cc-mujoco diagnose` with
    (Schwarz, Annals of Statistics 6, 1978): full refits of the likeliest effects to all
    data, from the same tuned baseline. BIC = n ln(S/n) + k ln n with the sum of squares
    S of n samples and k parameters, as if neighbouring samples were independent and the
    model exact. No data is held out.
    """
    problem, x = baseline_fit.problem, baseline_fit.whole.x
    counts = [record.counts for record in problem.plant.records]
    before, baseline = _scored(problem, x)
    scores, squares = {}, {}
    for signature in screen(problem, x, counts, ids)[:6]:  # that explain most
        wider = problem.with_effect(signature.id, signature.start)
        start = wider.placed(x, signature.start)
        try:
            found = fit(wider, start, counts, evaluations)
        except CableError:  # cannot be simulated, so it is no candidate
            continue
        squares[signature.id], scores[signature.id] = _scored(wider, found.x)
    ranking = tuple(sorted(scores, key=lambda name: scores[name]))
    if not ranking:
        return Guess(None, (), 0.0)
    first = ranking[0]
    named = first if scores[first] < baseline else None
    return Guess(named, ranking, 1.0 - squares[first] / before)


def _scored(problem: Problem, x: FloatArray) -> tuple[float, float]:
    """Return the sum of squared errors, and BIC."""
    kept = [
        error[:, record.counts].ravel()
        for error, record in zip(problem.errors(x), problem.plant.records, strict=True)
    ]
    squares = float(sum(part @ part for part in kept))
    count = sum(part.size for part in kept)
    score = count * math.log(squares / count) + x.size * math.log(count)
    return squares, score


def main(
    effects: tuple[str, ...] = ("static",),
    makes: tuple[Literal[tuple(MAKES)], ...] = tuple(MAKES),
    strength: tuple[float, ...] = (4.0, 2.0),
    protocol: tuple[Literal["bare", "standard"], ...] = ("standard",),
    first: int = 18000,
    rounds: int = 1,
    proposals: int = MAX_PROPOSED,
    naive: bool = False,
    search: tuple[str, ...] = (),
    jobs: int = 1,
    out: Path = Path("runs", "diagnose_benchmark"),
) -> None:
    """Run the cases that are not done; write and print the table.

    Args:
        effects: ids, pairs "a+b", none, or the groups static, named, earlier, newer,
            unknown, pairs, nones (ten rigs), rare, events, sealed (one or two effects,
            unknown ones, events, and five rigs of each make with nothing).
        strength: R of every effect.
        first: seed.
        rounds: rigs of each kind.
        proposals: number of proposed trials that are recorded at most.
        naive: name by BIC, too; a quarter longer.
        search: ids of the only effects that are considered.
        jobs: processes.
    """
    named = dict.fromkeys(n for m in makes for n in MAKES[m].named)
    earlier = tuple(name for name in named if name not in NEWER)
    newer = tuple(name for name in named if name in NEWER)
    groups = {
        "static": STATIC,
        "named": earlier + newer,
        "earlier": earlier,
        "newer": newer,
        "unknown": tuple(n for m in makes for n in MAKES[m].unknown),
        "pairs": PAIRS,
        "nones": ("none",) * 10,
        "rare": tuple(SESSIONS),
        "events": tuple(EVENT + kind for kind in KINDS),
    }
    sealed = ("named", "pairs", "unknown", "events")
    groups["sealed"] = sum((groups[each] for each in sealed), ("none",) * 5)
    hidden = [n for name in effects for n in groups.get(name, (name,))]
    every = cases(hidden, makes, strength, protocol, first, rounds)
    make = partial(run, proposals=proposals, with_bic=naive, search=search)
    complete(out, KEYS, every, make, summary, jobs)


if __name__ == "__main__":
    tyro.cli(main)
