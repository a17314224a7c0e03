"""Inputs of residual and features: motion, simulated torques, their history."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis import BaselineFit, Record, acceleration
from cc_mujoco.native import FloatArray

REST = 0.01  # speed of the motor below which it rests [rad/s]
PAUSE = 0.05  # shortest rest; a motion that turns has speed 0 for a moment too [s]


class Signals(NamedTuple):
    """One record as features see it; arrays are (samples,)."""

    dt: float  # time between samples [s]
    band: float  # to which the torques are low-passed [Hz]
    counts: NDArray[np.bool_]  # whether a sample counts
    time: FloatArray  # since the trial began [s]
    motor_angle: FloatArray  # [rad]
    joint_angle: FloatArray  # [rad]
    speed: FloatArray  # of the cable at the motor's pulley [m/s]
    direction: FloatArray  # sign of the speed; at rest that of the last motion
    motor_acceleration: FloatArray  # [rad/s^2]
    joint_acceleration: FloatArray  # [rad/s^2]
    travel: FloatArray  # of the cable since the motion last turned [m]
    rested: FloatArray  # how long the last rest was [s]
    since_rest: FloatArray  # travel of the cable since then [m]
    # (2, samples) of motor and joint, as the baseline simulates it [N m]
    torque: FloatArray
    residual: FloatArray  # (2, samples) measured minus simulated [N m]
    floor: FloatArray  # (2, samples) standard deviation of noise [N m]


def signals(baseline_fit: BaselineFit) -> tuple[Signals, ...]:
    """Return the signals of every record, about the tuned baseline."""
    problem = baseline_fit.problem
    values = problem.values(baseline_fit.whole.x)
    radius, _ = problem.plant.radii(values)
    played = problem.plant.simulate(values, problem.effects)
    return tuple(
        observed(record, torque, floor, radius)
        for record, torque, floor in zip(
            problem.plant.records, played, problem.floor, strict=True
        )
    )


def observed(
    record: Record, torque: FloatArray, floor: FloatArray, radius: float
) -> Signals:
    """Return the signals of one record.

    Args:
        torque: (2, samples) of motor and joint, simulated [N m].
        floor: (2, samples) standard deviation of their noise [N m].
        radius: of the motor's pulley [m].
    """
    turning = np.gradient(record.motor_angle, record.dt)
    moves = np.abs(turning) > REST
    direction = held(np.sign(turning), moves)
    path = radius * np.cumsum(np.abs(np.diff(record.motor_angle, prepend=0.0)))
    turned = np.diff(direction, prepend=direction[0]) != 0.0
    resting = _resting(moves, record.dt)
    sets_off = moves & (resting > PAUSE)
    return Signals(
        record.dt,
        record.band,
        record.counts,
        record.start + record.dt * np.arange(turning.size),
        record.motor_angle,
        record.joint_angle,
        radius * turning,
        direction,
        acceleration(record.motor_angle, record.dt),
        acceleration(record.joint_angle, record.dt),
        path - held(path, turned),
        held(resting, sets_off),
        path - held(path, sets_off),
        torque,
        record.measured - torque,
        floor,
    )


def held(values: FloatArray, taken: NDArray[np.bool_]) -> FloatArray:
    """Return every value held since last taken, at first the first (samples,)."""
    last = np.maximum.accumulate(np.where(taken, np.arange(values.size), 0))
    return values[last]


def _resting(moves: NDArray[np.bool_], dt: float) -> FloatArray:
    """Return the length of the rest before each sample that ends with it [s]."""
    place = np.arange(moves.size)
    last = np.maximum.accumulate(np.where(moves, place, 0))
    before = np.concatenate([[0], last[:-1]])
    return dt * (place - before - 1.0).clip(0.0)
