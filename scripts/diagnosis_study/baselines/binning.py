"""Binned residual regression: the residual over a feature, averaged in bins.

The mean of every bin takes out what does not depend on the feature, as the eye does in
a plot of friction error over speed; the effect whose formula runs through the means
best is named.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.features import FAMILIES, Term
from baselines.guess import Guess, decided
from baselines.signals import Signals, signals
from baselines.stacking import column, errors, gathered, weights
from cc_mujoco.diagnosis import BaselineFit
from cc_mujoco.native import FloatArray

BINS = 40  # bins with as many samples each
LEAST = 0.06
"""Share of the squared residual below which nothing is named.

Development rigs without any effect reach half of it.
"""


def binned(baseline_fit: BaselineFit) -> Guess:
    """Return the effect whose formula runs best through the binned residual."""
    return regressed(signals(baseline_fit))


def regressed(records: Sequence[Signals], least: float = LEAST) -> Guess:
    """Return the same from signals.

    Args:
        least: share of the squared residual below which nothing is named.
    """
    residual = [errors(records, channel) for channel in (0, 1)]
    total = sum(float(error @ error) for error in residual)
    shares = {
        family.id: sum(
            max(
                _taken(records, residual[channel], term, channel)
                for term in family.terms
            )
            for channel in family.channels
        )
        / total
        for family in FAMILIES
    }
    return decided(shares, least)


def _taken(
    records: Sequence[Signals], residual: FloatArray, term: Term, channel: int
) -> float:
    """Return the reduction of squares by a weighted regression of bin means."""
    bins = in_bins(gathered(records, lambda s: term.over(s, channel)))
    weight = weights(records, channel)
    root = np.sqrt(np.bincount(bins, weight**2))

    def means(values: FloatArray) -> FloatArray:
        """Return the weighted mean of every bin, times the root of its weight."""
        return np.bincount(bins, weight * values) / root

    seen = means(residual)
    columns = [means(column(records, part, channel)) for part in term.columns]
    table = np.column_stack(columns)
    left = seen - table @ np.linalg.lstsq(table, seen, rcond=1e-9)[0]
    return float(seen @ seen - left @ left)


def in_bins(over: FloatArray) -> NDArray[np.intp]:
    """Return the bin of every sample (samples,), none of them empty."""
    edges = np.unique(np.quantile(over, np.arange(1, BINS) / BINS))
    place = np.searchsorted(edges, over, side="right")
    return np.unique(place, return_inverse=True)[1]
