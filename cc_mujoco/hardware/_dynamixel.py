"""A Dynamixel servo of the X series on a serial port, by its protocol 2.0.

`pip install 'cc_mujoco[serial]'` installs pyserial. The servo is set to current
control. A cycle sends one Sync Write with the goal current, which no servo answers, and
one Read. The servo's watchdog stops it 60 ms after the last instruction. A hardware
error is a fault, which only a reboot clears. A cycle transfers about 80 bytes: set 1
Mbit/s or more, `Return Delay Time` 0, and a latency timer of 1 ms in the adapter. The
torque is `torque_per_ampere` times the commanded current; it is not measured.

Sources: https://emanual.robotis.com/docs/en/dxl, pages "Protocol 2.0" (protocol2), "CRC
Calculation" (crc) and the control table of the XH430-W350 (x/xh430-w350). Servos with
another unit of current (XC330, XL330) or table (XL320, P, PRO) are not supported.
"""

import math
import struct
import time
from collections import Counter
from typing import TYPE_CHECKING, NoReturn

from cc_mujoco.errors import CableError, import_extra
from cc_mujoco.hardware._packet import Status
from cc_mujoco.hardware._rig import TURN, Enabling, MotorState, Now

if TYPE_CHECKING:
    import serial

HEADER, _STUFFED = b"\xff\xff\xfd\x00", b"\xff\xff\xfd\xfd"
READ, STATUS, SYNC_WRITE = 0x02, 0x55, 0x83
OPERATING_MODE, CURRENT_LIMIT, TORQUE_ENABLE, BUS_WATCHDOG = 11, 38, 64, 98
GOAL_CURRENT, PRESENT_VELOCITY, PRESENT_POSITION = 102, 128, 132
"""Addresses in the control table."""
CURRENT_CONTROL = 0  # operating mode
AMPERE, VELOCITY = 2.69e-3, 0.229 * TURN / 60.0
"""Units of a current [A] and of a velocity [rad/s]."""
WATCHDOG_UNITS, WATCHDOG_TRIPPED = 3, 0xFF
"""Time of the watchdog in units of 20 ms, and its value after it has stopped the
servo."""
REPLY_TIME, MAX_FAILURES = 0.01, 5
"""Time to wait for a reply before anything else is sent [s]; number of consecutive
errors after which the port counts as lost."""
_SETTINGS, _WHOLE, _MOVING = (
    (OPERATING_MODE, CURRENT_LIMIT + 2 - OPERATING_MODE),
    (TORQUE_ENABLE, PRESENT_POSITION + 4 - TORQUE_ENABLE),
    (BUS_WATCHDOG, PRESENT_POSITION + 4 - BUS_WATCHDOG),
)
"""First address and number of the bytes to read: before the motor is enabled, until the
servo confirms that, and then."""


def _crc_entry(value: int) -> int:
    value <<= 8
    for _ in range(8):
        value = value << 1 ^ (0x8005 if value & 0x8000 else 0)
    return value & 0xFFFF


_CRC_TABLE = [_crc_entry(value) for value in range(256)]


def crc16(data: bytes) -> int:
    """Return the checksum of a packet: CRC-16, polynomial 0x8005, not reflected."""
    value = 0
    for byte in data:
        value = (value << 8 ^ _CRC_TABLE[value >> 8 ^ byte]) & 0xFFFF
    return value


def instruction(node: int, kind: int, parameters: bytes) -> bytes:
    # A header inside the packet gets one byte more.
    body = (bytes([kind]) + parameters).replace(HEADER[:3], _STUFFED)
    head = HEADER + struct.pack("<BH", node, len(body) + 2) + body
    return head + struct.pack("<H", crc16(head))


def read_instruction(node: int, address: int, size: int) -> bytes:
    """Return the packet that requests `size` bytes of the control table."""
    return instruction(node, READ, struct.pack("<HH", address, size))


def write_instruction(node: int, address: int, value: bytes) -> bytes:
    """Return the Sync Write packet that writes bytes to the control table."""
    parameters = struct.pack("<HHB", address, len(value), node) + value
    return instruction(0xFE, SYNC_WRITE, parameters)  # to all


def take_status(received: bytearray, node: int) -> tuple[int, bytes] | None:
    """Remove the next complete status packet of a servo from the bytes received.

    Returns its error byte and its parameters; None if there is no more. Damaged packets
    and those of other servos are skipped.
    """
    while (start := received.find(HEADER)) >= 0:
        del received[:start]
        if len(received) < 7:
            return None
        size = 7 + int.from_bytes(received[5:7], "little")
        if size > 256:
            del received[:1]
            continue
        if len(received) < size:
            return None
        packet = bytes(received[:size])
        if crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
            del received[:1]
            continue
        del received[:size]
        body = packet[7:-2].replace(_STUFFED, HEADER[:3])
        if packet[4] == node and len(body) > 1 and body[0] == STATUS:
            return body[1], body[2:]
    del received[: max(len(received) - 3, 0)]  # the rest may begin a header
    return None


class Dynamixel:
    """Dynamixel servo; see `MotorDrive`."""

    def __init__(
        self,
        port: str,
        node: int,
        baud_rate: int,
        torque_per_ampere: float,
        now: Now = time.perf_counter,
    ) -> None:
        """Open the port of servo `node`; `now` is the clock of the host [s]."""
        self.ignored: Counter[str] = Counter()
        self.where = f"Dynamixel {node} on {port}"
        self._port = _open_port(port, baud_rate)
        self._node, self._torque_per_ampere, self._now = node, torque_per_ampere, now
        self._enabling = Enabling(now)
        self._received = bytearray()
        self._requested: tuple[int, int] | None = None
        """Bytes that a reply is expected to hold."""
        self._requested_at = -math.inf
        self._mode: int | None = None
        self._limit = 0  # current limit, in units of a current
        self._heard = self._confirmed = False
        self._failures = 0

    def read(self) -> MotorState | None:
        try:
            self._received += self._port.read(4096)
        except OSError as error:  # those of pyserial are
            self._fail("read from", error)
        newest: MotorState | None = None
        while (found := take_status(self._received, self._node)) is not None:
            newest = self._reply(*found) or newest
        return newest

    def write(self, torque: float) -> None:
        waited = self._now() - self._requested_at
        if self._requested is not None and waited < REPLY_TIME:
            raise OSError("the servo's reply is still under way")
        if self._mode != CURRENT_CONTROL:
            writes = [(TORQUE_ENABLE, b"\0")]  # the mode changes only without torque
            if self._mode is not None:  # this memory wears out
                writes.append((OPERATING_MODE, bytes([CURRENT_CONTROL])))
            self._send(writes, _SETTINGS)
            return
        if not self._heard:
            self._send([(GOAL_CURRENT, b"\0\0"), (BUS_WATCHDOG, b"\0")], _WHOLE)
            return
        wanted = round(torque / self._torque_per_ampere / AMPERE)
        given = max(-self._limit, min(wanted, self._limit))
        # The servo ignores a goal beyond its limit and goes on with the one before.
        self.ignored["torque beyond the servo's current limit"] += given != wanted
        writes = [(GOAL_CURRENT, struct.pack("<h", given))]
        self._enabling.request()
        if not self._confirmed and self._enabling.status(False) is None:
            writes += (BUS_WATCHDOG, bytes([WATCHDOG_UNITS])), (TORQUE_ENABLE, b"\1")
        self._send(writes, _MOVING if self._confirmed else _WHOLE)

    def stop(self) -> None:
        self._send([(GOAL_CURRENT, b"\0\0"), (TORQUE_ENABLE, b"\0")], None)

    def close(self) -> None:
        self._port.close()

    def _send(
        self, writes: list[tuple[int, bytes]], requested: tuple[int, int] | None
    ) -> None:
        data = b"".join(write_instruction(self._node, *each) for each in writes)
        if requested is not None:
            data += read_instruction(self._node, *requested)
        self._requested, self._requested_at = requested, self._now()
        try:
            self._port.write(data)
        except OSError as error:
            self._fail("written to", error)
        self._failures = 0

    def _reply(self, error: int, data: bytes) -> MotorState | None:
        requested, self._requested = self._requested, None
        if requested is None or len(data) != requested[1]:
            self.ignored["error of the servo" if error else "corrupt"] += 1
            return None
        first = requested[0]
        if requested == _SETTINGS:
            self._mode, place = data[0], CURRENT_LIMIT - first
            (self._limit,) = struct.unpack_from("<H", data, place)
            return None
        self._heard = True
        self._confirmed |= requested == _WHOLE and data[0] == 1
        tripped = data[BUS_WATCHDOG - first] == WATCHDOG_TRIPPED
        is_off = requested == _WHOLE and data[0] != 1
        enabled = self._confirmed and not (tripped or is_off)
        velocity, position = struct.unpack_from("<ii", data, PRESENT_VELOCITY - first)
        status = Status.FAULT if error & 0x80 else self._enabling.status(enabled)
        angle = position * TURN / 4096  # positions in a turn
        return MotorState(self._now(), angle, velocity * VELOCITY, status)

    def _fail(self, done: str, error: Exception) -> NoReturn:
        self._failures += 1
        if self._failures < MAX_FAILURES:
            raise OSError(str(error)) from error
        raise CableError(
            f"{self.where} cannot be {done}: {error}; is its adapter plugged in?"
        ) from error


def _open_port(port: str, baud_rate: int) -> "serial.Serial":
    library = import_extra("serial", "a Dynamixel servo needs pyserial", "serial")
    try:
        made: serial.Serial = library.Serial(
            port, baud_rate, timeout=0.0, write_timeout=0.0
        )
        return made
    except (OSError, ValueError) as error:  # SerialException is an OSError
        text = getattr(error, "strerror", None) or str(error)
        raise CableError(
            f"the serial port {port} cannot be opened: {text}; is the adapter plugged "
            "in, and may this user open it?"
        ) from None
