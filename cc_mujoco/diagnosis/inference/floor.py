"""Error floor of any model: sensor noise, and that of angles sent through the rig.

Where the cable runs, noise of the angles hardly matters; where its end sticks, the
angle's last digit is worth newtons. So the floor is a number for every sample: how far
simulated torques come off when a likely motion is read again, and the torque sensors'
own noise. By what errors are divided is more: spikes of noise shift in time, and an
angle that seems to stand still may have moved by its noise. That weights samples; how
far off a model is, is told by what noise makes of errors so divided.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.checks.repeatability import scatter as scatter_of
from cc_mujoco.diagnosis.data.channels import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
)
from cc_mujoco.diagnosis.data.trials import Dataset, Facts, Noise, Trial
from cc_mujoco.diagnosis.inference.plant import SimulatedRig, Values
from cc_mujoco.diagnosis.inference.records import Filtering, Record
from cc_mujoco.diagnosis.inference.rereading import drawn, likely, unsettled

DRAWS = 6
"""Simulations with angles drawn anew."""
NEAR = 0.04
"""Time over which the scatter is taken together [s]."""
LEAST = 1e-3
"""Least floor, over the RMS of the channel."""

_QUIET = Noise(0.0, 0.0, "declared")


class NoiseFloor(NamedTuple):
    """Standard deviations (rows, samples) of every record [Nm].

    Attributes:
        noise: of what no model can explain; not less than repetitions differ.
        tolerance: by which errors are divided.
        scatter: (rows, 1), the part of `noise` by which repetitions differ beyond that
            of sensors.
    """

    noise: tuple[FloatArray, ...]
    tolerance: tuple[FloatArray, ...]
    scatter: FloatArray


def noise_floor(
    dataset: Dataset,
    plant: SimulatedRig,
    filtering: Filtering,
    values: Values,
    effects: tuple[str, ...] = (),
    seed: int = 0,
) -> NoiseFloor:
    """Noise in both torques of every record, as the simulated rig passes it on."""
    random, other = np.random.default_rng(seed), np.random.default_rng((seed, 1))
    noise = {n: dataset.noise.get(n, _QUIET) for n in (MOTOR_ANGLE, JOINT_ANGLE)}
    clean = plant.simulate(values, effects)
    true = [likely(record, filtering) for record in plant.records]
    exact = plant.limited(true).simulate(values, effects)

    def scatter(
        records: Sequence[Record], about: Sequence[FloatArray]
    ) -> list[FloatArray]:
        played = plant.limited(records).simulate(values, effects)
        return [(a - b) ** 2 / DRAWS for a, b in zip(played, about, strict=True)]

    plain = [np.zeros(torque.shape) for torque in clean]
    wide = [np.zeros(torque.shape) for torque in clean]
    for _ in range(DRAWS):
        read = [drawn(r, noise, filtering, other) for r in true]
        for total, square in zip(plain, scatter(read, exact), strict=True):
            total += square
        again = [drawn(r, noise, filtering, random) for r in plant.records]
        moved = [unsettled(r, filtering, random) for r in again]
        for total, square in zip(wide, scatter(moved, clean), strict=True):
            total += square
    known = plant.instruments
    own = [
        filtering.load**2
        if name == JOINT_TORQUE and known.joint == "known load"
        else dataset.noise.get(name, _QUIET).deviation ** 2 * filtering.passed
        for name in known.channels
    ]
    whole = np.concatenate([record.measured for record in plant.records], axis=1)
    least = (LEAST * np.std(whole, axis=1)) ** 2
    base = np.maximum(np.array(own), least)[:, None]
    alone = [total + base for total in plain]
    short = _unexplained(plant, clean, alone)
    return NoiseFloor(
        tuple(np.sqrt(each + short[:, None]) for each in alone),
        tuple(
            np.sqrt(_near(total, record.dt) + base)
            for total, record in zip(wide, plant.records, strict=True)
        ),
        np.sqrt(short)[:, None],
    )


def _unexplained(
    plant: SimulatedRig, clean: Sequence[FloatArray], noise: Sequence[FloatArray]
) -> FloatArray:
    """Variance of both torques between repetitions beyond that of noise (rows,).

    It is that of what the model leaves: a servo never repeats a motion to the digit,
    and what another motion makes of the torques is for the model to tell. But it is no
    more than the readings differ by: a model that is wrong makes newtons of a digit.
    Noise counts where motions were repeated: how much of it reaches the torques is a
    matter of the motion.
    """
    names = plant.instruments.channels
    found = []
    for told in clean, [np.zeros(torque.shape) for torque in clean]:
        trials: dict[str, list[tuple[Record, FloatArray]]] = {}
        for record, torque in zip(plant.records, told, strict=True):
            left = np.where(record.counts, record.measured - torque, np.nan)
            trials.setdefault(record.trial, []).append((record, left))
        found.append(
            scatter_of([_left(parts, names) for parts in trials.values()], names)
        )
    compared = found[0].trials
    if not compared:
        return np.zeros(len(names))
    deviation = np.minimum(found[0].deviation, found[1].deviation)
    there = [
        each[:, record.counts]
        for each, record in zip(noise, plant.records, strict=True)
        if record.trial in compared
    ]
    if not sum(each.shape[1] for each in there):  # none of them moves enough
        return np.zeros(len(names))
    known = np.concatenate(there, axis=1).mean(axis=1)
    short: FloatArray = np.maximum(deviation**2 - known, 0.0)
    return short


def _left(parts: Sequence[tuple[Record, FloatArray]], names: Sequence[str]) -> Trial:
    """A trial whose torques are what a model leaves, from its records."""
    records = [record for record, _ in parts]
    torques = dict(
        zip(names, np.concatenate([left for _, left in parts], axis=1), strict=True)
    )
    ends = np.cumsum([0, *(record.time.size for record in records)]).tolist()
    first = records[0]
    return Trial(
        first.trial,
        np.concatenate([record.time for record in records]),
        np.concatenate([record.motor_angle for record in records]),
        torques.get(MOTOR_TORQUE),
        np.concatenate([record.joint_angle for record in records]),
        torques.get(JOINT_TORQUE),
        tuple(slice(a, b) for a, b in pairwise(ends)),
        first.dt,
        facts=Facts(repeat_of=None if first.group == first.trial else first.group),
    )


def _near(square: FloatArray, dt: float) -> FloatArray:
    """Mean over the neighbourhood, at its highest nearby: spikes shift in time."""
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    size = max(3, round(NEAR / dt))
    mean: FloatArray = uniform_filter1d(square, size, axis=1)
    highest: FloatArray = maximum_filter1d(mean, size, axis=1)
    return highest
