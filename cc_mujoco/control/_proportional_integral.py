"""Proportional-integral feedback of the joint torque, with feed-forward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_spring
from cc_mujoco.control._controller import Controller, readings
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

_TORQUE_COLUMNS = compiled_laws.LAW_INPUTS[compiled_laws.TORQUE :]
"""Columns that the law reads, without those of its guard."""


class ProportionalIntegral(Controller):
    r"""Feedback of the joint torque, proportional and integral, and feed-forward.

    \[ \tau_m = \frac{1}{\rho} \Bigl( f \tau_d + K_p e + K_i \int e \, dt \Bigr),
       \qquad e = \tau_d - \tau_j \]

    with the desired and the measured joint torque \(\tau_d, \tau_j\) [N m], the ratio
    \(\rho\) of the drive and \(f\) = 1 with feed-forward, 0 without. The gains are
    those of the thesis, section 4.3.1: \(K_p\) = 1, \(K_i\) = 2 / s; with them both
    devices of this package are stable at 1 kHz, inertia and stretch included.

    Anti-windup by clamping: while the motor is at a limit, the integral does not grow
    beyond; and where cables only pull, the integral never takes more than the
    feed-forward. It would pay out cable for as long as friction holds back some
    tension, and the motor would then have to take up the slack at speed.

    Where a safe torque is known, the `guard` releases a joint with too large a torque:
    the motor then follows the joint by a damper, and the integral restarts.
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
        self._limits = guard.motor_limits(drive)._asdict()
        self.spring = joint_spring(drive.cables)
        """All cables as a spring at the joint, see `guard.STIFFNESS`; 0 where they are
        not known."""
        self.settling = stable_settling_time(drive, self.spring)
        """Time in which the motor settles relative to the joint [s]; without a model
        only while the guard releases the joint."""
        self._memory: FloatArray = np.zeros((1, compiled_laws.MEMORY_SIZE))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._memory = np.zeros((1, compiled_laws.MEMORY_SIZE))
        else:
            self.memory(np.size(where))[where] = 0.0

    def given(self, torque: Any) -> None:
        kept = self._memory[:, compiled_laws.GUARD + guard.COMMAND]
        np.copyto(kept, torque, where=guard.is_heard(torque))

    @property
    def gains(self) -> compiled_laws.FeedbackGains:
        """Present numbers of the law."""
        return compiled_laws.FeedbackGains(
            **self._limits,
            feed_forward=float(self.feed_forward),
            proportional=self.proportional,
            integral=self.integral,
            settling=self.settling,
            stiffness=float(self.spring[guard.STIFFNESS]),
            rest_torque=float(self.spring[guard.REST]),
            wrap_friction=float(self.spring[guard.FRICTION]),
        )

    def memory(self, rows: int) -> FloatArray:
        """Return the memory of the law, a row per environment (rows, `MEMORY_SIZE`)."""
        if len(self._memory) != rows:
            self._memory = np.tile(self._memory, (rows, 1))
        return self._memory

    def torque(self, observation: Mapping[str, Any]) -> Any:
        # Without a safe torque there is no guard, which alone reads angles.
        names = (
            compiled_laws.LAW_INPUTS
            if self.drive.safe_torque < math.inf
            else _TORQUE_COLUMNS
        )
        part = readings(_with_cable_motion(observation), names)
        seen = np.zeros((len(part), len(compiled_laws.LAW_INPUTS)))
        seen[:, -len(names) :] = part
        self.admit(seen)
        found = self.answer(seen)
        numbers = np.ndim(observation["desired_torque_nm"]) == 0
        return float(found[0]) if numbers else found

    def admit(self, seen: FloatArray) -> None:
        """Have the guard check measurements, and replace them where needed.

        They are (rows, `_compiled_laws.LAW_INPUTS`), changed in place.
        """
        _admit(self.gains.packed, self.spring, self.memory(len(seen)), seen)

    def answer(self, seen: FloatArray) -> FloatArray:
        """Return the torque of the motor (rows,) [N m]; `seen` is after `admit`."""
        found = np.empty(len(seen))
        _torques(self.gains.packed, self.spring, self.memory(len(seen)), seen, found)
        return found

    def closed(self, feedforward: Any, error: Any) -> Any:
        """Return the limited motor torque of the loop around a feed-forward [N m].

        `error` is the desired less the measured joint torque [N m].
        """
        both = readings({"fed": feedforward, "error": error}, ("fed", "error"))
        found = np.empty(len(both))
        _closed_loop_torques(self.gains.packed, self.memory(len(both)), both, found)
        numbers = np.ndim(feedforward) == 0 and np.ndim(error) == 0
        return float(found[0]) if numbers else found


def _with_cable_motion(observation: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the measurements, with the joint's motion as it moves the cables.

    For levers and cables that other joints wind, see `device.WINDING_COLUMNS`.
    """
    if WINDING_COLUMNS[1] not in observation:
        return observation
    angle, velocity = (observation[name] for name in WINDING_COLUMNS[:2])
    return {**observation, "joint_angle_rad": angle, "joint_velocity_rad_s": velocity}


def stable_settling_time(
    drive: Drive, spring: FloatArray, settling: float = guard.RELEASE_TIME
) -> float:
    """Return a stable time in which a damped motor settles, near the wanted one [s].

    `spring` is of all cables at the joint.
    """
    stiffness = float(spring[guard.STIFFNESS])
    if not (drive.inertia > 0.0 and stiffness > 0.0):
        return settling
    # A damper sampled this slowly would drive the motor, not calm it.
    most = guard.MAX_DAMPING_SHARE * drive.inertia / (drive.period + drive.motor_lag)
    at_motor = stiffness / drive.ratio**2
    return min(settling, most / at_motor)


@compiled
def _admit(
    gains: FloatArray, spring: FloatArray, memory: FloatMatrix, seen: FloatMatrix
) -> None:
    for row in range(seen.shape[0]):
        compiled_laws.admit(gains, spring, memory[row], seen[row])


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    memory: FloatMatrix,
    seen: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = compiled_laws.guarded_torque(gains, spring, memory[row], seen[row])


@compiled
def _closed_loop_torques(
    gains: FloatArray, memory: FloatMatrix, both: FloatMatrix, found: FloatArray
) -> None:
    for row in range(found.size):
        found[row] = compiled_laws.closed_loop_torque(
            gains, memory[row], both[row, 0], both[row, 1], np.inf
        )


class Feedback(ProportionalIntegral):
    """Feedback alone: proportional and integral, without feed-forward.

    The "model-free linear feedback controller" of the thesis, section 4.3.1.
    """

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        super().__init__(drive, proportional, integral, feed_forward=False)
