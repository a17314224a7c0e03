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
from numpy.typing import NDArray

from cc_mujoco.diagnosis.checks.mechanics import Mechanics, torques
from cc_mujoco.diagnosis.data.channels import (
    ANGLE,
    DRIVE,
    JOINT_ANGLE,
    JOINT_TORQUE,
    MOTOR_ANGLE,
    MOTOR_TORQUE,
    TORQUE,
    unit_of,
)
from cc_mujoco.diagnosis.data.findings import DataFinding, error, warning
from cc_mujoco.diagnosis.data.smoothing import velocity
from cc_mujoco.diagnosis.data.trials import Trial

_FOLLOWS = 0.6  # correlation from which on a sign is certain
_ASKS = 0.7
_SURE = 0.9
_SEEN, _MUCH = 0.03, 0.06  # share of the power that passes, made of nothing
_CLEAR = 0.2  # share of the net works, made of nothing
_SEVERAL = 3  # trials in which torques cannot oppose each other by chance
_DRAGGED = 0.6  # share of the power lost from which on both sides may be driving
_APART, _MENDED = 12.0, 4.0  # ratios of angles to torques that are wrong, and right
_ODD = 8.0
_LEAP = 300.0  # torques of one trial over those of the others that no load explains
_DEGREE = math.degrees(1.0)


class Group(NamedTuple):
    """Trials whose angles and torques agree in sign alike, judged together.

    A trial that is short says little of power, and trials of different loads show
    together what none of them shows alone.
    """

    trials: list[Trial]
    mechanics: Mechanics


def groups(trials: Sequence[Trial], known: Sequence[Mechanics]) -> list[Group]:
    """Group the trials of one rig, whose mechanics are known."""
    alike = defaultdict(list)
    for trial, m in zip(trials, known, strict=True):
        alike[_sign(m.follows, _FOLLOWS), _sign(m.asks, _ASKS)].append((trial, m))
    return [
        Group([trial for trial, _ in members], _pooled(members))
        for members in alike.values()
    ]


def _sign(correlation: float, least: float) -> float:
    """Sign of a correlation, 0 where it is not certain."""
    return math.copysign(1.0, correlation) if abs(correlation) > least else 0.0


def _pooled(members: list[tuple[Trial, Mechanics]]) -> Mechanics:
    """The mechanics of several trials together."""
    first = members[0][1]
    if len(members) == 1:
        return first
    known = [m for _, m in members]
    torque_ratio, asks = _shared([trial for trial, _ in members])
    if abs(asks) < abs(first.asks):
        torque_ratio, asks = first.torque_ratio, first.asks
    pooled = first._replace(
        ratio=float(np.median([m.ratio for m in known])),
        torque_ratio=torque_ratio,
        asks=asks,
    )
    told = [m for m in known if math.isfinite(m.doubt)]
    if not told:
        return pooled
    motor, joint, doubt, scale = np.array([m[4:] for m in told]).T
    return pooled._replace(
        motor_work=float(motor.mean()),
        joint_work=float(joint.mean()),
        doubt=float(np.sqrt((doubt**2).sum())) / len(told),
        scale=float(scale.mean()),
    )


def _shared(trials: list[Trial]) -> tuple[float, float]:
    """Motor torque per joint torque over several trials, and their correlation."""
    parts = [(trial, part) for trial in trials for part in trial.segments]
    omega = [velocity(trial.motor_angle[part], trial.step) for trial, part in parts]
    if any(t.motor_torque is None or t.joint_torque is None for t in trials):
        return 0.0, 0.0
    motor = [trial.channel(MOTOR_TORQUE)[part] for trial, part in parts]
    joint = [trial.channel(JOINT_TORQUE)[part] for trial, part in parts]
    return torques(
        np.concatenate(motor),
        np.concatenate(joint),
        np.concatenate(omega),
        trials[0].step,
    )


def check_signs(group: Group) -> list[DataFinding]:
    """Find channels with inverted sign, and swapped sides."""
    trials, m = group
    follows, asks = _sign(m.follows, _FOLLOWS), _sign(m.asks, _ASKS)
    friction = m.motor_work - m.joint_work
    told = []
    if follows < 0.0:
        told.append("the joint turns against the motor")
    if asks < 0.0:
        told.append("motor torque falls where joint torque rises")
    made = friction < -max(3.0 * m.doubt, _SEEN * m.scale)
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
        # With the torques swapped, each works on the other side's travel.
        if follows and m.joint_work / m.ratio > m.motor_work * m.ratio:
            ways.append(f"swap {{{MOTOR_TORQUE}}} and {{{JOINT_TORQUE}}}")
    advice = " or ".join(ways).format(**_labels(trials[0]))
    sentence = f"{_files(trials)}: {' and '.join(told)}; {advice}."
    if follows < 0.0:
        certain = True
    elif made:
        # A torque sensor of wrong gain makes a little power; only a sign makes much.
        net = abs(m.motor_work) + abs(m.joint_work)
        certain = asks < 0.0 or -friction > max(_MUCH * m.scale, _CLEAR * net)
    else:
        # Torques also oppose each other where both sides drive against friction.
        known = friction < _DRAGGED * m.scale and math.isfinite(m.doubt)
        certain = known or len(trials) >= _SEVERAL
    return [(error if certain else warning)(sentence, _name(trials))]


def _files(trials: list[Trial]) -> str:
    """Files of a group, for a sentence."""
    others = [trial.path for trial in trials[1:]]
    more = others[0] if len(others) == 1 else f"{len(others)} other files"
    return f"{trials[0].path} and {more}" if others else trials[0].path


def _name(trials: list[Trial]) -> str:
    """Name of the one trial of a group, else nothing."""
    return trials[0].name if len(trials) == 1 else ""


def _labels(trial: Trial) -> dict[str, str]:
    """Names that the channels have in the file."""
    return {channel: trial.labels.get(channel, channel) for channel in DRIVE}


_ANGLES, _TORQUES = (MOTOR_ANGLE, JOINT_ANGLE), (MOTOR_TORQUE, JOINT_TORQUE)
_MISREAD = {_ANGLES: ("deg", "radians", ANGLE), _TORQUES: ("mNm", "Nm", TORQUE)}
"""Small unit in which a channel may be, or its name alone; the plain one."""


def wrong_unit(trial: Trial, channel: str) -> str:
    """Suggest causes if a channel reads 57, or of torques 1000 times what it should."""
    pair = _ANGLES if channel in _ANGLES else _TORQUES
    small, plain, kind = _MISREAD[pair]
    other = pair[channel == pair[0]]
    label = trial.labels.get(other, other)
    if unit_of(label, kind) == small:
        return f"{label} is in {plain}, whatever its name says"
    said = "degrees" if small == "deg" else small
    return f"{trial.labels.get(channel, channel)} is in {said}"


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


def check_units(group: Group) -> list[DataFinding]:
    """Find units that contradict each other, by virtual work."""
    trials, m = group
    if not (abs(m.follows) > _FOLLOWS and abs(m.asks) > _SURE):
        return []
    apart = abs(m.torque_ratio / m.ratio)
    if 1.0 / _APART < apart < _APART:
        return []
    mends = {
        wrong_unit(trials[0], MOTOR_ANGLE): apart / _DEGREE,
        wrong_unit(trials[0], JOINT_ANGLE): apart * _DEGREE,
        wrong_unit(trials[0], MOTOR_TORQUE): apart / 1e3,
        wrong_unit(trials[0], JOINT_TORQUE): apart * 1e3,
        "the torque columns are swapped": 1.0 / abs(m.torque_ratio * m.ratio),
        "the angle columns are swapped": abs(m.torque_ratio * m.ratio),
    }
    likely = sorted(
        (abs(math.log(left)), text)
        for text, left in mends.items()
        if abs(math.log(left)) < math.log(_MENDED)
    )
    advice = " or ".join(text for _, text in likely[:2]).format(**_labels(trials[0]))
    sentence = (
        f"{_files(trials)}: the joint turns {m.ratio:.3g} rad per motor radian, but "
        f"motor torque is {m.torque_ratio:.3g} of joint torque, which cannot be; "
        f"{f'perhaps {advice}' if advice else 'check units and columns'}."
    )
    return [error(sentence, _name(trials))]


def check_sizes(
    trials: Sequence[Trial], known: Sequence[Mechanics]
) -> list[DataFinding]:
    """Find trials whose torques are hundreds of times those of the others.

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
    ratios = [abs(m.ratio) for m in known if abs(m.follows) > _FOLLOWS]
    ratio = float(np.median(ratios)) if ratios else 1.0
    share = {MOTOR_TORQUE: ratio, JOINT_TORQUE: 1.0 / ratio}
    leaps = {channel: _leap(size) for channel, size in sizes.items()}
    findings = []
    for channel, other in itertools.permutations(sizes):
        for k in np.flatnonzero(sizes[channel] > leaps[channel]).tolist():
            alike = sizes[channel][k] < _LEAP * share[channel] * sizes[other][k]
            if alike and sizes[other][k] <= leaps[other]:
                continue
            trial = trials[k]
            usual = float(sizes[channel][sizes[channel] <= leaps[channel]].max())
            told = (
                f"{trial.column(channel)} is {sizes[channel][k]:.3g} N m RMS, but at "
                f"most {usual:.3g} in other trials; perhaps it is in mNm: call it "
                f"{channel.removesuffix('_nm')}_mnm there."
            )
            findings.append(error(told, trial.name, channel))
    return findings


def _leap(sizes: NDArray[np.float64]) -> float:
    """The size below a leap in the sizes of the trials; infinite without one."""
    ordered = np.sort(sizes)
    above = np.flatnonzero(ordered[1:] > _LEAP * np.maximum(ordered[:-1], 1e-12))
    return float(ordered[above[-1]]) if len(above) else math.inf


def check_ratios(
    trials: Sequence[Trial], known: Sequence[Mechanics]
) -> list[DataFinding]:
    """Find trials whose angles have another ratio than those of the others."""
    certain = [
        (trial, m.ratio)
        for trial, m in zip(trials, known, strict=True)
        if abs(m.follows) > _FOLLOWS
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
        if not 1.0 / _ODD < abs(ratio) / usual < _ODD
    ]
