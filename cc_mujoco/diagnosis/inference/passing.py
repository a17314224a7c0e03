"""The low-pass that measured and simulated signals go through."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cc_mujoco.compiled import FloatArray


def low_passed(signals: FloatArray, band: float, rate: float) -> FloatArray:
    """Zero-phase low-pass of signals (..., samples)."""
    from scipy.signal import sosfilt

    if band >= 0.45 * rate:
        return signals
    # As scipy's sosfiltfilt, which finds the rest of the filter anew each time.
    filter_, rest, edge = _filter(band, rate)
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
        start = rest.reshape(-1, *(1,) * (signals.ndim - 1), 2) * passed[..., :1]
        passed, _ = sosfilt(filter_, passed, axis=-1, zi=start)
        passed = passed[..., ::-1]
    return passed[..., edge:-edge]


@lru_cache(maxsize=16)
def _filter(band: float, rate: float) -> tuple[FloatArray, FloatArray, int]:
    """Second-order sections, their state in a signal of 1, samples at the ends."""
    from scipy.signal import butter, sosfilt_zi

    filter_ = butter(2, band, fs=rate, output="sos")
    # One section of full order: what `sosfiltfilt` takes.
    return filter_, sosfilt_zi(filter_), 3 * (2 * len(filter_) + 1)
