"""Error floor of any model: sensor noise, and angle noise passed through the rig.

The floor is a number for every sample (`concepts.md`, Comparison): the scatter of
simulated torques when the angles of a likely motion are measured again, and the torque
sensors' own noise. The divisor of errors is larger, as spikes shift in time and an
angle that seems to rest may have moved. It only weights samples: errors are compared
with those of noise by the same divisor.

A recorded angle lacks the small movements that its filters removed, so that noise
during slow creep and rests would seem small. It keeps the ripple of rounded digits,
which would count twice. A likely motion has the movements back, and no ripple.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._quantization import reconstruct_angle
from cc_mujoco.datasets._trials import Dataset, Noise, Trial, TrialFacts
from cc_mujoco.diagnosis._checks.content import repeat_scatter as scatter_of
from cc_mujoco.diagnosis._rig.records import (
    Arrays,
    Filtering,
    Record,
    low_pass,
    play_filter,
)
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig, Values
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.native import FloatArray

_NO_NOISE = Noise(0.0, 0.0, "declared")


class NoiseFloor(NamedTuple):
    """Standard deviations (rows, samples) of the torques of every record [N m]."""

    # Error that no model can explain; at least that between repetitions
    noise: tuple[FloatArray, ...]
    tolerance: tuple[FloatArray, ...]  # divisor of errors
    # (rows, 1), the part of `noise` by which repetitions differ beyond that of sensors
    scatter: FloatArray


def noise_floor(
    dataset: Dataset, plant: SimulatedRig, filtering: Filtering, values: Values,
    seed: int = 0,
) -> NoiseFloor:  # fmt: skip
    """Return the noise floor of every record, by the rig simulated with `values`."""
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    random, other = np.random.default_rng(seed), np.random.default_rng((seed, 1))
    names = channels.MOTOR_ANGLE, channels.JOINT_ANGLE
    noise = {name: dataset.noise.get(name, _NO_NOISE) for name in names}
    clean = plant.simulate(values)
    true = [likely(record, filtering) for record in plant.records]
    exact = plant.limited(true).simulate(values)

    def scatter(records: Sequence[Record], about: Arrays) -> list[FloatArray]:
        played = plant.limited(records).simulate(values)
        pairs = zip(played, about, strict=True)
        return [(a - b) ** 2 / Limit.noise_draws for a, b in pairs]

    plain = [np.zeros(torque.shape) for torque in clean]
    wide = [np.zeros(torque.shape) for torque in clean]
    for _ in range(Limit.noise_draws):
        read = [resample_angles(r, noise, filtering, other) for r in true]
        for total, square in zip(plain, scatter(read, exact), strict=True):
            total += square
        again = [resample_angles(r, noise, filtering, random) for r in plant.records]
        moved = [unsettled(r, filtering, random) for r in again]
        for total, square in zip(wide, scatter(moved, clean), strict=True):
            total += square
    known = plant.instruments
    noises = [dataset.noise.get(name, _NO_NOISE).deviation for name in known.channels]
    own = [deviation**2 * filtering.passed for deviation in noises]
    if known.joint == "known load":
        own[known.channels.index(channels.JOINT_TORQUE)] = filtering.load**2
    whole = np.concatenate([record.measured for record in plant.records], axis=1)
    least = (Limit.min_floor_share * np.std(whole, axis=1)) ** 2
    base = np.maximum(np.array(own), least)[:, None]
    bases = [
        _cell_noise(base, record, known.rows, filtering) for record in plant.records
    ]
    alone = [total + own for total, own in zip(plain, bases, strict=True)]
    short = _unexplained(plant, clean, alone)
    tolerance = []
    for total, record, base in zip(wide, plant.records, bases, strict=True):
        # The highest local mean nearby counts, because spikes shift in time.
        size = max(3, round(0.04 / record.dt))
        mean = uniform_filter1d(total, size, axis=1)
        tolerance.append(np.sqrt(maximum_filter1d(mean, size, axis=1) + base))
    unexplained = tuple(np.sqrt(each + short[:, None]) for each in alone)
    return NoiseFloor(unexplained, tuple(tolerance), np.sqrt(short)[:, None])


def _cell_noise(
    base: FloatArray, record: Record, rows: Sequence[int], filtering: Filtering
) -> FloatArray:
    """Return a record's noise variance (rows, 1): `base`, or that of its load cell."""
    if (cell := record.load_cell) is None:
        return base
    found = base.copy()
    row = rows.index(cell.row)
    least = Limit.min_floor_share**2 * base[row, 0]
    found[row] = max(record.cell_noise**2 * filtering.passed, least)
    return found


def _unexplained(plant: SimulatedRig, clean: Arrays, noise: Arrays) -> FloatArray:
    """Return the variance (rows,) between repetitions beyond `noise` [(N m)^2].

    Residuals are compared, as a servo never repeats a motion exactly. It is at most
    that of the readings, as a wrong model amplifies a small difference of angle.
    """
    names, found = plant.instruments.channels, []
    for torques in clean, [np.zeros(torque.shape) for torque in clean]:
        trials: dict[str, list[tuple[Record, FloatArray]]] = {}
        for record, torque in zip(plant.records, torques, strict=True):
            left = np.where(record.counts, record.measured - torque, np.nan)
            trials.setdefault(record.trial, []).append((record, left))
        every = [_residual_trial(parts, names) for parts in trials.values()]
        found.append(scatter_of(every, names))
    pairs = zip(plant.records, noise, strict=True)
    repeated = [pair for pair in pairs if pair[0].trial in found[0].trials]
    there = [each[:, record.counts] for record, each in repeated]
    if not sum(each.shape[1] for each in there):  # none of them moves enough
        return np.zeros(len(names))
    deviation = np.minimum(found[0].deviation, found[1].deviation)
    known = np.concatenate(there, axis=1).mean(axis=1)
    return np.asarray(np.maximum(deviation**2 - known, 0.0))


def _residual_trial(
    parts: Sequence[tuple[Record, FloatArray]], names: Sequence[str]
) -> Trial:
    records = [record for record, _ in parts]
    first, left = records[0], np.concatenate([left for _, left in parts], axis=1)
    torques = dict(zip(names, left, strict=True))
    kept = ("time", "motor_angle", "joint_angle")
    signals = ([getattr(record, name) for record in records] for name in kept)
    time, motor, joint = map(np.concatenate, signals)
    ends = np.cumsum([0, *(record.time.size for record in records)]).tolist()
    shown = torques.get(channels.MOTOR_TORQUE), torques.get(channels.JOINT_TORQUE)
    segments = tuple(slice(a, b) for a, b in pairwise(ends))
    facts = TrialFacts(repeat_of=None if first.group == first.trial else first.group)
    known = first.trial, time, motor, shown[0], joint, shown[1]
    return Trial(*known, segments, first.dt, facts=facts)


def likely(record: Record, filtering: Filtering) -> Record:
    """Return the record with the motion that most likely produced its readings."""
    both = record.motor_angle, record.joint_angle
    angles = zip(both, record.read, filtering.still[:2], strict=True)
    band = filtering.motion_band
    motor, joint = (_likely(*angle, record.dt, band) for angle in angles)
    return replace(record, motor_angle=motor, joint_angle=joint)


def _likely(
    angle: FloatArray, seen: FloatArray, width: float, dt: float, band: float
) -> FloatArray:
    from scipy.ndimage import minimum_filter1d, uniform_filter1d

    if width == 0.0:
        return angle
    # Half of the slow movements are put back: some are noise, most of them where
    # readings are rounded. On rigs without effects the floor then equals the error.
    hidden = low_pass(seen - angle, 1.0 / 6.0 * band, 1.0 / dt)
    found = angle + 0.5 * hidden
    # The angle is smooth where it is under way for 0.2 s: near rests, smoothing would
    # start it early, to which a sticking cable would respond.
    smooth = low_pass(found, 1.0 / 5.0 * band, 1.0 / dt)
    half = max(1, round(0.5 * 0.05 / dt))
    wide = np.pad(smooth, half, mode="edge")
    moves = np.abs(wide[2 * half :] - wide[: -2 * half]) > 4.0 * width
    clear = minimum_filter1d(moves.astype(float), 2 * round(0.5 * 0.2 / dt) + 1)
    share: FloatArray = uniform_filter1d(clear, 2 * half + 1)
    return found + share * (smooth - found)


def resample_angles(
    record: Record, noise: Mapping[str, Noise], filtering: Filtering, random: Generator
) -> Record:
    """Return the record as it might be measured again, with new noise and rounding.

    At rest an angle may be anywhere within a digit: an error that passes every filter.
    """
    angles = [record.motor_angle, record.joint_angle]
    thin = round(record.dt / record.step)
    for k, name in enumerate((channels.MOTOR_ANGLE, channels.JOINT_ANGLE)):
        angle, own = angles[k], noise[name]
        if own.deviation == 0.0:
            continue
        size = (angle.size - 1) * thin + 1
        read = np.interp(np.arange(size) / thin, np.arange(angle.size), angle)
        digit = own.resolution
        white = max(own.deviation**2 - digit**2 / 12.0, 0.0)
        read += math.sqrt(white) * random.normal(size=size)
        if digit > 0.0:
            first = random.uniform(0.0, digit)
            read = first + digit * np.round((read - first) / digit)
            read = reconstruct_angle(read, own)
        smooth = low_pass(read, filtering.motion_band, 1.0 / record.step)[::thin]
        angles[k] = play_filter(smooth, filtering.still[k])
    return replace(record, motor_angle=angles[0], joint_angle=angles[1])


def unsettled(record: Record, filtering: Filtering, random: Generator) -> Record:
    """Return the record with random motion, too small to measure, added at rest."""
    angles = []
    both = record.motor_angle, record.joint_angle
    for angle, width in zip(both, filtering.still[:2], strict=True):
        # The play filter limits it: a servo that integrates creeps to the end.
        moved = np.zeros(angle.size)
        edges = np.flatnonzero(np.diff(angle) != 0.0)
        for first, last in pairwise([-1, *edges.tolist(), angle.size - 1]):
            size = last - first
            if size > 2:
                bump = np.sin(np.pi * np.arange(1, size + 1) / (size + 1))
                moved[first + 1 : last + 1] = random.uniform(-width, width) * bump
        angles.append(angle + moved)
    return replace(record, motor_angle=angles[0], joint_angle=angles[1])
