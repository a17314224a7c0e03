r"""Parameters of a cable, followed while it runs (3.2.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from cc_mujoco.cable._cable import PARAMETERS, Cable
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._recursive import RecursiveEstimate
from cc_mujoco.estimation._tension_slope import SlopeEstimator
from cc_mujoco.estimation._tracks import EstimateTrack, wrap_angles
from cc_mujoco.native import FloatArray

_BOUNDS = next(p for p in PARAMETERS if p.name == "friction")


def slope_law(
    cable: Cable,
    sensors: Sensors,
    rows: tuple[FloatArray, FloatArray],
    gain: float,
    start: float,
    *,
    signed: bool = False,
    integrated: bool = False,
) -> FloatArray:
    r"""Return friction by the update law that the thesis proposes, (samples,) (3.2.3).

    :math:`\mu = \mu_0 + k\,\mathrm{mean}((T_1 - T_N)_{extrap} - (T_1 - T_N)_{fit})`,
    where the whole cable moves one way. The rows are readings (samples, m) [N] and
    directions (samples, n); the gain is k [1/N].

    As printed its sign suits one direction of motion only, since :math:`T_1 - T_N`
    changes sign with it; and it returns to :math:`\mu_0` where the slopes agree, so it
    keeps an error of at least half of the first one: with a larger gain it oscillates
    and diverges. `signed` turns the sign with the motion, `integrated` takes the value
    before for :math:`\mu_0`. What then remains is that a straight line is not the
    profile. Estimates are kept within the bounds of the cable's parameter.
    """
    angle, nodes = wrap_angles(cable), sensors.on(cable)
    before = angle[nodes]
    after = float(angle[-1]) - before
    centred = nodes / cable.segments - np.mean(nodes / cable.segments)
    slope = centred / float(centred @ centred)
    friction, track = start, []
    for reading, sign in zip(*rows, strict=True):
        way = float(sign[0])
        if way != 0.0 and np.all(sign == way):
            ends = np.exp(-way * friction * before) - np.exp(way * friction * after)
            discrepancy = np.mean(reading * ends) + slope @ reading
            step = (way if signed else 1.0) * gain * float(discrepancy)
            base = friction if integrated else start
            friction = min(max(base + step, _BOUNDS.low), _BOUNDS.high)
        track.append(friction)
    return np.array(track)


class RecursiveLeastSquares:
    r"""Least squares of parameters that forgets only where something new is learnt.

    The information of the data, S in addition to that of the start :math:`R_0`, fades
    only in the directions V in which the new sample informs (after Cao and Schwartz,
    Automatica 36, 2000),

    .. math::
        S' = S - (1 - \lambda) S V (V^T (R_0 + S) V)^{-1} V^T S.

    Otherwise it is `estimation._recursive.RecursiveEstimate`, of several parameters.

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


class BendEstimator(SlopeEstimator):
    r"""mu/R along the cable as a cubic spline of four equal pieces.

    Equation 2.13 holds mu and R only as :math:`\mu/R`; where the bend is unknown
    their quotient is what can be found: it is :math:`s\,d\ln T/dx` of a moving part. It
    is written as a spline; the logarithm of tension is then linear in its coefficients,
    with the integrals of the basis functions as rows, and recursive least squares does
    the rest. What no moving pair of sensors spans keeps its value and its uncertainty.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        start: float,
        memory: float = 1000.0,
        drift: float = 0.0,
    ) -> None:
        """Start from a uniform guess of mu/R [1/m], as uncertain as it is large.

        A moving sample has faded to 1/e after `memory` more; `drift` is the standard
        deviation of the rate of drift, per moving sample [1/m].
        """
        length = cable.length
        knots = np.concatenate([[0.0] * 3, np.linspace(0.0, length, 5), [length] * 3])
        self._basis = BSpline(knots, np.eye(7), 3)
        integral = self._basis.antiderivative()
        design = np.asarray(integral(node_places(cable)) - integral(0.0))
        guess = np.full(7, start)
        fit = RecursiveLeastSquares(guess, guess, memory, drift)
        super().__init__(cable, sensors, design, fit, memory)

    def over(
        self, reading: ArrayLike, direction: ArrayLike, position: ArrayLike
    ) -> EstimateTrack:
        """Return mu/R (samples, k) [1/m] at k places [m] over a recording."""
        design = np.asarray(self._basis(np.asarray(position, dtype=float)))
        found = []
        for row in zip(np.asarray(reading), np.asarray(direction), strict=True):
            self._take(*row)
            variance = np.einsum("ki,ij,kj->k", design, self._fit.covariance, design)
            found.append((design @ self._fit.value, np.sqrt(np.maximum(variance, 0.0))))
        return EstimateTrack(*np.swapaxes(found, 0, 1))


LEAST = 4  # sensors, except that at node 0, that the front must have passed


class StiffnessEstimator:
    r"""Axial stiffness EA from one encoder, during partial motion.

    While the distal part of the cable stands still, all that the proximal end moves is
    stretch of the part in between (2.16): with :math:`Y = \int T\,dx` up to that part,

    .. math:: Y(t) = -EA\,u_0(t) + b,

    where b is a constant of this spell of partial motion, unknown. The encoder is the
    clean side and tensions the noisy one, so it is Y that is explained by :math:`u_0`;
    the other way round noise in Y would make the cable look stiffer the less it is
    pulled. The constant is taken out by comparing every sample with the mean of those
    before in the spell (Helmert's contrasts, whose errors are independent), and
    recursive least squares finds EA.

    In mass motion the distal end takes part. Its displacement is unmeasured and would
    pass for stretch, so such samples change nothing; nor do those in which the distal
    part slips on its own. Of the quadrature over the sensors remains an error that
    falls with the square of their distance.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        start: float,
        memory: float = 500.0,
        drift: float = 0.0,
    ) -> None:
        """Start from a guess [N] as uncertain as it is large.

        One sensor is at node 0 and at least `LEAST` more along the cable, in order; one
        at the distal end is not used. A partially moving sample has faded to 1/e after
        `memory` more; `drift` is the standard deviation of the rate of drift, per such
        sample [N]. Elasticity that changes must be off.
        """
        # (2.16) holds with one EA, whatever the friction.
        cable.require_terms(
            lambda term: term.acts_on != "elasticity" or not term.depends_on,
            "what the proximal end moves is not stretch by EA then",
        )
        nodes = sensors.on(cable)
        inner = nodes[nodes < cable.segments]
        self._used = inner.size
        self._reach = (int(inner[LEAST]), int(inner[-1]))
        gap = np.diff(node_places(cable)[inner])
        self._share = np.zeros(inner.size)
        self._share[:-1] += 0.5 * gap
        self._share[1:] += 0.5 * gap
        deviation = np.array(sensors.deviation)[: inner.size]
        self._variance = float(np.sum((self._share * deviation) ** 2))
        self._memory = memory
        self._fit = RecursiveEstimate(start, start, memory, drift)
        self._end_spell()

    def _end_spell(self) -> None:
        """End the period, since the later motion of the distal end is unknown."""
        self._count, self._mean_pull, self._moment = 0, 0.0, 0.0

    def update(self, u_proximal: float, reading: FloatArray, sign: FloatArray) -> None:
        """Take the next displacement [m], readings (m,) [N] and directions (n,)."""
        front = int(np.count_nonzero(sign))
        partial = front < sign.size and bool(np.all(sign[:front] * sign[0] > 0.0))
        if not partial or front > self._reach[1]:
            self._end_spell()
            return
        if self._count >= self._memory:
            self._end_spell()  # the mean must not be older than what is remembered
        if 0 < front < self._reach[0]:
            return
        pulled = -float(u_proximal)
        moment = float(self._share @ reading[: self._used])
        if front > 0 and self._count > 0:
            # One contrast with the mean of the spell so far.
            apart, more = pulled - self._mean_pull, moment - self._moment
            variance = self._variance * (1.0 + 1.0 / self._count)
            information = np.array([[apart**2 / variance]])
            self._fit.update(information, np.array([apart * more / variance]))
        self._count += 1
        self._mean_pull += (pulled - self._mean_pull) / self._count
        self._moment += (moment - self._moment) / self._count

    def over(
        self, u_proximal: FloatArray, reading: FloatArray, direction: FloatArray
    ) -> EstimateTrack:
        """Run over a recording: (samples,) [m], (samples, m) [N], (samples, n)."""
        found = []
        for row in zip(u_proximal, reading, direction, strict=True):
            self.update(*row)
            found.append((float(self._fit.value[0]), float(self._fit.deviation[0])))
        return EstimateTrack(*np.reshape(found, (-1, 2)).T)
