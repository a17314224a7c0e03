"""Distance from the noise floor of rigs in which nothing is hidden, trial by trial.

    python scripts/diagnosis_study/floors.py --make guides elements --rigs 10

Only the baseline is fitted. Every line is a rig: its held-out error over that of noise
alone; the square of it, how far trials disagree about that, and by how many of these
standard errors it exceeds 1; then squares by channel and by trial. `--effect` hides
something.

With `--by-motion` the noise floor is checked against the errors of readings: rigs in
which nothing is hidden are recorded twice, with sensors and with readings that have
neither noise nor digits. What changes in both torques, those that are measured and
those that the tuned model plays from the angles, is noise and nothing else: its RMS
over the floor, motor and joint, is printed by the pace of the faster end and by trial.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from kept_cases import Lines
from numpy.typing import NDArray

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench, Dataset, Noise
from cc_mujoco.diagnosis import (
    BaselineFit,
    CrossValidation,
    Filtering,
    Record,
    fit_baseline,
    huber_residual,
    load,
    plant_of,
    prepare,
)
from rig.dataset import clean_dataset, make_dataset, make_trials
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.sensors import BASIC
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


PACES = {"rest": 0.005, "creep": 0.06, "slow": 0.5, "fast": np.inf}
"""Speed up to which a moment is called so [rad/s], over a tenth of a second."""


def squares(make: str, seed: int) -> dict[str, Array]:
    """Return sums of squares by pace and trial: of noise, of the floor (2, channels).

    As in fits, errors are over what divides them, and Huber's.
    """
    rig = make_rig(seed, make=make)
    trials = MAKES[make].trials(rig)
    recorded = make_dataset(rig, {}, trials, seed)
    signals = clean_dataset(rig, {}, make_trials(trials, seed), seed)
    dataset = written(recorded, trials, seed)
    baseline, _ = fitted(dataset)
    problem = baseline.problem
    exact = tuple(
        replace(trial, **dict(zip(BASIC, clean.T, strict=True)))
        for trial, clean in zip(dataset.trials, signals, strict=True)
    )
    none = {name: Noise(1e-12, 0.0, "declared") for name in dataset.noise}
    without = replace(dataset, trials=exact, noise=none)
    true, _ = prepare(without, problem.plant.bench)
    values = problem.values(baseline.whole.x)
    played = problem.plant.simulate(values)
    meant = problem.plant.limited(true).simulate(values)
    found: dict[str, Array] = {}
    for k, (record, clean) in enumerate(zip(problem.plant.records, true, strict=True)):
        off = record.measured - clean.measured - (played[k] - meant[k])
        parts = np.array(
            [
                huber_residual(off / problem.floor[k]),
                problem.sensed[k] / problem.floor[k],
            ]
        )
        for name, mask in _moments(record, clean).items():
            sums = np.sum(parts[:, :, mask] ** 2, axis=2)
            found[name] = found.get(name, 0.0) + sums
    return found


def _moments(record: Record, clean: Record) -> Mapping[str, NDArray[np.bool_]]:
    size = max(1, round(0.1 / record.dt))
    steady = np.ones(size) / size
    speed = np.max(
        [
            np.convolve(np.abs(np.gradient(angle, record.dt)), steady, "same")
            for angle in (clean.motor_angle, clean.joint_angle)
        ],
        axis=0,
    )
    place = np.searchsorted(list(PACES.values()), speed)
    paces = {n: record.counts & (place == k) for k, n in enumerate(PACES)}
    return {**paces, record.trial: record.counts, "all": record.counts}


def print_by_motion(makes: Sequence[str], seeds: Iterable[int]) -> None:
    """Print noise over the floor by pace and trial, of all rigs together."""
    total: dict[str, Array] = {}
    for seed in seeds:
        for make in makes:
            for name, sums in squares(make, seed).items():
                total[name] = total.get(name, 0.0) + sums
    for name, (noise, floor) in total.items():
        motor, joint = np.sqrt(noise / floor)
        print(f"{name:9} {motor:.2f} {joint:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--make", nargs="+", choices=MAKES, default=list(MAKES))
    parser.add_argument("--rigs", type=int, default=10, help="of every make")
    parser.add_argument("--seed", type=int, default=FIRST, help="of the first rig")
    parser.add_argument("--step", type=int, default=1, help="from seed to seed")
    parser.add_argument("--by-motion", action="store_true")
    parser.add_argument("--effect", default="", help="id of one to hide")
    parser.add_argument("--strength", type=float, default=4.0, help="its R")
    parser.add_argument(
        "--out", type=Path, help="JSON lines to append to; rigs in them are not redone"
    )
    options = parser.parse_args()
    last = options.seed + options.step * options.rigs
    seeds = range(options.seed, last, options.step)
    if options.by_motion:
        print_by_motion(options.make, seeds)
        return
    lines = Lines(options.out)
    done = lines.done("make", "seed", "effect", "strength")
    strength = options.strength if options.effect else 0.0
    for seed in seeds:
        for make in options.make:
            if (make, seed, options.effect, strength) in done:
                continue
            record = errors_of(make, seed, options.effect, options.strength)
            print(told(record), flush=True)
            lines.add(record)


if __name__ == "__main__":
    main()
