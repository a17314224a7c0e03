"""Signs and units by mechanics: what a transmission cannot do.

Three things are known of every transmission, whatever its friction: the joint follows
the motor, the joint torque asks for motor torque of the same sign, and motor power less
joint power is never negative in the long run. Of the eight ways in which signs may be
wrong, each breaks another combination of the three (inverting everything on both sides
is a change of convention that nothing can show). And by virtual work the ratio of the
angles is the ratio of the torques, if the units are right.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis.channels import (
    DRIVE,
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
)
from cc_mujoco.diagnosis.findings import Finding, fix, note
from cc_mujoco.diagnosis.smoothing import velocity
from cc_mujoco.diagnosis.trials import FloatArray, Trial

_FOLLOWS = 0.6  # correlation from which on a sign is certain
_ASKS = 0.7
_SURE = 0.9
_CLEAR, _SEEN = 0.1, 0.03  # share of the power that is made of nothing
_TRAVEL = 4.0  # ranges of motion that a power balance needs
_BLOCKS = 8
_APART, _MENDED = 25.0, 5.0  # ratios of angles to torques that are wrong, and right
_DEGREE = math.degrees(1.0)


class Mechanics(NamedTuple):
    """What the two sides of a trial have to do with each other.

    Attributes:
        ratio: joint speed per motor speed.
        follows: correlation of the speeds, 0 if one side stands still.
        torque_ratio: motor torque per joint torque, friction aside.
        asks: their partial correlation, 0 if one of them is constant.
        motor_work: work of the motor per travel of the motor, less what is stored [Nm].
        joint_work: the same of the joint; their difference is friction.
        doubt: standard deviation of that difference.
        scale: power that passes per speed of the motor [Nm].
    """

    ratio: float
    follows: float
    torque_ratio: float
    asks: float
    motor_work: float
    joint_work: float
    doubt: float
    scale: float


def mechanics(trial: Trial) -> Mechanics:
    """Speeds, torques and works of both sides compared."""
    used = np.concatenate([np.arange(p.start, p.stop) for p in trial.segments])
    motor, joint = trial.motor_torque[used], trial.joint_torque[used]
    omega = velocity(trial.motor_angle, trial.step, trial.segments)[used]
    turn = velocity(trial.joint_angle, trial.step, trial.segments)[used]
    ratio = float(omega @ turn / max(omega @ omega, 1e-300))
    follows = _correlation(omega, turn)
    top = float(np.percentile(np.abs(omega), 95))
    slide = np.tanh(omega / max(0.1 * top, 1e-300))
    torque_ratio, asks = _partial(motor, joint, slide)
    works = _works(trial, used, omega, turn)
    return Mechanics(ratio, follows, torque_ratio, asks, *works)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    scale = math.sqrt(float((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale > 0.0 else 0.0


def _partial(
    motor: FloatArray, joint: FloatArray, slide: FloatArray
) -> tuple[float, float]:
    """Slope and partial correlation of two torques, direction of slip taken out."""
    basis = np.column_stack([np.ones_like(slide), slide])
    rest = [
        torque - basis @ np.linalg.lstsq(basis, torque, rcond=None)[0]
        for torque in (motor, joint)
    ]
    power = float(rest[1] @ rest[1])
    slope = float(rest[0] @ rest[1]) / power if power > 0.0 else 0.0
    return slope, _correlation(*rest)


def _works(
    trial: Trial, used: np.ndarray, omega: FloatArray, turn: FloatArray
) -> tuple[float, float, float, float]:
    """Works per travel, the doubt of their difference, and the power that passes.

    What is stored is a function of the state: it is fitted as one, so that cycles need
    not be closed. Linear terms in the angles take up constant offsets of the torques.
    """
    motor, joint = trial.motor_torque[used], trial.joint_torque[used]
    lengths = [part.stop - part.start for part in trial.segments]
    starts = np.cumsum([0, *lengths[:-1]])
    powers = np.column_stack([motor * omega, joint * turn, np.abs(omega)])
    passed = np.cumsum(powers, axis=0) * trial.step
    travel = passed[:, 2]
    span = np.ptp(trial.motor_angle[used])
    if not span > 0.0 or travel[-1] < _TRAVEL * span:
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


def check_signs(
    trials: Sequence[Trial], known: Sequence[Mechanics] | None = None
) -> list[Finding]:
    """Find channels with inverted sign, and swapped sides.

    Trials whose angles and torques agree in sign alike are judged together, for one
    that is short says little of power.

    Args:
        trials: of one rig.
        known: their mechanics, if they are known.
    """
    groups = defaultdict(list)
    for trial, m in zip(trials, known or map(mechanics, trials), strict=True):
        follows = np.sign(m.follows) if abs(m.follows) > _FOLLOWS else 0.0
        asks = np.sign(m.asks) if abs(m.asks) > _ASKS else 0.0
        groups[float(follows), float(asks)].append((trial, m))
    findings = []
    for (follows, asks), members in groups.items():
        pooled = _pooled([m for _, m in members])
        findings += _judged([trial for trial, _ in members], pooled, follows, asks)
    return findings


def _pooled(known: list[Mechanics]) -> Mechanics:
    """Works of several trials, averaged where they are known."""
    told = [m for m in known if math.isfinite(m.doubt)]
    if not told:
        return known[0]
    motor, joint, doubt, scale = np.array([m[4:] for m in told]).T
    return known[0]._replace(
        motor_work=float(motor.mean()),
        joint_work=float(joint.mean()),
        doubt=float(np.sqrt((doubt**2).sum())) / len(told),
        scale=float(scale.mean()),
    )


def _judged(
    trials: list[Trial], m: Mechanics, follows: float, asks: float
) -> list[Finding]:
    """The finding on trials that are alike, if there is one."""
    friction = m.motor_work - m.joint_work
    made = friction < -max(3.0 * m.doubt, _SEEN * m.scale)
    told = []
    if follows < 0.0:
        told.append("the joint turns against the motor")
    if asks < 0.0:
        told.append("motor torque falls where joint torque rises")
    if made:
        told.append(
            f"the transmission makes {-friction / m.scale:.0%} of the power that "
            "passes of nothing"
        )
    if not told:
        return []
    ways = _ways(m, follows, asks)
    if follows >= 0.0 and asks >= 0.0:
        ways.append("swap the motor's columns with the joint's")
    labels = {channel: trials[0].labels.get(channel, channel) for channel in DRIVE}
    advice = " or ".join(way.format(**labels) for way in ways)
    others = len(trials) - 1
    which = f" and {others} other files" if others > 1 else ""
    which = f" and {trials[1].path}" if others == 1 else which
    sentence = f"{trials[0].path}{which}: {' and '.join(told)}; {advice}."
    # A torque sensor of wrong gain can make a little power; only a sign makes much.
    gain = follows >= 0.0 and asks >= 0.0 and friction > -_CLEAR * m.scale
    return [(note if gain else fix)(sentence, "" if others else trials[0].name)]


def _ways(m: Mechanics, follows: float, asks: float) -> list[str]:
    """Fewest inversions that make the trial possible."""
    possible = []
    for flips in itertools.product((1, -1), repeat=4):
        motor_angle, motor_torque, joint_angle, joint_torque = flips
        friction = (
            motor_angle * motor_torque * m.motor_work
            - joint_angle * joint_torque * m.joint_work
        )
        if (
            follows * motor_angle * joint_angle >= 0.0
            and asks * motor_torque * joint_torque >= 0.0
            and friction > -min(2.0 * m.doubt, _SEEN * m.scale)
        ):
            inverted = [
                name for name, flip in zip(DRIVE, flips, strict=True) if flip < 0
            ]
            possible.append(inverted)
    if not possible:
        return ["check the signs"]
    fewest = min(map(len, possible))
    return [
        f"invert {' and '.join(f'{{{name}}}' for name in inverted)}"
        for inverted in possible
        if len(inverted) == fewest
    ]


def check_units(trial: Trial, known: Mechanics | None = None) -> list[Finding]:
    """Find units that contradict each other, by virtual work."""
    m = mechanics(trial) if known is None else known
    if not (abs(m.follows) > _FOLLOWS and abs(m.asks) > _SURE):
        return []
    apart = abs(m.torque_ratio / m.ratio)
    if 1.0 / _APART < apart < _APART:
        return []
    mends = {
        f"{{{MOTOR_ANGLE}}} is in degrees": apart / _DEGREE,
        f"{{{JOINT_ANGLE}}} is in degrees": apart * _DEGREE,
        f"{{{MOTOR_TORQUE}}} is in mNm": apart / 1e3,
        f"{{{JOINT_TORQUE}}} is in mNm": apart * 1e3,
        "the torque columns are swapped": 1.0 / abs(m.torque_ratio * m.ratio),
        "the angle columns are swapped": abs(m.torque_ratio * m.ratio),
    }
    likely = sorted(
        (abs(math.log(left)), text)
        for text, left in mends.items()
        if abs(math.log(left)) < math.log(_MENDED)
    )
    columns = {channel: trial.labels.get(channel, channel) for channel in DRIVE}
    advice = " or ".join(text.format(**columns) for _, text in likely[:2])
    sentence = (
        f"{trial.path}: the joint turns {m.ratio:.3g} rad per motor radian, but motor "
        f"torque is {m.torque_ratio:.3g} of joint torque, which cannot be; "
        f"{f'perhaps {advice}' if advice else 'check units and columns'}."
    )
    return [fix(sentence, trial.name)]
