"""Checks of signs and units by the mechanics of a transmission.

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
from numpy.typing import NDArray

from cc_mujoco.datasets._channels import (
    ANGLE,
    JOINT_ANGLE,
    JOINT_TORQUE,
    MAIN_CHANNELS,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
    TORQUE,
    unit_of,
)
from cc_mujoco.datasets._data_findings import DataFinding, error, warning
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import Trial
from cc_mujoco.diagnosis._checks.mechanics import Mechanics, sliding_torque_ratio

_MIN_ANGLE_CORRELATION = 0.6  # correlation from which on a sign is certain
_MIN_TORQUE_CORRELATION = 0.7
_UNIT_CHECK_CORRELATION = 0.9
_MIN_GENERATED_SHARE, _LARGE_GENERATED_SHARE = (
    0.03,
    0.06,
)  # energy gained, as a share of what passes
_CLEAR_WORK_SHARE = 0.2  # energy gained, as a share of the net works
_MIN_TRIALS = 3  # trials in which torques cannot oppose each other by chance
# Share of the power lost from which on both sides may be driving.
_MAX_FRICTION_SHARE = 0.6
_UNIT_MISMATCH_RATIO, _UNIT_MATCH_RATIO = (
    12.0,
    4.0,
)  # ratios of angles to torques that are wrong, and right
_ODD_ANGLE_RATIO = 8.0
# Torques of one trial over those of the others that no load explains.
_TORQUE_LEAP_RATIO = 300.0
_DEGREES_PER_RADIAN = math.degrees(1.0)


class Group(NamedTuple):
    """Trials whose angles and torques agree equally in sign, judged together.

    A trial that is short says little of power, and trials of different loads show
    together what none of them shows alone.
    """

    trials: list[Trial]
    mechanics: Mechanics


def group_trials(trials: Sequence[Trial], known: Sequence[Mechanics]) -> list[Group]:
    """Group the trials of one rig, whose mechanics are known."""
    by_signs = defaultdict(list)
    for trial, m in zip(trials, known, strict=True):
        by_signs[
            _sign(m.follows, _MIN_ANGLE_CORRELATION),
            _sign(m.asks, _MIN_TORQUE_CORRELATION),
        ].append((trial, m))
    return [
        Group([trial for trial, _ in members], _pool_mechanics(members))
        for members in by_signs.values()
    ]


def _sign(correlation: float, least: float) -> float:
    """Return the sign of a correlation, 0 where it is not certain."""
    return math.copysign(1.0, correlation) if abs(correlation) > least else 0.0


def _pool_mechanics(members: list[tuple[Trial, Mechanics]]) -> Mechanics:
    """Return the mechanics pooled over several trials."""
    first = members[0][1]
    if len(members) == 1:
        return first
    known = [m for _, m in members]
    torque_ratio, asks = _shared_torque_ratio([trial for trial, _ in members])
    if abs(asks) < abs(first.asks):
        torque_ratio, asks = first.torque_ratio, first.asks
    pooled = first._replace(
        ratio=float(np.median([m.ratio for m in known])),
        torque_ratio=torque_ratio,
        asks=asks,
    )
    usable = [m for m in known if math.isfinite(m.doubt)]
    if not usable:
        return pooled
    motor, joint, doubt, scale = np.array([m[4:] for m in usable]).T
    return pooled._replace(
        motor_work=float(motor.mean()),
        joint_work=float(joint.mean()),
        doubt=float(np.sqrt((doubt**2).sum())) / len(usable),
        scale=float(scale.mean()),
    )


def _shared_torque_ratio(trials: list[Trial]) -> tuple[float, float]:
    """Return motor over joint torque of several trials, and their correlation."""
    parts = [(trial, part) for trial in trials for part in trial.segments]
    omega = [velocity(trial.motor_angle[part], trial.step) for trial, part in parts]
    if any(t.motor_torque is None or t.joint_torque is None for t in trials):
        return 0.0, 0.0
    motor = [trial.channel(MOTOR_TORQUE)[part] for trial, part in parts]
    joint = [trial.channel(JOINT_TORQUE)[part] for trial, part in parts]
    return sliding_torque_ratio(
        np.concatenate(motor),
        np.concatenate(joint),
        np.concatenate(omega),
        trials[0].step,
    )


def check_signs(group: Group) -> list[DataFinding]:
    """Find channels with inverted sign, and swapped sides."""
    trials, m = group
    follows, asks = (
        _sign(m.follows, _MIN_ANGLE_CORRELATION),
        _sign(m.asks, _MIN_TORQUE_CORRELATION),
    )
    friction = m.motor_work - m.joint_work
    contradictions = []
    if follows < 0.0:
        contradictions.append("the joint turns against the motor")
    if asks < 0.0:
        contradictions.append("motor torque falls where joint torque rises")
    made = friction < -max(3.0 * m.doubt, _MIN_GENERATED_SHARE * m.scale)
    if made:
        contradictions.append(
            f"more energy leaves the transmission than enters, by "
            f"{-friction / m.scale:.0%} of what passes"
        )
    if not contradictions:
        return []
    ways = _fewest_inversions(m, follows, asks)
    if follows >= 0.0 and asks >= 0.0:
        ways.append("swap the motor's columns with the joint's")
        # With the torques swapped, each works on the other side's travel.
        if follows and m.joint_work / m.ratio > m.motor_work * m.ratio:
            ways.append(f"swap {{{MOTOR_TORQUE}}} and {{{JOINT_TORQUE}}}")
    advice = " or ".join(ways).format(**_labels(trials[0]))
    sentence = f"{_files(trials)}: {' and '.join(contradictions)}; {advice}."
    if follows < 0.0:
        certain = True
    elif made:
        # A torque sensor of wrong gain makes a little power; only a sign makes much.
        net = abs(m.motor_work) + abs(m.joint_work)
        certain = asks < 0.0 or -friction > max(
            _LARGE_GENERATED_SHARE * m.scale, _CLEAR_WORK_SHARE * net
        )
    else:
        # Torques also oppose each other where both sides drive against friction.
        known = friction < _MAX_FRICTION_SHARE * m.scale and math.isfinite(m.doubt)
        certain = known or len(trials) >= _MIN_TRIALS
    return [(error if certain else warning)(sentence, _single_trial_name(trials))]


def _files(trials: list[Trial]) -> str:
    """Return the files of a group, for a sentence."""
    others = [trial.path for trial in trials[1:]]
    more = others[0] if len(others) == 1 else f"{len(others)} other files"
    return f"{trials[0].path} and {more}" if others else trials[0].path


def _single_trial_name(trials: list[Trial]) -> str:
    """Name of the one trial of a group, else nothing."""
    return trials[0].name if len(trials) == 1 else ""


def _labels(trial: Trial) -> dict[str, str]:
    """Return the names that the channels have in the file."""
    return {channel: trial.labels.get(channel, channel) for channel in MAIN_CHANNELS}


_ANGLE_CHANNELS, _TORQUE_CHANNELS = (
    (MOTOR_ANGLE, JOINT_ANGLE),
    (MOTOR_TORQUE, JOINT_TORQUE),
)
_UNIT_CANDIDATES = {
    _ANGLE_CHANNELS: ("deg", "radians", ANGLE),
    _TORQUE_CHANNELS: ("mNm", "Nm", TORQUE),
}
"""Small unit in which a channel may be, or its name alone; the plain one."""


def wrong_unit(trial: Trial, channel: str) -> str:
    """Name the likely unit of a channel that is off by 57, or of a torque by 1000."""
    pair = _ANGLE_CHANNELS if channel in _ANGLE_CHANNELS else _TORQUE_CHANNELS
    small, plain, kind = _UNIT_CANDIDATES[pair]
    other = pair[channel == pair[0]]
    label = trial.labels.get(other, other)
    if unit_of(label, kind) == small:
        return f"{label} is in {plain}, whatever its name says"
    unit_name = "degrees" if small == "deg" else small
    return f"{trial.labels.get(channel, channel)} is in {unit_name}"


def _fewest_inversions(m: Mechanics, follows: float, asks: float) -> list[str]:
    """Return the fewest inversions that make the trial possible."""
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
            and friction > -min(2.0 * m.doubt, _MIN_GENERATED_SHARE * m.scale)
        ):
            inverted = [
                name
                for name, flip in zip(MAIN_CHANNELS, flips, strict=True)
                if flip < 0
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


def check_units(group: Group) -> list[DataFinding]:
    """Find units that contradict each other, by virtual work."""
    trials, m = group
    if not (
        abs(m.follows) > _MIN_ANGLE_CORRELATION
        and abs(m.asks) > _UNIT_CHECK_CORRELATION
    ):
        return []
    mismatch = abs(m.torque_ratio / m.ratio)
    if 1.0 / _UNIT_MISMATCH_RATIO < mismatch < _UNIT_MISMATCH_RATIO:
        return []
    mends = {
        wrong_unit(trials[0], MOTOR_ANGLE): mismatch / _DEGREES_PER_RADIAN,
        wrong_unit(trials[0], JOINT_ANGLE): mismatch * _DEGREES_PER_RADIAN,
        wrong_unit(trials[0], MOTOR_TORQUE): mismatch / 1e3,
        wrong_unit(trials[0], JOINT_TORQUE): mismatch * 1e3,
        "the torque columns are swapped": 1.0 / abs(m.torque_ratio * m.ratio),
        "the angle columns are swapped": abs(m.torque_ratio * m.ratio),
    }
    likely = sorted(
        (abs(math.log(left)), text)
        for text, left in mends.items()
        if abs(math.log(left)) < math.log(_UNIT_MATCH_RATIO)
    )
    advice = " or ".join(text for _, text in likely[:2]).format(**_labels(trials[0]))
    sentence = (
        f"{_files(trials)}: the joint turns {m.ratio:.3g} rad per motor radian, but "
        f"motor torque is {m.torque_ratio:.3g} of joint torque, which cannot be; "
        f"{f'perhaps {advice}' if advice else 'check units and columns'}."
    )
    return [error(sentence, _single_trial_name(trials))]


def check_sizes(
    trials: Sequence[Trial], known: Sequence[Mechanics]
) -> list[DataFinding]:
    """Find trials with torques hundreds of times as large as in the others.

    A free joint carries next to nothing, so a loaded trial may well leap over the
    others in one torque; but then its other torque is of a like size.
    """
    if any(t.motor_torque is None or t.joint_torque is None for t in trials):
        return []
    sizes = {
        channel: np.array(
            [np.sqrt(np.nanmean(t.channel(channel) ** 2)) for t in trials]
        )
        for channel in (MOTOR_TORQUE, JOINT_TORQUE)
    }
    ratios = [abs(m.ratio) for m in known if abs(m.follows) > _MIN_ANGLE_CORRELATION]
    ratio = float(np.median(ratios)) if ratios else 1.0
    share = {MOTOR_TORQUE: ratio, JOINT_TORQUE: 1.0 / ratio}
    leaps = {channel: _size_below_leap(size) for channel, size in sizes.items()}
    findings = []
    for channel, other in itertools.permutations(sizes):
        for k in np.flatnonzero(sizes[channel] > leaps[channel]).tolist():
            is_consistent = (
                sizes[channel][k]
                < _TORQUE_LEAP_RATIO * share[channel] * sizes[other][k]
            )
            if is_consistent and sizes[other][k] <= leaps[other]:
                continue
            trial = trials[k]
            usual = float(sizes[channel][sizes[channel] <= leaps[channel]].max())
            message = (
                f"{trial.column(channel)} is {sizes[channel][k]:.3g} N m RMS, but at "
                f"most {usual:.3g} in other trials; perhaps it is in mNm: call it "
                f"{channel.removesuffix('_nm')}_mnm there."
            )
            findings.append(error(message, trial.name, channel))
    return findings


def _size_below_leap(sizes: NDArray[np.float64]) -> float:
    """Return the size below a leap in the sizes of the trials, or infinity."""
    ordered = np.sort(sizes)
    above = np.flatnonzero(
        ordered[1:] > _TORQUE_LEAP_RATIO * np.maximum(ordered[:-1], 1e-12)
    )
    return float(ordered[above[-1]]) if len(above) else math.inf


def check_ratios(
    trials: Sequence[Trial], known: Sequence[Mechanics]
) -> list[DataFinding]:
    """Find trials with another ratio of the angles than the others."""
    certain = [
        (trial, m.ratio)
        for trial, m in zip(trials, known, strict=True)
        if abs(m.follows) > _MIN_ANGLE_CORRELATION
    ]
    if len(certain) < 3:
        return []
    usual = float(np.median([abs(ratio) for _, ratio in certain]))
    return [
        error(
            f"{trial.path}: the joint turns {ratio:.3g} rad per motor radian, but "
            f"{usual:.3g} in the other trials; check the units of its angles.",
            trial.name,
        )
        for trial, ratio in certain
        if not 1.0 / _ODD_ANGLE_RATIO < abs(ratio) / usual < _ODD_ANGLE_RATIO
    ]
