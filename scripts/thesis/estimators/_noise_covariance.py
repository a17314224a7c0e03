r"""Variances of process and sensor noise from data: autocovariance least squares.

    model = trend_model(factors)                   # of the sensors to one tension
    found = autocovariance_least_squares(innovations(model, readings)[50:], model)
    found.sensor                                   # variance of every sensor

After Odelson, Rajamani and Rawlings, *A new autocovariance least-squares method for
estimating noise covariances*, Automatica 42 (2006) 303-308, which the thesis names in
3.2.2: a filter with any fixed gain runs over the readings. Its innovations would be
white if the gain were the best one; how they are correlated in time is linear in the
unknown variances,

.. math:: C_l = C \bar A^l P C^T - C \bar A^{l-1} A L R \ (l > 0), \quad
          C_0 = C P C^T + R, \quad
          P = \bar A P \bar A^T + G Q G^T + A L R L^T A^T,

with :math:`\bar A = A - A L C`; so they follow from measured autocovariances by linear
least squares. Q and R are diagonal here.

On a cable that moves as a whole all sensors measure one tension, each times its known
capstan factor. `trend_model` takes that tension for a local trend, level and rate, the
rate a random walk. `_sensor_noise` has a method that needs no model of the tension and
no time to settle, and works while the cable runs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_discrete_lyapunov
from scipy.optimize import nnls

from cc_mujoco.native import FloatArray

LAGS = 5  # autocovariances that are used, from lag 0 on
SMOOTHING = 0.2
"""Share of an innovation that the fixed-gain filter takes into its level."""


class LinearModel(NamedTuple):
    """x' = A x + G w, y = C x + v, and the gain L of x^ + L (y - C x^)."""

    transition: FloatArray  # A (k, k)
    disturbance: FloatArray  # G (k, g)
    output: FloatArray  # C (p, k)
    gain: FloatArray  # L (k, p); A - A L C must be stable


class NoiseVariance(NamedTuple):
    """Variances of independent noises."""

    process: FloatArray  # of w (g,)
    sensor: FloatArray  # of v (p,)


def trend_model(factors: ArrayLike) -> LinearModel:
    """Return one tension with a trend, measured by sensors at known factors (m,)."""
    factor = np.asarray(factors, dtype=float)
    shares = 1.0 / (factor * factor.size)
    root = 1.0 - np.sqrt(1.0 - SMOOTHING)  # critically damped
    return LinearModel(
        transition=np.array([[1.0, 1.0], [0.0, 1.0]]),
        disturbance=np.array([[0.5], [1.0]]),
        output=np.column_stack([factor, np.zeros_like(factor)]),
        gain=np.outer([SMOOTHING, root**2], shares),
    )


def innovations(model: LinearModel, readings: ArrayLike) -> FloatArray:
    """Compute the innovations of the fixed-gain filter, (samples, p).

    It starts from the smallest state that fits the first reading best; its first
    innovations, until it has settled, are of no use for autocovariances.
    """
    measured = np.asarray(readings, dtype=float)
    state = np.linalg.lstsq(model.output, measured[0], rcond=None)[0]
    rows = []
    for reading in measured:
        rows.append(reading - model.output @ state)
        state = model.transition @ (state + model.gain @ rows[-1])
    return np.array(rows)


def autocovariances(model: LinearModel) -> FloatArray:
    """Return the autocovariances of the innovations per unit of every variance.

    They are (lags * p * p, g + p): columns are the unknown variances, first those of w.
    """
    a, g, c, gain = model
    through = a @ gain
    closed = a - through @ c
    sources = np.concatenate([g.T, through.T])
    columns = []
    for index, source in enumerate(sources):
        error = solve_discrete_lyapunov(closed, np.outer(source, source))
        sensor = index - g.shape[1]
        seen = np.zeros(c.shape[0])
        if sensor >= 0:
            seen[sensor] = 1.0
        column = [c @ error @ c.T + np.diag(seen)]
        # Error of the next prediction, correlated with the innovation of now.
        cross = closed @ error @ c.T - np.outer(source, seen)
        for _ in range(1, LAGS):
            column.append(c @ cross)
            cross = closed @ cross
        columns.append(np.concatenate([part.ravel() for part in column]))
    return np.column_stack(columns)


def autocovariance_least_squares(
    innovation: ArrayLike, model: LinearModel, *, nonnegative: bool = True
) -> NoiseVariance:
    """Return the variances of process and sensors from one stretch of innovations.

    Args:
        innovation: of the model's filter in its steady state (samples, p).
        model: the model; its filter must be stable.
        nonnegative: keep variances at or above 0; without it they are unbiased, with it
            those near 0 are a little too large on average.
    """
    rows = np.asarray(innovation, dtype=float)
    measured = [
        (rows[lag:].T @ rows[: len(rows) - lag] / (len(rows) - lag)).ravel()
        for lag in range(LAGS)
    ]
    matrix, right = autocovariances(model), np.concatenate(measured)
    # In columns of unit length: variances differ by orders of magnitude.
    size = np.linalg.norm(matrix, axis=0)
    if nonnegative:
        found = nnls(matrix / size, right)[0] / size
    else:
        found = np.linalg.lstsq(matrix / size, right, rcond=None)[0] / size
    return NoiseVariance(*np.split(found, [model.disturbance.shape[1]]))


def difference_variance(readings: ArrayLike) -> FloatArray:
    """Return half the mean square of time differences, a baseline (m,) [N^2].

    It takes every change of the tension for noise.
    """
    change = np.diff(np.asarray(readings, dtype=float), axis=0)
    return 0.5 * np.mean(change**2, axis=0)
