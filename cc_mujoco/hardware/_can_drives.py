"""Drives on a CAN bus by their makers' protocols: moteus and ODrive.

A moteus controller on CAN FD, by its register protocol: a frame to `0x8000 | id` writes
mode and command and requests position, velocity, torque, mode and fault; the reply is
from `id << 8`. Torque control is position mode with all gains scaled to zero and a
feed-forward torque. A command is valid for 50 ms. Set `servo.max_current_A`,
`servo.max_velocity` and `servo.timeout_mode = 0`, which removes the torque after that
time (12, the default, brakes).

Sources: https://mjbots.github.io/moteus, pages "CAN Protocol" (protocol/can), "Register
Reference" (protocol/registers) and "Control Modes" (guides/control-modes).

An ODrive by its protocol CAN Simple: classical CAN, identifiers of 11 bits, `node << 5
| command`; values are little endian, angles in turns. The first commands set torque
control and clear errors. The motor is enabled once the drive was read. Before a run,
set on the drive:

- `config.can.encoder_msg_rate_ms` at most the period of the loop (10 ms by default),
- `config.can.heartbeat_msg_rate_ms` of about 10 (100 by default): a heartbeat
  reports faults,
- `config.enable_watchdog` with `watchdog_timeout = 0.05`, else it keeps the last torque
  when the host has gone; its current limit and velocity limit.

Source: ODrive documentation, "CAN Protocol"
(https://docs.odriverobotics.com/v/latest/manual/can-protocol.html); states and errors
as in firmware 0.5 and 0.6.
"""

import math
import struct
import time
from abc import ABC, abstractmethod
from typing import ClassVar

from cc_mujoco.hardware._address import CanPlace
from cc_mujoco.hardware._can_bus import CanBuses, CanPort
from cc_mujoco.hardware._packet import Status
from cc_mujoco.hardware._rig import TURN, Enabling, MotorState, Now, pending


class CanDrive(ABC):
    """Connection to a drive on a CAN bus; subclasses complete it to a `MotorDrive`."""

    title: ClassVar[str]  # name of the kind of drive in sentences
    fd: ClassVar[bool]  # true if its frames are those of CAN FD

    def __init__(
        self,
        place: CanPlace,
        node: int,
        buses: CanBuses | None = None,
        now: Now = time.perf_counter,
    ) -> None:
        """Open the bus, see `CanPort`, for drive `node`; `now` is a clock [s]."""
        self._port = CanPort(place, self.identifiers(node), fd=self.fd, buses=buses)
        self.ignored = self._port.ignored
        self.where = f"{self.title} {node} on {self._port.where}"
        self._node, self._now = node, now
        self._enabling = Enabling(now)
        self._heard = False

    @staticmethod
    @abstractmethod
    def identifiers(node: int) -> list[int]: ...

    def close(self) -> None:
        self._port.close()


MODE, POSITION, VELOCITY, FAULT_CODE = 0x000, 0x001, 0x002, 0x00F
"""Registers that are read; the torque is between the last two."""
COMMAND, WATCHDOG_TIMEOUT, INTEGRAL_SCALE = 0x020, 0x027, 0x02B
"""Registers that are written: five from `COMMAND` on, then one each."""
STOPPED, FAULT, PREPARING, POSITION_MODE = 0, 1, (2, 3, 4), 10
_WRITE, _READ, _REPLY, _NOP, _FLOAT = 0x00, 0x10, 0x20, 0x50, 0x0C


def query() -> bytes:
    """Return the subframes that ask for position, velocity, torque, mode and fault."""
    floats = bytes([_READ | _FLOAT | 3, POSITION])
    return floats + bytes([_READ | 1, MODE, _READ | 1, FAULT_CODE])


def stop_command() -> bytes:
    """Return the frame that stops the motor and clears its faults."""
    return padded(bytes([_WRITE | 1, MODE, STOPPED]) + query())


def torque_command(torque: float) -> bytes:
    """Return the frame that commands a torque of the output shaft [N m]."""
    values = (math.nan, 0.0, torque, 0.0, 0.0)  # position, velocity, torque, kp, kd
    parts = [
        bytes([_WRITE | 1, MODE, POSITION_MODE]),
        bytes([_WRITE | _FLOAT, len(values), COMMAND]) + struct.pack("<5f", *values),
        # Time after which a command without a successor ends [s].
        bytes([_WRITE | _FLOAT | 1, WATCHDOG_TIMEOUT]) + struct.pack("<f", 0.05),
        bytes([_WRITE | _FLOAT | 1, INTEGRAL_SCALE]) + struct.pack("<f", 0.0),
        query(),
    ]
    return padded(b"".join(parts))


def padded(data: bytes) -> bytes:
    """Return the data, lengthened by no-operations to a length that CAN FD allows."""
    sizes = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # of CAN FD
    size: int = next(size for size in sizes if size >= len(data))
    return data + bytes([_NOP]) * (size - len(data))


def registers(data: bytes) -> dict[int, float] | None:
    """Return the register values in a moteus reply; None if the frame is damaged.

    Integers are not scaled: only modes and fault codes are requested as integers.
    """
    found: dict[int, float] = {}
    place = 0
    try:
        while place < len(data):
            first, place = data[place], place + 1
            if first == _NOP:
                continue
            if first in (0x30, 0x31):  # errors
                _, place = _varuint(data, place)
                _, place = _varuint(data, place)
                continue
            if first & ~0x0F != _REPLY:
                return None
            count = first & 3
            if count == 0:
                count, place = _varuint(data, place)
            start, place = _varuint(data, place)
            kind = "bhif"[first >> 2 & 3]  # int8, int16, int32 or float
            layout = struct.Struct(f"<{count}{kind}")
            values = layout.unpack_from(data, place)
            found |= zip(range(start, start + count), map(float, values), strict=True)
            place += layout.size
    except (IndexError, struct.error):
        return None
    return found


def _varuint(data: bytes, place: int) -> tuple[int, int]:
    """Return a number of seven bits per byte, lowest first, and the index after it."""
    value = shift = 0
    while True:
        byte, place = data[place], place + 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
        shift += 7


class Moteus(CanDrive):
    """Moteus controller; see `MotorDrive`."""

    title, fd = "moteus", True

    @staticmethod
    def identifiers(node: int) -> list[int]:
        return [node << 8]

    def read(self) -> MotorState | None:
        newest: dict[int, float] | None = None
        for frame in pending(self._port.receive):
            found = registers(bytes(frame.data))
            if found is None or not {MODE, POSITION, VELOCITY} <= found.keys():
                self.ignored["corrupt"] += 1
                continue
            self.ignored["overtaken"] += newest is not None
            newest = found
        if newest is None:
            return None
        self._heard = True
        angle, velocity = TURN * newest[POSITION], TURN * newest[VELOCITY]
        return MotorState(self._now(), angle, velocity, self._status(newest[MODE]))

    def write(self, torque: float) -> None:
        if not self._heard:
            self.stop()
            return
        self._enabling.request()
        self._send(torque_command(torque))

    def stop(self) -> None:
        self._send(stop_command())

    def _send(self, data: bytes) -> None:
        self._port.send(0x8000 | self._node, data)  # and reply

    def _status(self, mode: float) -> Status | None:
        if mode == FAULT:
            return Status.FAULT
        if mode in PREPARING:
            return None
        return self._enabling.status(mode == POSITION_MODE)


HEARTBEAT, ESTIMATES = 0x01, 0x09  # commands that the drive sends by itself
SET_AXIS_STATE, SET_CONTROLLER_MODE = 0x07, 0x0B
SET_INPUT_TORQUE, CLEAR_ERRORS = 0x0E, 0x18
IDLE, CLOSED_LOOP_CONTROL = 1, 8  # states of an axis
TORQUE_CONTROL, PASSTHROUGH = 1, 1  # control mode and input mode


def identifier(node: int, command: int) -> int:
    return node << 5 | command


class Odrive(CanDrive):
    """Axis of an ODrive; see `MotorDrive`."""

    title, fd = "ODrive", False
    _cleared = _requested = -math.inf
    _beat = (-math.inf, 0, 0)  # time, errors and state of the last heartbeat

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
