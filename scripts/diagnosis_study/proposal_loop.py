"""Loop of diagnosis and proposed trials, on rigs in which an effect is hidden.

    python scripts/diagnosis_study/proposal_loop.py --effects named --strength 4 2 \
        --makes bristles guides elements --first 21000 --out runs/loop

A rig is recorded and diagnosed. If the verdict proposes a trial, its folder
(`next_trial_NN`) is written, the rig plays the motion of that folder under the facts of
its `dataset.toml`, and all trials are diagnosed again: until no trial is proposed, or
`--proposals` have been recorded. `--protocol` selects the first trials: `bare`, motions
only, or `standard`, also the rig turned, its cables off, and known weights.

`rigs.jsonl` has a record of each rig; rigs that have one are not repeated. A rig keeps
its seed over strengths and protocols, so rates of different strengths share rigs.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import tyro
from diagnose_benchmark import NEWER, PAIRS, exact, is_right, judged, judgement
from kept_cases import Lines

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.report import table
from rig.dataset import clean_dataset, make_dataset
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import NOMINAL, Rig, make_rig
from rig.sensors import BASIC, logged
from rig.strength import calibrate
from rig.trials import Trial, asked

if TYPE_CHECKING:
    from cc_mujoco.diagnosis import Diagnosis, DiagnosisResult
    from cc_mujoco.hardware._references import Planned

MAX_PROPOSED = 2  # proposed trials that are recorded at most
STATIC = (
    "joint_gravity", "joint_stiffness", "torque_sensor_gain", "torque_sensor_offset",
    "asymmetric_friction",
)  # fmt: skip
"""Effects that motions alone cannot separate."""
CELLS = {
    f"tension_{cable}_{end}_n": f"tension_{letter}_{end}"
    for cable, letter in (("agonist", "a"), ("antagonist", "b"))
    for end in ("proximal", "distal")
}
"""Channels of the rig by those of load cells in the scene `bench`."""
ODDS_BANDS = (0.0, 0.7, 0.85, 0.92, 1.01)
"""Limits of the bands of stated probability in which verdicts are counted."""
KEYS = "make", "protocol", "hidden", "strength", "seed"  # what tells a rig
Record = dict[str, Any]


class Case(NamedTuple):
    """A rig to be diagnosed; the fields are `KEYS` of its record."""

    make: str
    protocol: str
    hidden: str
    strength: float
    seed: int

    @property
    def kind(self) -> str:
        if self.hidden == "none":
            return "none"
        if "+" in self.hidden:
            return "pair"
        return "unknown" if self.hidden in MAKES[self.make].unknown else "named"

    @property
    def effects(self) -> tuple[str, ...]:
        return () if self.hidden == "none" else tuple(self.hidden.split("+"))


class Step(NamedTuple):
    """One diagnosis, its time [s], and the trial that it proposes ("" for none)."""

    result: DiagnosisResult
    proposed: str
    seconds: float

    @property
    def diagnosis(self) -> Diagnosis:
        """The `Diagnosis` of the result."""
        return self.result.diagnosis


def loop(
    rig: Rig,
    amounts: Mapping[str, float],
    recorded: str,
    seed: int,
    folder: Path,
    proposals: int = MAX_PROPOSED,
) -> list[Step]:
    """Diagnose a rig, record up to `proposals` proposed trials, diagnose again."""
    from cc_mujoco.diagnosis import infer
    from cc_mujoco.diagnosis._report.output import write_proposed

    bench = Bench.of(scene_path("bench"))
    data = make_dataset(rig, amounts, recorded, seed)
    facts = facts_of(recorded, seed)
    steps: list[Step] = []
    while True:
        place = folder / f"data_{len(steps)}"
        write_data(place, data, facts)
        begin = time.perf_counter()
        result, _ = infer(bench, [place])
        spent = time.perf_counter() - begin
        planned, motion = result.diagnosis.next_experiment, result.motion
        steps.append(Step(result, planned.description if planned else "", spent))
        if planned is None or motion is None or len(steps) > proposals:
            return steps
        plan = folder / planned.folder
        write_proposed(plan, planned, motion, str(place / "dataset.toml"))
        trial, cell, facts = planned_trial(plan)
        names = (*BASIC, CELLS[cell]) if cell else BASIC
        (more,) = clean_dataset(rig, amounts, [trial], seed, names)
        key = [seed, rig.seed, len(data)]
        columns = logged(more, MAKES[rig.make].chain_of(rig), names, key)
        if cell:
            columns[cell] = columns.pop(f"{CELLS[cell]}_n")
        data.append(columns)


def planned_trial(plan: Path) -> tuple[Trial, str, str]:
    """Return the trial of a folder `next_trial_NN`, its load cell, and its facts."""
    from cc_mujoco.hardware._references import read_plan

    (planned,) = read_plan(plan)
    text = (plan / "dataset.toml").read_text(encoding="utf-8")
    known = tomllib.loads(text)["trials"][planned.name]
    return trial_of(planned, known), known.get("load_cell", ""), text


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
    usual = NOMINAL["pretension_n"]
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


def run(case: Case, proposals: int, amounts: Mapping[str, float]) -> Record:
    rig = make_rig(case.seed, make=case.make)
    trials = MAKES[rig.make].trials(rig)
    recorded = f"{trials}_standard" if case.protocol == "standard" else trials
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        steps = loop(rig, amounts, recorded, case.seed, Path(folder), proposals)
    beliefs = [step.diagnosis.belief for step in steps]
    return {
        **case._asdict(),
        "kind": case.kind,
        "effects": case.effects,
        "amounts": list(amounts.values()),
        "steps": [judgement(step.diagnosis) for step in steps],
        "proposed": [step.proposed for step in steps],
        "odds": [belief.probability if belief else None for belief in beliefs],
        "seconds": round(time.process_time() - begin),
    }


def word_of(record: Record, step: int) -> str:
    """Return how the diagnosis of number `step` went, see `judged`."""
    found = record["steps"][step]
    parts = found["verdict"], found["named"], found["ties"]
    return judged(record["kind"], record["effects"], *parts)


def end_of(record: Record) -> str:
    """Return the end of a loop: its verdict, "undecidable" or "open".

    A tie is undecidable if no trial of the catalogue would settle it, and open if one
    more is proposed than may be recorded.
    """
    last = record["steps"][-1]
    if last["verdict"] != "tie" and not last["ties"]:
        return str(last["verdict"])
    return "open" if record["proposed"][-1] else "undecidable"


def is_alone(record: Record) -> bool:
    """Return whether the last verdict is right and names nothing else."""
    named = set(record["steps"][-1]["named"])
    alone = record["kind"] in ("none", "unknown") or named == set(record["effects"])
    return word_of(record, -1) == "right" and alone


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
                known = {"none", *MAKES[make].named, *MAKES[make].unknown}
                if not set(name.split("+")) <= known:
                    continue
                seed = first + 100 * turn + place
                for strength in strengths if name != "none" else (0.0,):
                    for protocol in protocols:
                        yield Case(make, protocol, name, strength, seed)


def amounts_of(case: Case, records: Sequence[Record]) -> dict[str, float]:
    """Return amounts of the hidden effects, the same for all protocols of a rig."""
    for record in records:
        if all(record[k] == getattr(case, k) for k in KEYS if k != "protocol"):
            return dict(zip(case.effects, record["amounts"], strict=True))
    rig = make_rig(case.seed, make=case.make)
    trials = MAKES[rig.make].trials(rig)
    return {
        name: calibrate(rig, name, case.strength, trials, case.seed)
        for name in case.effects
    }


def summary(records: Sequence[Record]) -> str:
    """Return Markdown: rates by hidden effect, then the rigs diagnosed wrongly."""
    groups: dict[tuple[str, str, str], list[Record]] = {}
    for r in records:
        group = "static" if r["hidden"] in STATIC else r["kind"]
        size = "-" if r["kind"] == "none" else f"{r['strength']:g}"
        groups.setdefault((r["protocol"], group, size), []).append(r)
    rates = []
    for key, own in sorted(groups.items()):
        alone = sum(map(is_alone, own))
        first, last = ([word_of(r, step) for r in own] for step in (0, -1))
        ends = [end_of(r) for r in own]
        numbers = len(own), first.count("right")
        others = ends.count("undecidable"), last.count("missed"), last.count("wrong")
        share = f"{alone} ({exact(alone, len(own))} %)"
        rates.append([*key, *map(str, numbers), share, *map(str, others)])
    head = (
        "recorded first", "hidden", "R", "rigs", "right at once", "right and alone",
        "undecidable", "missed", "wrong",
    )  # fmt: skip
    failed = []
    for r in records:
        if not is_alone(r):
            parts = ("verdict", "named", "ties")
            said = ["; ".join(str(each[part]) for each in r["steps"]) for part in parts]
            which = [str(r[key]) for key in KEYS]
            failed.append([*which, *said, "; ".join(r["proposed"]), end_of(r)])
    return "\n\n".join(
        [
            table(head, rates),
            table(("odds", "verdicts", "mean", "right"), calibration(records)),
            table((*KEYS, "verdicts", "named", "ties", "proposed", "end"), failed),
        ]
    )


def calibration(records: Sequence[Record]) -> list[list[str]]:
    """Return the share of right verdicts in bands of the odds that they stated.

    The last verdict of every rig counts, and the first where a trial followed it.
    """
    stated, right = [], []
    for record in records:
        for place in {0, len(record["steps"]) - 1}:
            if (odds := record["odds"][place]) is not None:
                stated.append(odds)
                case = {"kind": record["kind"], "hidden": record["effects"]}
                right.append(is_right({**case, **record["steps"][place]}))
    found = []
    for low, high in pairwise(ODDS_BANDS):
        here = [k for k, odds in enumerate(stated) if low <= odds < high]
        if here:
            count = sum(right[k] for k in here)
            mean = sum(stated[k] for k in here) / len(here)
            found.append(
                [
                    f"{low:.2f} to {min(high, 1.0):.2f}", str(len(here)), f"{mean:.3f}",
                    f"{count / len(here):.3f} ({exact(count, len(here))} %)",
                ]
            )  # fmt: skip
    return found


def main(
    effects: tuple[str, ...] = ("static",),
    makes: tuple[Literal[tuple(MAKES)], ...] = tuple(MAKES),
    strength: tuple[float, ...] = (4.0, 2.0),
    protocol: tuple[Literal["bare", "standard"], ...] = ("standard",),
    first: int = 18000,
    rounds: int = 1,
    proposals: int = MAX_PROPOSED,
    out: Path = Path("runs", "proposal_loop"),
) -> None:
    """Run the rigs that are not done, and print the tables.

    Args:
        effects: ids, pairs "a+b", none, or the groups static, named, unknown, pairs.
        first: seed.
        rounds: rigs of each kind.
        proposals: number of proposed trials that are recorded at most.
    """
    named = dict.fromkeys(n for m in makes for n in MAKES[m].named)
    groups = {
        "static": STATIC,
        "named": tuple(sorted(named, key=NEWER.__contains__)),
        "unknown": tuple(n for m in makes for n in MAKES[m].unknown),
        "pairs": tuple(map("+".join, PAIRS)),
    }
    hidden = [n for name in effects for n in groups.get(name, (name,))]
    out.mkdir(parents=True, exist_ok=True)
    lines = Lines(out / "rigs.jsonl")
    done = lines.done(*KEYS)
    for case in cases(hidden, makes, strength, protocol, first, rounds):
        if case in done:
            continue
        record = run(case, proposals, amounts_of(case, lines.records))
        lines.add(record)
        print(*case, end_of(record), word_of(record, -1), record["seconds"], flush=True)
    print(summary(lines.records))


if __name__ == "__main__":
    tyro.cli(main)
