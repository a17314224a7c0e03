"""How far from the noise floor rigs are in which nothing is hidden, trial by trial.

    python scripts/diagnosis_study/floors.py --make guides elements --rigs 10

Only the baseline is fitted. Every line is a rig: the squared held-out error over that
of the floor by channel and by trial, what noise alone makes of it, its mean, how far
trials disagree about that mean, and the mean less 1 over that disagreement. `--effect`
hides something.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from diagnose_benchmark import off
from numpy.typing import NDArray

from cc_mujoco.assets import scene_path
from cc_mujoco.diagnosis.data.bench import Bench
from cc_mujoco.diagnosis.evidence import Evidence, Isolability
from cc_mujoco.diagnosis.inference.baseline import fit_baseline, plant_of
from cc_mujoco.diagnosis.inference.folds import CrossValidation
from cc_mujoco.diagnosis.inference.records import prepare
from cc_mujoco.diagnosis.inference.result import Result
from cc_mujoco.diagnosis.intake import load
from cc_mujoco.diagnosis.verdict import Diagnosis
from rig.dataset import make_dataset
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.strength import calibrate

FIRST = 500
"""Seed of the first rig; no study has these."""


def errors_of(make: str, seed: int, effect: str, strength: float) -> dict[str, Any]:
    """Squared held-out errors of the tuned baseline over the floor, by trial."""
    rig = make_rig(seed, make=make)
    trials = MAKES[make].trials(rig)
    amounts = {effect: calibrate(rig, effect, strength, trials, seed)} if effect else {}
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        write_data(
            data, make_dataset(rig, amounts, trials, seed), facts_of(trials, seed)
        )
        dataset, _ = load([data])
    bench = Bench.of(scene_path("bench")).known(dataset.constants)
    records, filtering = prepare(dataset, bench)
    baseline = fit_baseline(dataset, plant_of(dataset, bench, records), filtering, 0)
    nothing = Evidence((), (), Isolability((), np.zeros((0, 0)), np.zeros(0)))
    result = Result(Diagnosis("none", ""), nothing, None, np.zeros(0), bench, baseline)
    return {
        "make": make, "seed": seed, "trials": trials, "effect": effect,
        "strength": strength if effect else 0.0,
        "misfit": baseline.crossed.misfit, "off": off(result),
        "noise": noise_alone(baseline.crossed),
    }  # fmt: skip


def noise_alone(crossed: CrossValidation) -> list[float]:
    """What the squared error over the floor is if there is noise only, by channel.

    Errors are divided by a little more than the noise, see `NoiseFloor`.
    """
    problem = crossed.problem
    parts = [
        (noise / floor)[:, np.isfinite(errors[0])] ** 2
        for noise, floor, errors in zip(
            problem.noise, problem.floor, crossed.errors, strict=True
        )
    ]
    means = np.concatenate(parts, axis=1).mean(axis=1)
    return list((problem.inflation**2 * means).round(3).tolist())


def summed(off: Mapping[str, list[list[float]]]) -> NDArray[np.float64]:
    """Mean squared error over the floor (trials, channels)."""
    return np.array([np.mean(blocks, axis=0) for blocks in off.values()])


def told(record: Mapping[str, Any]) -> str:
    """A rig in a line."""
    squares = summed(record["off"])
    by_trial = squares.mean(axis=1)
    apart = float(np.std(by_trial, ddof=1)) / math.sqrt(by_trial.size)
    over = (float(by_trial.mean()) - 1.0) / apart
    hidden = record["effect"] or "none"
    channels = ", ".join(
        f"{value:.2f} (noise alone {noise:.2f})"
        for value, noise in zip(squares.mean(axis=0), record["noise"], strict=True)
    )
    trials = " ".join(f"{value:.2f}" for value in by_trial)
    return (
        f"{record['make']:9} {record['seed']:5} {record['trials']:8} {hidden:28} "
        f"{record['misfit']:.2f} floors; squares: mean {by_trial.mean():.2f} +- "
        f"{apart:.2f} ({over:+.1f}); channels {channels}; trials {trials}"
    )


def main() -> None:
    """Fit, print, and keep what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--make", nargs="+", choices=MAKES, default=list(MAKES))
    parser.add_argument("--rigs", type=int, default=10, help="of every make")
    parser.add_argument("--effect", default="", help="id of one to hide")
    parser.add_argument("--strength", type=float, default=4.0, help="its R")
    parser.add_argument(
        "--out", type=Path, help="JSON lines to append to; rigs in them are not redone"
    )
    options = parser.parse_args()
    done = set()
    if options.out and options.out.exists():
        kept = [json.loads(line) for line in options.out.read_text().splitlines()]
        done = {(r["make"], r["seed"], r["effect"], r["strength"]) for r in kept}
    strength = options.strength if options.effect else 0.0
    for seed in range(FIRST, FIRST + options.rigs):
        for make in options.make:
            if (make, seed, options.effect, strength) in done:
                continue
            record = errors_of(make, seed, options.effect, options.strength)
            print(told(record), flush=True)
            if options.out:
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(record) + "\n")


if __name__ == "__main__":
    main()
