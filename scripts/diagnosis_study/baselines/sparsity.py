"""Sparse regression of the residual (SINDy discrepancy model), with pysindy.

All looks of all effects stand side by side as columns of one table for each channel;
sequentially thresholded least squares drops the small ones. What is left over shows
which effects are in the residual; the one with the largest part is named.

Kaheman, Kaiser, Strom, Kutz, Brunton, arXiv 1909.08574.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from baselines.features import looks
from baselines.guess import Guess
from baselines.signals import Signals, signals
from baselines.stacking import column, errors
from cc_mujoco.diagnosis import BaselineFit
from cc_mujoco.native import FloatArray

THRESHOLD = 0.15
"""Coefficient that is dropped; columns and residual have unit length.

On development rigs without any effect columns are left over at 0.1, none at this.
"""
RIDGE = 0.05  # weight of squared coefficients, pysindy's own default


def sparse(baseline_fit: BaselineFit) -> Guess:
    """Return the effect with the largest part of a sparse model of the residual."""
    return selected(signals(baseline_fit))


def selected(records: Sequence[Signals], threshold: float = THRESHOLD) -> Guess:
    """Return the same from signals."""
    residual = [errors(records, channel) for channel in (0, 1)]
    scale = float(np.sqrt(sum(error @ error for error in residual)))
    parts: dict[str, float] = {}
    left = 0.0
    for channel, error in enumerate(residual):
        names, table = library(records, channel)
        target = error / scale
        found = thresholded(table, target, threshold)
        left += float(np.sum((target - table @ found) ** 2))
        for name in dict.fromkeys(names):
            part = table @ np.where([n == name for n in names], found, 0.0)
            parts[name] = parts.get(name, 0.0) + float(part @ part)
    kept = [name for name, part in parts.items() if part > 0.0]
    ranking = tuple(sorted(kept, key=lambda name: -parts[name]))
    return Guess(ranking[0] if ranking else None, ranking, max(1.0 - left, 0.0))


def library(
    records: Sequence[Signals], channel: int
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names of the columns and columns of unit length (samples, k)."""
    names, columns = [], []
    for name, where, term in looks():
        if where != channel:
            continue
        for part in term.columns:
            signal = column(records, part, channel)
            length = float(np.linalg.norm(signal))
            if length > 0.0:
                names.append(name)
                columns.append(signal / length)
    return tuple(names), np.column_stack(columns)


def thresholded(table: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """Return the coefficients of sequentially thresholded least squares (k,)."""
    from pysindy import STLSQ

    model = STLSQ(threshold=threshold, alpha=RIDGE)
    with warnings.catch_warnings():
        # It warns where nothing is left, which is an answer here.
        warnings.simplefilter("ignore")
        model.fit(table, target)
    return np.asarray(model.coef_, dtype=np.float64).ravel()
