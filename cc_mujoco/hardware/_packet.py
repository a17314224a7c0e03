"""The two packets between host and rig: fixed, little endian, with a checksum.

    reading (rig to host), 64 bytes:  `<4s H H I Q 5d I`
    command (host to rig), 32 bytes:  `<4s H H I Q d I`

Fields are magic, version, status, sequence number, time stamp of the rig [ns], values,
and the CRC-32 (of zlib) of all bytes before it, without padding. The README of this
package has a table with offsets.
"""

import struct
import zlib
from enum import IntFlag
from typing import Any, NamedTuple

READING_MAGIC, COMMAND_MAGIC = b"CCMR", b"CCMC"
PROTOCOL_VERSION, SEQUENCE_MODULUS = 1, 1 << 32
"""Version; number of packets after which sequence numbers begin again."""
_READING, _COMMAND, _CHECKSUM = map(struct.Struct, ("<4sHHIQ5d", "<4sHHIQd", "<I"))


class Status(IntFlag):
    """Status bits of both packets; unknown ones are ignored."""

    NONE = 0
    ENABLED = 1  # torque is to be applied (command), or is applied (reading)
    STOPPED = 2  # the run is over (command), or was stopped at the rig (reading)
    FAULT = 4  # error that the rig has found of its own (reading)


class Readings(NamedTuple):
    """Measurements of a rig at one time, with the signs of measured data."""

    time: float  # of the rig's own clock [s]; only differences matter
    motor_angle: float  # [rad]
    motor_velocity: float  # [rad/s]
    joint_angle: float  # [rad]
    joint_velocity: float  # [rad/s]
    joint_torque: float  # torque that the transmission puts into the joint [N m]
    status: Status | None = None  # None of a rig that tells none


class Command(NamedTuple):
    """Command of the host: torque of the motor, with status bits."""

    sequence: int
    echo: int  # time stamp of the newest reading that the host had [ns]; 0 before any
    torque: float
    status: Status


class Packet(NamedTuple):
    """Reading with the sequence number and time stamp of its packet."""

    sequence: int
    stamp: int  # [ns]
    readings: Readings


def pack_reading(sequence: int, stamp: int, values: Readings) -> bytes:
    """Return the packet of a reading, with `stamp` [ns] in place of `Readings.time`."""
    status = values.status or Status.NONE
    return _packed(_READING, READING_MAGIC, status, sequence, stamp, *values[1:6])


def pack_command(given: Command) -> bytes:
    sequence, echo, torque, status = given
    return _packed(_COMMAND, COMMAND_MAGIC, status, sequence, echo, torque)


def read_reading(data: bytes) -> Packet | None:
    """Return the reading in a packet; None if damaged or of another version."""
    if (found := _unpacked(_READING, READING_MAGIC, data)) is None:
        return None
    status, sequence, stamp, *values = found
    readings = Readings(stamp * 1e-9, *values)._replace(status=status)
    return Packet(sequence, stamp, readings)


def read_command(data: bytes) -> Command | None:
    """Return the command in a packet; None if damaged or of another version."""
    if (found := _unpacked(_COMMAND, COMMAND_MAGIC, data)) is None:
        return None
    status, sequence, echo, torque = found
    return Command(sequence, echo, torque, status)


def is_newer(sequence: int, than: int) -> bool:
    """Return whether a sequence number follows `than`, also after an overflow."""
    return 0 < (sequence - than) % SEQUENCE_MODULUS < SEQUENCE_MODULUS // 2


def _packed(
    layout: struct.Struct, magic: bytes, status: Status, sequence: int, *values: float
) -> bytes:
    head = magic, PROTOCOL_VERSION, int(status), sequence % SEQUENCE_MODULUS
    data = layout.pack(*head, *values)
    return data + _CHECKSUM.pack(zlib.crc32(data))


def _unpacked(layout: struct.Struct, magic: bytes, data: bytes) -> list[Any] | None:
    """Return the fields from the status on; None if damaged or of another version."""
    if len(data) != layout.size + _CHECKSUM.size:
        return None
    found, version, status, *others = layout.unpack_from(data)
    (checksum,) = _CHECKSUM.unpack_from(data, layout.size)
    known = found == magic and version == PROTOCOL_VERSION
    if not known or checksum != zlib.crc32(data[:-4]):
        return None
    return [Status(status & 7), *others]
