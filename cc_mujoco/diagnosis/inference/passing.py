"""The low-pass that measured and simulated signals go through."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cc_mujoco.compiled import FloatArray


def low_passed(signals: FloatArray, band: float, rate: float) -> FloatArray:
    """Zero-phase low-pass of signals (..., samples)."""
    from scipy.signal import lfilter

    if band >= 0.45 * rate:
        return signals
    # As scipy's filtfilt, which finds the rest of the filter anew each time.
    numerator, denominator, rest = _filter(band, rate)
    edge = 3 * max(numerator.size, denominator.size)
    first, last = signals[..., :1], signals[..., -1:]
    passed: FloatArray = np.concatenate(
        [
            2.0 * first - signals[..., edge:0:-1],
            signals,
            2.0 * last - signals[..., -2 : -edge - 2 : -1],
        ],
        axis=-1,
    )
    for _ in range(2):
        start = rest * passed[..., :1]
        passed, _ = lfilter(numerator, denominator, passed, axis=-1, zi=start)
        passed = passed[..., ::-1]
    return passed[..., edge:-edge]


@lru_cache(maxsize=16)
def _filter(band: float, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Numerator and denominator of the filter, and its state in a signal of 1."""
    from scipy.signal import butter, lfilter_zi

    numerator, denominator = butter(2, band, fs=rate)
    return numerator, denominator, lfilter_zi(numerator, denominator)
