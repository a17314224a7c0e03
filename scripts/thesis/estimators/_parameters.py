r"""Parameters of a cable, followed while it runs (3.2.3).

estimator = BendEstimator(cable, sensors)
estimator.update(measured, reading.slip)          # in an environment step
estimator.at([0.3, 1.0])                          # value and deviation [1/m]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.cable._cable import PARAMETERS, Cable
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation import _tracks as tracks
from cc_mujoco.estimation._recursive import RecursiveEstimate
from cc_mujoco.estimation._tension_slope import SlopeEstimator, require_slope
from cc_mujoco.native import FloatArray

_BOUNDS = next(p for p in PARAMETERS if p.name == "friction")


class SlopeLaw:
    r"""The update law that the thesis proposes, literally (3.2.3).

    :math:`\mu = \mu_0 + k\,\mathrm{mean}((T_1 - T_N)_{extrap} - (T_1 - T_N)_{fit})`:
    every sensor's reading is carried to both ends by the model with the present
    :math:`\mu`, the fit is a straight line through the readings. It acts while the
    whole cable moves one way.

    As printed its sign suits one direction of motion only, since :math:`T_1 - T_N`
    changes sign with it; and it returns to :math:`\mu_0` where the slopes agree, so it
    keeps an error of at least half of the first one: with a larger gain it oscillates
    and diverges. `signed` turns the sign with the motion, `integrated` takes the value
    before for :math:`\mu_0`. What then remains is that a straight line is not the
    profile. Estimates are kept within the bounds of the cable's parameter.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        gain: float,
        *,
        start: float | None = None,
        signed: bool = False,
        integrated: bool = False,
    ) -> None:
        """Start from mu_0, by default the cable's, with the gain k [1/N]."""
        require_slope(cable)
        self._start = self.friction = cable.friction if start is None else start
        self._nodes, self._gain = sensors.on(cable), gain
        self._signed, self._integrated = signed, integrated
        angle = tracks.wrap_angles(cable)
        self._segments = cable.segments
        self._before = angle[self._nodes]
        self._after = float(angle[-1]) - self._before
        along = self._nodes / cable.segments
        centred = along - np.mean(along)
        self._slope = centred / float(centred @ centred)

    def discrepancy(self, reading: ArrayLike, slip_direction: float) -> float:
        """Return the tension difference of the ends by model less that by line [N]."""
        measured = np.asarray(reading, dtype=float)
        sign = slip_direction * self.friction
        ends = np.exp(-sign * self._before) - np.exp(sign * self._after)
        return float(np.mean(measured * ends)) + float(self._slope @ measured)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> float:
        """Return friction after a sample, see `FrictionEstimator.update`."""
        measured, sign = tracks.checked_sample(
            reading, direction, self._nodes.size, self._segments
        )
        slip_direction = float(sign[0])
        if slip_direction != 0.0 and np.all(sign == slip_direction):
            base = self.friction if self._integrated else self._start
            turn = slip_direction if self._signed else 1.0
            step = turn * self._gain * self.discrepancy(measured, slip_direction)
            self.friction = min(max(base + step, _BOUNDS.low), _BOUNDS.high)
        return self.friction


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


class Bend(NamedTuple):
    """Estimate of mu/R at places along the cable [1/m]."""

    value: FloatArray  # [1/m]
    deviation: FloatArray  # standard deviation of its error [1/m]


class BendEstimator(SlopeEstimator):
    r"""mu/R along the cable as a spline.

    Equation 2.13 holds mu and R only as :math:`\mu/R`; where the bend is unknown
    their quotient is what can be found: it is :math:`s\,d\ln T/dx` of a moving part. It
    is written as a spline; the logarithm of tension is then linear in its coefficients,
    with the integrals of the basis functions as rows, and recursive least squares does
    the rest. What no moving pair of sensors spans keeps its value and its uncertainty.
    Nothing forces the estimate to be positive.
    """

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
        """Start from the cable's parameters, or from a guess of mu/R (n,) [1/m].

        No term may be on for which the law does not hold, see
        `estimation._tension_slope.require_slope`. Between two sensors that are
        neighbours only the mean is determined. The spline has `pieces` equal intervals,
        of degree 3 where the bend varies smoothly, of degree 0 (a value per interval)
        where straight and bent parts meet. Its coefficients, local means, deviate from
        the guess by `spread` [1/m], by default the largest value of the guess. A moving
        sample has faded to 1/e after `memory` more; `drift` is the standard deviation
        of the rate of drift, per moving sample [1/m].
        """
        n, self.length = cable.segments, cable.length
        places = node_places(cable)
        guess = cable.friction * np.diff(tracks.wrap_angles(cable)) / np.diff(places)
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
        super().__init__(cable, sensors, design, fit, memory)

    @exclusive
    def update(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Use the sensors' readings (m,) [N] and the segments' slip (n,)."""
        self._take(reading, direction)

    def at(self, position: ArrayLike) -> Bend:
        """Return the estimate at places [m] from the proximal end."""
        place = np.asarray(position, dtype=float)
        if not np.all((place >= 0.0) & (place <= self.length)):
            raise CableError(
                f"position is {place.tolist()} m; the cable has {self.length:g} m"
            )
        design = np.asarray(self._basis(place))
        fit = self._fit
        variance = np.einsum("...i,ij,...j->...", design, fit.covariance, design)
        return Bend(design @ fit.value, np.sqrt(np.maximum(variance, 0.0)))

    def over(
        self, reading: ArrayLike, direction: ArrayLike, position: ArrayLike
    ) -> Bend:
        """Return the estimates (samples, k) at k places over a recording."""
        place = np.atleast_1d(np.asarray(position, dtype=float))
        found = []
        for row in tracks.rows(reading=reading, direction=direction):
            self.update(*row)
            found.append(self.at(place))
        return Bend(*np.reshape(found, (-1, 2, place.size)).swapaxes(0, 1))


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
    part slips on its own. Directions must cover all the time between samples: call it
    in every step of the model, for a slip that fell between two calls would pass for
    stretch too; and take `u_proximal` of the same instant as the readings.

    The integral is the trapezoidal rule over the sensors. It errs by the bend of the
    tension at the front, by up to a quarter of (sensor spacing / length of the moving
    part) squared, which is why the front must have passed `LEAST` sensors.
    """

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        start: float | None = None,
        memory: float = 500.0,
        drift: float = 0.0,
    ) -> None:
        """Start from a guess [N], the cable's stiffness, as uncertain as it is large.

        Of the cable its length and its segments count; elasticity that changes must be
        off. One sensor is at node 0 and at least `LEAST` more along the cable; one at
        the distal end is not used. A partially moving sample has faded to 1/e after
        `memory` more; `drift` is the standard deviation of the rate of drift, per such
        sample [N].
        """
        # (2.16) holds with one EA, whatever the friction.
        cable.require_terms(
            lambda term: term.acts_on != "elasticity" or not term.depends_on,
            "what the proximal end moves is not stretch by EA then",
        )
        guess = cable.axial_stiffness if start is None else start
        nodes = sensors.on(cable)
        order = np.argsort(nodes)
        used = order[nodes[order] < cable.segments]
        inner = nodes[used]
        if inner.size <= LEAST or inner[0] != 0 or np.any(np.diff(inner) == 0):
            raise CableError(
                f"sensors are at nodes {list(sensors.nodes)}; stiffness takes one at "
                f"node 0 and at least {LEAST} more, none twice, before the distal end"
            )
        self._segments, self._sensors, self._used = cable.segments, nodes.size, used
        self._reach = (int(inner[LEAST]), int(inner[-1]))
        gap = np.diff(node_places(cable)[inner])
        self._share = np.zeros(inner.size)
        self._share[:-1] += 0.5 * gap
        self._share[1:] += 0.5 * gap
        deviation = np.array(sensors.deviation)[used]
        self._variance = float(np.sum((self._share * deviation) ** 2))
        self._memory = memory
        self._fit = RecursiveEstimate(guess, guess, memory, drift)
        self._end_spell()

    def _end_spell(self) -> None:
        """End the period, since the later motion of the distal end is unknown."""
        self._count, self._mean_pull, self._moment = 0, 0.0, 0.0

    @property
    def stiffness(self) -> float:
        """The estimate of EA [N]."""
        return float(self._fit.value[0])

    @property
    def deviation(self) -> float:
        """Standard deviation of its error, by noise and by lag behind the drift [N]."""
        return float(self._fit.deviation[0])

    def update(
        self, u_proximal: float, reading: ArrayLike, direction: ArrayLike
    ) -> float:
        """Take the next displacement, readings, directions; return the estimate [N].

        The displacement is that of the proximal end [m], from anywhere; sensors read
        (m,) [N], and segments slip by -1, 0 or 1 (n,).
        """
        measured, sign = tracks.checked_sample(
            reading, direction, self._sensors, self._segments
        )
        front = int(np.count_nonzero(sign))
        partial = front < sign.size and bool(np.all(sign[:front] * sign[0] > 0.0))
        if not partial or front > self._reach[1]:
            self._end_spell()
            return self.stiffness
        if self._count >= self._memory:
            self._end_spell()  # the mean must not be older than what is remembered
        if 0 < front < self._reach[0]:
            return self.stiffness
        pulled = -float(u_proximal)
        moment = float(self._share @ measured[self._used])
        if front > 0 and self._count > 0:
            # One contrast with the mean of the spell so far.
            apart, more = pulled - self._mean_pull, moment - self._moment
            variance = self._variance * (1.0 + 1.0 / self._count)
            information = np.array([[apart**2 / variance]])
            self._fit.update(information, np.array([apart * more / variance]))
        self._count += 1
        self._mean_pull += (pulled - self._mean_pull) / self._count
        self._moment += (moment - self._moment) / self._count
        return self.stiffness

    def over(
        self, u_proximal: ArrayLike, reading: ArrayLike, direction: ArrayLike
    ) -> tracks.EstimateTrack:
        """Run over a recording: (samples,) [m], (samples, m) [N], (samples, n)."""
        found = [
            (self.update(float(u), measured, sign), self.deviation)
            for u, measured, sign in tracks.rows(
                u_proximal=u_proximal, reading=reading, direction=direction
            )
        ]
        return tracks.EstimateTrack(*np.reshape(found, (-1, 2)).T)
