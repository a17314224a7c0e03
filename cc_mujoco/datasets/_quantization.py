"""Quantised readings: their step, and the angle between two steps.

When a reading jumps, the angle stands halfway between two steps, better known than at
any other time. In slow creep only the jumps inform: simulated as steps of the angle,
they would shake a cable that sticks.
"""

import math

import numpy as np

from cc_mujoco.datasets._trials import Noise, Trial
from cc_mujoco.native import FloatArray


def resolution(values: FloatArray) -> float:
    """Return the quantisation step of raw readings, 0 if they show none.

    It is the step of which the differences between distinct readings are multiples.
    Interpolated readings would have other differences.
    """
    values = values[:200_000]  # enough to see a digit
    values = values[np.isfinite(values)]
    levels = np.unique(values)
    if len(levels) < 3:
        return 0.0
    change = np.diff(levels)
    change = change[change > 1e-9 * (levels[-1] - levels[0])]
    least = float(np.percentile(change, 10))
    few = change[change < 10.5 * least]
    # An encoder that is fine for its range hardly ever reads the same twice.
    if len(levels) > 0.5 * len(values) and len(few) < 50:
        return 0.0
    for jump in range(1, 7):  # digits of the least difference
        step = least / jump
        for _ in range(5):
            multiples = np.maximum(1.0, np.round(few / step))
            step = float(few.sum() / multiples.sum())
        off = np.abs(few / step - np.round(few / step))
        if float(np.mean(off)) < 0.1:
            return step
    return 0.0


def digit_of(trial: Trial, channel: str) -> float:
    """Return the quantisation step of a channel of a trial, 0 if it shows none."""
    if channel in trial.digits:
        return trial.digits[channel]
    return resolution(trial.channel(channel))


def interpolate_readings(
    wanted: FloatArray, clock: FloatArray, reading: FloatArray, digit: float = 0.0
) -> FloatArray:
    """Return readings at other times: linear, or the nearest one during slow creep.

    Where neighbours differ by one quantisation step `digit`, a value between them would
    hide the step. Times `wanted` (n,) and `clock` (samples,), two at least, are in
    seconds; the result is NaN before the first and after the last reading.
    """
    found: FloatArray = np.interp(wanted, clock, reading, left=np.nan, right=np.nan)
    if digit == 0.0:
        return found
    after = np.clip(np.searchsorted(clock, wanted), 1, len(clock) - 1)
    one, other = reading[after - 1], reading[after]
    early = wanted - clock[after - 1] < clock[after] - wanted
    creeps = np.isfinite(found) & (np.abs(other - one) < 1.5 * digit)
    return np.where(creeps, np.where(early, one, other), found)


def reconstruct_angle(reading: FloatArray, noise: Noise | None) -> FloatArray:
    """Return the angle (samples,) [rad] behind quantised readings, others unchanged.

    At each jump the angle is midway between the two steps. Between two jumps in the
    same direction it moves to the step at the rate of the neighbouring intervals, and
    rests there if it arrives early. Between two opposite jumps it turns back, as far as
    a parabola at that rate reaches, at most at the step. It is at most half a step from
    the reading, also where the speed changes by several steps between two readings.
    """
    if noise is None or not 0.0 < noise.resolution:
        return reading
    # With more noise than rounding makes the mean tells more than the digits.
    if noise.deviation > math.sqrt(1.5 / 12.0) * noise.resolution:
        return reading
    step = np.diff(reading)
    before = np.flatnonzero(np.abs(step) > 0.5 * noise.resolution)
    if before.size < 3:
        return reading
    when, way = before + 0.5, np.sign(step[before])
    edge = reading[before] + 0.5 * step[before]
    dwell = np.diff(when)
    earlier = np.concatenate([dwell[:1], dwell[:-1]])
    later = np.concatenate([dwell[1:], dwell[-1:]])
    level = reading[before[:-1] + 1]
    turns = way[:-1] != way[1:]
    reach = np.where(turns, np.minimum(dwell / (earlier + later), 1.0), 1.0)
    value = edge[:-1] + reach * (level - edge[:-1])
    arrive = when[:-1] + 0.5 * np.minimum(dwell, earlier)
    leave = when[1:] - 0.5 * np.minimum(dwell, later)
    x = np.concatenate([when, arrive, leave])
    y = np.concatenate([edge, value, value])
    order = np.argsort(x, kind="stable")
    found: FloatArray = np.interp(np.arange(reading.size), x[order], y[order])
    # Before the first jump and after the last there is a digit only.
    found[: before[0] + 1] = reading[: before[0] + 1]
    found[before[-1] + 1 :] = reading[before[-1] + 1 :]
    half = 0.5 * noise.resolution
    return np.clip(found, reading - half, reading + half)
