"""The two packets, and a rig behind UDP that loses, repeats and spoils them."""

from __future__ import annotations

import socket
import struct
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.control import controller
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    Loop,
    Outcome,
    Readings,
    Status,
    UdpRig,
    Watchdog,
    packet,
)
from cc_mujoco.hardware.desired import constant
from cc_mujoco.hardware.packet import Command
from hardware.fakes import LIMITS, Rows, drive
from hardware.peers import Peer

PATIENT = Watchdog(missed_readings=500, missed_deadlines=500)
DOUBLES = st.floats(allow_nan=False)
STAMPS = st.integers(0, 2**53)
SEQUENCES = st.integers(0, 2**32 - 1)


class PacedClock:
    """Every cycle takes about a millisecond, and none is late on a busy machine."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def wait(self, deadline: float) -> None:
        time.sleep(1e-3)
        self.time = deadline


def run(peer: Peer, duration: float, watchdog: Watchdog = PATIENT) -> Outcome:
    loop = Loop(
        UdpRig("127.0.0.1", peer.port),
        controller("none", drive()),
        constant(2.0),
        LIMITS,
        watchdog,
        clock=PacedClock(),
        log=Rows(),
    )
    return loop.run(duration)


@given(values=st.tuples(*[DOUBLES] * 5), sequence=SEQUENCES, stamp=STAMPS)
def test_a_reading_comes_as_it_was_sent(
    values: tuple[float, ...], sequence: int, stamp: int
) -> None:
    data = packet.reading(sequence, stamp, Readings(0.0, *values, Status.FAULT))
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
    data = packet.command(given)
    assert len(data) == 32
    assert packet.read_command(data) == given
    assert packet.read_reading(data) is None


def test_packets_lie_in_memory_as_the_page_says() -> None:
    """Offset by offset, by what has no part in the code."""
    data = packet.command(Command(7, 9, -0.5, Status.STOPPED))
    assert data[:8] == b"CCMC\x01\x00\x02\x00"
    assert data[8:12] == (7).to_bytes(4, "little")
    assert data[12:20] == (9).to_bytes(8, "little")
    assert data[20:28] == struct.pack("<d", -0.5)
    assert data[28:] == zlib.crc32(data[:28]).to_bytes(4, "little")
    data = packet.reading(3, 5, Readings(0.0, 1.0, 2.0, 3.0, 4.0, 5.0))
    assert data[:8] == b"CCMR\x01\x00\x00\x00"
    assert data[20:60] == struct.pack("<5d", 1.0, 2.0, 3.0, 4.0, 5.0)
    assert data[60:] == zlib.crc32(data[:60]).to_bytes(4, "little")


@given(place=st.integers(0, 511), values=st.tuples(*[DOUBLES] * 5))
def test_a_packet_with_any_bit_turned_is_none(
    place: int, values: tuple[float, ...]
) -> None:
    data = bytearray(packet.reading(1, 2, Readings(0.0, *values)))
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


class Received:
    """A `UdpRig` that receives what a test sends it."""

    def __init__(self) -> None:
        self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.peer.bind(("127.0.0.1", 0))
        self.rig = UdpRig("127.0.0.1", self.peer.getsockname()[1])
        self.rig.write(0.0)
        self.address = self.peer.recvfrom(100)[1]

    def __call__(self, *packets: bytes) -> Readings | None:
        for data in packets:
            self.peer.sendto(data, self.address)
        time.sleep(0.01)  # loopback is far faster
        return self.rig.read()


@pytest.fixture
def received() -> Iterable[Received]:
    made = Received()
    yield made
    made.rig.close()
    made.peer.close()


def sent(sequence: int, angle: float, stamp: int | None = None) -> bytes:
    values = Readings(0.0, angle, 0.0, 0.0, 0.0, 0.0)
    return packet.reading(sequence, 1000 * sequence if stamp is None else stamp, values)


def test_the_newest_reading_counts_and_others_are_counted(received: Received) -> None:
    assert received.rig.read() is None
    found = received(sent(1, 0.1), sent(2, 0.2), sent(4, 0.4), sent(3, 0.3))
    assert found is not None and found.motor_angle == 0.4
    ignored = received.rig.ignored
    assert ignored == Counter(overtaken=2, reordered=1)
    assert received(sent(4, 0.5)) is None
    assert received(sent(5, 0.5)[:-1], sent(5, 0.5) + b"x", b"") is None
    assert received(sent(6, 0.6, stamp=4000)) is None
    assert received.rig.read() is None
    assert ignored["repeated"] == 1 and ignored["corrupt"] == 3
    assert ignored["stamp stands still"] == 1
    found = received(sent(7, 0.7))
    assert found is not None and found.motor_angle == 0.7


def test_packets_of_others_are_not_received(received: Received) -> None:
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.sendto(sent(9, 0.9), received.address)
    stranger.close()
    time.sleep(0.01)
    assert received.rig.read() is None
    assert not received.rig.ignored


def test_commands_are_enabled_once_the_rig_is_heard(received: Received) -> None:
    received(sent(1, 0.1))
    received.rig.write(0.25)
    command = packet.read_command(received.peer.recv(100))
    assert command == Command(2, 1000, 0.25, Status.ENABLED)
    received.rig.close()
    farewells = [packet.read_command(received.peer.recv(100)) for _ in range(10)]
    assert all(
        each is not None and each.torque == 0.0 and each.status == Status.STOPPED
        for each in farewells
    )


def test_the_first_command_is_not_enabled() -> None:
    with Peer() as peer:
        run(peer, 0.05)
    assert peer.commands[0].status == Status.NONE and peer.commands[0].torque == 0.0
    assert peer.stopped() and peer.commands[-2].torque == 0.0


def lost(count: int, data: bytes) -> list[bytes]:
    return [] if count % 3 else [data]


def repeated(count: int, data: bytes) -> list[bytes]:
    return [data, data]


def corrupt(count: int, data: bytes) -> list[bytes]:
    return [data[:30] + bytes([data[30] ^ 4]) + data[31:], data]


class Reordering:
    """Sends every second reading after the one that follows it."""

    def __init__(self) -> None:
        self.kept = b""

    def __call__(self, count: int, data: bytes) -> list[bytes]:
        if count % 2:
            self.kept = data
            return []
        return [data, self.kept]


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lost, None),
        (repeated, "repeated"),
        (corrupt, "corrupt"),
        (Reordering(), "reordered"),
    ],
)
def test_a_run_goes_on_through_what_networks_do(
    spoil: Callable[[int, bytes], list[bytes]], why: str | None
) -> None:
    with Peer(spoil) as peer:
        outcome = run(peer, 0.3)
    assert outcome.code == 0, outcome.sentence
    assert max(peer.torques) > 0.5 and peer.torques[-1] == 0.0
    assert all(abs(torque) <= LIMITS.torque for torque in peer.torques)
    if why is None:
        assert outcome.without_reading > 20
    else:
        assert outcome.ignored[why] > 20


def test_only_corrupt_packets_end_the_run() -> None:
    quick = Watchdog(missed_readings=25, missed_deadlines=500)
    with Peer(lambda k, d: corrupt(k, d)[: 1 if k > 50 else 2]) as peer:
        outcome = run(peer, 5.0, quick)
    assert "no new reading in 25 cycles" in outcome.sentence and outcome.code == 3
    assert peer.stopped()


def test_a_peer_that_is_killed_ends_the_run() -> None:
    quick = Watchdog(missed_readings=25, missed_deadlines=500)
    with Peer() as peer:

        def killed(count: int, data: bytes) -> list[bytes]:
            if count == 50:
                peer.kill()
                return []
            return [data]

        peer.spoil = killed
        outcome = run(peer, 5.0, quick)
    assert "silent" in outcome.sentence and outcome.code == 3


def test_a_host_that_cannot_be_is_refused() -> None:
    with pytest.raises(CableError, match="HOST:PORT"):
        UdpRig("no.such.host.invalid", 5005)
