"""A metric as a smooth function of the variables, fitted to the designs of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from cc_mujoco.whatif.designs import Range
from cc_mujoco.whatif.variables import Value

Array = NDArray[np.float64]

MOST = 1000
"""Designs that a surface is fitted to; more are only used to test it."""
FOLDS = 5
SMOOTHING = (0.0, 1e-4, 1e-2, 1.0)


@dataclass(frozen=True)
class Axis:
    """A variable on a scale from 0 to 1; logarithmic ranges on that of ratios."""

    values: Range

    def code(self, given: Sequence[Value]) -> Array:
        """Values on the scale, (n,); texts by their place among the levels."""
        if self.values.ends is not None:
            low, high = self.values.ends
            found = np.array(given, dtype=np.float64)
            if self.values.log:
                low, high, found = np.log(low), np.log(high), np.log(found)
        elif any(isinstance(level, str) for level in self.values.levels):
            place = {level: i for i, level in enumerate(self.values.levels)}
            found = np.array([place[value] for value in given], dtype=np.float64)
            low, high = 0.0, float(len(place) - 1)
        else:
            found = np.array(given, dtype=np.float64)
            levels = np.array(self.values.levels, dtype=np.float64)
            low, high = float(levels.min()), float(levels.max())
        return np.asarray((found - low) / (high - low))

    def shares(self, count: int) -> Array:
        """Shares at which to look at it: its levels, or `count` across its range."""
        if self.values.ends is not None:
            return np.linspace(0.0, 1.0, count)
        levels = len(self.values.levels)
        return (np.arange(levels) + 0.5) / levels

    def sample(self, share: Array) -> Array:
        """Places on the scale for shares in [0, 1) of the designs that may be."""
        return self.code(self.values.at(share))


@dataclass(frozen=True)
class Surface:
    """A thin-plate spline through the designs, smoothed as cross-validation wants it.

    Attributes:
        spline: from (n, variables), each on its scale, to (n,).
        r_squared: part of the variance that it foretells at designs left out.
        designs: how many it is fitted to.
    """

    spline: RBFInterpolator
    r_squared: float
    designs: int

    def __call__(self, x: Array) -> Array:
        """The metric at (n, variables)."""
        return np.asarray(self.spline(x))


def axes_of(ranges: Mapping[str, Range], varied: Sequence[str]) -> list[Axis]:
    """The scale of each variable."""
    return [Axis(ranges[name]) for name in varied]


def fit(x: Array, y: Array) -> Surface | None:
    """Fit a surface, or None where there are too few designs for one.

    Args:
        x: variables on their scales, (designs, variables).
        y: a metric, (designs,), all numbers.
    """
    rng = np.random.default_rng(0)
    shuffled = rng.permutation(len(y))[:MOST]
    x, y = x[shuffled], y[shuffled]
    least = 3 * (x.shape[1] + 1)
    if len(y) < max(least, 10) or not np.ptp(y) > 0.0:
        return None
    scores = {}
    for smoothing in SMOOTHING:
        error = np.zeros_like(y)
        for fold in range(FOLDS):
            out = np.arange(len(y)) % FOLDS == fold
            try:
                error[out] = _spline(x[~out], y[~out], smoothing)(x[out]) - y[out]
            except np.linalg.LinAlgError:
                error[out] = np.inf
        scores[smoothing] = 1.0 - float(np.mean(error**2) / np.var(y))
    best = max(scores, key=lambda smoothing: scores[smoothing])
    if not np.isfinite(scores[best]):
        return None
    return Surface(_spline(x, y, best), scores[best], len(y))


def _spline(x: Array, y: Array, smoothing: float) -> RBFInterpolator:
    return RBFInterpolator(x, y, smoothing=smoothing, kernel="thin_plate_spline")
