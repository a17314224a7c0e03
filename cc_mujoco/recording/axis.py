"""How far the axis of a plot reaches in a Rerun recording."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

Array = NDArray[np.float64]

START = 0.3
"""What belongs to the start of a trial or an episode [s]."""


def axis(time: Array, lines: Iterable[Array]) -> rrb.ScalarAxis | None:
    """An axis with `limits`, or None for Rerun's own choice, all samples.

    Args:
        time: Of the samples, rising [s], (T,).
        lines: Values, each (T,).
    """
    found = limits(time, lines)
    return None if found is None else rrb.ScalarAxis(range=found, zoom_lock=False)


def limits(time: Array, lines: Iterable[Array]) -> tuple[float, float] | None:
    """Limits of an axis for the lines after their start, where that would flatten them.

    A motor that is not where the motion begins catches up within moments, and may need
    many times the torque of all that follows.

    Args:
        time: Of the samples, rising [s], (T,).
        lines: Values, each (T,).

    Returns:
        Low and high, or None where all samples together show them well.
    """
    values = np.stack([np.where(np.isfinite(line), line, np.nan) for line in lines])
    later = values[:, time - time[0] > START]
    if np.isfinite(later).sum() < 2:
        return None
    low, high = float(np.nanmin(later)), float(np.nanmax(later))
    if not 0.0 < 2.0 * (high - low) < float(np.nanmax(values) - np.nanmin(values)):
        return None
    margin = 0.1 * (high - low)
    return low - margin, high + margin
