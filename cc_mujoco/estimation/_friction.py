r"""Friction of a cable while it runs, from tension sensors along it (3.2.3).

    estimator = FrictionEstimator(cable, sensors, start=0.3)
    reading = cc_mujoco.read(model, data, "flexor")      # in an environment step
    estimator.update(measured, reading.slip)
    estimator.friction, estimator.deviation

    found = estimator.over(measured, log["slip_flexor_direction"])    # of a recording

Where the cable slips, :math:`\ln T` grows by :math:`s\mu` per radian of wrap: exactly,
at any friction, whatever the stiffness and the level of tension. So friction is the
slope of :math:`\ln T` against wrap angle, found by recursive least squares (`slope`,
`recursive`). Samples without a moving part that holds two sensors change nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco._utils.arguments import numbers, require_kind
from cc_mujoco._validation import require_number
from cc_mujoco.cable._parameters import Cable
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._recursive import RecursiveLeastSquares
from cc_mujoco.estimation._tension_slope import (
    SlopeEstimator,
    SlopeFit,
    require_bend_between,
)
from cc_mujoco.estimation._tracks import EstimateTrack, rows, wrap_angles


class FrictionEstimator(SlopeEstimator):
    """Kinetic friction coefficient mu_d, followed while the cable runs."""

    def __init__(
        self,
        cable: Cable,
        sensors: Sensors,
        *,
        start: float | None = None,
        spread: float = 0.2,
        memory: float = 500.0,
        drift: float = 0.0,
    ) -> None:
        """Start from a guess.

        Args:
            cable: the cable; only its wrap angles count. No term may be on for which
                the law does not hold, see `estimation._tension_slope.require_slope`.
            sensors: at least two.
            start: the guess; default the cable's friction.
            spread: standard deviation of the guess.
            memory: moving samples after which one has faded to 1/e. Noise goes down
                with its root; a drift lags by this many samples.
            drift: standard deviation of the rate of drift, per moving sample; it widens
                `deviation` by the lag.

        Raises:
            CableError: sensors or a cable that cannot tell, or a start, a spread or a
                memory that is none.
        """
        require_kind("cable", cable, Cable)
        require_kind("sensors", sensors, Sensors)
        guess = cable.friction if start is None else start
        require_number("start", guess, 0.0, 1e3, "")
        require_number("memory", memory, 1.0, 1e12, "samples")
        angle = wrap_angles(cable)
        require_bend_between(cable, sensors)
        fit = RecursiveLeastSquares([guess], [spread], memory, [drift])
        super().__init__(SlopeFit(cable, sensors, angle[:, None], fit, memory))
        self._segments = cable.segments

    @property
    def friction(self) -> float:
        """The estimate."""
        return float(self._slope.fit.value[0])

    @property
    def deviation(self) -> float:
        """Standard deviation of its error, by noise and by lag behind the drift."""
        return float(self._slope.fit.deviation[0])

    def rebend(self, angles: ArrayLike) -> None:
        """Take other wrap angles from now on: the path changed, and was measured.

        Args:
            angles: of every segment (n,) [rad].

        Raises:
            CableError: another shape, or an angle that is negative or not finite.
        """
        given = numbers(
            "the array of wrap angles", angles, (self._segments,), 1e6, "rad"
        )
        if np.any(given < 0.0):
            raise CableError(f"wrap angles are {given.min()} rad; none is less than 0")
        self._slope.lay(np.concatenate([[0.0], np.cumsum(given)])[:, None])

    def update(self, reading: ArrayLike, direction: ArrayLike) -> float:
        """Take the readings of the next instant.

        Args:
            reading: of every sensor (m,) [N].
            direction: slip of every segment, -1, 0 or 1, (n,).

        Returns:
            The estimate.

        Raises:
            CableError: shapes that fit neither the sensors nor the cable, a reading
                that is not finite, or another direction.
        """
        self._slope.update(reading, direction)
        return self.friction

    def over(self, reading: ArrayLike, direction: ArrayLike) -> EstimateTrack:
        """Run over a recording, from the present estimate on.

        Args:
            reading: (samples, m) [N].
            direction: (samples, n).

        Raises:
            CableError: unequal numbers of samples, or as `update`.
        """
        found = [
            (self.update(*row), self.deviation)
            for row in rows(reading=reading, direction=direction)
        ]
        return EstimateTrack(*np.reshape(found, (-1, 2)).T)
