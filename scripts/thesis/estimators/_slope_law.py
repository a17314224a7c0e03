"""Friction update law that the thesis proposes (3.2.3), see `FrictionEstimator`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._cable import PARAMETERS, Cable
from cc_mujoco.device._sensors import Sensors
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
        angle = wrap_angles(cable)
        self._segments = cable.segments
        self._before = angle[self._nodes]
        self._after = float(angle[-1]) - self._before
        along = self._nodes / cable.segments
        centred = along - np.mean(along)
        self._slope = centred / float(centred @ centred)

    def discrepancy(self, reading: ArrayLike, slip_direction: float) -> float:
        """Return the difference between the ends, by the model less by the line [N]."""
        measured = np.asarray(reading, dtype=float)
        sign = slip_direction * self.friction
        ends = np.exp(-sign * self._before) - np.exp(sign * self._after)
        return float(np.mean(measured * ends)) + float(self._slope @ measured)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> float:
        """Update as `FrictionEstimator.update` does."""
        measured, sign = checked_sample(
            reading, direction, self._nodes.size, self._segments
        )
        slip_direction = float(sign[0])
        if slip_direction != 0.0 and np.all(sign == slip_direction):
            base = self.friction if self._integrated else self._start
            turn = slip_direction if self._signed else 1.0
            step = turn * self._gain * self.discrepancy(measured, slip_direction)
            self.friction = min(max(base + step, _BOUNDS.low), _BOUNDS.high)
        return self.friction
