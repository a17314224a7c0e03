"""Relations between the two sides of a trial: ratios and works.

By virtual work the ratio of the angles is the ratio of the torques, friction aside. The
work that goes in on one side and does not come out on the other is friction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import FloatArray, Trial

_SETTLING_SHARE = 0.1  # share of the range of motion after which friction has settled
# Share of the usual speed from which on the cable surely slides.
_SLIDING_SPEED_SHARE = 0.3
# Share of its spread that a torque must show while the cable slides.
_MIN_SPREAD_SHARE = 0.2
_MIN_SAMPLES = 50
_MIN_TRAVEL = 4.0  # ranges of motion that a power balance needs
_BLOCKS = 8


class Mechanics(NamedTuple):
    """Relations between the two sides of a trial.

    Attributes:
        ratio: joint speed per motor speed.
        follows: correlation of the speeds, 0 if one side stands still.
        torque_ratio: motor torque per joint torque, friction aside.
        asks: their correlation while the cable slides either way, 0 if unknown.
        motor_work: work of the motor per travel of the motor, less what is stored [N
            m].
        joint_work: the same of the joint; their difference is friction.
        doubt: standard deviation of that difference.
        scale: power that passes per speed of the motor [N m].
    """

    ratio: float
    follows: float
    torque_ratio: float
    asks: float
    motor_work: float
    joint_work: float
    doubt: float
    scale: float


def measure_mechanics(trial: Trial) -> Mechanics:
    """Compare the known speeds, torques and works of both sides."""
    used = np.concatenate([np.arange(p.start, p.stop) for p in trial.segments])
    omega = velocity(trial.motor_angle, trial.step, trial.segments)[used]
    turn = velocity(trial.joint_angle, trial.step, trial.segments)[used]
    ratio = float(omega @ turn / max(omega @ omega, 1e-300))
    follows = _correlation(omega, turn)
    if trial.motor_torque is None or trial.joint_torque is None:
        return Mechanics(ratio, follows, 0.0, 0.0, 0.0, 0.0, math.inf, 1.0)
    motor, joint = trial.motor_torque[used], trial.joint_torque[used]
    torque_ratio, asks = sliding_torque_ratio(motor, joint, omega, trial.step)
    works = _work_per_travel(trial, used, (motor, joint), omega, turn)
    return Mechanics(ratio, follows, torque_ratio, asks, *works)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    scale = math.sqrt(float((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale > 0.0 else 0.0


def sliding_torque_ratio(
    motor: FloatArray, joint: FloatArray, omega: FloatArray, step: float
) -> tuple[float, float]:
    """Return motor over joint torque during sliding, and their correlation.

    Friction that grows with load tilts the slope up one way and down the other; their
    geometric mean is the ratio without friction. At reversals torques change together
    or against each other as the ends move, which says nothing of signs.
    """
    usual = math.sqrt(float(np.mean(omega**2)))
    ways, settled = _sliding(omega, usual, step)
    slopes, matches = [], []
    for way in (1.0, -1.0):
        rows = settled & (ways == way)
        if np.count_nonzero(rows) < _MIN_SAMPLES:
            return 0.0, 0.0
        one, other = motor[rows] - motor[rows].mean(), joint[rows] - joint[rows].mean()
        spread, other_spread = motor.std(), joint.std()
        if not (
            one.std() > _MIN_SPREAD_SHARE * spread
            and other.std() > _MIN_SPREAD_SHARE * other_spread
        ):
            return 0.0, 0.0
        slopes.append(float(one @ other) / float(other @ other))
        matches.append(_correlation(one, other))
    if slopes[0] * slopes[1] <= 0.0:
        return 0.0, 0.0
    ratio = math.copysign(math.sqrt(slopes[0] * slopes[1]), slopes[0])
    return ratio, math.copysign(min(map(abs, matches)), slopes[0])


def _sliding(
    omega: FloatArray, usual: float, step: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the direction of motion, and where friction has settled."""
    moving = np.flatnonzero(np.abs(omega) > 0.2 * _SLIDING_SPEED_SHARE * usual)
    last = np.zeros(len(omega), dtype=np.intp)
    last[moving] = moving
    ways = np.sign(omega[np.maximum.accumulate(last)])
    travel = np.cumsum(np.abs(omega)) * step
    turned = np.flatnonzero(np.diff(ways, prepend=ways[0]))
    start = np.zeros(len(omega))
    start[turned] = travel[turned]
    since = travel - np.maximum.accumulate(start)
    span = float(np.ptp(np.cumsum(omega) * step))
    return ways, (since > _SETTLING_SHARE * span) & (
        np.abs(omega) > _SLIDING_SPEED_SHARE * usual
    )


def _work_per_travel(
    trial: Trial,
    used: np.ndarray,
    shown: tuple[FloatArray, FloatArray],
    omega: FloatArray,
    turn: FloatArray,
) -> tuple[float, float, float, float]:
    """Return works per travel, their uncertainty, and the transmitted power.

    What is stored is a function of the state: it is fitted as one, so that cycles need
    not be closed. Linear terms in the angles take up constant offsets of the torques.
    """
    motor, joint = shown
    lengths = [part.stop - part.start for part in trial.segments]
    starts = np.cumsum([0, *lengths[:-1]])
    powers = np.column_stack([motor * omega, joint * turn, np.abs(omega)])
    passed = np.cumsum(powers, axis=0) * trial.step
    travel = passed[:, 2]
    span = np.ptp(trial.motor_angle[used])
    if not span > 0.0 or travel[-1] < _MIN_TRAVEL * span:
        return 0.0, 0.0, math.inf, 1.0
    state = np.column_stack(
        [
            trial.motor_angle[used],
            trial.joint_angle[used],
            motor**2,
            joint**2,
            motor * joint,
            omega**2,
            turn**2,
        ]
    )
    columns = np.column_stack([travel, state, passed[:, :2]])
    for start, length in zip(starts, lengths, strict=True):
        part = slice(start, start + length)
        columns[part] -= columns[part].mean(axis=0)
    known, works = columns[:, :8], columns[:, 8:]
    scale = np.maximum(np.abs(known).max(axis=0), 1e-300)
    slopes = np.linalg.lstsq(known / scale, works, rcond=None)[0] / scale[:, None]
    lost = (works - known[:, 1:] @ slopes[1:]) @ [1.0, -1.0]
    blocks = np.array_split(np.arange(len(used)), _BLOCKS)
    rates = [
        np.polyfit(travel[block], lost[block], 1)[0]
        for block in blocks
        if len(block) > 2 and np.ptp(travel[block]) > 0.02 * travel[-1]
    ]
    doubt = np.std(rates) / math.sqrt(len(rates)) if len(rates) > 2 else math.inf
    power = float(np.abs(powers[:, :2]).sum() * trial.step / travel[-1])
    return float(slopes[0, 0]), float(slopes[0, 1]), float(doubt), max(power, 1e-300)
