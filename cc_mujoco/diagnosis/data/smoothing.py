"""Speeds from angles, without shifting them in time.

The same filter must be applied to what is simulated before the two are compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from cc_mujoco.diagnosis.data.trials import FloatArray

SPAN = 0.05
"""Stretch of time over which a speed is estimated [s]."""
_ORDER = 2
_FEWEST = 5


def velocity(
    angle: FloatArray,
    step: float,
    segments: Iterable[slice] | None = None,
    span: float = SPAN,
) -> FloatArray:
    """Rate of change by a zero-phase Savitzky-Golay filter of second order.

    A parabola is fitted to the samples within `span` around each sample (at least
    five); its slope there is the speed (Savitzky and Golay, Anal. Chem. 36, 1964).

    Args:
        angle: (samples,) [rad].
        step: time between samples [s].
        segments: stretches without gaps, each filtered by itself; None is all samples.
        span: length of the window [s].

    Returns:
        (samples,) [rad/s]; NaN outside the segments.
    """
    from scipy.signal import savgol_filter

    speed = np.full(len(angle), np.nan)
    for part in [slice(0, len(angle))] if segments is None else segments:
        count = len(angle[part])
        window = max(_FEWEST, 2 * (round(span / step) // 2) + 1)
        window = min(window, 2 * ((count - 1) // 2) + 1)
        if window > _ORDER:
            speed[part] = savgol_filter(
                angle[part], window, _ORDER, deriv=1, delta=step, mode="interp"
            )
    return speed


def velocity_noise(deviation: float, step: float, span: float = SPAN) -> float:
    """Standard deviation of `velocity` in the middle of a stretch, for white noise.

    Args:
        deviation: of the angle readings [rad].
        step: time between samples [s].
        span: length of the window [s].
    """
    half = max(_FEWEST // 2, round(span / step) // 2)
    return deviation / step * math.sqrt(3.0 / (half * (half + 1) * (2 * half + 1)))
