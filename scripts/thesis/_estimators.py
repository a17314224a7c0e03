"""Estimators that run beside a cable: friction (3.2.3) and tensions (3.2.1).

Each takes the readings of sensors and the directions of slip, sample by sample or over
a recording, and states the deviation of its error. The controllers of the package
estimate friction by a filter of their own.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import (
    Fused,
    Weights,
    cumulative_sums,
    fuse,
    tension_gains,
)
from cc_mujoco.estimation._tension_slope import (
    SlopeEquations,
    require_bend_between,
    require_slope,
    run_equations,
    wrap_angles,
)
from cc_mujoco.native import FloatArray

UNKNOWN_DEVIATION = 1e6  # standard deviation of an unknown tension [N]


class EstimateTrack(NamedTuple):
    """Estimates over a recording, one per sample."""

    value: FloatArray  # after every sample (samples,), of p parameters (samples, p)
    deviation: FloatArray  # standard deviation of their errors, in the same shape


class RecursiveLeastSquares:
    r"""Least squares of parameters that forgets only where something new is learnt.

    The information of the data, S in addition to that of the start :math:`R_0`, fades
    only in the directions V in which the new sample informs (after Cao and Schwartz,
    Automatica 36, 2000),

    .. math::
        S' = S - (1 - \lambda) S V (V^T (R_0 + S) V)^{-1} V^T S.

    Plain exponential forgetting loses information while the data have none: the
    variance winds up, and the next noise moves the estimate. The information of the
    start never fades, which bounds the gain; it does not pull the estimate to the
    start. A gain with forgetting does not minimise the variance, so that is propagated
    separately. It is exact for white noise of the stated size and a true value that is
    constant or drifts at a constant rate of given standard deviation.

    Attributes:
        value: the estimate (p,).
        covariance: covariance of its error (p, p).
    """

    def __init__(
        self, start: ArrayLike, spread: ArrayLike, memory: float, drift: ArrayLike = 0.0
    ) -> None:
        """Start from a guess (p,) and the standard deviation of its error (p,).

        A sample has faded to 1/e after `memory` informative ones; `drift` is the
        standard deviation of the rate of drift per such sample.
        """
        self._start = np.asarray(start, dtype=float)
        self._spread = np.diag(np.asarray(spread, dtype=float) ** 2)
        self._rate = np.diag(np.broadcast_to(drift, self._start.shape) ** 2.0)
        self._least = np.linalg.inv(self._spread)
        self._fading = 1.0 - float(np.exp(-1.0 / memory))
        self.reset()

    def reset(self) -> None:
        self.value, self.covariance = self._start.copy(), self._spread.copy()
        self._information_matrix = np.zeros_like(self._spread)
        self._with_rate = np.zeros_like(self._spread)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the error of `value` (p,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def update(self, information: FloatArray, target: FloatArray) -> None:
        r"""Take the equations :math:`\Phi\theta = y` of a sample, noise of variance 1.

        The information is :math:`\Phi^T \Phi` (p, p), the target :math:`\Phi^T y` (p,).
        """
        size, axes = np.linalg.eigh(information)
        # A direction is silent below 1e-9 of the largest information.
        informed = axes[:, size > 1e-9 * max(float(size[-1]), 0.0)]
        if informed.shape[1] == 0 or not size[-1] > 0.0:
            return
        seen = self._information_matrix @ informed
        within = informed.T @ ((self._least + self._information_matrix) @ informed)
        learnt = self._information_matrix - self._fading * seen @ np.linalg.solve(
            within, seen.T
        )
        self._information_matrix = 0.5 * (learnt + learnt.T) + information
        gain = np.linalg.inv(self._least + self._information_matrix)
        self.value = self.value + gain @ (target - information @ self.value)
        kept = np.eye(self.value.size) - gain @ information
        # The truth has moved on by its rate; then Joseph's form, right for any gain.
        cross = self._with_rate
        ahead = self.covariance - cross - cross.T + self._rate
        self._with_rate = kept @ (cross - self._rate)
        self.covariance = kept @ ahead @ kept.T + gain @ information @ gain


class SlopeEstimator:
    """Base of estimators of parameters in which the logarithm of tension is linear."""

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        design: FloatArray,
        fit: RecursiveLeastSquares,
        memory: float,
    ) -> None:
        """Start from the state of `fit`.

        `design` (n + 1, p) is the derivative of ln T at every node, from the proximal
        end, by each parameter when all slips towards distal. `memory` is that of the
        misfit, in samples.
        """
        require_slope(cable)
        self._fit = fit
        self._nodes = sensors.on(cable).astype(np.int64)
        self.noise = np.array(sensors.deviation)
        self._lay(design)
        self._fading = float(np.exp(-1.0 / memory))
        self.reset()

    def _lay(self, design: FloatArray) -> None:
        """Set the derivatives of ln T at the sensors from those at all nodes."""
        self._design = np.ascontiguousarray(design[self._nodes], dtype=float)

    def reset(self) -> None:
        """Restore the start values; the noise of the sensors stays as set."""
        self._fit.reset()
        self._squares, self._count = 0.0, 0.0

    @property
    def misfit(self) -> float:
        """RMS residual over the noise; 1 if model and noise are right, NaN at first."""
        if self._count == 0.0:
            return float("nan")
        return float(np.sqrt(self._squares / self._count))

    def _take(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Include the readings of the next instant, see `FrictionEstimator.update`."""
        sensors, parameters = self._design.shape
        tensions, sign = (np.asarray(each, float) for each in (reading, direction))
        information, target = np.empty((parameters, parameters)), np.empty(parameters)
        equations = SlopeEquations(
            self._design, self._nodes, self.noise, np.empty_like(self._design),
            np.empty(sensors), np.empty(sensors), information, target,
        )  # fmt: skip
        power, count = run_equations(equations, self._fit.value, tensions, sign)
        if count == 0 or not np.any(information):
            return
        self._fit.update(information, target)
        value = self._fit.value
        squares = power + float(value @ (information @ value - 2.0 * target))
        self._squares = self._fading * self._squares + max(squares, 0.0)
        self._count = self._fading * self._count + count


class FrictionEstimator(SlopeEstimator):
    """Kinetic friction coefficient mu_d while the cable runs."""

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        start: float,
        spread: float = 0.2,
        memory: float = 500.0,
        drift: float = 0.0,
    ) -> None:
        """Start from a guess with the standard deviation `spread`.

        Of the cable only its wrap angles are used. A moving sample has faded to 1/e
        after `memory` more; noise falls with its root, and the estimate lags a drift by
        as many samples. `drift` is the standard deviation of the rate of drift, per
        moving sample.
        """
        require_bend_between(cable, sensors)
        fit = RecursiveLeastSquares([start], [spread], memory, drift)
        super().__init__(cable, sensors, wrap_angles(cable)[:, None], fit, memory)

    @property
    def friction(self) -> float:
        return float(self._fit.value[0])

    @property
    def deviation(self) -> float:
        """Standard deviation of the error of `friction` [-], by noise and by drift."""
        return float(self._fit.deviation[0])

    def rebend(self, angles: FloatArray) -> None:
        """Use other wrap angles (n,) [rad] from now on, as of a path measured anew."""
        self._lay(np.concatenate([[0.0], np.cumsum(angles)])[:, None])

    def update(self, reading: ArrayLike, direction: ArrayLike) -> float:
        """Return the friction estimated with the readings of the next instant.

        `reading` is that of every sensor (m,) [N], `direction` the slip of every
        segment, -1, 0 or 1, (n,).
        """
        self._take(reading, direction)
        return self.friction

    def over(self, reading: FloatArray, direction: FloatArray) -> EstimateTrack:
        """Return estimates over readings (samples, m) [N], directions (samples, n)."""
        found = [
            (self.update(*row), self.deviation)
            for row in zip(reading, direction, strict=True)
        ]
        return EstimateTrack(*np.reshape(found, (-1, 2)).T)


AtRest = Literal["average", "hold"]
"""Treatment of nodes at rest: go on averaging, or hold as the thesis does."""


class TensionFusion:
    """Tensions of all nodes of a cable whose directions of slip are known (3.2.1).

    A node at rest keeps its tension. The thesis then keeps the estimate, with the error
    of the last moment of motion. Here further readings are averaged, as all are of the
    same tension, so that the error falls with the duration of rest. The tension at an
    end may change while the segment next to it still rests; a reading that differs too
    much from the average resets it.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        weights: Weights = "variance",
        at_rest: AtRest = "average",
    ) -> None:
        """Start from the pretension of a cable, whose friction must be Coulomb's alone.

        For `weights` see `fuse`. For nodes at rest, `at_rest="average"` averages
        further readings; `"hold"` keeps the estimate of the last moment of motion.
        """
        self.cable, self.mesh = cable, Mesh.of(cable)
        self.noise = np.array(sensors.deviation)
        self.weights: Weights = weights
        self.at_rest: AtRest = at_rest
        self._nodes = sensors.on(cable)
        self.reset()

    def reset(
        self,
        tension: FloatArray | None = None,
        deviation: float = UNKNOWN_DEVIATION,
        shape: tuple[int, ...] = (),
    ) -> None:
        """Reset the state, and set the leading axes of later readings to `shape`.

        `tension` is that of the nodes (..., n + 1) [N], by default the pretension, with
        independent errors of standard deviation `deviation` [N].
        """
        count = self.mesh.segments + 1
        start = self.cable.pretension if tension is None else tension
        self.tension = np.array(np.broadcast_to(start, (*shape, count)))
        spread = np.diag(np.full(count, deviation**2))
        self._covariance = np.array(np.broadcast_to(spread, (*shape, count, count)))

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the error of `tension` (..., n + 1) [N]."""
        variance = np.diagonal(self._covariance, axis1=-2, axis2=-1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def update(self, reading: ArrayLike, direction: ArrayLike) -> FloatArray:
        """Return the tension of every node (..., n + 1) [N] at the next instant.

        `reading` is that of every sensor (..., m) [N], `direction` the slip of every
        segment, -1, 0 or 1, (..., n).
        """
        reading, sign = (np.asarray(each, float) for each in (reading, direction))
        moves = np.zeros(self.tension.shape, dtype=bool)
        moves[..., :-1] |= sign != 0.0
        moves[..., 1:] |= sign != 0.0
        gain = tension_gains(self.mesh, sign, self._nodes)
        fused = fuse(reading, gain, self.noise, self.weights)
        found = moves & np.isfinite(fused.tension)
        self.tension = np.where(found, fused.tension, self.tension)
        # The errors of moving nodes are renewed, in one run all in proportion.
        deviation = np.where(found, fused.deviation, UNKNOWN_DEVIATION)
        run = cumulative_sums((sign == 0.0).astype(float))
        together = run[..., :, None] == run[..., None, :]
        together &= found[..., :, None] & found[..., None, :]
        together |= np.eye(self.mesh.segments + 1, dtype=bool)
        new = together * deviation[..., :, None] * deviation[..., None, :]
        either = moves[..., :, None] | moves[..., None, :]
        self._covariance = np.where(either, new, self._covariance)
        if self.at_rest == "average":
            self._average(reading, ~moves[..., self._nodes])
        return self.tension

    def over(self, reading: FloatArray, direction: FloatArray) -> Fused:
        """Return estimates (samples, ..., n + 1) over a recording."""
        found = [
            (self.update(*row), self.deviation)
            for row in zip(reading, direction, strict=True)
        ]
        whole = np.reshape(found, (-1, 2, *self.tension.shape))
        return Fused(whole[:, 0], whole[:, 1])

    def _average(self, reading: FloatArray, rests: NDArray[np.bool_]) -> None:
        """Apply a Kalman update for each sensor whose node rests.

        If a reading differs by more than 4 standard deviations, the node has moved
        after all, and its estimate is reset.
        """
        for sensor, node in enumerate(self._nodes):
            lack = reading[..., sensor] - self.tension[..., node]
            total = self._covariance[..., node, node] + self.noise[sensor] ** 2
            # Standard deviations by which a reading at rest may differ from the
            # estimate.
            moved = rests[..., sensor] & (lack**2 > 4.0**2 * total)
            self._covariance[..., node, :] *= ~moved[..., None]
            self._covariance[..., :, node] *= ~moved[..., None]
            self._covariance[..., node, node] += UNKNOWN_DEVIATION**2 * moved
            column = self._covariance[..., :, node]
            total = column[..., node] + self.noise[sensor] ** 2
            gain = column * (rests[..., sensor] / total)[..., None]
            self.tension = self.tension + gain * lack[..., None]
            self._covariance -= gain[..., :, None] * column[..., None, :]
