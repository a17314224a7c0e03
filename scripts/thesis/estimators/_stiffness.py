r"""Stiffness of a cable from one encoder, during partial motion (3.2.3).

    estimator = StiffnessEstimator(cable, sensors, start=3000.0)
    u_proximal = data.actuator("flexor_proximal").length[0]
    estimator.update(u_proximal, measured, reading.slip)    # in every physics step
    estimator.stiffness, estimator.deviation                # EA [N]

While the distal part of the cable stands still, all that the proximal end moves is
stretch of the part in between (2.16): with :math:`Y = \int T\,dx` up to that part,

.. math:: Y(t) = -EA\,u_0(t) + b,

where b is a constant of this spell of partial motion, unknown. The encoder is the clean
side and tensions the noisy one, so it is Y that is explained by :math:`u_0`; the other
way round noise in Y would make the cable look stiffer the less it is pulled. The
constant is taken out by comparing every sample with the mean of those before in the
spell (Helmert's contrasts, whose errors are independent), and recursive least squares
finds EA.

In mass motion the distal end takes part. Its displacement is unmeasured and would pass
for stretch, so such samples change nothing; nor do those in which the distal part slips
on its own. Directions must cover all the time between samples: call it in every step of
the model, for a slip that fell between two calls would pass for stretch too; and take
`u_proximal` of the same instant as the readings.

The integral is the trapezoidal rule over the sensors. It errs by the bend of the
tension at the front, by up to a quarter of (sensor spacing / length of the moving part)
squared, which is why the front must have passed `LEAST` sensors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.cable._parameter import Term
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._recursive import RecursiveLeastSquares
from cc_mujoco.estimation._tracks import EstimateTrack, checked_sample, rows
from cc_mujoco.native import FloatArray

LEAST = 4  # sensors, except that at node 0, that the front must have passed


class StiffnessEstimator:
    """Axial stiffness EA, followed while the cable runs."""

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        start: float | None = None,
        memory: float = 500.0,
        drift: float = 0.0,
    ) -> None:
        """Start from a guess, as uncertain as it is large.

        Args:
            cable: only its length and its segments count. Elasticity that changes must
                be off.
            sensors: one at node 0 and at least `LEAST` more along the cable; one at the
                distal end is not used.
            start: the guess [N]; default the cable's stiffness.
            memory: partially moving samples after which one has faded to 1/e.
            drift: standard deviation of the rate of drift, per such sample [N].
        """
        cable.require_terms(
            _has_stiffness, "what the proximal end moves is not stretch by EA then"
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
        self._fit = RecursiveLeastSquares([guess], [guess], memory, [drift])
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
        """Take encoder, readings and directions of the next instant.

        Args:
            u_proximal: displacement of the proximal end [m], from anywhere.
            reading: of every sensor (m,) [N].
            direction: slip of every segment, -1, 0 or 1, (n,).

        Returns:
            The estimate [N].
        """
        measured, sign = checked_sample(
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
            self._learn(pulled - self._mean_pull, moment - self._moment)
        self._count += 1
        self._mean_pull += (pulled - self._mean_pull) / self._count
        self._moment += (moment - self._moment) / self._count
        return self.stiffness

    def _learn(self, pulled: float, moment: float) -> None:
        """Take one contrast with the mean of the spell so far."""
        variance = self._variance * (1.0 + 1.0 / self._count)
        information: FloatArray = np.array([[pulled**2 / variance]])
        self._fit.update(information, np.array([pulled * moment / variance]))

    def over(
        self, u_proximal: ArrayLike, reading: ArrayLike, direction: ArrayLike
    ) -> EstimateTrack:
        """Run over a recording: (samples,) [m], (samples, m) [N], (samples, n)."""
        found = [
            (self.update(float(u), measured, sign), self.deviation)
            for u, measured, sign in rows(
                u_proximal=u_proximal, reading=reading, direction=direction
            )
        ]
        return EstimateTrack(*np.reshape(found, (-1, 2)).T)


def _has_stiffness(term: Term) -> bool:
    """Return whether (2.16) holds with one EA, whatever the friction."""
    return term.acts_on != "elasticity" or not term.depends_on
