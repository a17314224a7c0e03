"""A rig behind UDP or on CAN that loses, repeats and spoils its packets."""

from __future__ import annotations

import copy
import time
from collections import Counter
from collections.abc import Callable, Iterable

import pytest

from cc_mujoco.control import controller
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    DrivenAxis,
    Loop,
    Readings,
    RunOutcome,
    Status,
    UdpRig,
    Watchdog,
)
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._packet import Command
from cc_mujoco.hardware._references import constant_course
from hardware.ends import CanEnd, End, UdpEnd
from hardware.fakes import LIMITS, Rows, drive
from hardware.peers import Peer

PATIENT = Watchdog(missed_readings=500, missed_deadlines=500)
ENDS = (UdpEnd, CanEnd)


class PacedClock:
    """Every cycle takes about a millisecond, and none is late on a busy machine."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def wait(self, deadline: float) -> None:
        time.sleep(1e-3)
        self.time = deadline


def run(peer: Peer, duration: float, watchdog: Watchdog = PATIENT) -> RunOutcome:
    axis = DrivenAxis(peer.end.host(), drive(), constant_course(2.0), LIMITS, watchdog)
    law = controller("none", drive())
    return Loop([axis], law, clock=PacedClock(), log=Rows()).run(duration)


class Received:
    """A rig at the host's end that receives what a test sends it."""

    def __init__(self, end: End) -> None:
        self.end, self.rig = end, end.host()
        self.rig.write(0.0)
        assert end.receive() is not None

    def __call__(self, *packets: bytes) -> Readings | None:
        for data in packets:
            self.end.send(data)
        time.sleep(0.01)  # loopback is far faster
        return self.rig.read()

    def command(self) -> Command | None:
        return packet.read_command(self.end.receive() or b"")


@pytest.fixture(params=ENDS)
def end(request: pytest.FixtureRequest) -> Iterable[End]:
    made: End = request.param()
    yield made
    made.close()


@pytest.fixture
def received(end: End) -> Iterable[Received]:
    made = Received(end)
    yield made
    made.rig.close()


def sent(sequence: int, angle: float, stamp: int | None = None) -> bytes:
    values = Readings(0.0, angle, 0.0, 0.0, 0.0, 0.0)
    return packet.pack_reading(
        sequence, 1000 * sequence if stamp is None else stamp, values
    )


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
    received.end.stray(sent(9, 0.9))
    time.sleep(0.01)
    assert received.rig.read() is None
    assert not received.rig.ignored


def test_commands_are_enabled_once_the_rig_is_heard(received: Received) -> None:
    received(sent(1, 0.1))
    received.rig.write(0.25)
    assert received.command() == Command(2, 1000, 0.25, Status.ENABLED)
    received.rig.close()
    farewells = [received.command() for _ in range(10)]
    assert all(
        each is not None and each.torque == 0.0 and each.status == Status.STOPPED
        for each in farewells
    )


def test_the_first_command_is_not_enabled(end: End) -> None:
    with Peer(end=end) as peer:
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


class Late:
    """Sends every reading after three others have been requested."""

    def __init__(self) -> None:
        self.kept: list[bytes] = []

    def __call__(self, count: int, data: bytes) -> list[bytes]:
        self.kept.append(data)
        return [self.kept.pop(0)] if len(self.kept) > 3 else []


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lost, None),
        (Late(), ""),
        (repeated, "repeated"),
        (corrupt, "corrupt"),
        (Reordering(), "reordered"),
    ],
)
def test_a_run_goes_on_through_what_networks_do(
    end: End, spoil: Callable[[int, bytes], list[bytes]], why: str | None
) -> None:
    with Peer(copy.deepcopy(spoil), end) as peer:
        outcome = run(peer, 0.3)
    assert outcome.code == 0, outcome.sentence
    assert max(peer.torques) > 0.5 and peer.torques[-1] == 0.0
    assert all(abs(torque) <= LIMITS.torque for torque in peer.torques)
    if why is None:
        assert outcome.without_reading > 20
    elif why:
        assert outcome.ignored[why] > 20
    else:
        assert not outcome.ignored["reordered"]


def test_only_corrupt_packets_end_the_run(end: End) -> None:
    quick = Watchdog(missed_readings=25, missed_deadlines=500)
    with Peer(lambda k, d: corrupt(k, d)[: 1 if k > 50 else 2], end) as peer:
        outcome = run(peer, 5.0, quick)
    assert "no new reading in 25 cycles" in outcome.sentence and outcome.code == 3
    assert peer.stopped()


def test_a_peer_that_is_killed_ends_the_run(end: End) -> None:
    quick = Watchdog(missed_readings=25, missed_deadlines=500)
    with Peer(end=end) as peer:

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
