"""Measures on pairs of signals: width of a hysteresis loop, lag between two signals."""

from __future__ import annotations

import itertools
import math

import numpy as np

from cc_mujoco.metrics._metric import Array


def moving_mean(values: Array, period: float, window: float = 0.05) -> Array:
    """Return the mean over a full moving window [s] of samples every `period` [s]."""
    width = min(max(1, round(window / period)), len(values))
    return np.convolve(values, np.full(width, 1.0 / width), mode="valid")


def loop_width(angle: Array, torque: Array) -> float:
    """Return the width [rad] of a torque-angle loop at zero torque.

    The torque visits zero from when it enters the band of 5 % of its peak until it
    leaves it, so that chatter inside the band is one visit. Each visit gives the angles
    at which the torque changes sign (interpolated) or is below 0.1 % of its peak (a
    dead zone). The width is the range of these angles over all visits: hysteresis and
    dead zone together. Angles [rad] and torques, in any unit, are (T,); NaN if the
    torque does not return through zero, so that there is no loop.
    """
    peak = float(np.max(np.abs(torque)))
    if not peak > 0:
        return math.nan
    outside = np.flatnonzero(np.abs(torque) > 0.05 * peak)
    touched: list[float] = []
    visits = returns = 0
    for first, last in itertools.pairwise(outside):
        crosses = torque[first] * torque[last] < 0
        if last - first == 1 and not crosses:
            continue
        part, at = torque[first : last + 1], angle[first : last + 1]
        here = list(at[np.abs(part) <= 1e-3 * peak])
        change = np.flatnonzero(part[:-1] * part[1:] < 0)
        share = part[change] / (part[change] - part[change + 1])
        here += list(at[change] + share * (at[change + 1] - at[change]))
        if here:
            touched += here
            visits += 1
            returns += not crosses
    if visits < 2 and not returns:
        return math.nan
    return float(max(touched) - min(touched))


def loop_opening(angle: Array, torque: Array) -> float:
    """Return the angle [rad] between a loop's zero crossings of torque, out and back.

    It is the difference between the mean angle of the torque's sign changes while the
    angle falls and that while it rises, at least 0. Friction F on a spring k opens the
    loop by 2 F/k, or by all of the motion if F exceeds the spring's torque.
    `loop_width` is the range of all crossings instead, which chatter about zero widens.
    Angles and torques are (T,); NaN if the torque does not cross zero in both
    directions.
    """
    change = np.flatnonzero(torque[:-1] * torque[1:] < 0)
    share = torque[change] / (torque[change] - torque[change + 1])
    step = angle[change + 1] - angle[change]
    at = angle[change] + share * step
    rising = step > 0
    if rising.all() or not rising.any():
        return math.nan
    return abs(float(np.mean(at[~rising]) - np.mean(at[rising])))


def signal_lag(
    time: Array, desired: Array, actual: Array, *, signed: bool = False
) -> float:
    """Return the lag of a signal `actual` (T,) behind the `desired` one [s].

    It is the shift, at most a quarter of the episode and at most 1 s, at which the
    correlation coefficient peaks, refined by a parabola. Of several peaks within 5 %,
    as of a periodic signal, it is the nearest to 0. The times (T,) [s] are equally
    spaced. If `actual` is ahead, the lag is negative when `signed`, else 0. NaN if the
    largest coefficient is below 0.5 or at the largest shift.
    """
    count = len(time)
    if count < 8:
        return math.nan
    step = float(time[-1] - time[0]) / (count - 1)
    reach = max(1, min(count // 4, round(1.0 / step)))
    shifts = np.arange(-reach if signed else 0, reach + 1)
    score = np.array([correlation(desired, actual, k) for k in shifts.tolist()])
    before = np.concatenate([[-1.0], score[:-1]])
    rising = score >= before
    falling = np.concatenate([score[:-1] >= score[1:], [True]])
    peaks = np.flatnonzero(rising & falling & (score >= 0.95 * score.max()))
    if peaks.size == 0:
        return math.nan
    best = int(peaks[np.argmin(np.abs(shifts[peaks]))])
    if abs(shifts[best]) == reach or score[best] < 0.5:
        return math.nan
    if best == 0:
        return 0.0
    left, middle, right = score[best - 1 : best + 2]
    bend = left - 2 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float((shifts[best] + offset) * step)


def correlation(desired: Array, actual: Array, shift: int = 0) -> float:
    """Return the correlation of `desired` with `actual` `shift` samples later."""
    ahead, behind = max(shift, 0), max(-shift, 0)
    one = desired[behind : desired.size - ahead]
    other = actual[ahead : actual.size - behind]
    one, other = one - one.mean(), other - other.mean()
    scale = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale > 1e-12 else -1.0
