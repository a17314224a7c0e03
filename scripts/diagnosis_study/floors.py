"""Distance from the noise floor of rigs in which nothing is hidden, trial by trial.

    python scripts/diagnosis_study/floors.py --make guides elements --rigs 10

Only the baseline is fitted. Every line is a rig: its held-out error over that of noise
alone; the square of it, how far trials disagree about that, and by how many of these
standard errors it exceeds 1; then squares by channel and by trial. `--effect` hides
something, `--seed` is of the first rig.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from kept_cases import Lines
from numpy.typing import NDArray

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench, Dataset
from cc_mujoco.diagnosis import (
    BaselineFit,
    CrossValidation,
    Filtering,
    fit_baseline,
    load,
    plant_of,
    prepare,
)
from rig.dataset import make_dataset
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.strength import calibrate

FIRST = 500  # seed of the first rig; no study has these

Array = NDArray[np.float64]


def written(data: list[dict[str, Array]], trials: str, seed: int) -> Dataset:
    """Return recorded trials as an experimenter's files make them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data"
        write_data(path, data, facts_of(trials, seed))
        return load([path])[0]


def fitted(dataset: Dataset) -> tuple[BaselineFit, Filtering]:
    """Return the baseline of a data set on the bench."""
    bench = Bench.of(scene_path("bench")).known(dataset.constants)
    records, filtering = prepare(dataset, bench)
    baseline = fit_baseline(dataset, plant_of(dataset, bench, records), filtering, 0)
    return baseline, filtering


def errors_of(make: str, seed: int, effect: str, strength: float) -> dict[str, Any]:
    """Return squared held-out errors of the baseline and of noise, by trial."""
    rig = make_rig(seed, make=make)
    trials = MAKES[make].trials(rig)
    amounts = {effect: calibrate(rig, effect, strength, trials, seed)} if effect else {}
    data = make_dataset(rig, amounts, trials, seed)
    crossed = fitted(written(data, trials, seed))[0].crossed
    return {
        "make": make, "seed": seed, "trials": trials, "effect": effect,
        "strength": strength if effect else 0.0,
        "misfit": crossed.misfit, "squares": by_trial(crossed),
    }  # fmt: skip


def by_trial(crossed: CrossValidation) -> dict[str, list[list[float]]]:
    """Return sums of squares by trial and channel: held-out errors, and those of noise.

    Both are over what errors are divided by, so that their ratio is over the floor.
    """
    problem = crossed.problem
    found: dict[str, Array] = {}
    for record, errors, noise, floor in zip(
        problem.plant.records,
        crossed.errors,
        problem.sensed,
        problem.floor,
        strict=True,
    ):
        kept = np.isfinite(errors[0])
        both = np.array([errors[:, kept], (noise / floor)[:, kept]])
        sums = np.sum(both**2, axis=2)
        found[record.trial] = found.get(record.trial, 0.0) + sums
    return {trial: sums.round(3).tolist() for trial, sums in found.items()}


def told(record: Mapping[str, Any]) -> str:
    """Return a rig in a line."""
    squares = np.array(list(record["squares"].values()))
    errors, noise = squares.sum(axis=2).T
    beyond = (errors - noise) / noise.sum()
    apart = float(np.std(beyond, ddof=1)) * math.sqrt(beyond.size)
    both = squares.sum(axis=0)
    channels = " ".join(f"{value:.2f}" for value in both[0] / both[1])
    trials = " ".join(f"{value:.2f}" for value in errors / noise)
    return (
        f"{record['make']:9} {record['seed']:5} {record['trials']:8} "
        f"{record['effect'] or 'none':28} {record['misfit']:.2f} floors; squares: "
        f"{1.0 + beyond.sum():.2f} +- {apart:.2f} ({beyond.sum() / apart:+.1f}); "
        f"channels {channels}; trials {trials}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--make", nargs="+", choices=MAKES, default=list(MAKES))
    parser.add_argument("--rigs", type=int, default=10, help="of every make")
    parser.add_argument("--seed", type=int, default=FIRST, help="of the first rig")
    parser.add_argument("--effect", default="", help="id of one to hide")
    parser.add_argument("--strength", type=float, default=4.0, help="its R")
    parser.add_argument(
        "--out", type=Path, help="JSON lines to append to; rigs in them are not redone"
    )
    options = parser.parse_args()
    lines = Lines(options.out)
    done = lines.done("make", "seed", "effect", "strength")
    strength = options.strength if options.effect else 0.0
    for seed in range(options.seed, options.seed + options.rigs):
        for make in options.make:
            if (make, seed, options.effect, strength) in done:
                continue
            record = errors_of(make, seed, options.effect, options.strength)
            print(told(record), flush=True)
            lines.add(record)


if __name__ == "__main__":
    main()
