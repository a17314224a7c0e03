"""Velocities from measured angles by a filter without delay.

Before measured and simulated angles are compared, both must pass the same filter.
"""

import math
from collections.abc import Iterable

import numpy as np

from cc_mujoco.datasets._trials import FloatArray

SIGMAS_PER_MEDIAN = 1.4826
"""Standard deviation of normal noise over the median of its size."""


def velocity(
    angle: FloatArray, step: float, segments: Iterable[slice] | None = None
) -> FloatArray:
    """Return the rate of change by a zero-phase Savitzky-Golay filter of second order.

    A parabola is fitted to a window of 0.05 s around each sample (five at
    least); its slope there is the speed (Savitzky and Golay, Anal. Chem. 36, 1964).

    Args:
        angle: (samples,) [rad].
        step: time between samples [s].
        segments: stretches without gaps, each filtered by itself; None is all samples.

    Returns:
        (samples,) [rad/s]; NaN outside the segments.
    """
    speed = np.full(len(angle), np.nan)
    for part in [slice(0, len(angle))] if segments is None else segments:
        count = len(angle[part])
        half = min(_half_window(step), (count - 1) // 2)
        if half > 0:
            speed[part] = _local_slopes(angle[part], half) / step
    return speed


def _half_window(step: float) -> int:
    return max(2, round(0.05 / step) // 2)


def _local_slopes(values: FloatArray, half: int) -> FloatArray:
    """Return slopes per sample of parabolas through `half` samples on either side.

    The first and last `half` slopes are of the first and last whole window. This is
    `scipy.signal.savgol_filter` with mode "interp", which takes a second to import.
    """
    place = np.arange(-half, half + 1)
    found = np.empty(len(values))
    weights = place / float(place @ place)
    found[half : len(values) - half] = np.correlate(values, weights, "valid")
    powers = np.vander(place / half, 3, increasing=True)
    for window, kept, inside in (
        (slice(0, 2 * half + 1), slice(0, half), place[:half]),
        (slice(-2 * half - 1, None), slice(len(values) - half, None), place[-half:]),
    ):
        _, slope, bend = np.linalg.lstsq(powers, values[window])[0]
        found[kept] = (slope + 2.0 * bend * inside / half) / half
    return found


def velocity_noise(deviation: float, step: float) -> float:
    """Return the standard deviation [rad/s] of `velocity` for white angle noise.

    `deviation` is that of the angle readings [rad], `step` the sampling time [s].
    """
    half = _half_window(step)
    return deviation / step * math.sqrt(3.0 / (half * (half + 1) * (2 * half + 1)))
