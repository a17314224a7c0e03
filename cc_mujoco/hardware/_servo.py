"""A motor that follows a course of angles, played by torque.

    loop = Loop(rig, controller("none", drive), Servo(drive, course), ...)

A servo is a `Desired`: what it asks for is the joint's torque without friction, and the
controller `none` makes the motor's of it. So the limits, the watchdog and the log of a
run are those of every other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco._validation import require_parameter
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._packet import Readings
from cc_mujoco.hardware._references import Array

APPROACH_TIME = 1.0
"""Time in which the motor goes from where it is to where its course begins [s]."""
_DAMPING_GAIN, _FOLLOW_PERIODS, _INTEGRAL_PERIODS = 0.25, 6.0, 25.0
"""Damping over inertia per period; periods in which it follows, and the integral."""


@dataclass(frozen=True)
class Stiffness:
    """Stiffness with which a motor is held on its course."""

    stiffness: float
    """[N m/rad]"""
    damping: float
    """[N m s/rad]"""
    integral: float
    """Rate at which the torque grows while there is an error [N m/(rad s)]."""

    def __post_init__(self) -> None:
        require_parameter(self, "stiffness", 1e-9, 1e9, "N m/rad")
        require_parameter(self, "damping", 0.0, 1e9, "N m s/rad")
        require_parameter(self, "integral", 0.0, 1e12, "N m/(rad s)")

    @classmethod
    def of(cls, drive: Drive) -> Stiffness:
        """Return the firmest hold of a motor of this inertia at this period.

        What is measured is a period old, a torque lasts for another, and a motor may
        lag. So the damping stays well below inertia over that time, and the stiffness
        below the damping.

        Raises:
            CableError: The inertia is not known.
        """
        if not drive.inertia > 0.0:
            raise CableError(
                "to follow a course the motor's inertia must be known; the scene gives "
                "it none."
            )
        late = drive.period + drive.motor_lag
        damping = _DAMPING_GAIN * drive.inertia / late
        stiffness = damping / (_FOLLOW_PERIODS * late)
        return cls(stiffness, damping, stiffness / (_INTEGRAL_PERIODS * late))


class Servo:
    """Servo whose torque keeps the motor on its course; see `Desired`."""

    def __init__(
        self, drive: Drive, times: Array, angles: Array, firm: Stiffness | None = None
    ) -> None:
        """Begin a course of motor `angles` at `times` from 0 (n,) [rad, s].

        It is as `firm` as `Stiffness.of` the drive by default.
        """
        self._drive = drive
        self._times, self._angles = times, angles
        self._servo_stiffness = firm or Stiffness.of(drive)
        self._begin: float | None = None
        self._integral, self._last = 0.0, 0.0

    def torque(self, time: float, seen: Readings) -> float:
        """See `Desired`."""
        firm, drive = self._servo_stiffness, self._drive
        if time == 0.0 or self._begin is None:
            self._begin, self._integral, self._last = seen.motor_angle, 0.0, 0.0
        angle, speed = self.course(time, self._begin)
        error = angle - seen.motor_angle
        self._integral += firm.integral * error * (time - self._last)
        self._integral = min(max(self._integral, drive.low), drive.high)
        self._last = time
        torque = firm.stiffness * error + firm.damping * (speed - seen.motor_velocity)
        return drive.ratio * (torque + self._integral)

    def course(self, time: float, begin: float) -> tuple[float, float]:
        """Return the desired angle [rad] and speed [rad/s] of a motor from `begin`.

        The way to the course's first angle is a cosine.
        """
        first = float(self._angles[0])
        if time < APPROACH_TIME:
            turn = math.pi * time / APPROACH_TIME
            half = 0.5 * (first - begin)
            return begin + half * (1.0 - math.cos(turn)), (
                half * math.pi / APPROACH_TIME * math.sin(turn)
            )
        now = time - APPROACH_TIME
        step = self._drive.period
        angle, later = np.interp((now, now + step), self._times, self._angles)
        return float(angle), float(later - angle) / step
