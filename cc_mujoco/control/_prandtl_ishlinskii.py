r"""The modified Prandtl-Ishlinskii operator and its inverse in closed form.

K. Kuhnen, "Modeling, identification and compensation of complex hysteretic
nonlinearities: a modified Prandtl-Ishlinskii approach", European J. Control 9, 2003: a
sum of plays \(H\) of the motor angle, then a curve \(S\) without memory. The inverse of
\(H\) is a sum of plays, too. Of \(S\) only its inverse \(S'\) is needed, a curve of
straight pieces, so weights and curve are one linear least squares with bounds:
\(H[\theta] = S'(q)\).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.control._hysteresis import Array, HysteresisModel, HysteresisTrial
from cc_mujoco.errors import CableError

PLAYS = 12
"""Plays of a fit."""
PIECES = 8
"""Straight pieces of the curve of a fit."""
LEAST_SLOPE = 0.1
"""Least slope of the curve, and least weight of the play of no width, relative to the
mean."""


@dataclass(frozen=True)
class PrandtlIshlinskii(HysteresisModel):
    """Weighted plays and a curve without memory; see the module."""

    thresholds: tuple[float, ...]
    """Half widths of the plays of the motor angle; 0 first, increasing [rad]."""
    weights: tuple[float, ...]
    """Weight of each play [-]; the first above 0, no other below."""
    knots: tuple[float, ...]
    """Joint angles at which pieces of the curve S' meet, increasing [rad]."""
    values: tuple[float, ...]
    """Curve S' at these [rad]; outside, the end pieces go on."""

    def __post_init__(self) -> None:
        """Refuse what has no inverse."""
        r, w = np.array(self.thresholds), np.array(self.weights)
        if not (r.size and r.size == w.size and r[0] == 0.0 and np.all(np.diff(r) > 0)):
            raise CableError(
                "PrandtlIshlinskii.thresholds must begin with 0 and increase, with a "
                "weight for each."
            )
        if not (w[0] > 0.0 and np.all(w >= 0.0)):
            raise CableError(
                "PrandtlIshlinskii.weights must be at least 0, and the first above 0."
            )
        knots, values = np.array(self.knots), np.array(self.values)
        if not (
            knots.size >= 2
            and knots.size == values.size
            and np.all(np.diff(knots) > 0)
            and np.all(np.diff(values) > 0)
        ):
            raise CableError(
                "PrandtlIshlinskii.knots and values must be at least two and increase."
            )

    @classmethod
    def fit(cls, trial: HysteresisTrial) -> PrandtlIshlinskii:
        """Return weights and curve of least squares; see `HysteresisModel.fit`."""
        from scipy.optimize import lsq_linear

        motor, joint = trial.motor_angle, trial.joint_angle
        reach = 0.5 * np.ptp(motor)
        thresholds = reach * np.arange(PLAYS) / PLAYS
        plays = _plays(motor, thresholds)
        knots = np.linspace(joint.min(), joint.max(), PIECES + 1)
        width = knots[1] - knots[0]
        pieces = np.clip(joint[:, None] - knots[:-1], 0.0, width)
        # The scale of both sides is free: the curve has slope 1 in the mean.
        columns = np.hstack([plays, -pieces, -np.ones((joint.size, 1))])
        fixed = np.zeros(columns.shape[1])
        fixed[PLAYS:-1] = 1.0 / PIECES
        heavy = 1e3 * np.sqrt(joint.size) * width
        slope = np.ptp(joint) / np.ptp(motor)
        low = np.zeros(columns.shape[1])
        low[0], low[PLAYS:-1], low[-1] = LEAST_SLOPE * slope, LEAST_SLOPE, -np.inf
        found = lsq_linear(
            np.vstack([columns, heavy * fixed]),
            np.append(np.zeros(joint.size), heavy),
            bounds=(low, np.full(low.size, np.inf)),
            tol=1e-12,
        ).x
        weights = found[:PLAYS]
        values = found[-1] + width * np.concatenate([[0.0], np.cumsum(found[PLAYS:-1])])
        return cls(
            tuple(thresholds.tolist()),
            tuple(np.maximum(weights, 0.0).tolist()),
            tuple(knots.tolist()),
            tuple(values.tolist()),
        )

    def rest(self, count: int) -> Array:
        """Return the plays of the inverse; see `HysteresisModel.rest`."""
        return np.zeros((count, len(self.thresholds)))

    def invert(self, state: Array, joint: Array) -> Array:
        """Return the motor angles [rad]; see `HysteresisModel.invert`."""
        thresholds, weights = inverse_plays(
            np.array(self.thresholds), np.array(self.weights)
        )
        at = self._curve(joint)[:, None]
        state[:] = np.maximum(at - thresholds, np.minimum(at + thresholds, state))
        # A product of matrices would have other bits for other numbers of rows.
        found: Array = np.sum(state * weights, axis=1)
        return found

    def course(self, motor: ArrayLike) -> Array:
        """Return the course of the joint for a course of the motor (samples,) [rad].

        The operator that `invert` inverts.
        """
        played = _plays(np.asarray(motor, dtype=float), np.array(self.thresholds))
        knots, values = np.array(self.knots), np.array(self.values)
        return _interpolated(played @ np.array(self.weights), values, knots)

    def _curve(self, joint: Array) -> Array:
        return _interpolated(joint, np.array(self.knots), np.array(self.values))


def inverse_plays(thresholds: Array, weights: Array) -> tuple[Array, Array]:
    """Return thresholds and weights of the inverse of a sum of plays.

    Kuhnen 2003; the memories at rest are those of the operator at rest, zero.
    """
    total = np.cumsum(weights)
    inverse = np.concatenate(
        [[1.0 / weights[0]], -weights[1:] / (total[1:] * total[:-1])]
    )
    lower = np.cumsum(weights * thresholds)
    return total * thresholds - lower, inverse


def _plays(course: Array, thresholds: Array) -> Array:
    """Return the plays of a course, at 0 before it (samples, plays)."""
    found, state = np.empty((course.size, thresholds.size)), np.zeros(thresholds.size)
    for place, angle in enumerate(course):
        state = np.maximum(angle - thresholds, np.minimum(angle + thresholds, state))
        found[place] = state
    return found


def _interpolated(at: Array, knots: Array, values: Array) -> Array:
    """Return a curve of straight pieces, the end pieces of which go on."""
    piece = np.clip(np.searchsorted(knots, at) - 1, 0, knots.size - 2)
    slope = np.diff(values) / np.diff(knots)
    return np.asarray(values[piece] + slope[piece] * (at - knots[piece]))
