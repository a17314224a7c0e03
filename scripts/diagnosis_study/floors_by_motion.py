"""Check of the noise floor against the errors of readings, by motion of the rig.

    python scripts/diagnosis_study/floors_by_motion.py --make bristles --rigs 10

Rigs in which nothing is hidden are recorded twice, with sensors and with readings that
have neither noise nor digits. What changes in both torques, those that are measured and
those that the tuned model plays from the angles, is noise and nothing else: its RMS
over the floor, motor and joint, is printed by the pace of the faster end and by trial.
`--odd` and `--even` take such rigs only (of `elements`: coarse encoders, fine ones).
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from floors import FIRST, fitted, written
from numpy.typing import NDArray

from cc_mujoco.datasets import Noise
from cc_mujoco.diagnosis import Record, huber_residual, prepare
from rig.dataset import clean_dataset, make_dataset, make_trials
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.sensors import BASIC, CHANNELS

Array = NDArray[np.float64]

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
    exact = [
        {"time_s": noisy["time_s"]}
        | {
            CHANNELS[name].column: column
            for name, column in zip(BASIC, clean.T, strict=True)
        }
        for noisy, clean in zip(recorded, signals, strict=True)
    ]
    baseline, _ = fitted(written(recorded, trials, seed))
    problem = baseline.problem
    without = written(exact, trials, seed)
    none = {name: Noise(1e-12, 0.0, "declared") for name in without.noise}
    true, _ = prepare(replace(without, noise=none), problem.plant.bench)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--make", choices=MAKES, default="bristles")
    parser.add_argument("--rigs", type=int, default=10)
    parser.add_argument("--odd", action="store_true", help="rigs of odd seeds only")
    parser.add_argument("--even", action="store_true", help="rigs of even seeds only")
    options = parser.parse_args()
    every = range(FIRST, FIRST + options.rigs)
    kept = {
        True: options.odd or not options.even,
        False: options.even or not options.odd,
    }
    total: dict[str, Array] = {}
    for seed in (seed for seed in every if kept[seed % 2 == 1]):
        for name, sums in squares(options.make, seed).items():
            total[name] = total.get(name, 0.0) + sums
    for name, (noise, floor) in total.items():
        motor, joint = np.sqrt(noise / floor)
        print(f"{name:9} {motor:.2f} {joint:.2f}")


if __name__ == "__main__":
    main()
