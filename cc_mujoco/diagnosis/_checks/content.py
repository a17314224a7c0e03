"""Content of a dataset: noise of its channels, repetitions, rests.

Repeated trials scatter by the RMS difference of two over the square root of two, which
no model can explain. The part of a difference that is proportional to that of the motor
angles is another input of the model, and is removed before.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from cc_mujoco.datasets._channels import MOTOR_ANGLE
from cc_mujoco.datasets._data_findings import DataFinding, error
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._quantization import digit_of
from cc_mujoco.datasets._smoothing import SIGMAS_PER_MEDIAN, velocity
from cc_mujoco.datasets._trials import Dataset, FloatArray, Noise, Trial
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.estimation._least_squares import autocorrelation


def find_holds(trial: Trial) -> list[slice]:
    """Return the stretches at rest of at least `Limit.min_hold_time` seconds."""
    still = np.ones(len(trial.time), dtype=bool)
    for angle in (trial.motor_angle, trial.joint_angle):
        if not angle.size:
            continue
        speed = np.abs(velocity(angle, trial.step, trial.segments))
        with np.errstate(invalid="ignore"):
            still &= speed <= Limit.noise_rest_speed_share * np.nanpercentile(speed, 95)
    found = []
    for part in trial.segments:
        edges = np.flatnonzero(np.diff(still[part], prepend=False, append=False))
        rests, least = edges.reshape(-1, 2).tolist(), Limit.min_hold_time
        long = [(a, b) for a, b in rests if (b - a) * trial.step >= least]
        found += [slice(part.start + a, part.start + b) for a, b in long]
    return found


def noise_of(dataset: Dataset, file: DatasetFile) -> dict[str, Noise]:
    """Return the noise of every channel, by name: as declared, or estimated.

    It is estimated as the median deviation about short straight lines at rest, as a
    torque may relax and a hand tremble; without rests, from third differences. It is at
    least the rounding of digits, and a millionth of the channel's range.
    """
    still = {trial.name: find_holds(trial) for trial in dataset.trials}
    found: dict[str, Noise] = {}
    cells = sorted({trial.facts.load_cell for trial in dataset.trials} - {""})
    for channel in dict.fromkeys([*dataset.channels, *cells]):
        trials = [trial for trial in dataset.trials if channel in trial.channels]
        if not trials:
            continue
        source = file.source(channel)
        factor = file.factor(channel, trials[0].labels.get(channel, channel))
        if source.resolution is not None:
            step = source.resolution * factor
        else:
            # A joint that is locked in a trial shows no digit there.
            steps = [digit_of(trial, channel) for trial in trials]
            step = float(np.median([each for each in steps if each > 0.0] or [0.0]))
        if source.noise is not None:
            found[channel] = Noise(source.noise * factor, step, "declared")
            continue
        parts = ((trial, part) for trial in trials for part in trial.segments)
        spans = [float(np.ptp(trial.channel(channel)[part])) for trial, part in parts]
        least = max(step / math.sqrt(12.0), (1e-6) * max(spans, default=0.0))
        holds = ((trial, part) for trial in trials for part in still[trial.name])
        values = [(trial.channel(channel)[part], trial.step) for trial, part in holds]
        held = [scatter for each in values for scatter in _line_scatter(*each)]
        seen = float(np.median(held or [_roughness(t, channel) for t in trials]))
        how: Literal["holds", "differences"] = "holds" if held else "differences"
        found[channel] = Noise(max(least, seen), step, how)
    return found


def _line_scatter(values: FloatArray, step: float) -> Iterator[float]:
    """Yield the standard deviation about a line, for each short window of `values`."""
    length = max(8, round(0.5 * Limit.min_hold_time / step))
    place = np.arange(length) - 0.5 * (length - 1)
    for start in range(0, len(values) - length + 1, length):
        part = values[start : start + length]
        rest = part - part.mean() - place * float(place @ part / (place @ place))
        yield math.sqrt(float(rest @ rest) / (length - 2))


def _roughness(trial: Trial, channel: str) -> float:
    """Return the deviation of white noise with the third differences of the channel."""
    values = trial.channel(channel)
    third = [np.abs(np.diff(values[part], 3)) for part in trial.segments]
    return SIGMAS_PER_MEDIAN * float(np.median(np.concatenate(third))) / math.sqrt(20.0)


Pair = dict[str, FloatArray]
"""Differences between two repetitions, by channel."""


class Scatter(NamedTuple):
    deviation: FloatArray  # of one repetition by channel [its unit]; 0 without any
    trials: frozenset[str]  # names of the compared trials


def wrong_repeats(trials: Sequence[Trial]) -> list[DataFinding]:
    """Return errors for trials that do not repeat what they declare to."""
    moved, changed = [], []
    for original, trial in _repeat_pairs(trials):
        start = f"{trial.path} is declared a repeat of {original.name}, but"
        if _compare_trials(original, trial) is None:
            text = f"{start} its motor moves otherwise; correct repeat_of."
            moved.append(error(text, trial.name))
        before, now = original.facts, trial.facts
        for what, one, other in (
            ("pretension", before.pretension, now.pretension),
            ("tilt", before.tilt or 0.0, now.tilt or 0.0),
            ("state of the cables", before.unhooked, now.unhooked),
            ("place of the sensors", before.swapped, now.swapped),
            ("load cell", before.load_cell, now.load_cell),
        ):
            if one is not None and other is not None and one != other:
                text = f"{start} with another {what}; correct repeat_of or the {what}."
                changed.append(error(text, trial.name))
    return moved + changed


def repeat_scatter(trials: Sequence[Trial], channels: Sequence[str]) -> Scatter:
    """Return the scatter of repetitions or, if no trial repeats, of periods."""
    pairs = [
        ({original.name, trial.name}, pair)
        for original, trial in _repeat_pairs(trials)
        if (pair := _compare_trials(original, trial)) is not None
    ]
    periods = ((trial, pair) for trial in trials for pair in period_differences(trial))
    pairs = pairs or [({trial.name}, pair) for trial, pair in periods]
    if not pairs:
        return Scatter(np.zeros(len(channels)), frozenset())
    squares = [[_rms_difference(pair, n) ** 2 for n in channels] for _, pair in pairs]
    compared = frozenset().union(*(names for names, _ in pairs))
    return Scatter(np.sqrt(0.5 * np.mean(squares, axis=0)), compared)


def _repeat_pairs(trials: Sequence[Trial]) -> Iterator[tuple[Trial, Trial]]:
    named = {trial.name: trial for trial in trials}
    for trial in trials:
        if trial.facts.repeat_of in named:
            yield named[str(trial.facts.repeat_of)], trial


def _rms_difference(pair: Pair, channel: str) -> float:
    """Return the RMS difference without the part proportional to the motor angle's."""
    counts = np.isfinite(pair[channel])
    if not np.any(counts):
        return 0.0
    difference, motor = pair[channel][counts], pair[MOTOR_ANGLE][counts]
    power = float(motor @ motor)
    if channel != MOTOR_ANGLE and power > 0.0:
        difference = difference - motor * (float(motor @ difference) / power)
    return math.sqrt(float(np.mean(difference**2)))


def _compare_trials(original: Trial, trial: Trial) -> Pair | None:
    """Return the differences at the best time shift; None if the motions differ."""
    first = original.time[original.segments[0]][0]
    times = trial.time - trial.time[trial.segments[0]][0] + first
    shifts = np.arange(-Limit.max_shift, Limit.max_shift + 1) * trial.step
    errors = []
    for shift in shifts:
        difference = _channel_difference(original, trial, MOTOR_ANGLE, times + shift)
        errors.append(float(np.mean(difference**2)) if len(difference) else math.inf)
    best = times + shifts[int(np.argmin(errors))]
    spread = float(np.std(original.motor_angle[original.segments[0]]))
    if math.sqrt(min(errors)) > Limit.repeat_tolerance * spread:
        return None
    shared = [name for name in original.channels if name in trial.channels]
    return {name: _channel_difference(original, trial, name, best) for name in shared}


def _channel_difference(
    original: Trial, trial: Trial, channel: str, times: FloatArray
) -> FloatArray:
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
    """Yield by stretch the differences of channels from one period to the next."""
    for part in trial.segments:
        length = find_period(trial.motor_angle[part])
        if length is None:
            continue
        row = np.arange(part.stop - part.start)
        # The first period contains the transient of the start.
        now = row[math.ceil(2.0 * length) :]
        whole = {name: trial.channel(name)[part] for name in trial.channels}
        pair = {n: v[now] - np.interp(now - length, row, v) for n, v in whole.items()}
        # A growing swing correlates with itself, yet it is another motion.
        spread = np.std(trial.motor_angle[part])
        if np.std(pair[MOTOR_ANGLE]) < Limit.period_tolerance * spread:
            yield pair


def find_period(angle: FloatArray) -> float | None:
    """Return the period of a motion [samples], None if it is not periodic."""
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
    peaks = (match[1:-1] >= match[:-2]) & (match[1:-1] > match[2:])
    high = match[1:-1] > Limit.min_period_correlation
    able = np.flatnonzero(peaks & high) + 1
    able = able[able > fallen[0]] if len(fallen) else fallen
    if not len(able):
        return None
    best = int(able[0])
    left, middle, right = match[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return best + (0.5 * float((left - right) / bend) if bend < 0.0 else 0.0)
