r"""Friction times curvature, mu/R, as it varies along a cable, while it runs (3.2.3).

    estimator = BendEstimator(cable, sensors)
    estimator.update(measured, reading.slip)          # in an environment step
    estimator.at([0.3, 1.0])                          # value and deviation [1/m]

Equation 2.13 holds mu and R only as :math:`\mu/R`, so that where the bend is unknown
their quotient is what can be found: it is :math:`s\,d\ln T/dx` of a moving part. It is
written as a spline; the logarithm of tension is then linear in its coefficients, with
the integrals of the basis functions as rows, and recursive least squares does the rest.
What no moving pair of sensors spans keeps its value and its uncertainty. Nothing forces
the estimate to be positive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._recursive import RecursiveLeastSquares
from cc_mujoco.estimation._tension_slope import SlopeEstimator, SlopeFit
from cc_mujoco.estimation._tracks import rows, wrap_angles
from cc_mujoco.native import FloatArray


class Bend(NamedTuple):
    """mu/R at places along the cable."""

    value: FloatArray  # [1/m]
    deviation: FloatArray  # standard deviation of its error [1/m]


class BendEstimator(SlopeEstimator):
    """mu/R along the cable as a spline, followed while the cable runs."""

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        pieces: int = 4,
        degree: int = 3,
        start: ArrayLike | None = None,
        spread: float | None = None,
        memory: float = 1000.0,
        drift: float = 0.0,
    ) -> None:
        """Start from the cable's parameters, or from a guess.

        Args:
            cable: the cable. No term may be on for which the law does not hold, see
                `estimation._tension_slope.require_slope`.
            sensors: at least two; between neighbours only the mean is determined.
            pieces: equal intervals of the spline.
            degree: of the spline: 3 where the bend varies smoothly, 0 (a value per
                interval) where straight and bent parts meet.
            start: guess of mu/R in every segment, a number or (n,) [1/m].
            spread: standard deviation of every coefficient of the guess [1/m], which
                are local means; default the largest value of the guess.
            memory: moving samples after which one has faded to 1/e.
            drift: standard deviation of the rate of drift, per moving sample [1/m].
        """
        n, self.length = cable.segments, cable.length
        places = node_places(cable)
        guess = cable.friction * np.diff(wrap_angles(cable)) / np.diff(places)
        if start is not None:
            guess = np.broadcast_to(np.asarray(start, dtype=float), (n,))
        width = float(np.max(np.abs(guess))) if spread is None else spread
        ends = [0.0] * degree, [self.length] * degree
        inner = np.linspace(0.0, self.length, pieces + 1)
        size = pieces + degree
        self._basis = BSpline(
            np.concatenate([ends[0], inner, ends[1]]), np.eye(size), degree
        )
        integral = self._basis.antiderivative()
        design = np.asarray(integral(places) - integral(0.0))
        # In every piece.
        dense = (np.arange(20 * size) + 0.5) / (20 * size) * self.length
        segment = np.searchsorted(places, dense, side="right") - 1
        wanted = guess[np.clip(segment, 0, n - 1)]
        first = np.linalg.lstsq(self._basis(dense), wanted, rcond=None)[0]
        fit = RecursiveLeastSquares(first, np.full(size, width), memory, drift)
        super().__init__(SlopeFit(cable, sensors, design, fit, memory))

    def update(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Take the sensors' readings (m,) [N] and the segments' slip (n,)."""
        self._slope.update(reading, direction)

    def at(self, position: ArrayLike) -> Bend:
        """Return the estimate at places [m] from the proximal end."""
        place = np.asarray(position, dtype=float)
        if not np.all((place >= 0.0) & (place <= self.length)):
            raise CableError(
                f"position is {place.tolist()} m; the cable has {self.length:g} m"
            )
        design = np.asarray(self._basis(place))
        fit = self._slope.fit
        variance = np.einsum("...i,ij,...j->...", design, fit.covariance, design)
        return Bend(design @ fit.value, np.sqrt(np.maximum(variance, 0.0)))

    def over(
        self, reading: ArrayLike, direction: ArrayLike, position: ArrayLike
    ) -> Bend:
        """Return the estimates (samples, k) at k places over a recording."""
        place = np.atleast_1d(np.asarray(position, dtype=float))
        found = []
        for row in rows(reading=reading, direction=direction):
            self.update(*row)
            found.append(self.at(place))
        return Bend(*np.reshape(found, (-1, 2, place.size)).swapaxes(0, 1))
