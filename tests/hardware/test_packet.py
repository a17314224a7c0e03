"""The two packets: what is in them, and what is none."""

from __future__ import annotations

import struct
import zlib

from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.hardware import Readings, Status
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._packet import Command

DOUBLES = st.floats(allow_nan=False)
STAMPS = st.integers(0, 2**53)
SEQUENCES = st.integers(0, 2**32 - 1)


@given(values=st.tuples(*[DOUBLES] * 5), sequence=SEQUENCES, stamp=STAMPS)
def test_a_reading_comes_as_it_was_sent(
    values: tuple[float, ...], sequence: int, stamp: int
) -> None:
    data = packet.pack_reading(sequence, stamp, Readings(0.0, *values, Status.FAULT))
    assert len(data) == 64
    found = packet.read_reading(data)
    assert found is not None
    assert (found.sequence, found.stamp) == (sequence, stamp)
    assert found.readings == Readings(stamp * 1e-9, *values, Status.FAULT)


@given(torque=DOUBLES, sequence=SEQUENCES, echo=STAMPS)
def test_a_command_comes_as_it_was_sent(
    torque: float, sequence: int, echo: int
) -> None:
    given = Command(sequence, echo, torque, Status.ENABLED)
    data = packet.pack_command(given)
    assert len(data) == 32
    assert packet.read_command(data) == given
    assert packet.read_reading(data) is None


def test_packets_lie_in_memory_as_the_page_says() -> None:
    """Offset by offset, by what has no part in the code."""
    data = packet.pack_command(Command(7, 9, -0.5, Status.STOPPED))
    assert data[:8] == b"CCMC\x01\x00\x02\x00"
    assert data[8:12] == (7).to_bytes(4, "little")
    assert data[12:20] == (9).to_bytes(8, "little")
    assert data[20:28] == struct.pack("<d", -0.5)
    assert data[28:] == zlib.crc32(data[:28]).to_bytes(4, "little")
    data = packet.pack_reading(3, 5, Readings(0.0, 1.0, 2.0, 3.0, 4.0, 5.0))
    assert data[:8] == b"CCMR\x01\x00\x00\x00"
    assert data[20:60] == struct.pack("<5d", 1.0, 2.0, 3.0, 4.0, 5.0)
    assert data[60:] == zlib.crc32(data[:60]).to_bytes(4, "little")


@given(place=st.integers(0, 511), values=st.tuples(*[DOUBLES] * 5))
def test_a_packet_with_any_bit_turned_is_none(
    place: int, values: tuple[float, ...]
) -> None:
    data = bytearray(packet.pack_reading(1, 2, Readings(0.0, *values)))
    data[place // 8] ^= 1 << place % 8
    assert packet.read_reading(bytes(data)) is None


@given(data=st.binary(max_size=80))
def test_rubbish_is_none(data: bytes) -> None:
    assert packet.read_reading(data) is None and packet.read_command(data) is None


@given(start=SEQUENCES, ahead=st.integers(1, 2**31 - 1))
def test_sequence_numbers_go_on_across_their_turn(start: int, ahead: int) -> None:
    later = (start + ahead) % 2**32
    assert packet.is_newer(later, start)
    assert not packet.is_newer(start, later)
    assert not packet.is_newer(start, start)
