r"""Inverse of the backlash of a cable transmission in closed form.

law = BacklashInverse(env.unwrapped.drive)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_spring, joint_stiffness
from cc_mujoco.control._compiled_laws import LAW_INPUTS
from cc_mujoco.control._controller import Controller, as_round_pulley, readings
from cc_mujoco.control._full_slip import cable_table, full_slip_balance
from cc_mujoco.control._tuned_feedback import (
    loop_gains,
    require_known_motor,
    total_delay,
)
from cc_mujoco.device._drive import Drive
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

_MOTOR, _MOTOR_SPEED, _JOINT, _JOINT_SPEED, _TORQUE, _DESIRED = range(len(LAW_INPUTS))
_DELAY_SHARE = 0.2
"""Bandwidth of the motor's position, times the delay."""
_MAX_BANDWIDTH = 200.0
"""Most of that bandwidth [rad/s]."""
_INTEGRAL_SHARE = 1.2
"""Bandwidth of the integral over that of the position."""
_ENCODER_STEP = 5e-4
"""Motion of the joint that is none [rad]."""
_BAND_SIGMAS = 0.34
"""Motion that is none, in standard deviations of the torque sensor."""
_SLACK_SHARE = 1.0
"""Most that the integral pays out of a single cable, over its stretch."""

_LATE, _POSITION, _DAMPING, _INTEGRAL, _STIFFNESS, _BAND, _RELEASE, GAINS = range(
    guard.LIMITS, guard.LIMITS + 8
)
"""Places of the gains behind `DriveLimits`, and their number."""
_STARTED, _MOTOR_0, _JOINT_0, _SENSE, _EXTREME, _OFFSET, GUARD = range(7)
LAST_COMMAND = GUARD + guard.COMMAND
MEMORY_SIZE = GUARD + guard.MEMORY_SIZE
"""Place of the last torque in the memory, and its size."""


class BacklashInverse(Controller):
    r"""The motor's angle from the inverse of the backlash, with integral feedback.

    Cables that slip as a whole make the desired torque at one angle of the motor for
    either sense of motion (`full_slip_balance`). The sense is that of the wanted angle
    without friction, \(\rho (\theta_j + \tau_d / k)\), and turns when it reverses by
    more than noise; then the wanted angle jumps across the backlash, and the motor
    follows by a position loop with the balance of the cables fed forward. An integral
    of the torque error shifts the angle. As the inverse of a cable transmission after
    T. Do et al., "Hysteresis modeling and position control of tendon-sheath mechanism",
    Mechatronics 24, 2014, for a torque.
    """

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device; its `cables` and the motor's inertia must be known.

        Raises:
            CableError: They are not known.
        """
        super().__init__(drive)
        require_known_motor(drive)
        stiffness = joint_stiffness(drive.cables)
        bandwidth = min(_DELAY_SHARE / total_delay(drive), _MAX_BANDWIDTH)
        self.limits = guard.motor_limits(drive)
        self.cables = cable_table(drive.cables)
        """See `cable_table`, (cables, numbers)."""
        self.gains = np.zeros(GAINS)
        """Numbers of the law, `DriveLimits` first."""
        self.gains[: guard.LIMITS] = self.limits
        self.gains[_LATE] = total_delay(drive)
        self.gains[_POSITION] = drive.inertia * bandwidth**2
        self.gains[_DAMPING] = 2.0 * drive.inertia * bandwidth
        self.gains[_INTEGRAL] = _INTEGRAL_SHARE * bandwidth
        self.gains[_STIFFNESS] = stiffness
        noise = _BAND_SIGMAS * drive.torque_noise / stiffness
        self.gains[_BAND] = max(noise, _ENCODER_STEP)
        self.spring = joint_spring(drive.cables)
        """See `guard.STIFFNESS`."""
        self.gains[_RELEASE] = loop_gains(drive).settling * stiffness / drive.ratio**2
        self._memory: FloatArray = np.zeros((0, MEMORY_SIZE))

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Start at rest in the pretension; see `Controller.reset`."""
        if where is None:
            self._memory = np.zeros((0, MEMORY_SIZE))
        elif len(self._memory):
            self._memory[where] = 0.0

    def given(self, torque: Any) -> None:
        """Accept the torque that the motor got; see `Controller.given`."""
        kept = self._memory[:, LAST_COMMAND]
        np.copyto(kept, torque, where=guard.is_heard(torque))

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`."""
        seen = readings(as_round_pulley(observation, self.drive), LAW_INPUTS)
        rows = len(seen)
        if len(self._memory) != rows:
            self._memory = np.zeros((rows, MEMORY_SIZE))
        found = np.empty(rows)
        _torques(self.gains, self.spring, self.cables, self._memory, seen, found)
        numbers = np.ndim(observation[LAW_INPUTS[0]]) == 0
        return float(found[0]) if numbers else found


@compiled
def _turn(memory: FloatArray, wanted: float, band: float) -> float:
    """Return the sense in which an angle moves, which noise does not turn."""
    sense = memory[_SENSE]
    if sense == 0.0:
        if abs(wanted - memory[_EXTREME]) > band:
            memory[_SENSE] = np.sign(wanted - memory[_EXTREME])
            memory[_EXTREME] = wanted
    elif sense * (wanted - memory[_EXTREME]) > 0.0:
        memory[_EXTREME] = wanted
    elif sense * (wanted - memory[_EXTREME]) < -band:
        memory[_SENSE], memory[_EXTREME] = -sense, wanted
    return float(memory[_SENSE])


@internal
def motor_torque(
    gains: FloatArray,
    spring: FloatArray,
    cables: FloatMatrix,
    memory: FloatArray,
    seen: FloatArray,
) -> float:
    """Return the torque of the motor of one device [N m].

    Args:
        gains: see `BacklashInverse.gains`.
        spring: see `guard.STIFFNESS`.
        cables: see `cable_table`.
        memory: (`MEMORY_SIZE`,), 0 at the start.
        seen: in the order of `LAW_INPUTS`; changed.
    """
    limits, stiffness, own = guard.limits_of(gains), gains[_STIFFNESS], memory[GUARD:]
    ratio = limits.ratio
    guard.admit(limits, spring, own, seen)
    if memory[_STARTED] == 0.0:
        memory[_STARTED], memory[_MOTOR_0] = 1.0, seen[_MOTOR]
        memory[_JOINT_0] = seen[_JOINT]
        memory[_EXTREME] = seen[_DESIRED] / stiffness
    ahead = seen[_MOTOR_SPEED] - ratio * seen[_JOINT_SPEED]
    if guard.state(limits, spring, own, ahead, seen[_DESIRED]) != guard.FREE:
        memory[_OFFSET] = 0.0
        torque = guard.let_go_torque(own, gains[_RELEASE], ahead)
        return guard.bounded(limits, spring, own, guard.limited(gains, torque))
    joint = seen[_JOINT] - memory[_JOINT_0] + gains[_LATE] * seen[_JOINT_SPEED]
    motor = seen[_MOTOR] - memory[_MOTOR_0] + gains[_LATE] * seen[_MOTOR_SPEED]
    sense = _turn(memory, joint + seen[_DESIRED] / stiffness, gains[_BAND])
    balance, stretch = full_slip_balance(cables, sense, seen[_DESIRED])
    relative = ratio * (stretch + memory[_OFFSET])
    error = (seen[_DESIRED] - seen[_TORQUE]) / stiffness
    torque = balance + gains[_POSITION] * (relative + ratio * joint - motor)
    torque += gains[_DAMPING] * (ratio * seen[_JOINT_SPEED] - seen[_MOTOR_SPEED])
    limited = guard.bounded(limits, spring, own, guard.limited(gains, torque))
    if not (torque - limited) * error * ratio > 0.0:
        memory[_OFFSET] += gains[_INTEGRAL] * limits.period * error
    if limits.one_way != 0.0:
        # A torque that no paying out ends would pay out without an end.
        least = -_SLACK_SHARE * abs(stretch) - _BAND_SIGMAS * gains[_BAND]
        memory[_OFFSET] = max(memory[_OFFSET], least)
    return float(limited)


@compiled
def _torques(
    gains: FloatArray,
    spring: FloatArray,
    cables: FloatMatrix,
    memory: FloatMatrix,
    seen: FloatMatrix,
    found: FloatArray,
) -> None:
    for row in range(found.size):
        found[row] = motor_torque(gains, spring, cables, memory[row], seen[row])
