"""The low-pass that measured and simulated signals go through."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, compiled

MAX_BAND = 25.0
"""Highest frequency compared [Hz]."""
_EDGE_SAMPLES = 9
"""Samples by which a signal is continued, turned over, at either end."""


def compared_band(rate: float) -> float:
    """Return the cut-off of torques that are recorded at a rate [Hz]."""
    return min(MAX_BAND, 0.3 * rate)


def low_pass(signals: FloatArray, band: float, rate: float) -> FloatArray:
    """Apply a zero-phase Butterworth low-pass to signals (..., samples).

    As `filtfilt` of `scipy.signal` with `butter(2, band)`, to rounding; that module
    takes a second to load, and a call of it longer than the filter.
    """
    if band >= 0.45 * rate:
        return signals
    first, last = signals[..., :1], signals[..., -1:]
    passed: FloatArray = np.concatenate(
        [
            2.0 * first - signals[..., _EDGE_SAMPLES:0:-1],
            signals,
            2.0 * last - signals[..., -2 : -_EDGE_SAMPLES - 2 : -1],
        ],
        axis=-1,
        dtype=np.float64,
    )
    rows = passed.reshape(-1, passed.shape[-1])
    _pass_both_ways(*_coefficients(band / rate), rows)
    return rows.reshape(passed.shape)[..., _EDGE_SAMPLES:-_EDGE_SAMPLES]


@lru_cache(maxsize=16)
def _coefficients(band: float) -> tuple[float, float, float]:
    """Compute the filter's coefficients by bilinear map.

    That of z**0, over which those of z**-1 and z**-2 of the denominator.
    The numerator is the first times 1, 2, 1.

    Args:
        band: at which half of the power passes, over the rate.
    """
    k = math.tan(math.pi * band)
    whole = 1.0 + math.sqrt(2.0) * k + k * k
    return (
        k * k / whole,
        2.0 * (k * k - 1.0) / whole,
        (1.0 - math.sqrt(2.0) * k + k * k) / whole,
    )


@compiled
def _pass_both_ways(gain: float, a1: float, a2: float, rows: FloatMatrix) -> None:
    """Filter rows (rows, samples) in place, forwards and then backwards in time.

    Each way it begins at rest in the first value.
    """
    count = rows.shape[1]
    for row in range(rows.shape[0]):
        for way in range(2):
            at, step = (0, 1) if way == 0 else (count - 1, -1)
            # Transposed second direct form, its state in a signal of 1 times the first.
            one = (1.0 - gain) * rows[row, at]
            two = (gain - a2) * rows[row, at]
            for _ in range(count):
                given = rows[row, at]
                out = gain * given + one
                one = 2.0 * gain * given - a1 * out + two
                two = gain * given - a2 * out
                rows[row, at] = out
                at += step
