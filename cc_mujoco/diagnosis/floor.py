"""What no model can explain: sensor noise, and that of angles sent through the rig.

Where the cable runs, noise of the angles hardly matters; where its end sticks, the
angle's last digit is worth newtons. So the floor is a number for every sample: the
scatter of the simulated torques over draws of angle noise, quantisation included, and
the torque sensors' own noise.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.channels import (
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
)
from cc_mujoco.diagnosis.plant import Plant, Values
from cc_mujoco.diagnosis.records import Filtering, Record, low_passed, stilled
from cc_mujoco.diagnosis.trials import Dataset, Noise

DRAWS = 6
"""Simulations with angles drawn anew."""
NEAR = 0.04
"""Time over which the scatter is taken together [s]."""
LEAST = 1e-3
"""Least floor, over the RMS of the channel."""

_QUIET = Noise(0.0, 0.0, "declared")


def noise_floor(
    dataset: Dataset,
    plant: Plant,
    filtering: Filtering,
    values: Values,
    effects: tuple[str, ...] = (),
    seed: int = 0,
) -> tuple[FloatArray, ...]:
    """Standard deviation of noise in both torques, (2, samples) per record [Nm]."""
    random = np.random.default_rng(seed)
    noise = {n: dataset.noise.get(n, _QUIET) for n in (MOTOR_ANGLE, JOINT_ANGLE)}
    clean = plant.simulate(values, effects)
    scatter = [np.zeros(torque.shape) for torque in clean]
    for _ in range(DRAWS):
        drawn = plant.limited(
            [_drawn(r, noise, filtering, random) for r in plant.records]
        )
        for total, torque, first in zip(
            scatter, drawn.simulate(values, effects), clean, strict=True
        ):
            total += (torque - first) ** 2 / DRAWS
    own = [
        dataset.noise.get(n, _QUIET).deviation ** 2 * filtering.passed
        for n in (MOTOR_TORQUE, JOINT_TORQUE)
    ]
    whole = np.concatenate([record.measured for record in plant.records], axis=1)
    least = (LEAST * np.std(whole, axis=1)) ** 2
    base = np.maximum(np.array(own), least)[:, None]
    return tuple(
        np.sqrt(_near(total, record.dt) + base)
        for total, record in zip(scatter, plant.records, strict=True)
    )


def _near(square: FloatArray, dt: float) -> FloatArray:
    """Mean over the neighbourhood, at its highest nearby: spikes shift in time."""
    size = max(3, round(NEAR / dt))
    mean: FloatArray = uniform_filter1d(square, size, axis=1)
    highest: FloatArray = maximum_filter1d(mean, size, axis=1)
    return highest


def _drawn(
    record: Record,
    noise: dict[str, Noise],
    filtering: Filtering,
    random: np.random.Generator,
) -> Record:
    """The record as it might have been read another time."""
    angles = (record.motor_angle, record.joint_angle)
    read = [
        _read_again(angle, noise[name], width, filtering, random)
        for angle, name, width in zip(
            angles, (MOTOR_ANGLE, JOINT_ANGLE), filtering.still, strict=True
        )
    ]
    return replace(record, motor_angle=read[0], joint_angle=read[1])


def _read_again(
    angle: FloatArray,
    noise: Noise,
    width: float,
    filtering: Filtering,
    random: np.random.Generator,
) -> FloatArray:
    if noise.deviation == 0.0:
        return angle
    impulse = np.zeros(2001)
    impulse[1000] = 1.0
    here = np.sum(low_passed(impulse, filtering.motion_band, filtering.rate) ** 2)
    scale = noise.deviation * np.sqrt(filtering.motion_passed / here)
    read = angle + scale * random.normal(size=angle.size)
    read = stilled(low_passed(read, filtering.motion_band, filtering.rate), width)
    return read + _unseen(read, width, random)


def _unseen(angle: FloatArray, width: float, random: np.random.Generator) -> FloatArray:
    """Movement that may have happened where the angle was taken to stand still."""
    moved = np.zeros(angle.size)
    edges = np.flatnonzero(np.diff(angle) != 0.0)
    for first, last in pairwise([-1, *edges.tolist(), angle.size - 1]):
        size = last - first
        if size > 2:
            bump = np.sin(np.pi * np.arange(1, size + 1) / (size + 1))
            moved[first + 1 : last + 1] = 0.5 * random.uniform(-width, width) * bump
    return moved
