"""Seconds of the trials that the report shows: the worst ones, and ordinary ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._report_data import Evidence, TrialTrace
from cc_mujoco.native import FloatArray

MAX_EXCERPT = 6.0
"""Length of an excerpt, if the trial is as long [s]."""


class Excerpt(NamedTuple):
    """A stretch of one trial.

    Attributes:
        trace: of the trial.
        part: its samples that are shown.
        error: RMS error of the baseline in it, over that of all trials [1].
    """

    trace: TrialTrace
    part: slice
    error: float


def worst_excerpt(evidence: Evidence) -> Excerpt | None:
    """Return the stretch with the largest baseline error, or None."""
    found = _windows(evidence)
    return max(found, key=lambda excerpt: excerpt.error, default=None)


def ordinary_excerpt(evidence: Evidence) -> Excerpt | None:
    """Return the stretch with the median baseline error, or None."""
    found = sorted(_windows(evidence), key=lambda excerpt: excerpt.error)
    return found[len(found) // 2] if found else None


def model_changed(evidence: Evidence) -> bool:
    """Return whether the model of `after` is another one than that of `before`."""
    return any(
        not np.array_equal(trace.before[channel], trace.after[channel], equal_nan=True)
        for trace in evidence.traces
        for channel in trace.measured
    )


def _windows(evidence: Evidence) -> list[Excerpt]:
    """Return the stretches of every trial that overlap by three quarters."""
    power = _mean_square_error(evidence)
    found: list[Excerpt] = []
    for trace in evidence.traces:
        time, counts = trace.time, trace.counts > 0
        if not counts.any():
            continue
        error = np.zeros(len(time))
        for channel, scale in power.items():
            if channel in trace.measured:
                error += _squared_error(trace, channel) / scale
        start, end = time[counts][0], time[counts][-1]
        length = min(MAX_EXCERPT, end - start)
        total = np.concatenate([[0.0], np.cumsum(error)])
        many = np.concatenate([[0], np.cumsum(counts)])
        steps = 1 + int(np.ceil(4.0 * (end - start - length) / max(length, 1e-9)))
        for begin in np.linspace(start, end - length, steps):
            # Times that were read from text differ in the last digits.
            edges = (begin - 1e-9, begin + length + 1e-9)
            first, last = np.searchsorted(time, edges)
            number = many[last] - many[first]
            if number > 1:
                mean = (total[last] - total[first]) / (number * max(1, len(power)))
                found.append(Excerpt(trace, slice(first, last), float(np.sqrt(mean))))
    return found


def _mean_square_error(evidence: Evidence) -> dict[str, float]:
    """Return the mean squared error of each channel over all trials."""
    squares: dict[str, list[FloatArray]] = {}
    for trace in evidence.traces:
        for channel in trace.measured:
            part = _squared_error(trace, channel)[trace.counts > 0]
            squares.setdefault(channel, []).append(part)
    means = {name: _mean(np.concatenate(parts)) for name, parts in squares.items()}
    return {name: mean for name, mean in means.items() if mean > 0}


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else 0.0


def _squared_error(trace: TrialTrace, channel: str) -> FloatArray:
    """Return the squared error of the baseline, 0 without valid data."""
    error = trace.error(channel) * (trace.counts > 0)
    return np.nan_to_num(error) ** 2
