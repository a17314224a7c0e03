"""No compensation: the desired torque through the ideal ratio, friction unknown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._controller import Controller, readings
from cc_mujoco.native import FloatArray, compiled


class FeedForward(Controller):
    r"""No compensation: the desired torque is given as if without friction.

    \[ \tau_m = \tau_d / \rho \]

    with the desired joint torque \(\tau_d\) [N m] and the ratio \(\rho\) of the drive
    ("feed-forward only" of the thesis, section 4.3.1). It has no state. A desired
    torque that is no number, or beyond `guard.MAX_READING`, gives none.
    """

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    @property
    def gains(self) -> compiled_laws.FeedbackGains:
        """Present numbers of the law."""
        return compiled_laws.FeedbackGains(**guard.motor_limits(self.drive)._asdict())

    def torque(self, observation: Mapping[str, Any]) -> Any:
        desired = readings(observation, ("desired_torque_nm",))[:, 0]
        found = np.empty(desired.size)
        _torques(self.gains.packed, desired, found)
        numbers = np.ndim(observation["desired_torque_nm"]) == 0
        return float(found[0]) if numbers else found


@compiled
def _torques(gains: FloatArray, desired: FloatArray, found: FloatArray) -> None:
    for row in range(found.size):
        found[row] = 0.0
        if guard.is_reading(desired[row]):
            found[row] = compiled_laws.feed_forward(gains, desired[row])
