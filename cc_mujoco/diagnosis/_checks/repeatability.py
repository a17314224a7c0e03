"""Deviation between two repetitions, which no model can explain.

Of two repetitions the root mean square difference over the square root of two is what
one of them scatters. The part of the difference that follows the motor's is no scatter
but another motion, which is an input of the model; that part is removed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._channels import MOTOR_ANGLE
from cc_mujoco.datasets._data_findings import DataFinding, error
from cc_mujoco.datasets._trials import FloatArray, Trial
from cc_mujoco.estimation._least_squares import autocorrelation

_MIN_PERIOD_CORRELATION = 0.98  # correlation of a periodic motion with the next period
# Share of its spread by which a motion may differ from period to period.
_PERIOD_TOLERANCE = 0.03
_REPEAT_TOLERANCE = 0.15  # share of its spread by which a repeated motion may differ
_MAX_SHIFT = 20  # samples between the starts of repeats

Pair = dict[str, FloatArray]
"""Differences between two repetitions, by channel."""


class Scatter(NamedTuple):
    """Deviation between repetitions.

    Attributes:
        deviation: of one repetition by channel [its unit]; 0 without any.
        trials: names of those that were compared.
    """

    deviation: FloatArray
    trials: frozenset[str]


def wrong_repeats(trials: Sequence[Trial]) -> list[DataFinding]:
    """Return declared repeats that differ in motor motion or set-up."""
    found = [
        error(
            f"{trial.path} is declared a repeat of {original.name}, but its motor "
            "moves otherwise; correct repeat_of.",
            trial.name,
        )
        for original, trial in _repeat_pairs(trials)
        if _compare_trials(original, trial) is None
    ]
    return found + [
        error(
            f"{trial.path} is declared a repeat of {original.name}, but with another "
            f"{what}; correct repeat_of or the {what}.",
            trial.name,
        )
        for original, trial in _repeat_pairs(trials)
        for what, one, other in (
            ("pretension", original.facts.pretension, trial.facts.pretension),
            ("tilt", original.facts.tilt or 0.0, trial.facts.tilt or 0.0),
            ("state of the cables", original.facts.unhooked, trial.facts.unhooked),
            ("place of the sensors", original.facts.swapped, trial.facts.swapped),
            ("load cell", original.facts.load_cell, trial.facts.load_cell),
        )
        if one is not None and other is not None and one != other
    ]


def repeat_scatter(trials: Sequence[Trial], channels: Sequence[str]) -> Scatter:
    """Return the deviation of one repetition, and the trials it is from.

    It comes from trials declared as repeats, else from the periods of periodic trials.
    Samples that are NaN do not count.
    """
    pairs = [
        ({original.name, trial.name}, pair)
        for original, trial in _repeat_pairs(trials)
        if (pair := _compare_trials(original, trial)) is not None
    ]
    if not pairs:
        pairs = [
            ({trial.name}, pair)
            for trial in trials
            for pair in period_differences(trial)
        ]
    if not pairs:
        return Scatter(np.zeros(len(channels)), frozenset())
    squares = [
        [_rms_difference(pair, name) ** 2 for name in channels] for _, pair in pairs
    ]
    compared = frozenset().union(*(names for names, _ in pairs))
    return Scatter(np.sqrt(0.5 * np.mean(squares, axis=0)), compared)


def _repeat_pairs(trials: Sequence[Trial]) -> Iterator[tuple[Trial, Trial]]:
    """Yield pairs of a trial and its declared repeat."""
    named = {trial.name: trial for trial in trials}
    for trial in trials:
        if trial.facts.repeat_of in named:
            yield named[str(trial.facts.repeat_of)], trial


def _rms_difference(pair: Pair, channel: str) -> float:
    """Return the root mean square difference that does not follow the motor's."""
    counts = np.isfinite(pair[channel])
    if not np.any(counts):
        return 0.0
    difference, motor = pair[channel][counts], pair[MOTOR_ANGLE][counts]
    power = float(motor @ motor)
    if channel != MOTOR_ANGLE and power > 0.0:
        difference = difference - motor * (float(motor @ difference) / power)
    return math.sqrt(float(np.mean(difference**2)))


def _compare_trials(original: Trial, trial: Trial) -> Pair | None:
    """Return the differences of two trials, or None if the motor motion differs."""
    first = original.time[original.segments[0]][0]
    times = trial.time - trial.time[trial.segments[0]][0] + first
    shifts = np.arange(-_MAX_SHIFT, _MAX_SHIFT + 1) * trial.step
    errors = []
    for shift in shifts:
        difference = _channel_difference(original, trial, MOTOR_ANGLE, times + shift)
        errors.append(float(np.mean(difference**2)) if len(difference) else math.inf)
    best = times + shifts[int(np.argmin(errors))]
    spread = float(np.std(original.motor_angle[original.segments[0]]))
    if math.sqrt(min(errors)) > _REPEAT_TOLERANCE * spread:
        return None
    shared = [name for name in original.channels if name in trial.channels]
    return {name: _channel_difference(original, trial, name, best) for name in shared}


def _channel_difference(
    original: Trial, trial: Trial, channel: str, times: FloatArray
) -> FloatArray:
    """Return the differences between two trials where both have readings."""
    differences = [np.empty(0)]
    for part in original.segments:
        clock = original.time[part]
        for own in trial.segments:
            inside = (times[own] >= clock[0]) & (times[own] <= clock[-1])
            wanted = times[own][inside]
            there = np.interp(wanted, clock, original.channel(channel)[part])
            differences.append(trial.channel(channel)[own][inside] - there)
    return np.concatenate(differences)


def period_differences(trial: Trial) -> Iterator[Pair]:
    """Yield the differences of neighbouring periods of periodic segments."""
    for part in trial.segments:
        length = find_period(trial.motor_angle[part])
        if length is None:
            continue
        row = np.arange(part.stop - part.start)
        # The first period holds what is left of the start.
        now = row[math.ceil(2.0 * length) :]
        pair = {
            name: values[now] - np.interp(now - length, row, values)
            for name in trial.channels
            for values in [trial.channel(name)[part]]
        }
        # A swing that grows is in step with itself, yet it is another motion.
        if np.std(pair[MOTOR_ANGLE]) < _PERIOD_TOLERANCE * np.std(
            trial.motor_angle[part]
        ):
            yield pair


def find_period(angle: FloatArray) -> float | None:
    """Return the period of a motion in samples, None if it is not periodic."""
    angle = angle - angle.mean()
    count = len(angle)
    if count < 40 or not angle.any():
        return None
    shifted = autocorrelation(angle)
    power = np.concatenate([[0.0], np.cumsum(angle**2)])
    lags = np.arange(int(count / 2.5))
    scale = np.sqrt(power[count - lags] * (power[count] - power[lags]))
    match = shifted[: len(lags)] / np.maximum(scale, 1e-300)
    fallen = np.flatnonzero(match < 0.5)
    if not len(fallen):
        return None
    peaks = (match[1:-1] >= match[:-2]) & (match[1:-1] > match[2:])
    candidates = np.flatnonzero(peaks & (match[1:-1] > _MIN_PERIOD_CORRELATION)) + 1
    candidates = candidates[candidates > fallen[0]]
    if not len(candidates):
        return None
    best = int(candidates[0])
    left, middle, right = match[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return best + (0.5 * float((left - right) / bend) if bend < 0.0 else 0.0)
