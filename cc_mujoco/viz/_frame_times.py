"""Samples of an episode that a film, a recording or a page of it shows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

FRAME_RATE = 30
"""Frames per simulated second [1/s]."""
MAX_SAMPLES = 60_000
"""Most samples that a recording, a page or a figure plots: of a longer episode every
k-th one, so that they need no more memory for it."""
FRAMES_AT_ONCE = 1800
"""Frames that are prepared for a recording at the same time."""


def frame_slices(count: int) -> Iterator[slice]:
    """Yield slices of `FRAMES_AT_ONCE` that together are all of so many frames."""
    for start in range(0, count, FRAMES_AT_ONCE):
        yield slice(start, start + FRAMES_AT_ONCE)


def frame_samples(
    time: NDArray[np.float64], rate: float = FRAME_RATE
) -> NDArray[np.intp]:
    """Return the sample nearest to each frame; an episode has at least one frame."""
    count = max(1, round(float(time[-1] - time[0]) * rate))
    wanted = time[0] + np.arange(count) / rate
    after = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    if len(time) == 1:
        return np.zeros(1, dtype=np.intp)
    later = wanted - time[after - 1] > time[after] - wanted
    return np.asarray(np.where(later, after, after - 1), dtype=np.intp)


def frame_rate(time: NDArray[np.float64], rate: float, most: int) -> float:
    """Return a rate of frames, lowered where an episode would have too many [1/s]."""
    return min(rate, most / max(float(time[-1] - time[0]), 1e-9))
