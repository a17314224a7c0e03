"""Friction update law that the thesis proposes (3.2.3), see `FrictionEstimator`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._parameters import PARAMETERS, Cable
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._tension_slope import require_slope
from cc_mujoco.estimation._tracks import checked_sample, wrap_angles

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

    Attributes:
        friction: the estimate.
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
        """Start from mu_0.

        Args:
            cable: as in `FrictionEstimator`.
            sensors: at least two.
            gain: k [1/N].
            start: mu_0; default the cable's friction.
            signed: multiply the gain by the direction of motion.
            integrated: add to the last value instead of to mu_0.

        Raises:
            CableError: fewer than two sensors, a gain that is not finite, a start
                out of bounds, or a cable that the law does not hold for.
        """
        require_slope(cable)
        if len(set(sensors.nodes)) < 2 or not np.isfinite(gain):
            raise CableError(
                f"gain is {gain!r} with {len(set(sensors.nodes))} sensors; "
                "it must be finite, with at least 2 sensors"
            )
        self._start = cable.friction if start is None else start
        if not _BOUNDS.low <= self._start <= _BOUNDS.high:
            raise CableError(
                f"start is {start!r}; friction must be {_BOUNDS.low:g} to "
                f"{_BOUNDS.high:g}"
            )
        self._nodes, self._gain = sensors.on(cable), gain
        self._signed, self._integrated = signed, integrated
        angle = wrap_angles(cable)
        self._segments = cable.segments
        self._before = angle[self._nodes]
        self._after = float(angle[-1]) - self._before
        along = self._nodes / cable.segments
        centred = along - np.mean(along)
        self._slope = centred / float(centred @ centred)
        self.reset()

    def reset(self) -> None:
        """Return to mu_0."""
        self.friction = self._start

    def discrepancy(self, reading: ArrayLike, slip_direction: float) -> float:
        """Return the difference between the ends, by the model less by the line [N].

        Args:
            reading: of every sensor (m,) [N].
            slip_direction: direction of motion of the whole cable.
        """
        told = np.asarray(reading, dtype=float)
        sign = slip_direction * self.friction
        ends = np.exp(-sign * self._before) - np.exp(sign * self._after)
        return float(np.mean(told * ends)) + float(self._slope @ told)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> float:
        """Update as `FrictionEstimator.update` does."""
        told, sign = checked_sample(
            reading, direction, self._nodes.size, self._segments
        )
        slip_direction = float(sign[0])
        if slip_direction != 0.0 and np.all(sign == slip_direction):
            base = self.friction if self._integrated else self._start
            turn = slip_direction if self._signed else 1.0
            step = turn * self._gain * self.discrepancy(told, slip_direction)
            self.friction = min(max(base + step, _BOUNDS.low), _BOUNDS.high)
        return self.friction
