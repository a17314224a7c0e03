"""Loop of diagnosis and proposed trials, on rigs in which an effect is hidden.

    python scripts/diagnosis_study/proposal_loop.py --effects named --strength 4 2 \
        --makes bristles guides elements --first 21000 --out runs/loop

A rig is recorded and diagnosed. If the verdict proposes a trial, its folder
(`next_trial_NN`) is written, the rig plays the motion of that folder under the facts of
its `dataset.toml`, and all trials are diagnosed again: until no trial is proposed, or
`--proposals` have been recorded. `--protocol` selects the first trials: `bare`, motions
only, or `standard`, also the rig turned, its cables off, and known weights.

`rigs.csv` has one row for each rig; rigs that have a row are not repeated. A rig keeps
its seed over strengths and protocols, so rates of different strengths share rigs.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from diagnose_benchmark import NEWER, PAIRS
from diagnose_table import exact, is_right, judged

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
    from cc_mujoco.hardware._servo import Planned

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
RIGS = "rigs.csv"
COLUMNS = (
    "make", "protocol", "hidden", "strength", "seed", "amounts", "verdicts", "named",
    "ties", "proposed", "end", "first", "last", "alone", "odds", "correct", "seconds",
)  # fmt: skip
"""Columns of a row; lists are separated by "; ", one entry for each diagnosis."""


class Case(NamedTuple):
    """A rig to be diagnosed; the fields are the first columns of its row."""

    make: str
    protocol: str
    hidden: str
    strength: float
    seed: int

    @property
    def kind(self) -> str:
        """Kinds of what is hidden: none, unknown, named or pair."""
        if self.hidden == "none":
            return "none"
        if "+" in self.hidden:
            return "pair"
        return "unknown" if self.hidden in MAKES[self.make].unknown else "named"

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of the hidden effects."""
        return () if self.hidden == "none" else tuple(self.hidden.split("+"))


class Step(NamedTuple):
    """One diagnosis, the trial that it proposes, "" without one, and its time [s]."""

    result: DiagnosisResult
    proposed: str
    seconds: float

    @property
    def diagnosis(self) -> Diagnosis:
        """The result's own."""
        return self.result.diagnosis


def loop(
    rig: Rig,
    amounts: Mapping[str, float],
    recorded: str,
    seed: int,
    folder: Path,
    proposals: int = MAX_PROPOSED,
) -> list[Step]:
    """Diagnose a rig, record what is proposed, and diagnose again.

    Args:
        recorded: set of trials that is recorded first, see `rig.trials.SETS`.
        proposals: number of proposed trials that are recorded at most.
    """
    from cc_mujoco.diagnosis import infer
    from cc_mujoco.diagnosis._report.output import write_proposed
    from cc_mujoco.diagnosis._verdict import next_folder

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
        plan = folder / next_folder(planned)
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
    """Return the trial of a folder `next_trial_NN`, its load cell, and all facts."""
    from cc_mujoco.hardware._servo import read_plan

    (planned,) = read_plan(plan)
    text = (plan / "dataset.toml").read_text(encoding="utf-8")
    known = tomllib.loads(text)["trials"][planned.name]
    return trial_of(planned, known), known.get("load_cell", ""), text


def trial_of(planned: Planned, known: Mapping[str, Any]) -> Trial:
    """Return a planned trial as a rig plays it, by its facts of `dataset.toml`."""
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


def run(case: Case, proposals: int, amounts: Mapping[str, float]) -> dict[str, Any]:
    """Return the row of a rig."""
    rig = make_rig(case.seed, make=case.make)
    trials = MAKES[rig.make].trials(rig)
    recorded = f"{trials}_standard" if case.protocol == "standard" else trials
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        steps = loop(rig, amounts, recorded, case.seed, Path(folder), proposals)
    found = [step.diagnosis for step in steps]
    named = [[effect.id for effect in each.missing] for each in found]
    words = [
        judged(case.kind, case.effects, each.verdict, names, each.ties)
        for each, names in zip(found, named, strict=True)
    ]
    return {
        **case._asdict(),
        "amounts": " ".join(f"{size:.6g}" for size in amounts.values()),
        "verdicts": "; ".join(each.verdict for each in found),
        "named": "; ".join(" ".join(names) for names in named),
        "ties": "; ".join(", ".join(" ".join(t) for t in each.ties) for each in found),
        "proposed": "; ".join(step.proposed for step in steps if step.proposed),
        "end": end_of(steps),
        "first": words[0],
        "last": words[-1],
        "alone": int(is_alone(case, found[-1].verdict, named[-1], words[-1])),
        "odds": "; ".join(
            f"{each.belief.probability:.4f}" if each.belief else "" for each in found
        ),
        "correct": "; ".join(
            str(int(is_correct(case.kind, case.effects, each))) for each in found
        ),
        "seconds": f"{time.process_time() - begin:.0f}",
    }


def end_of(steps: Sequence[Step]) -> str:
    """Return how a loop ended: with a verdict, as undecidable, or open.

    A tie is undecidable if no trial of the catalogue would settle it, and open if one
    more is proposed than may be recorded.
    """
    last = steps[-1]
    if last.diagnosis.verdict != "tie" and not last.diagnosis.ties:
        return last.diagnosis.verdict
    return "open" if last.proposed else "undecidable"


def is_alone(case: Case, verdict: str, named: Sequence[str], word: str) -> bool:
    """Return whether a verdict is right and names nothing else."""
    if case.kind in ("none", "unknown"):
        return word == "right"
    return word == "right" and set(named) == set(case.effects)


def is_correct(kind: str, hidden: Sequence[str], found: Diagnosis) -> bool:
    """Return whether a diagnosis is right as a whole, as its odds mean it."""
    record = {
        "kind": kind, "hidden": hidden, "verdict": found.verdict,
        "named": [each.id for each in found.missing], "ties": found.ties,
    }  # fmt: skip
    return is_right(record)


def cases(
    hidden: Sequence[str],
    makes: Sequence[str],
    strengths: Sequence[float],
    protocols: Sequence[str],
    first: int,
    rounds: int,
) -> Iterator[Case]:
    """Yield cases, with makes in turn so that a part of them is balanced.

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


def amounts_of(case: Case, rows: Sequence[Mapping[str, str]]) -> dict[str, float]:
    """Return how much to hide, taken from another protocol of the same rig if done."""
    key = ("make", "hidden", "strength", "seed")
    for row in rows:
        if all(row[name] == str(getattr(case, name)) for name in key):
            sizes = map(float, row["amounts"].split())
            return dict(zip(case.effects, sizes, strict=True))
    rig = make_rig(case.seed, make=case.make)
    trials = MAKES[rig.make].trials(rig)
    return {
        name: calibrate(rig, name, case.strength, trials, case.seed)
        for name in case.effects
    }


def summary(rows: Sequence[Mapping[str, str]]) -> str:
    """Return Markdown: rates by what is hidden, then the rigs that are not right."""
    groups: dict[tuple[str, str, str], list[Mapping[str, str]]] = {}
    for row in rows:
        kind = Case(row["make"], "", row["hidden"], 0.0, 0).kind
        group = "static" if row["hidden"] in STATIC else kind
        size = "-" if kind == "none" else f"{float(row['strength']):g}"
        groups.setdefault((row["protocol"], group, size), []).append(row)
    rates = []
    for key, own in sorted(groups.items()):
        alone = sum(int(row["alone"]) for row in own)
        last = [row["last"] for row in own]
        rates.append(
            [
                *key, str(len(own)), str(sum(row["first"] == "right" for row in own)),
                f"{alone} ({exact(alone, len(own))} %)",
                str(sum(row["end"] == "undecidable" for row in own)),
                str(last.count("missed")), str(last.count("wrong")),
                str(sum(_repeats(row) for row in own)),
            ]
        )  # fmt: skip
    head = (
        "recorded first", "hidden", "R", "rigs", "right at once", "right and alone",
        "undecidable", "missed", "wrong", "proposed twice",
    )  # fmt: skip
    failed = [
        [row[name] for name in ("protocol", "make", "hidden", "strength", "seed")]
        + [row["verdicts"], row["named"], row["ties"], row["proposed"], row["end"]]
        for row in rows
        if row["alone"] != "1"
    ]
    more = ("recorded", "make", "hidden", "R", "seed", "verdicts", "named", "ties")
    bands = ("odds", "verdicts", "mean", "right")
    return "\n\n".join(
        [
            table(head, rates),
            table(bands, calibration(rows)),
            table((*more, "proposed", "end"), failed),
        ]
    )


def calibration(rows: Sequence[Mapping[str, str]]) -> list[list[str]]:
    """Return how often verdicts were right, in bands of the odds that they stated.

    The last verdict of every rig counts, and the first where a trial followed it.
    """
    stated, right = [], []
    for row in rows:
        odds, correct = row["odds"].split("; "), row["correct"].split("; ")
        for place in {0, len(odds) - 1}:
            if odds[place]:
                stated.append(float(odds[place]))
                right.append(int(correct[place]))
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


def _repeats(row: Mapping[str, str]) -> bool:
    """Return whether a trial was proposed twice."""
    proposed = row["proposed"].split("; ")
    return len(set(proposed)) < len(proposed)


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows of an earlier run, none if there was none."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--effects", nargs="+", default=["static"],
        help='ids, pairs "a+b", none, or the groups static, named, unknown, pairs',
    )  # fmt: skip
    parser.add_argument("--makes", nargs="+", choices=MAKES, default=list(MAKES))
    parser.add_argument("--strength", nargs="+", type=float, default=[4.0, 2.0])
    parser.add_argument(
        "--protocol", nargs="+", choices=("bare", "standard"), default=["standard"]
    )
    parser.add_argument("--first", type=int, default=18000, help="seed")
    parser.add_argument("--rounds", type=int, default=1, help="rigs of each kind")
    parser.add_argument("--proposals", type=int, default=MAX_PROPOSED)
    parser.add_argument("--out", type=Path, default=Path("runs", "proposal_loop"))
    options = parser.parse_args()
    named = dict.fromkeys(n for m in options.makes for n in MAKES[m].named)
    groups = {
        "static": STATIC,
        "named": tuple(sorted(named, key=NEWER.__contains__)),
        "unknown": tuple(n for m in options.makes for n in MAKES[m].unknown),
        "pairs": tuple(map("+".join, PAIRS)),
    }
    hidden = [n for name in options.effects for n in groups.get(name, (name,))]
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / RIGS
    rows = read(path)
    if rows and tuple(rows[0]) != COLUMNS:
        parser.error(f"{path} has other columns than this program; name another --out")
    keys = ("make", "protocol", "hidden", "strength", "seed")
    done = {tuple(row[name] for name in keys) for row in rows}
    for case in cases(
        hidden, options.makes, options.strength, options.protocol, options.first,
        options.rounds,
    ):  # fmt: skip
        if tuple(map(str, case)) in done:
            continue
        row = run(case, options.proposals, amounts_of(case, rows))
        rows.append({name: str(value) for name, value in row.items()})
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(row)
        print(*(row[name] for name in (*keys, "end", "last", "seconds")), flush=True)
    print(summary(rows))


if __name__ == "__main__":
    main()
