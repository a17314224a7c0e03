"""Distance from the noise floor of rigs in which nothing is hidden.

    python scripts/diagnosis_study/floors.py --make guides elements --rigs 10

Only the baseline is fitted. Every line is a rig: its held-out error over that of noise
alone.

With `--by-motion` the noise floor is checked against the errors of readings: rigs in
which nothing is hidden are recorded twice, with sensors and with readings that have
neither noise nor digits. What changes in both torques, those that are measured and
those that the tuned model plays from the angles, is noise and nothing else: its RMS
over the floor, motor and joint, is printed by the pace of the faster end and by trial.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from cc_mujoco import diagnosis
from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench, Dataset, Noise
from rig.dataset import clean_dataset, make_dataset, make_trials
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.sensors import BASIC

FIRST = 500  # seed of the first rig; no study has these

Array = NDArray[np.float64]


def written(data: list[dict[str, Array]], trials: str, seed: int) -> Dataset:
    """Return recorded trials as the dataset read from an experimenter's files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data"
        write_data(path, data, facts_of(trials, seed))
        return diagnosis.load([path])[0]


def fitted(dataset: Dataset) -> diagnosis.BaselineFit:
    bench = Bench.of(scene_path("bench")).known(dataset.constants)
    records, filtering = diagnosis.prepare(dataset, bench)
    return diagnosis.fit_baseline(
        dataset, diagnosis.plant_of(dataset, bench, records), filtering, 0
    )


PACES = {"rest": 0.005, "creep": 0.06, "slow": 0.5, "fast": np.inf}
"""Speed up to which a moment is called so [rad/s], over a tenth of a second."""


def squares(make: str, seed: int) -> dict[str, Array]:
    """Return sums of squares (2, channels) of noise and of floor, by pace and trial.

    As in fits, errors are divided by their scale, with Huber's loss.
    """
    rig = make_rig(seed, make=make)
    trials = MAKES[make].trials(rig)
    recorded = make_dataset(rig, {}, trials, seed)
    signals = clean_dataset(rig, {}, make_trials(trials, seed), seed)
    dataset = written(recorded, trials, seed)
    baseline = fitted(dataset)
    problem = baseline.problem
    exact = tuple(
        replace(trial, **dict(zip(BASIC, clean.T, strict=True)))
        for trial, clean in zip(dataset.trials, signals, strict=True)
    )
    none = {name: Noise(1e-12, 0.0, "declared") for name in dataset.noise}
    without = replace(dataset, trials=exact, noise=none)
    true, _ = diagnosis.prepare(without, problem.plant.bench)
    values = problem.values(baseline.whole.x)
    played = problem.plant.simulate(values)
    meant = problem.plant.limited(true).simulate(values)
    found: dict[str, Array] = {}
    for k, (record, clean) in enumerate(zip(problem.plant.records, true, strict=True)):
        off = record.measured - clean.measured - (played[k] - meant[k])
        parts = np.array(
            [
                diagnosis.huber_residual(off / problem.floor[k]),
                problem.sensed[k] / problem.floor[k],
            ]
        )
        for name, mask in _moments(record, clean).items():
            sums = np.sum(parts[:, :, mask] ** 2, axis=2)
            found[name] = found.get(name, 0.0) + sums
    return found


def _moments(
    record: diagnosis.Record, clean: diagnosis.Record
) -> Mapping[str, NDArray[np.bool_]]:
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


def main(
    make: tuple[Literal[tuple(MAKES)], ...] = tuple(MAKES),
    rigs: int = 10,
    seed: int = FIRST,
    step: int = 1,
    by_motion: bool = False,
) -> None:
    """Print the distances of rigs.

    Args:
        rigs: of every make.
        seed: of the first rig.
        step: from seed to seed.
    """
    seeds = range(seed, seed + step * rigs, step)
    total: dict[str, Array] = {}
    for kind, one in ((kind, one) for one in seeds for kind in make):
        if by_motion:
            for name, sums in squares(kind, one).items():
                total[name] = total.get(name, 0.0) + sums
            continue
        rig = make_rig(one, make=kind)
        trials = MAKES[kind].trials(rig)
        data = make_dataset(rig, {}, trials, one)
        misfit = fitted(written(data, trials, one)).crossed.misfit
        print(f"{kind:9} {one:5} {misfit:.2f} floors", flush=True)
    for name, (noise, floor) in total.items():
        motor, joint = np.sqrt(noise / floor)
        print(f"{name:9} {motor:.2f} {joint:.2f}")


if __name__ == "__main__":
    tyro.cli(main)
