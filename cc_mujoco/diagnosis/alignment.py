"""Do both sides of a trial run on one clock?

The speeds of motor and joint are correlated in windows. Lost motion makes the joint
late by a time that shrinks with speed; a delay is the same in every window; a clock of
its own makes the delay grow with time. The three are fitted together, so that a motion
that grows faster is not taken for a clock that drifts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate

from cc_mujoco.diagnosis.channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.diagnosis.findings import Finding, fix, note
from cc_mujoco.diagnosis.smoothing import velocity
from cc_mujoco.diagnosis.trials import FloatArray, Trial

REACH = 1.0
"""Delays are searched up to this [s]."""
FAR = 0.15
"""A delay beyond this is a mistake of the recording, not an effect [s]."""
_WINDOW, _MOST, _FEWEST = 4.0, 40, 6
_ALIKE = 0.8
_DRIFT = 0.02  # change of the delay over a trial that matters [s]


class Alignment(NamedTuple):
    """How the joint's readings lie in time against the motor's.

    Attributes:
        delay: by which the joint comes late [s], NaN if that cannot be seen.
        drift: change of the delay per time [s/s], 0 if there is none to be seen.
        doubt: standard deviation of the drift; infinite if there are too few windows.
        gain: by how much the correlation of the speeds rises when the delay is undone.
    """

    delay: float
    drift: float
    doubt: float
    gain: float


def alignment(trial: Trial) -> Alignment:
    """Delay between the two sides, and its drift."""
    motor = velocity(trial.motor_angle, trial.step, trial.segments)
    joint = velocity(trial.joint_angle, trial.step, trial.segments)
    usual = float(np.nanstd(motor))
    length = max(trial.duration / _MOST, _WINDOW)
    found = []
    for part in trial.segments:
        count = max(1, round((part.stop - part.start) * trial.step / length))
        for rows in np.array_split(np.arange(part.start, part.stop), count):
            speed = float(np.std(motor[rows]))
            if speed < 0.2 * usual or len(rows) < 20:
                continue
            lag, alike, gain = _lag(motor[rows], joint[rows], trial.step)
            if alike > _ALIKE:
                found.append((trial.time[rows].mean(), lag, gain, speed))
    if not found:
        return Alignment(math.nan, 0.0, math.inf, 0.0)
    times, lags, gains, speeds = np.array(found).T
    delay, gain = float(np.median(lags)), float(np.median(gains))
    if len(found) < _FEWEST or np.ptp(times) == 0.0:
        return Alignment(delay, 0.0, math.inf, gain)
    basis = np.column_stack([times - times.mean(), np.ones_like(times), 1.0 / speeds])
    scale = np.abs(basis).max(axis=0)
    inverse = np.linalg.pinv((basis / scale).T @ (basis / scale))
    slopes = inverse @ (basis / scale).T @ lags
    rest = lags - basis / scale @ slopes
    spread = float(rest @ rest) / max(1, len(lags) - 3)
    doubt = math.sqrt(spread * inverse[0, 0]) / scale[0]
    return Alignment(delay, float(slopes[0] / scale[0]), doubt, gain)


def _lag(
    motor: FloatArray, joint: FloatArray, step: float
) -> tuple[float, float, float]:
    """Lag of the joint [s], correlation there, and by how much more than at none."""
    motor, joint = motor - motor.mean(), joint - joint.mean()
    count = len(motor)
    reach = min(round(REACH / step), count // 3)
    scale = math.sqrt(float((motor @ motor) * (joint @ joint)))
    if not scale > 0.0 or reach < 2:
        return 0.0, 0.0, 0.0
    match = correlate(joint, motor, mode="full", method="fft") / scale
    match = np.abs(match[count - 1 - reach : count + reach])
    # Of a periodic motion the nearest peak counts, unless another is clearly better.
    inner = (match[1:-1] >= match[:-2]) & (match[1:-1] >= match[2:])
    peaks = np.flatnonzero(inner) + 1
    if not len(peaks):
        return 0.0, 0.0, 0.0
    good = peaks[match[peaks] >= 0.95 * match[peaks].max()]
    best = int(good[np.argmin(np.abs(good - reach))])
    left, middle, right = match[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * float((left - right) / bend) if bend < 0.0 else 0.0
    lag = (best - reach + offset) * step
    return lag, float(middle), float(middle - match[reach])


def check_alignment(trial: Trial) -> list[Finding]:
    """Find clocks that drift apart, and delays that no rig has."""
    a = alignment(trial)
    grown = a.drift * (trial.time[-1] - trial.time[0])
    motor, joint = (trial.labels.get(name, name) for name in (MOTOR_ANGLE, JOINT_ANGLE))
    if abs(a.drift) > 6.0 * a.doubt and abs(grown) > max(_DRIFT, 5.0 * trial.step):
        told = (
            f"{trial.path}: the delay of {joint} after {motor} changes by "
            f"{1e3 * grown:.3g} ms within the trial ({1e6 * a.drift:.0f} ppm), so "
            "they run on two clocks; record on one, or declare the clock of each."
        )
        return [fix(told, trial.name, JOINT_ANGLE)]
    if abs(a.delay) > FAR and a.gain > 0.1:
        told = (
            f"{trial.path}: {joint} comes {a.delay:.3g} s after {motor}; declare its "
            "delay or record on one clock."
        )
        return [fix(told, trial.name, JOINT_ANGLE)]
    if abs(a.delay) > max(0.01, 2.0 * trial.step):
        told = (
            f"{trial.path}: {joint} comes {1e3 * a.delay:.3g} ms after {motor}, by "
            "lost motion, elasticity or a delay."
        )
        return [note(told, trial.name, JOINT_ANGLE)]
    return []
