"""Content of a dataset: noise of its channels, repetitions, rests, excitation.

Repeated trials scatter by the RMS difference of two over the square root of two, which
no model can explain. The part of a difference that is proportional to that of the motor
angles is another input of the model, and is removed before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._channels import MOTOR_ANGLE
from cc_mujoco.datasets._data_findings import DataFinding, error
from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._quantization import digit_of
from cc_mujoco.datasets._smoothing import SIGMAS_PER_MEDIAN, velocity, velocity_noise
from cc_mujoco.datasets._trials import Dataset, FloatArray, Noise, Trial
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.errors import CableError
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
    """Return an error for each trial that does not repeat what it declares to."""
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
    """Return the deviation of a repetition by channel, and the trials compared."""
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
    """Yield the differences by channel between each period and the one before it."""
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


class Excitation(NamedTuple):
    """Range of speeds, loads and conditions that a dataset covers."""

    duration: float  # time in valid stretches [s]
    # Slowest and fastest speed of the motor's motions, 2nd and 99th percentile [rad/s]
    speed: tuple[float, float]
    reversals: int  # of the motor
    dwells: tuple[float, float]  # shortest and longest rest between motions [s]
    dwell_count: int  # number of rests
    torque: tuple[float, float] | None  # of the joint, 1st and 99th percentile [N m]
    motor_torque: tuple[float, float] | None  # of the motor; None if not measured
    turns: float  # range of the motor's angle [revolutions]
    joint_turns: float  # range of the joint's angle [revolutions]
    bandwidth: float  # below it lies 99 % of the power of the motor's speed [Hz]
    repeats: int  # trials that repeat another
    pretensions: tuple[float, ...]  # the different ones declared [N]
    temperature: tuple[float, float] | None  # lowest and highest [degC]
    tensions: int  # cable ends whose tension is measured

    @property
    def speed_decades(self) -> float:
        """Powers of ten between the slowest and the fastest speed."""
        low, high = self.speed
        return math.log10(high / low) if low > 0.0 else 0.0

    @property
    def statements(self) -> tuple[str, ...]:
        """Sentences of the report about this coverage."""
        low, high = self.speed
        torque, motor_torque = (
            f"{ends[0]:.3g} to {ends[1]:.3g} N m" if ends else "not measured"
            for ends in (self.torque, self.motor_torque)
        )
        rests = ", so dwell and break-away cannot be judged."
        if self.dwell_count:
            rests = f" of {self.dwells[0]:.2g} to {self.dwells[1]:.2g} s."
        repeats = "No trial repeats another."
        if self.repeats:
            repeats = f"{_count_text(self.repeats, 'repeat')}."
        known = self.pretensions
        tension = (
            "One pretension and no measured tension, so friction and pretension cannot "
            "be distinguished."
        )
        if self.tensions:
            ends = _count_text(self.tensions, "cable end")
            tension = f"Tension is measured at {ends}."
        elif len(known) > 1:
            tension = f"{len(known)} pretensions, {known[0]:.3g} to {known[-1]:.3g} N."
        sentences = [
            f"{self.duration:.3g} s of valid data.",
            f"The motor moves at {low:.2g} to {high:.2g} rad/s "
            f"({self.speed_decades:.1f} decades) and has "
            f"{_count_text(self.reversals, 'reversal')}.",
            f"{_count_text(self.dwell_count, 'rest')}{rests}",
            f"Joint torque {torque}, motor torque {motor_torque}.",
            f"The motor covers {self.turns:.2g} revolutions, the joint "
            f"{self.joint_turns:.2g}.",
            f"99 % of the motion lies below {self.bandwidth:.2g} Hz.",
            repeats,
            tension,
        ]
        if self.temperature is not None:
            cold, warm = self.temperature
            sentences.append(f"Temperature {cold:.3g} to {warm:.3g} degC.")
        return tuple(sentences)


def excitation(dataset: Dataset) -> Excitation:
    """Return the range of speeds, loads and conditions over all trials of a dataset.

    Raises:
        CableError: the motor's angle is not measured.
    """
    if not dataset.has_motor_angle:
        raise CableError(
            f"{dataset.path} declares that the motor's angle is not measured, of which "
            "the excitation is; give trials with that angle"
        )
    trials = dataset.trials
    known = dataset.noise.get(channels.MOTOR_ANGLE)
    speeds, rests = [np.empty(0)], []
    for trial in trials:
        speed = np.abs(velocity(trial.motor_angle, trial.step, trial.segments))
        floor = velocity_noise(known.deviation if known else 0.0, trial.step)
        with np.errstate(invalid="ignore"):
            speeds.append(speed[speed > max(3.0 * floor, 1e-9)])
        rests += [(part.stop - part.start) * trial.step for part in find_holds(trial)]
    warmth = [t.temperature for t in trials if t.temperature is not None]
    celsius = np.concatenate([np.empty(0), *warmth])
    temperature = None
    if celsius.size:
        temperature = float(np.nanmin(celsius)), float(np.nanmax(celsius))
    pretensions = {t.facts.pretension for t in trials if not t.facts.unhooked} - {None}
    names = {trial.name for trial in trials}
    angles = [_valid_samples(dataset, channel) for channel in channels.ANGLES]
    turns = [float(np.ptp(a)) / math.tau if len(a) else 0.0 for a in angles]
    return Excitation(
        duration=sum(trial.duration for trial in trials),
        speed=_percentiles(np.concatenate(speeds), 2, 99),
        reversals=sum(
            count_reversals(t.motor_angle[part]) for t in trials for part in t.segments
        ),
        dwells=(min(rests), max(rests)) if rests else (0.0, 0.0),
        dwell_count=len(rests),
        torque=_torques(dataset, channels.JOINT_TORQUE),
        motor_torque=_torques(dataset, channels.MOTOR_TORQUE),
        turns=turns[0],
        joint_turns=turns[1],
        bandwidth=max((_bandwidth(trial) for trial in trials), default=0.0),
        repeats=sum(trial.facts.repeat_of in names for trial in trials),
        pretensions=tuple(sorted(t for t in pretensions if t is not None)),
        temperature=temperature,
        tensions=sum(channels.is_tension(name) for name in dataset.channels),
    )


def count_reversals(angle: FloatArray) -> int:
    band = Limit.reversal_share * float(np.ptp(angle)) if len(angle) else 0.0
    if not band > 0.0:
        return 0
    # Only the extremes between which the angle changes by more than the band count.
    steps = np.diff(angle)
    rows = np.flatnonzero(steps)
    bends = rows[1:][np.sign(steps[rows[1:]]) != np.sign(steps[rows[:-1]])]
    extremes = angle[np.concatenate([[0], bends, [len(angle) - 1]])]
    count, way, best = 0, 0, float(extremes[0])
    for value in extremes[1:]:
        change = float(value) - best
        if way == 0:
            if abs(change) > band:
                way, best = (1 if change > 0 else -1), float(value)
        elif change * way > 0.0:
            best = float(value)
        elif abs(change) > band:
            count, way, best = count + 1, -way, float(value)
    return count


def _bandwidth(trial: Trial) -> float:
    """Return the frequency below which 99 % of the motor speed's power lies [Hz]."""
    from scipy.signal import welch

    part = max(trial.segments, key=lambda part: part.stop - part.start)
    speed = velocity(trial.motor_angle[part], trial.step)
    length = min(len(speed), max(256, round(10.0 / trial.step)))
    frequency, power = welch(speed, trial.rate, nperseg=length, detrend="constant")
    if not power.sum() > 0.0:
        return 0.0
    share = np.cumsum(power) / power.sum()
    return float(frequency[np.searchsorted(share, 0.99)])


def _valid_samples(dataset: Dataset, channel: str) -> FloatArray:
    parts = [t.channel(channel)[part] for t in dataset.trials for part in t.segments]
    return np.concatenate([np.zeros(0), *parts])


def _torques(dataset: Dataset, channel: str) -> tuple[float, float] | None:
    if dataset.trials and channel not in dataset.channels:
        return None
    return _percentiles(_valid_samples(dataset, channel), 1, 99)


def _percentiles(values: FloatArray, low: float, high: float) -> tuple[float, float]:
    if not len(values):
        return 0.0, 0.0
    ends = np.percentile(values, [low, high])
    return float(ends[0]), float(ends[1])


def _count_text(number: int, word: str) -> str:
    return f"{number or 'no'} {word}{'' if number == 1 else 's'}"
