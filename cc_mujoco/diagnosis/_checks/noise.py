"""Readings of a channel when nothing happens: quantisation and sensor noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from cc_mujoco.datasets._dataset_file import DatasetFile
from cc_mujoco.datasets._quantization import digit_of
from cc_mujoco.datasets._smoothing import velocity
from cc_mujoco.datasets._trials import Dataset, FloatArray, Noise, Trial

_REST_SPEED_SHARE = 0.02  # share of the usual top speed below which nothing moves
MIN_HOLD_TIME = 0.2
"""A hold is at least so long [s]."""
_MIN_WINDOW = 8
_MIN_NOISE_SHARE = 1e-6


def find_holds(trial: Trial) -> list[slice]:
    """Return stretches of `MIN_HOLD_TIME` seconds or more without motion."""
    still = np.ones(len(trial.time), dtype=bool)
    for angle in (trial.motor_angle, trial.joint_angle):
        if not angle.size:
            continue
        speed = np.abs(velocity(angle, trial.step, trial.segments))
        with np.errstate(invalid="ignore"):
            still &= speed <= _REST_SPEED_SHARE * np.nanpercentile(speed, 95)
    found = []
    for part in trial.segments:
        edges = np.flatnonzero(np.diff(still[part], prepend=False, append=False))
        found += [
            slice(part.start + int(a), part.start + int(b))
            for a, b in edges.reshape(-1, 2)
            if (b - a) * trial.step >= MIN_HOLD_TIME
        ]
    return found


def noise_of(dataset: Dataset, file: DatasetFile) -> dict[str, Noise]:
    """Return the noise of every channel: declared, from holds or from differences.

    From holds it is the median standard deviation about straight lines of half their
    least length, so that a torque that relaxes or a hand that trembles is not noise.
    From differences it is the median size of third differences: what is smooth over
    four samples is not noise. It is never less than what quantisation makes, nor than
    a millionth of the channel's range.
    """
    still = [(trial, find_holds(trial)) for trial in dataset.trials]
    found: dict[str, Noise] = {}
    cells = sorted({trial.facts.load_cell for trial in dataset.trials} - {""})
    for channel in dict.fromkeys([*dataset.channels, *cells]):
        trials = [trial for trial in dataset.trials if channel in trial.channels]
        if not trials:
            continue
        source = file.source(channel)
        column = trials[0].labels.get(channel, channel)
        factor = file.factor(channel, column)
        if source.resolution is not None:
            step = source.resolution * factor
        else:
            # A joint that is locked in a trial shows no digit there.
            steps = [digit_of(trial, channel) for trial in trials]
            step = float(np.median([each for each in steps if each > 0.0] or [0.0]))
        spans = [float(np.ptp(values)) for values in _valid_stretches(trials, channel)]
        least = max(step / math.sqrt(12.0), _MIN_NOISE_SHARE * max(spans, default=0.0))
        if source.noise is not None:
            found[channel] = Noise(source.noise * factor, step, "declared")
            continue
        held = [
            scatter
            for trial, parts in still
            if channel in trial.channels
            for part in parts
            for scatter in _line_scatter(trial.channel(channel)[part], trial.step)
        ]
        rough = [_roughness(trial, channel) for trial in trials]
        seen = float(np.median(held or rough))
        how: Literal["holds", "differences"] = "holds" if held else "differences"
        found[channel] = Noise(max(least, seen), step, how)
    return found


def _line_scatter(values: FloatArray, step: float) -> Iterator[float]:
    """Yield the standard deviations about straight lines over short windows."""
    length = max(_MIN_WINDOW, round(0.5 * MIN_HOLD_TIME / step))
    place = np.arange(length) - 0.5 * (length - 1)
    for start in range(0, len(values) - length + 1, length):
        part = values[start : start + length]
        rest = part - part.mean() - place * float(place @ part / (place @ place))
        yield math.sqrt(float(rest @ rest) / (length - 2))


def _valid_stretches(trials: Sequence[Trial], channel: str) -> Iterator[FloatArray]:
    """Yield the valid stretches of a channel."""
    for trial in trials:
        for part in trial.segments:
            yield trial.channel(channel)[part]


def _roughness(trial: Trial, channel: str) -> float:
    """Return the standard deviation of white noise with the same third differences."""
    values = trial.channel(channel)
    third = [np.abs(np.diff(values[part], 3)) for part in trial.segments]
    return 1.4826 * float(np.median(np.concatenate(third))) / math.sqrt(20.0)
