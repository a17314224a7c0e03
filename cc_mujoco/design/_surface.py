"""A metric as a smooth function of the variables, fitted to the designs of a study."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.interpolate import RBFInterpolator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Smooth fit of a metric over the design variables.

    Attributes:
        x: (n, variables) places of the designs on the scales of the variables.
        y: (n,) metric of the designs.
        active: columns of `x` that the fit uses.
        smoothing: smoothing of the spline; 0 interpolates.
        r_squared: share of the variance explained in cross-validation.
    """

    x: Array
    y: Array
    active: tuple[int, ...]
    smoothing: float
    r_squared: float

    @cached_property
    def _fitted(self) -> RBFInterpolator:
        return _spline(self.x[:, self.active], self.y, self.smoothing)

    def __call__(self, x: Array) -> Array:
        """Return the metric at the points `x` (n, variables)."""
        return np.asarray(self._fitted(x[:, self.active]))

    def halves(self, count: int) -> Iterator[Surface]:
        """Yield surfaces through random halves of the designs, if they exist."""
        rng = np.random.default_rng(1)
        for _ in range(count):
            half = rng.permutation(len(self.y))[: (len(self.y) + 1) // 2]
            one = dataclasses.replace(self, x=self.x[half], y=self.y[half])
            with contextlib.suppress(np.linalg.LinAlgError, ValueError):
                _ = one._fitted
                yield one


def fit(x: Array, y: Array) -> Surface | None:
    """Fit a surface, or None where there are too few designs or nothing predicts them.

    To a metric `y` (designs,) of the variables `x` (designs, variables) on their
    scales.
    """
    rng = np.random.default_rng(0)
    # At most 1000 designs are fitted.
    shuffled = rng.permutation(len(y))[:1000]
    x, y = x[shuffled], y[shuffled]
    least = 3 * (x.shape[1] + 1)
    if len(y) < max(least, 10) or not np.ptp(y) > 0.0:
        return None
    active = _active_columns(x[:300], y[:300])  # enough to choose variables by
    if not active:
        return None
    smoothing, error = _best_smoothing(x[:, active], y)
    r_squared = 1.0 - float(np.mean(error) / np.var(y))
    if not r_squared > 0.0:
        return None
    return Surface(x, y, active, smoothing, r_squared)


def _active_columns(x: Array, y: Array) -> tuple[int, ...]:
    """Return the columns that improve the prediction of held-out designs."""
    active = tuple(range(x.shape[1]))
    while active:
        smoothing, error = _best_smoothing(x[:, active], y)
        help_of = {}
        for column in active:
            rest = tuple(other for other in active if other != column)
            gain = _left_out_errors(x[:, rest], y, smoothing) - error
            deviation = float(np.std(gain)) / np.sqrt(len(y))
            help_of[column] = float(np.mean(gain)) / max(deviation, 1e-300)
        least = min(active, key=lambda column: help_of[column])
        # A variable stays if it lowers the squared error by two standard errors.
        if help_of[least] > 2.0:
            break
        active = tuple(other for other in active if other != least)
    return active


def _best_smoothing(x: Array, y: Array) -> tuple[float, Array]:
    errors = {each: _left_out_errors(x, y, each) for each in (0.0, 1e-4, 1e-2, 1.0)}
    best = min(errors, key=lambda each: float(np.mean(errors[each])))
    return best, errors[best]


def _left_out_errors(x: Array, y: Array, smoothing: float) -> Array:
    """Return the squared error at every design of a spline without its fold, of 5."""
    error = np.zeros_like(y)
    for fold in range(5):
        out = np.arange(len(y)) % 5 == fold
        predicted: Any = np.mean(y[~out])  # all there is without variables, or a spline
        if x.shape[1]:
            with contextlib.suppress(np.linalg.LinAlgError):
                predicted = _spline(x[~out], y[~out], smoothing)(x[out])
        error[out] = predicted - y[out]
    return error**2


def _spline(x: Array, y: Array, smoothing: float) -> RBFInterpolator:
    from scipy.interpolate import RBFInterpolator

    return RBFInterpolator(x, y, smoothing=smoothing, kernel="thin_plate_spline")
