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

from cc_mujoco.datasets._channels import JOINT_ANGLE, MOTOR_ANGLE
from cc_mujoco.datasets._data_findings import DataFinding, error, warning
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import FloatArray, Trial

MAX_SEARCHED_DELAY = 0.6
"""Delays are searched up to this [s]."""
MAX_PLAUSIBLE_DELAY = 0.15
"""A delay beyond this is a mistake of the recording, not an effect [s]."""
_MIN_WINDOW, _MAX_WINDOWS, _MIN_WINDOWS, _MIN_DRIFT_WINDOWS = 2.0, 40, 2, 6
_MIN_CORRELATION = 0.8  # correlation from which on a lag counts
_MAX_DRIFT, _DRIFT_RESOLUTION = (
    0.02,
    0.01,
)  # drifts searched [s/s], and their steps over a trial [s]
_DISTANCE_PENALTY = 0.01
_PEAK_TOLERANCE = 0.1
_DRIFT_SIGMAS, _MIN_DRIFT_GAIN = 6.0, 2e-3
_RELEVANT_DRIFT = 0.03  # change of the delay over a trial that matters [s]


class Alignment(NamedTuple):
    """Timing of the joint's readings against the motor's.

    Attributes:
        delay: by which the joint comes late [s], NaN if that cannot be seen.
        drift: change of the delay per time [s/s], 0 if there is none to be seen.
        doubt: standard deviation of the drift; infinite if there are too few windows.
        gain: by how much the correlation of the speeds rises when the delay is undone.
        drift_gain: by how much more when the drift is undone as well.
    """

    delay: float
    drift: float
    doubt: float
    gain: float
    drift_gain: float


def measure_alignment(trial: Trial) -> Alignment:
    """Return the delay between the two sides, and its drift."""
    windows = _windows(trial)
    if not windows:
        return Alignment(math.nan, 0.0, math.inf, 0.0, 0.0)
    times = np.array([window.time for window in windows])
    times -= times.mean()
    delay, drift = _delay_and_drift(windows, times, trial.step)
    found = []
    for window, time in zip(windows, times, strict=True):
        lag = _nearest_peak(window.match, delay + drift * time, trial.step)
        if lag is not None:
            found.append((time, lag, 1.0 / window.speed, window.match))
    if len(found) < max(_MIN_WINDOWS, 0.5 * len(windows)):
        return Alignment(math.nan, 0.0, math.inf, 0.0, 0.0)
    now, lags, slow = np.array([entry[:3] for entry in found]).T
    middle = float(np.median(lags))
    matches = np.array([match for *_, match in found])
    none, there = matches.shape[1] // 2, round(middle / trial.step)
    gain = float(np.median(matches[:, none + there] - matches[:, none]))
    if len(found) < _MIN_DRIFT_WINDOWS or np.ptp(now) == 0.0:
        return Alignment(middle, 0.0, math.inf, gain, 0.0)
    basis = np.column_stack([now - now.mean(), np.ones_like(now), slow])
    scale = np.abs(basis).max(axis=0)
    inverse = np.linalg.pinv((basis / scale).T @ (basis / scale))
    slopes = inverse @ (basis / scale).T @ lags
    rest = lags - basis / scale @ slopes
    spread = float(rest @ rest) / max(1, len(lags) - 3)
    doubt = math.sqrt(spread * inverse[0, 0]) / scale[0]
    drift = float(slopes[0] / scale[0])
    row = np.arange(len(found))
    moved = np.round((middle + drift * (now - np.median(now))) / trial.step)
    moved = np.clip(none + moved.astype(int), 0, matches.shape[1] - 1)
    rise = matches[row, moved] - matches[row, none + there]
    return Alignment(middle, drift, doubt, gain, float(np.mean(rise)))


class _Window(NamedTuple):
    """Correlation of the speeds in a stretch of time.

    Attributes:
        time: its middle [s].
        speed: of the motor, standard deviation [rad/s].
        match: correlation at lags from -REACH to REACH.
    """

    time: float
    speed: float
    match: FloatArray


def _windows(trial: Trial) -> list[_Window]:
    """Return the stretches in which the motor moves."""
    motor = velocity(trial.motor_angle, trial.step, trial.segments)
    joint = velocity(trial.joint_angle, trial.step, trial.segments)
    usual = float(np.nanstd(motor))
    length = max(trial.duration / _MAX_WINDOWS, _MIN_WINDOW)
    reach = round(MAX_SEARCHED_DELAY / trial.step)
    windows = []
    for part in trial.segments:
        count = max(1, round((part.stop - part.start) * trial.step / length))
        for rows in np.array_split(np.arange(part.start, part.stop), count):
            one, other = motor[rows], joint[rows]
            one, other = one - one.mean(), other - other.mean()
            speed = float(np.std(one))
            scale = math.sqrt(float((one @ one) * (other @ other)))
            if len(rows) <= 2 * reach or speed < 0.2 * usual or not scale > 0.0:
                continue
            match = correlation(other, one, reach) / scale
            sign = 1.0 if match.max() >= -match.min() else -1.0
            windows.append(_Window(trial.time[rows].mean(), speed, sign * match))
    return windows


def correlation(late: FloatArray, early: FloatArray, reach: int) -> FloatArray:
    """Return the cross-correlation for lags of the first signal, -reach to reach."""
    size = 1 << (2 * early.size).bit_length()
    product = np.fft.rfft(late, size) * np.conj(np.fft.rfft(early, size))
    found: FloatArray = np.fft.irfft(product, size)
    return np.concatenate([found[-reach:], found[: reach + 1]])


def _delay_and_drift(
    windows: list[_Window], times: FloatArray, step: float
) -> tuple[float, float]:
    """Return the delay and drift at which all windows together correlate best.

    A single window of a periodic motion has many peaks; together they have one.
    """
    matches = np.array([window.match for window in windows])
    width = matches.shape[1]
    reach = width // 2
    far = np.abs(np.arange(width) - reach) / max(reach, 1)
    row = np.arange(len(windows))[:, None]
    best, found = -math.inf, (0.0, 0.0)
    span = float(np.ptp(times))
    most = min(_MAX_DRIFT, 2.0 * MAX_SEARCHED_DELAY / span) if span > 0.0 else 0.0
    ways = max(1, int(most * span / _DRIFT_RESOLUTION))
    for drift in np.linspace(-most, most, 2 * ways + 1):
        shift = np.round(drift * times / step).astype(int)[:, None]
        lags = np.arange(width)[None, :] + shift
        inside = (lags >= 0) & (lags < width)
        values = np.where(inside, matches[row, np.clip(lags, 0, width - 1)], 0.0)
        # What is nearer to no delay and no drift wins, unless another is better.
        total = values.mean(axis=0) - _DISTANCE_PENALTY * far
        k = int(np.argmax(total))
        value = float(total[k]) - _DISTANCE_PENALTY * abs(drift) / max(most, 1e-300)
        if value > best:
            best, found = value, ((k - reach) * step, float(drift))
    return found


def _nearest_peak(match: FloatArray, expected: float, step: float) -> float | None:
    """Return the lag of the peak nearest to the expected lag [s], or None."""
    peaks = np.flatnonzero((match[1:-1] >= match[:-2]) & (match[1:-1] >= match[2:])) + 1
    peaks = peaks[match[peaks] > _MIN_CORRELATION]
    if not len(peaks):
        return None
    lags = (peaks - len(match) // 2) * step
    if not np.min(np.abs(lags - expected)) < _PEAK_TOLERANCE:
        return None
    k = int(peaks[np.argmin(np.abs(lags - expected))])
    left, middle, right = match[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * float((left - right) / bend) if bend < 0.0 else 0.0
    return (k - len(match) // 2 + offset) * step


def check_alignment(trial: Trial, alone: bool = False) -> list[DataFinding]:
    """Find clocks that drift relative to each other, and implausible delays.

    Args:
        trial: the trial.
        alone: whether one cable joins the sides; slack lets either move by itself.
    """
    a = measure_alignment(trial)
    grown = a.drift * (trial.time[-1] - trial.time[0])
    motor, joint = (trial.labels.get(name, name) for name in (MOTOR_ANGLE, JOINT_ANGLE))
    certain = abs(a.drift) > _DRIFT_SIGMAS * a.doubt and a.drift_gain > _MIN_DRIFT_GAIN
    if certain and abs(grown) > max(_RELEVANT_DRIFT, 5.0 * trial.step):
        message = (
            f"{trial.path}: the delay of {joint} after {motor} changes by "
            f"{1e3 * grown:.3g} ms within the trial ({1e6 * a.drift:.0f} ppm), so "
            "they run on two clocks; record on one, or declare the clock of each."
        )
        return [error(message, trial.name, JOINT_ANGLE)]
    if abs(a.delay) > MAX_PLAUSIBLE_DELAY and a.gain > 0.1 and not alone:
        message = (
            f"{trial.path}: {joint} comes {_delay_text(a.delay)} {motor}; declare its "
            f"delay ([columns.{JOINT_ANGLE}] delay = {a.delay:.2f}), or record on one "
            "clock."
        )
        return [error(message, trial.name, JOINT_ANGLE)]
    if abs(a.delay) > max(0.01, 2.0 * trial.step):
        message = (
            f"{trial.path}: {joint} comes {_delay_text(a.delay)} {motor}, by lost "
            f"motion, {'slack, ' if alone else ''}elasticity or a delay."
        )
        return [warning(message, trial.name, JOINT_ANGLE)]
    return []


def _delay_text(delay: float) -> str:
    return f"{1e3 * abs(delay):.3g} ms {'after' if delay > 0.0 else 'before'}"
