"""No compensation: the desired torque through the ideal ratio, friction unknown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control.controller import Controller


class FeedForward(Controller):
    r"""No compensation: the motor gives the desired torque as if nothing rubbed.

    \[ \tau_m = \tau_d / \rho \]

    with the desired joint torque \(\tau_d\) [Nm] and the ratio \(\rho\) of the drive
    ("feed-forward only" of the thesis, section 4.3.1). It has no state.
    """

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        return self.limited(observation["desired_torque_nm"] / self.drive.ratio)
