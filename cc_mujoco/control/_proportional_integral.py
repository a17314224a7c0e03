"""Proportional-integral feedback of the joint torque, with feed-forward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.compilation import FloatArray, compiled
from cc_mujoco._validation import require_number
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control._cable_model import joint_stiffness
from cc_mujoco.control._controller import Controller, readings
from cc_mujoco.control._guard import MAX_DAMPING_SHARE, NO_TORQUE_LIMIT, RELEASE_TIME
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS

_TORQUE_COLUMNS = compiled_laws.LAW_INPUTS[compiled_laws.TORQUE :]
"""Columns that the law reads, but for its guard."""


class ProportionalIntegral(Controller):
    r"""Feedback of the joint torque, proportional and integral, and feed-forward.

    \[ \tau_m = \frac{1}{\rho} \Bigl( f \tau_d + K_p e + K_i \int e \, dt \Bigr),
       \qquad e = \tau_d - \tau_j \]

    with the desired and the measured joint torque \(\tau_d, \tau_j\) [N m], the ratio
    \(\rho\) of the drive and \(f\) = 1 with feed-forward, 0 without. The gains are
    those of the thesis, section 4.3.1: \(K_p\) = 1, \(K_i\) = 2 / s; with them both
    devices of this package are stable at 1 kHz, inertia and stretch included.

    Anti-windup by clamping: while the motor is at a limit, the integral does not move
    further beyond; and where cables only pull, the integral never takes more than what
    is fed forward. It would pay out cable for as long as friction holds back some
    tension, and the motor would then have to catch the slack at speed.

    Where a safe torque is known, the `guard` lets a joint go that is pulled too far:
    the motor then follows the joint by a damper, and the integral begins anew.
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
        require_number("proportional", proportional, 0.0, 1e6, "")
        require_number("integral", integral, 0.0, 1e6, "1/s")
        self.proportional = proportional
        self.integral = integral
        self.feed_forward = feed_forward
        known = drive.cable_drives
        self.stiffness = np.array([joint_stiffness(row) for row in known] or [0.0])
        """Stiffness of all cables at the joint, one for all environments or one each; 0
        where the cables are not known [N m/rad]."""
        self.settling = stable_settling_time(drive, self.stiffness)
        """Time in which the motor settles relative to the joint [s]; without a model
        only while the guard lets go."""
        self._memory: FloatArray = np.zeros((1, compiled_laws.MEMORY_SIZE))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Empty the integral; see `Controller.reset`."""
        if where is None:
            self._memory = np.zeros((1, compiled_laws.MEMORY_SIZE))
        else:
            self.memory(np.size(where))[where] = 0.0

    @property
    def gains(self) -> compiled_laws.FeedbackGains:
        """The numbers of the law, as they are now."""
        drive = self.drive
        return compiled_laws.FeedbackGains(
            ratio=drive.ratio,
            low=drive.low,
            high=drive.high,
            period=drive.period,
            one_way=float(drive.one_way),
            feed_forward=float(self.feed_forward),
            proportional=self.proportional,
            integral=self.integral,
            safe_torque=min(drive.safe_torque, NO_TORQUE_LIMIT),
            settling=self.settling,
            inertia=drive.inertia,
            stiffness=float(self.stiffness[0]),
        )

    def memory(self, rows: int) -> FloatArray:
        """Return the memory of the law, a row per environment (rows, `MEMORY_SIZE`)."""
        if len(self._memory) != rows:
            self._memory = np.tile(self._memory, (rows, 1))
        return self._memory

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`."""
        # Without a safe torque there is no guard, which alone reads velocities.
        names = (
            compiled_laws.LAW_INPUTS
            if self.drive.safe_torque < math.inf
            else _TORQUE_COLUMNS
        )
        part = readings(_with_cable_velocity(observation), names)
        seen = np.zeros((len(part), len(compiled_laws.LAW_INPUTS)))
        seen[:, -len(names) :] = part
        found = self.answer(seen)
        numbers = np.ndim(observation["desired_torque_nm"]) == 0
        return float(found[0]) if numbers else found

    def answer(self, seen: FloatArray) -> FloatArray:
        """Return the torque of the motor (rows,) [N m].

        Args:
            seen: What is measured (rows, `_compiled_laws.LAW_INPUTS`).
        """
        found = np.empty(len(seen))
        stiffness = np.full(len(seen), self.stiffness)
        _torques(self.gains.packed, stiffness, self.memory(len(seen)), seen, found)
        return found

    def closed(self, feedforward: Any, error: Any) -> Any:
        """Close the loop around a feed-forward.

        Args:
            feedforward: Motor torque that is fed forward [N m].
            error: Desired less measured joint torque [N m].

        Returns:
            Torque of the motor within its limits [N m].
        """
        both = readings({"fed": feedforward, "error": error}, ("fed", "error"))
        found = np.empty(len(both))
        _closed_loop_torques(self.gains.packed, self.memory(len(both)), both, found)
        numbers = np.ndim(feedforward) == 0 and np.ndim(error) == 0
        return float(found[0]) if numbers else found


def _with_cable_velocity(observation: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the measurements, with the joint's velocity as the cables see it.

    Of a lever, or of cables that other joints wind, see
    `device.WINDING_COLUMNS`.
    """
    if WINDING_COLUMNS[1] not in observation:
        return observation
    return {**observation, "joint_velocity_rad_s": observation[WINDING_COLUMNS[1]]}


def stable_settling_time(
    drive: Drive, stiffness: ArrayLike, settling: float = RELEASE_TIME
) -> float:
    """Return a time in which a damped motor settles that is stable [s].

    Args:
        drive: The device.
        stiffness: Of all cables at the joint, one or one each [N m/rad].
        settling: The time that is wanted [s].
    """
    stiffest = float(np.max(stiffness))
    if not (drive.inertia > 0.0 and stiffest > 0.0):
        return settling
    # A damper sampled this slowly would drive the motor, not calm it.
    most = MAX_DAMPING_SHARE * drive.inertia / (drive.period + drive.motor_lag)
    at_motor = stiffest / drive.ratio**2
    return min(settling, most / at_motor)


@compiled
def _torques(
    gains: FloatArray,
    stiffness: FloatArray,
    memory: FloatArray,
    seen: FloatArray,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = compiled_laws.guarded_torque(
            gains, stiffness[row], memory[row], seen[row]
        )


@compiled
def _closed_loop_torques(
    gains: FloatArray, memory: FloatArray, both: FloatArray, found: FloatArray
) -> None:
    for row in range(found.size):
        found[row] = compiled_laws.closed_loop_torque(
            gains, memory[row], both[row, 0], both[row, 1]
        )


class Feedback(ProportionalIntegral):
    """Feedback alone: proportional and integral, without feed-forward.

    The "model-free linear feedback controller" of the thesis, section 4.3.1.
    """

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        """Prepare for the first episode; see `ProportionalIntegral`."""
        super().__init__(drive, proportional, integral, feed_forward=False)
