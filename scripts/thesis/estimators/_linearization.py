"""Sigma points, and the line that fits a function at them best.

    points = sigma_points(mean, covariance)
    line = linearize(points, np.array([function(point) for point in points]))

The unscented transform (Julier and Uhlmann, Proc. IEEE 92, 2004) read as statistical
linear regression: what a function does to a normal distribution, as a straight line
and the covariance of what the line leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray

_BETA = 2.0
"""Weight of the fourth moment, for a normal distribution (Wan and van der Merwe)."""


def square_root(covariance: FloatArray) -> FloatArray:
    """Return A with A A' = covariance, also if rounding left it slightly indefinite."""
    symmetric = 0.5 * (covariance + covariance.T)
    root: FloatArray
    try:
        root = np.asarray(np.linalg.cholesky(symmetric), dtype=np.float64)
    except np.linalg.LinAlgError:
        size, axes = np.linalg.eigh(symmetric)
        root = axes * np.sqrt(np.maximum(size, 0.0))
    return root


def sigma_points(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the mean and 2 p points around it (2 p + 1, p).

    With the scaling of Wan and van der Merwe (Proc. AS-SPCC 2000) at alpha = 1,
    kappa = 0, where no weight is negative, so that every covariance made of them is
    one. The mean itself then counts for covariances only.
    """
    reach = np.sqrt(mean.size) * square_root(covariance).T
    return np.concatenate([mean[None], mean + reach, mean - reach])


class Linearization(NamedTuple):
    """A function near a normal distribution: y = slope x + offset + residual."""

    slope: FloatArray  # (k, p)
    offset: FloatArray  # (k,)
    root: FloatArray  # of the covariance of the residual, root root' (k, 2 p + 1)


def linearize(points: FloatArray, said: FloatArray) -> Linearization:
    """Statistical linearization of a function by its values at sigma points.

    Args:
        points: of `sigma_points` (2 p + 1, p).
        said: the values at the points (2 p + 1, k).
    """
    size = points.shape[1]
    weight = np.concatenate([[_BETA], np.full(2 * size, 0.5 / size)])
    mean, middle = np.mean(points[1:], axis=0), np.mean(said[1:], axis=0)
    apart, spoken = points - mean, said - middle
    cross = (weight * spoken.T) @ apart
    covariance = (weight * apart.T) @ apart
    slope = cross @ np.linalg.pinv(covariance, rcond=1e-12, hermitian=True)
    root = np.sqrt(weight) * (spoken - apart @ slope.T).T
    return Linearization(slope, middle - slope @ mean, root)


def kalman_gain(
    line: Linearization, covariance: FloatArray, variance: FloatArray
) -> FloatArray:
    """Return the gain of a measurement that is this line and noise, (p, k).

    By Woodbury's identity, so that no matrix of the size of the measurement is solved.

    Args:
        covariance: of the state before it (p, p).
        variance: of the noise (k,).
    """
    scale = np.sqrt(variance)[:, None]
    slope = line.slope / scale
    known = np.concatenate([slope @ square_root(covariance), line.root / scale], axis=1)
    inner = np.eye(known.shape[1]) + known.T @ known
    wanted = slope @ covariance
    gain: FloatArray = wanted - known @ np.linalg.solve(inner, known.T @ wanted)
    gain /= scale
    return gain.T
