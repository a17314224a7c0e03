"""The samples of an episode that a film of it shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FRAME_RATE = 30
"""Frames per simulated second [1/s]."""


def frame_samples(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the sample nearest to each frame; an episode has at least one frame.

    Args:
        time: Of the samples, rising [s], (T,).
    """
    count = max(1, round(float(time[-1] - time[0]) * FRAME_RATE))
    wanted = time[0] + np.arange(count) / FRAME_RATE
    after = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    if len(time) == 1:
        return np.zeros(1, dtype=np.intp)
    later = wanted - time[after - 1] > time[after] - wanted
    return np.asarray(np.where(later, after, after - 1), dtype=np.intp)
