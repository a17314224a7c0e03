"""Check of which side leads: a cable that pulls is longer, so that the motor is ahead.

The motor turns further than the joint by what the cable stretches, and more the more
it pulls, whatever its friction. Angles that show the opposite are those of the other
side: if both pulleys are equal nothing else shows it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cc_mujoco._utils.compilation import FloatArray
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.datasets._data_findings import DataFinding, error, warning
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import Trial

_MIN_CORRELATION = 0.6
"""Correlation of lead and torque from which on it is no accident."""
_MIN_SAMPLES = 200


def check_lead(trials: Sequence[Trial], bench: Bench) -> list[DataFinding]:
    """Find angles that belong to the other side.

    Args:
        trials: of one rig.
        bench: of its scene; where other joints move the cables nothing is checked.
    """
    if bench.others:
        return []
    sure = [
        (trial, lead)
        for trial in trials
        if not trial.facts.unhooked
        and abs(lead := _lead_correlation(trial, bench)) > _MIN_CORRELATION
    ]
    if not sure or any(lead > 0.0 for _, lead in sure):
        return []
    names = [sure[0][0].labels.get(name, name) for name in (MOTOR_ANGLE, JOINT_ANGLE)]
    where = sure[0][0].path
    if len(sure) > 1:
        where += f" and {len(sure) - 1} more"
    message = (
        f"{where}: the joint leads the motor the more, the more torque passes, as no "
        f"cable that stretches lets it; perhaps {names[0]} and {names[1]} are swapped."
    )
    certain = len(sure) > 1
    return [
        (error if certain else warning)(message, "" if certain else sure[0][0].name)
    ]


def _lead_correlation(trial: Trial, bench: Bench) -> float:
    """Return the correlation of motor lead and transmitted torque, 0 if unknown.

    Clocks and offsets that differ make a lead as well, and are taken out. A wrong ratio
    may, too: what counts is what is there with and without it.
    """
    if trial.motor_torque is None or trial.joint_torque is None:
        return 0.0
    parts = [p for p in trial.segments if p.stop - p.start >= _MIN_SAMPLES]
    if not parts:
        return 0.0
    used = np.concatenate([np.arange(p.start, p.stop) for p in parts])
    along = bench.following(trial.joint_angle)[used]
    lead = trial.motor_angle[used] - along
    torque = np.zeros(used.size)
    for shown in (trial.motor_torque[used], trial.joint_torque[used]):
        torque += shown / max(float(np.std(shown)), 1e-300)
    speed = velocity(trial.motor_angle, trial.step, trial.segments)[used]
    usual = [speed] + [
        ((used >= part.start) & (used < part.stop)).astype(np.float64) for part in parts
    ]
    fixed, free = (
        _partial_correlation(lead, torque, usual),
        _partial_correlation(lead, torque, [*usual, along]),
    )
    return min(fixed, free, key=abs) if fixed * free > 0.0 else 0.0


def _partial_correlation(
    one: FloatArray, other: FloatArray, known: Sequence[FloatArray]
) -> float:
    """Return the partial correlation of two signals given others."""
    axes, _ = np.linalg.qr(np.column_stack([k / max(_norm(k), 1e-300) for k in known]))
    one, other = (signal - axes @ (axes.T @ signal) for signal in (one, other))
    size = _norm(one) * _norm(other)
    return float(one @ other) / size if size > 0.0 else 0.0


def _norm(signal: FloatArray) -> float:
    return math.sqrt(float(signal @ signal))
