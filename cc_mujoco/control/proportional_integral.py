"""Proportional-integral feedback of the joint torque, with feed-forward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.checks import number
from cc_mujoco.control.controller import Controller
from cc_mujoco.control.drive import Drive


class ProportionalIntegral(Controller):
    r"""Feedback of the joint torque, proportional and integral, and feed-forward.

    \[ \tau_m = \frac{1}{\rho} \Bigl( f \tau_d + K_p e + K_i \int e \, dt \Bigr),
       \qquad e = \tau_d - \tau_j \]

    with the desired and the measured joint torque \(\tau_d, \tau_j\) [Nm], the ratio
    \(\rho\) of the drive and \(f\) = 1 with feed-forward, 0 without. The gains are
    those of the thesis, section 4.3.1: \(K_p\) = 1, \(K_i\) = 2 / s; with them both
    devices of this package are stable at 1 kHz, inertia and stretch included.

    Anti-windup by clamping: while the motor is at a limit, the integral does not move
    further beyond; and where cables only pull, the integral never takes more than what
    is fed forward. It would pay out cable for as long as friction holds back some
    tension, and the motor would then have to catch the slack at speed.
    """

    def __init__(
        self,
        drive: Drive,
        proportional: float = 1.0,
        integral: float = 2.0,
        feed_forward: bool = True,
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven.
            proportional: Kp [-].
            integral: Ki [1/s].
            feed_forward: Whether the desired torque is fed forward.

        Raises:
            CableError: If a gain is negative or not a number.
        """
        super().__init__(drive)
        number("proportional", proportional, 0.0, 1e6, "")
        number("integral", integral, 0.0, 1e6, "1/s")
        self.proportional = proportional
        self.integral = integral
        self.feed_forward = feed_forward
        self._sum: Any = 0.0

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Empty the integral; see `Controller.reset`."""
        self._sum = 0.0 if where is None else np.where(where, 0.0, self._sum)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        desired = observation["desired_torque_nm"]
        feedforward = desired / self.drive.ratio if self.feed_forward else 0.0
        return self.closed(feedforward, desired - observation["joint_torque_nm"])

    def closed(self, feedforward: Any, error: Any) -> Any:
        """Close the loop around a feed-forward.

        Args:
            feedforward: Motor torque that is fed forward [Nm].
            error: Desired less measured joint torque [Nm].

        Returns:
            Torque of the motor within its limits [Nm].
        """
        drive = self.drive
        following = self._sum + self.integral * drive.period * error / drive.ratio
        if drive.one_way:
            following = np.maximum(following, -np.maximum(feedforward, 0.0))
        torque = feedforward + self.proportional * error / drive.ratio + following
        limited = self.limited(torque)
        # Beyond a limit, and the error would push further.
        winding = (torque - limited) * (error / drive.ratio) > 0.0
        self._sum = np.where(winding, self._sum, following)
        return limited


class Feedback(ProportionalIntegral):
    """Feedback alone: proportional and integral, without feed-forward.

    The "model-free linear feedback controller" of the thesis, section 4.3.1.
    """

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        """Prepare for the first episode; see `ProportionalIntegral`."""
        super().__init__(drive, proportional, integral, feed_forward=False)
