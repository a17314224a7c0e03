r"""Position control: a motor angle for the desired joint angle, and a servo.

    law = controller("none", drive)               # of a drive that commands an angle
    law.torque({"reference_angle_rad": 0.2, "motor_angle_rad": 0.0,
                "motor_velocity_rad_s": 0.0})     # N m

A law maps the desired course of the joint to a course of the motor; that map may
compensate friction and stretch of the cable. The servo reads the encoder of the motor
alone, as that of an endoscope does.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_number
from cc_mujoco.control._controller import Controller, readings, total_delay
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import REFERENCE_COLUMN
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]

BANDWIDTH = 150.0  # bandwidth of the servo without delay [rad/s]


class PositionController(Controller):
    r"""Motor angle for each desired joint angle, held by a servo.

    \[ \tau_m = J \omega^2 \Bigl( e + \tfrac{\omega}{5} \int e \, dt \Bigr)
       + 2 J \omega \, \dot e, \qquad e = \theta^* - \theta_m \]

    with the motor's inertia J, the bandwidth \(\omega\), lower where measurements are
    late, and the motor angle \(\theta^*\) of the law, both relative to the start. A law
    jumps where the joint reverses; the part that needs more than a quarter of the
    motor's torque is covered as the servo settles, so that the motor does not
    overshoot. The integral stops where the motor is at its limit. The joint angle at
    the start is measured or, without a sensor there, its neutral angle.
    """

    def __init__(self, drive: Drive, bandwidth: float = BANDWIDTH) -> None:
        """Prepare for the first episode, with a bandwidth of the servo [rad/s].

        Raises:
            CableError: The bandwidth is out of range, or the inertia is not known.
        """
        super().__init__(drive)
        require_number("bandwidth", bandwidth, 1.0, 1e4, "rad/s")
        # Inertia below which a servo cannot be tuned [kg m^2].
        if not drive.inertia > 1e-9:
            raise CableError(
                "a position controller needs the inertia of the motor; Drive.inertia "
                f"is {drive.inertia:g} kg m^2."
            )
        # The servo's bandwidth times the delay of the loop is at most 0.4 rad.
        self.bandwidth = min(bandwidth, 0.4 / total_delay(drive))
        most = min(abs(drive.low) or math.inf, abs(drive.high) or math.inf)
        # A quarter of the motor's torque is used to follow a change of rate.
        self._acceleration = 0.25 * most / drive.inertia
        self._rows = 0
        self.reset()

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._rows = 0
        elif self._rows:
            self._fresh |= where

    @abstractmethod
    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        """Begin an episode of the environments `rows` of `count`, at rest."""

    @abstractmethod
    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        """Return the angle of the motor from its start (n,) [rad].

        `joint` is the desired joint angle from its start (n,) [rad]; the observation
        has the measurements of this instant, arrays or numbers.
        """

    def torque(self, observation: Mapping[str, Any]) -> Any:
        names = REFERENCE_COLUMN, "motor_angle_rad", "motor_velocity_rad_s"
        reference, angle, velocity = readings(observation, names).T
        count = reference.size
        if self._rows != count:
            self._rows, self._fresh = count, np.ones(count, dtype=np.bool_)
            self._start, self._memory = np.zeros(count), np.zeros((5, count))
            self.joint_start = np.full(count, self.drive.joint_neutral)
        fresh = self._fresh
        if fresh.any():
            self._start[fresh] = angle[fresh]
            self._memory[:, fresh] = 0.0
            if self.drive.joint_sensor:
                (joint,) = readings(observation, ["joint_angle_rad"]).T
                self.joint_start[fresh] = joint[fresh]
            self.begin(np.flatnonzero(fresh), count)
        wanted = self.motor_angle(reference - self.joint_start, observation)
        self._fresh = np.zeros(count, dtype=np.bool_)
        given = self._servo(wanted, angle - self._start, velocity)
        return float(given[0]) if np.ndim(observation[REFERENCE_COLUMN]) == 0 else given

    def _servo(self, wanted: Array, angle: Array, velocity: Array) -> Array:
        """Return the torques of the motor (n,) [N m].

        `wanted` are angles of the law, `angle` measured angles from the start (n,)
        [rad].
        """
        period, omega, inertia = self.drive.period, self.bandwidth, self.drive.inertia
        before, rate, left, leaving, total = self._memory
        demanded_rate = (wanted - before) / period
        most = self._acceleration * period
        rate = np.clip(demanded_rate, rate - most, rate + most)
        # The part that is too fast remains, and decays without overshoot.
        left = left + (demanded_rate - rate) * period
        kept, turn = math.exp(-omega * period), omega * period
        left, leaving = (
            kept * ((1.0 + turn) * left + period * leaving),
            kept * ((1.0 - turn) * leaving - turn * omega * left),
        )
        speeding = omega * omega * left + 2.0 * omega * leaving
        error, missing = wanted - left - angle, rate - leaving - velocity
        # Rate of the servo's integral over its bandwidth.
        slow = total + 0.2 * omega * period * error
        demanded = omega * omega * (error + slow) + 2.0 * omega * missing + speeding
        demanded = inertia * demanded + self.drive.damping * (rate - leaving)
        given = np.clip(demanded, self.drive.low, self.drive.high)
        total = np.where(given == demanded, slow, total)
        self._memory = np.stack([wanted, rate, left, leaving, total])
        return np.asarray(given)


class IdealRatio(PositionController):
    """No compensation: the cable is assumed without friction and stretch."""

    def begin(self, rows: NDArray[np.intp], count: int) -> None:
        """Do nothing; see `PositionController.begin`."""

    def motor_angle(self, joint: Array, observation: Mapping[str, Any]) -> Array:
        """Return ratio times joint angle [rad]."""
        return self.drive.ratio * joint
