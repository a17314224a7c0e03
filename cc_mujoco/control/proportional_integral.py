"""Proportional-integral feedback of the joint torque, with feed-forward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.checks import number
from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.control import laws
from cc_mujoco.control.controller import Controller, readings
from cc_mujoco.control.drive import Drive
from cc_mujoco.control.guard import UNLIMITED


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
        self._memory: FloatArray = np.zeros((1, laws.MEMORY))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Empty the integral; see `Controller.reset`."""
        if where is None:
            self._memory = np.zeros((1, laws.MEMORY))
        else:
            self.memory(np.size(where))[where] = 0.0

    @property
    def gains(self) -> laws.Gains:
        """The numbers of the law, as they are now."""
        drive = self.drive
        return laws.Gains(
            ratio=drive.ratio,
            low=drive.low,
            high=drive.high,
            period=drive.period,
            one_way=float(drive.one_way),
            feed_forward=float(self.feed_forward),
            proportional=self.proportional,
            integral=self.integral,
            safe_torque=min(drive.safe_torque, UNLIMITED),
        )

    def memory(self, rows: int) -> FloatArray:
        """What the law keeps of every environment (rows, `laws.MEMORY`)."""
        if len(self._memory) != rows:
            self._memory = np.tile(self._memory, (rows, 1))
        return self._memory

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        seen = readings(observation, ("desired_torque_nm", "joint_torque_nm"))
        memory, found = self.memory(len(seen)), np.empty(len(seen))
        _torques(self.gains.packed, memory, seen, found)
        numbers = np.ndim(observation["desired_torque_nm"]) == 0
        return float(found[0]) if numbers else found

    def closed(self, feedforward: Any, error: Any) -> Any:
        """Close the loop around a feed-forward.

        Args:
            feedforward: Motor torque that is fed forward [Nm].
            error: Desired less measured joint torque [Nm].

        Returns:
            Torque of the motor within its limits [Nm].
        """
        both = readings({"fed": feedforward, "error": error}, ("fed", "error"))
        found = np.empty(len(both))
        _closed(self.gains.packed, self.memory(len(both)), both, found)
        numbers = np.ndim(feedforward) == 0 and np.ndim(error) == 0
        return float(found[0]) if numbers else found


@compiled
def _torques(
    gains: FloatArray, memory: FloatArray, seen: FloatArray, found: FloatArray
) -> None:
    for row in range(found.size):
        desired, torque = seen[row, 0], seen[row, 1]
        found[row] = laws.proportional_integral(gains, memory[row], desired, torque)


@compiled
def _closed(
    gains: FloatArray, memory: FloatArray, both: FloatArray, found: FloatArray
) -> None:
    for row in range(found.size):
        found[row] = laws.closed(gains, memory[row], both[row, 0], both[row, 1])


class Feedback(ProportionalIntegral):
    """Feedback alone: proportional and integral, without feed-forward.

    The "model-free linear feedback controller" of the thesis, section 4.3.1.
    """

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        """Prepare for the first episode; see `ProportionalIntegral`."""
        super().__init__(drive, proportional, integral, feed_forward=False)
