"""Peers of the learned curves, on the same rigs and the same trials held out.

    pip install pysindy scikit-learn "mujoco[sysid]"
    python scripts/diagnosis_study/residual_peers.py --out runs/residual_peers

The rigs are those of `diagnose_benchmark.py --effects unknown --strength 6 --search
viscous_friction`. The package tunes the scene to each, a peer predicts what is left of
each torque, and the scene is tuned again to the rest. A score is the share of the gap
to the noise floor that closes on whole trials that neither has seen. Of the versions of
a peer the one with the best score on a rig counts, which is more than a user can know:

- sysid: `mujoco.sysid` fits spring and damper (polynomials), friction, inertia and
  weight of a hinge, gain and zero of the sensor, by inverse dynamics, of either sign;
- sindy: PySINDy, sparse sums of polynomials and Fourier series, by two optimisers;
- bam: friction at motor and joint, models M1 to M6 of Duclusaud and others (Extended
  Friction Models for the Physics Simulation of Servo Actuators, 2024);
- process: Gaussian process with a length for each input, on 400 samples.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from diagnose_benchmark import KEYS, Case, Record, cases, loop
from kept_cases import complete
from peer_models import LAWS, LIBRARY, Peer, Records, bam, process, sindy, sysid

from cc_mujoco.diagnosis import Problem
from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._learn.learning import ErrorRecord, ErrorRows
from cc_mujoco.diagnosis._learn.residual import rows_of
from cc_mujoco.native import FloatArray
from cc_mujoco.report import table
from rig.dataset import make_dataset
from rig.generate import facts_of
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.strength import calibrate

VERSIONS: dict[str, list[Peer]] = {
    "sysid": [partial(sysid, sign=sign) for sign in (1.0, -1.0)],
    "sindy": [
        partial(sindy, name="STLSQ", threshold=0.1, alpha=0.1),
        partial(sindy, name="FROLS", max_iter=8, alpha=1e-3),
    ],
    "bam": [partial(bam, law=law) for law in LAWS],
    "process": [process],
}


def scored(problem: Problem, x: FloatArray, rows: ErrorRows, peer: Peer) -> float:
    """Return the share of the gap that a peer closes on trials left out."""
    records, played = problem.plant.records, problem.torques(x)
    division, own = fitting.trial_folds(records), rows.stretches
    before, after = ([torque.copy() for torque in played] for _ in range(2))
    used = [k for k, record in enumerate(records) if record.counts.any()]

    def less(parts: Sequence[Any]) -> list[ErrorRecord]:
        return [o._replace(error=o.error - p) for o, p in zip(own, parts, strict=True)]

    def tuned(left: Records, groups: Any) -> list[FloatArray]:
        fit = ErrorRows(left, rows.sides, x, rows.precise).fitted([], groups)
        return [-np.tensordot(fit[: x.size], each.slopes, 1) for each in own]

    for fold in division:
        seen = [p for p, k in enumerate(used) if fold.train[k].any()]
        inside = {own[p].group for p in seen}
        groups = np.flatnonzero([name in inside for name in rows.names])
        begin = tuned(own, groups)
        left = less(begin)
        known = [left[p] for p in seen]
        sides = [peer(known, left, row) for row in range(len(rows.sides))]
        shown = [np.array(parts) for parts in zip(*sides, strict=True)]
        end = tuned(less(shown), groups)
        for p, k in enumerate(used):
            if fold.test[k].any():
                before[k] = played[k] + begin[p]
                after[k] = played[k] + end[p] + shown[p]
    return fitting.whole_gap(problem, before, after, division).gap_closed


def run(*keys: Any) -> Record:
    """Return the shares of the learned curves and of every peer on one rig."""
    case = Case(*keys)
    rig, search = make_rig(case.seed, make=case.make), ("viscous_friction",)
    trials, name = MAKES[case.make].trials(rig), case.hidden
    amounts = {name: calibrate(rig, name, case.strength, trials, case.seed)}
    data = make_dataset(rig, amounts, f"{trials}_standard", case.seed)
    facts = facts_of(f"{trials}_standard", case.seed)
    with tempfile.TemporaryDirectory() as folder:
        (step,) = loop(rig, amounts, data, facts, Path(folder), 0, (), search)
    found, learned = step.result.found, step.diagnosis.learned
    assert found is not None
    rows = rows_of(found.problem, found.x)
    shares = {"curves": learned.gap_closed if learned and learned.curves else 0.0}
    for name, peers in VERSIONS.items():
        try:
            each = [scored(found.problem, found.x, rows, peer) for peer in peers]
        except ModuleNotFoundError as missing:
            print(f"{name} is left out: {missing}.")
        else:
            shares[name] = max(each)
    LIBRARY.clear()
    return {**case._asdict(), "shares": shares}


def summary(records: Sequence[Record]) -> str:
    names = ["curves", *(name for name in VERSIONS if name in records[0]["shares"])]
    columns = np.array([[r["shares"][name] for name in names] for r in records])
    ends = {"median": np.median(columns, 0), "worst": columns.min(0)}
    hidden = [record["hidden"].removeprefix("unknown_") for record in records]
    rows = [*zip(hidden, columns, strict=True), *ends.items()]
    shown = [[name, *(f"{value:.2f}" for value in own)] for name, own in rows]
    counts = [str(n) for n in np.sum(np.round(columns, 2) < 0.0, 0)]
    return table(("hidden", *names), [*shown, ["negative", *counts]])


def main(first: int = 18000, out: Path = Path("runs", "residual_peers")) -> None:
    """Score the rigs that are not done; write and print the table."""
    hidden = [name for make in MAKES.values() for name in make.unknown]
    every = cases(hidden, tuple(MAKES), (6.0,), ("standard",), first, 1)
    complete(out, KEYS, every, run, summary)


if __name__ == "__main__":
    tyro.cli(main)
