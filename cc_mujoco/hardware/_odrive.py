"""An ODrive on CAN, by its protocol CAN Simple: classical CAN, identifiers of 11 bits.

The identifier is `node << 5 | command`; values are little endian, angles in turns. The
first commands set torque control and clear errors. The motor is enabled once the drive
was read. Before a run, the drive itself needs:

- `config.can.encoder_msg_rate_ms` at most the period of the loop (10 ms by default),
- `config.can.heartbeat_msg_rate_ms` of about 10 (100 by default): a heartbeat
  reports faults,
- `config.enable_watchdog` with `watchdog_timeout = 0.05`, or it goes on with the last
  torque of a host that is gone; its current limit and velocity limit.

Source: ODrive documentation, "CAN Protocol"
(https://docs.odriverobotics.com/v/latest/manual/can-protocol.html); states and errors
as in firmware 0.5 and 0.6.
"""

from __future__ import annotations

import math
import struct

from cc_mujoco.hardware._can_bus import CanDrive
from cc_mujoco.hardware._drive_rig import TURN, MotorState
from cc_mujoco.hardware._packet import Status
from cc_mujoco.hardware._rig import pending

HEARTBEAT, ESTIMATES = 0x01, 0x09
"""Commands that the drive sends by itself."""
SET_AXIS_STATE, SET_CONTROLLER_MODE = 0x07, 0x0B
SET_INPUT_TORQUE, CLEAR_ERRORS = 0x0E, 0x18
IDLE, CLOSED_LOOP_CONTROL = 1, 8
"""States of an axis."""
TORQUE_CONTROL, PASSTHROUGH = 1, 1
"""Control mode and input mode."""


def identifier(node: int, command: int) -> int:
    return node << 5 | command


class Odrive(CanDrive):
    """An axis of an ODrive; see `MotorDrive`."""

    title, fd = "ODrive", False
    _cleared = _requested = -math.inf
    _beat = (-math.inf, 0, 0)
    """Time, errors and state of the last heartbeat."""

    @staticmethod
    def identifiers(node: int) -> list[int]:
        return [identifier(node, each) for each in (HEARTBEAT, ESTIMATES)]

    def read(self) -> MotorState | None:
        newest: tuple[float, float] | None = None
        for frame in pending(self._port.receive):
            data = bytes(frame.data)
            if frame.is_extended_id or len(data) != 8:
                self.ignored["corrupt"] += 1
            elif frame.arbitration_id == identifier(self._node, HEARTBEAT):
                errors, state = struct.unpack_from("<IB", data)
                self._beat = self._now(), errors, state
            else:
                self.ignored["overtaken"] += newest is not None
                newest = struct.unpack("<ff", data)
        if newest is None:
            return None
        self._heard = True
        turns, speed = newest
        return MotorState(self._now(), TURN * turns, TURN * speed, self._status())

    def write(self, torque: float) -> None:
        if not self._heard:
            # An error of the last run is no fault of this one, unless it remains.
            self._cleared = self._now()
            self._send(CLEAR_ERRORS, b"\0")
            modes = struct.pack("<II", TORQUE_CONTROL, PASSTHROUGH)
            self._send(SET_CONTROLLER_MODE, modes)
        else:
            self._enabling.request()
            # Never again after a drive has disabled itself.
            waits = self._enabling.status(self._enabled()) is None
            if waits and self._now() - self._requested >= 0.1:
                self._requested = self._now()
                self._send(SET_AXIS_STATE, struct.pack("<I", CLOSED_LOOP_CONTROL))
        self._send(SET_INPUT_TORQUE, struct.pack("<f", torque if self._heard else 0.0))

    def stop(self) -> None:
        self._send(SET_INPUT_TORQUE, struct.pack("<f", 0.0))
        self._send(SET_AXIS_STATE, struct.pack("<I", IDLE))

    def _send(self, command: int, data: bytes) -> None:
        self._port.send(identifier(self._node, command), data)

    def _enabled(self) -> bool:
        time, _, state = self._beat
        known = self._now() - time <= 0.5  # an older state is unknown
        return known and state == CLOSED_LOOP_CONTROL

    def _status(self) -> Status | None:
        time, errors, _ = self._beat
        # A drive clears its errors in 20 ms.
        if errors and time > self._cleared + 0.02:
            return Status.FAULT
        return self._enabling.status(self._enabled())
