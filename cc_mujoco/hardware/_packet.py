"""The two packets between host and rig: fixed, little endian, with a checksum.

    reading (rig to host), 64 bytes:  `<4s H H I Q 5d I`
    command (host to rig), 32 bytes:  `<4s H H I Q d I`

magic, version, status, sequence number, time stamp of the rig [ns], values, CRC-32 (of
zlib) of all bytes before it; nothing lies between the fields. The table with offsets is
in the README of this package.
"""

from __future__ import annotations

import struct
import zlib
from enum import IntFlag
from typing import NamedTuple

READING_MAGIC, COMMAND_MAGIC = b"CCMR", b"CCMC"
PROTOCOL_VERSION = 1
_READING = struct.Struct("<4sHHIQ5d")
_COMMAND = struct.Struct("<4sHHIQd")
_CHECKSUM = struct.Struct("<I")
SEQUENCE_MODULUS = 1 << 32
"""Sequence numbers begin again after this many."""


class Status(IntFlag):
    """Bits that both packets have; those unknown are ignored."""

    NONE = 0
    ENABLED = 1
    """Torque is to be applied (command), or is applied (reading)."""
    STOPPED = 2
    """Run is over (command), or the rig was stopped by hand (reading)."""
    FAULT = 4
    """Error that the rig has found of its own (reading)."""


class Readings(NamedTuple):
    """Measurements of a rig at one time; signs are those of the measured data."""

    time: float
    """Time of the rig's own clock [s]; only differences matter."""
    motor_angle: float
    """[rad]"""
    motor_velocity: float
    """[rad/s]"""
    joint_angle: float
    """[rad]"""
    joint_velocity: float
    """[rad/s]"""
    joint_torque: float
    """Torque that the transmission puts into the joint [N m]."""
    status: Status | None = None
    """None of a rig that tells none."""


class Command(NamedTuple):
    """Command of the host to a rig."""

    sequence: int
    echo: int
    """Time stamp of the newest reading that the host had [ns]; 0 before any."""
    torque: float
    status: Status


class Packet(NamedTuple):
    """A reading with the sequence number and time stamp of its packet."""

    sequence: int
    stamp: int
    """[ns]"""
    readings: Readings


def pack_reading(sequence: int, stamp: int, values: Readings) -> bytes:
    """Return the packet of a reading, with `stamp` [ns] in place of `Readings.time`."""
    status = int(values.status or Status.NONE)
    head = (READING_MAGIC, PROTOCOL_VERSION, status, sequence % SEQUENCE_MODULUS, stamp)
    return _with_checksum(_READING.pack(*head, *values[1:6]))


def pack_command(given: Command) -> bytes:
    head = (
        COMMAND_MAGIC,
        PROTOCOL_VERSION,
        int(given.status),
        given.sequence % SEQUENCE_MODULUS,
    )
    return _with_checksum(_COMMAND.pack(*head, given.echo, given.torque))


def read_reading(data: bytes) -> Packet | None:
    """Return the reading in a packet; None if damaged or of another version."""
    if not _is_intact(data, _READING, READING_MAGIC):
        return None
    _, _, status, sequence, stamp, *values = _READING.unpack_from(data)
    readings = Readings(stamp * 1e-9, *values)._replace(status=Status(status & 7))
    return Packet(sequence, stamp, readings)


def read_command(data: bytes) -> Command | None:
    """Return the command in a packet; None if damaged or of another version."""
    if not _is_intact(data, _COMMAND, COMMAND_MAGIC):
        return None
    _, _, status, sequence, echo, torque = _COMMAND.unpack_from(data)
    return Command(sequence, echo, torque, Status(status & 7))


def is_newer(sequence: int, than: int) -> bool:
    """Return whether a sequence number comes after another, across the turn."""
    return 0 < (sequence - than) % SEQUENCE_MODULUS < SEQUENCE_MODULUS // 2


def _with_checksum(data: bytes) -> bytes:
    return data + _CHECKSUM.pack(zlib.crc32(data))


def _is_intact(data: bytes, layout: struct.Struct, magic: bytes) -> bool:
    if len(data) != layout.size + _CHECKSUM.size or data[:4] != magic:
        return False
    if int.from_bytes(data[4:6], "little") != PROTOCOL_VERSION:
        return False
    (checksum,) = _CHECKSUM.unpack_from(data, layout.size)
    return bool(checksum == zlib.crc32(data[:-4]))
