"""Rig on CAN: frames, and errors of a failing bus."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import can
import pytest

from cc_mujoco.control import controller
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    CanAddress,
    CanLink,
    CanRig,
    DrivenAxis,
    Loop,
    Readings,
    RunOutcome,
    Watchdog,
    read_settings,
)
from cc_mujoco.hardware import _can_bus as can_bus
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._address import CanPlace
from cc_mujoco.hardware._can_bus import MAX_FAILURES
from cc_mujoco.hardware._can_drives import Moteus, Odrive
from cc_mujoco.hardware._references import constant_course
from cc_mujoco.hardware._rig import MAX_PENDING, PacketRig
from hardware.ends import GROUP, CanEnd
from hardware.fakes import LIMITS, Rows, SimulatedClock, drive
from hardware.peers import toml

READING = packet.pack_reading(1, 1000, Readings(0.0, 0.1, 0.0, 0.0, 0.0, 0.0))


class Broken(can.BusABC):
    """Fake bus that returns the given frames and can refuse to send."""

    def __init__(self, frames: Iterable[can.Message | Exception] = ()) -> None:
        super().__init__("none")
        self._can_protocol = can.CanProtocol.CAN_FD
        self.frames = list(frames)
        self.refused: list[Exception] = []
        """Exceptions that the next sends raise, in order."""
        self.sent: list[can.Message] = []

    def recv(self, timeout: float | None = None) -> can.Message | None:
        assert timeout == 0.0
        found = self.frames.pop(0) if self.frames else None
        if isinstance(found, Exception):
            raise found
        return found

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        assert timeout == 0.0
        if self.refused:
            raise self.refused.pop(0)
        self.sent.append(msg)


Opened = Callable[[Broken], CanLink]


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Opened:
    """Return a function that opens a fake bus in place of SocketCAN."""

    def link(bus: Broken) -> CanLink:
        monkeypatch.setattr(can, "Bus", lambda **_: bus)
        return CanLink(CanAddress("can7"))

    return link


def frame(data: bytes = READING, **others: Any) -> can.Message:
    usual = {"arbitration_id": 0x111, "is_extended_id": False, "is_fd": True}
    return can.Message(data=data, **{**usual, **others})


def test_a_command_is_one_frame_of_can_fd(opened: Opened) -> None:
    bus = Broken()
    opened(bus).send(bytes(32))
    (sent,) = bus.sent
    assert (sent.arbitration_id, sent.is_extended_id, sent.dlc) == (0x110, False, 32)
    assert sent.is_fd and sent.bitrate_switch and sent.data == bytes(32)
    sent._check()


def test_an_identifier_beyond_11_bits_has_29() -> None:
    address = CanAddress("long", "virtual", command_id=0x800, reading_id=0x1FFFFFFF)
    host, rig = CanLink(address), CanLink(address.other_end())
    listening = can.Bus("long", "virtual")
    host.send(b"to the rig")
    rig.send(b"to the host")
    assert (rig.receive(), host.receive()) == (b"to the rig", b"to the host")
    assert listening.recv(0.0).is_extended_id  # type: ignore[union-attr]
    listening.shutdown()
    host.close()
    rig.close()


def test_frames_of_others_hide_no_reading(opened: Opened) -> None:
    others = [frame(arbitration_id=k) for k in range(0x100, 0x110)]
    remote = can.Message(
        arbitration_id=0x111, is_extended_id=False, is_remote_frame=True
    )
    error = frame(b"", is_error_frame=True, arbitration_id=4)
    rest = [remote, frame(is_extended_id=True), error]
    link = opened(Broken([*others, *rest, frame()]))
    assert link.receive() == READING
    assert link.receive() is None
    assert dict(link.ignored) == {"error frame": 1}


def test_a_bus_full_of_others_does_not_hold_up(opened: Opened) -> None:
    bus = Broken([frame(arbitration_id=1) for _ in range(3 * MAX_PENDING)])
    assert opened(bus).receive() is None
    assert len(bus.frames) == 2 * MAX_PENDING


class Endless(Broken):
    """Fake bus on which a frame always waits."""

    def __init__(self, given: can.Message) -> None:
        super().__init__()
        self.given, self.count = given, 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self.count += 1
        return self.given


@pytest.mark.parametrize("data", [READING, READING[:8]], ids=["whole", "part"])
@pytest.mark.parametrize("extended", [False, True])
@pytest.mark.parametrize("make", [Odrive, Moteus, PacketRig])
def test_a_sender_without_a_pause_does_not_hold_up(
    make: type[Odrive | Moteus | PacketRig],
    extended: bool,
    data: bytes,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = {Odrive: (9 << 5) | 9, Moteus: 9 << 8, PacketRig: 0x111}[make]
    bus = Endless(frame(data, arbitration_id=node, is_extended_id=extended))
    monkeypatch.setattr(can, "Bus", lambda **_: bus)
    rig = (
        PacketRig(CanLink(CanAddress("can7")))
        if make is PacketRig
        else make(CanPlace("can7"), 9)
    )
    rig.read()
    assert 1 < bus.count <= 2 * MAX_PENDING


def test_a_frame_of_classical_can_is_no_reading(opened: Opened) -> None:
    rig = PacketRig(opened(Broken([frame(READING[:8], is_fd=False)])))
    assert rig.read() is None
    assert rig.ignored["corrupt"] == 1


def run(bus: Broken, monkeypatch: pytest.MonkeyPatch, dog: Watchdog) -> RunOutcome:
    """In simulated time."""
    monkeypatch.setattr(can, "Bus", lambda **_: bus)
    rig = CanRig(CanAddress("can7"))
    axis = DrivenAxis(rig, drive(), constant_course(2.0), LIMITS, dog)
    law = controller("none", drive())
    return Loop([axis], law, clock=SimulatedClock(), log=Rows()).run(1.0)


def readings(count: int) -> list[can.Message]:
    return [
        frame(
            packet.pack_reading(k, 2_000_000 * k, Readings(0.0, 1e-4 * k, *[0.0] * 4))
        )
        for k in range(1, count)
    ]


class Answering(Broken):
    """Bus that returns a frame on every second request."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self.waited = not getattr(self, "waited", False)
        return super().recv(timeout) if self.waited else None


@pytest.mark.parametrize("when", [0, 50])
def test_a_bus_that_takes_nothing_ends_the_run(
    when: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = Answering(readings(500))

    def send(msg: can.Message, timeout: float | None = None) -> None:
        if len(bus.sent) >= when:
            raise can.CanOperationError("Transmit buffer full", 105)
        bus.sent.append(msg)

    monkeypatch.setattr(bus, "send", send)
    outcome = run(bus, monkeypatch, Watchdog(missed_readings=500))
    assert outcome.code == 3
    assert outcome.sentence == (
        "the CAN bus 'can7' of interface 'socketcan' cannot be sent to: Transmit "
        "buffer full [Error Code 105]; is the rig on, with the same bit rates, and is "
        "the bus terminated?"
    )
    assert outcome.ignored["unsent"] >= MAX_FAILURES - 1


def test_frames_that_are_not_sent_now_and_then_are_only_lost(opened: Opened) -> None:
    bus = Broken()
    link = opened(bus)
    for _ in range(3):
        bus.refused = [can.CanOperationError("full") for _ in range(MAX_FAILURES - 1)]
        for _ in range(MAX_FAILURES - 1):
            with pytest.raises(OSError, match="full"):
                link.send(b"lost")
        link.send(b"sent")
    assert len(bus.sent) == 3


def test_a_bus_that_cannot_be_read_ends_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    down = OSError(100, "Network is down")
    bus = Broken([*readings(2), *[down] * 1000])
    outcome = run(bus, monkeypatch, Watchdog(missed_readings=500))
    assert outcome.code == 3
    assert "cannot be read from: Network is down; is the rig on" in outcome.sentence


def test_a_bus_that_is_off_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    off = frame(bytes(8), is_fd=False, is_error_frame=True, arbitration_id=0x40)
    bus = Broken([*readings(2), off])
    outcome = run(bus, monkeypatch, Watchdog(missed_readings=500))
    assert outcome.code == 3
    assert "'socketcan' is off after too many errors" in outcome.sentence
    assert outcome.ignored["error frame"] == 1


def test_without_the_library_it_is_said_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(CableError, match=r"pip install 'cc_mujoco\[can\]'"):
        CanLink(CanAddress("can0"))


@pytest.mark.parametrize(
    ("address", "why"),
    [
        (CanAddress("0", "virtul"), "unknown CAN interface 'virtul': did you mean"),
        (
            CanAddress("0", "virtual", bus={"receive_own_mesages": True}),
            "knows no 'receive_own_mesages', .* did you mean 'receive_own_messages'",
        ),
        (CanAddress("0", "pcan", bus={"f_clok_mhz": 80}), "mean 'f_clock_mhz'"),
        (CanAddress("0", "pcan", bus={"f_clock_mhz": 80}), "cannot be opened: "),
        (CanAddress("no_such_0"), "'no_such_0' of .* cannot be opened: "),
        (CanAddress(GROUP, "udp_multicast", bus={"port": "x"}), "cannot be opened: "),
        (CanAddress(GROUP, "udp_multicast", bus={"fd": False}), "takes CAN FD"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_said(address: CanAddress, why: str) -> None:
    with pytest.raises(CableError, match=why) as error:
        CanLink(address)
    assert "\n" not in str(error.value)


def test_settings_outside_of_rig_toml_are_not_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CAN_CONFIG", '{"rx_queue_size": 1}')
    address = CanAddress("alone", "virtual")
    host, rig = CanLink(address), CanLink(address.other_end())
    for _ in range(3):
        rig.send(READING)
    assert [host.receive() for _ in range(4)] == [READING] * 3 + [None]
    host.close()
    rig.close()


def test_a_network_without_can_fd_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, opened: Opened
) -> None:
    monkeypatch.setattr(can_bus, "NETWORK_FOLDER", tmp_path)
    (tmp_path / "can7").mkdir()
    mtu = tmp_path / "can7" / "mtu"
    mtu.write_text("72\n")
    opened(Broken()).close()
    mtu.write_text("16\n")
    with pytest.raises(CableError, match="is one of classical CAN"):
        opened(Broken())


def test_rig_toml_leads_to_a_bus(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    plain = 'address = "can:can1"'
    path.write_text(toml(plain))
    assert read_settings(path).address() == CanAddress("can1")
    path.write_text(
        toml(f"{plain}\ncommand_id = 0x20\nbus = {{data_bitrate = 5_000_000}}")
    )
    found = read_settings(path).address()
    assert found == CanAddress("can1", command_id=0x20, bus={"data_bitrate": 5_000_000})
    for more, why in (
        ("interfce = 'pcan'", "did you mean 'interface'"),
        ("interface = 'pcn'", r"\[rig\]: unknown CAN interface 'pcn'"),
        ("interface = 1", "interface must be a text"),
        ("command_id = '1'", "command_id must be a whole number from 0 to 0x1fffffff"),
        ("reading_id = 0x20000000", "reading_id must be a whole number"),
        ("reading_id = 0x110", "command_id and reading_id must differ"),
        ("bus = 5", "bus must be a table, such as"),
        ("bus = {local_loopbak = true}", "mean 'local_loopback'"),
    ):
        path.write_text(toml(f"{plain}\n{more}"))
        with pytest.raises(CableError, match=why) as error:
            read_settings(path).connect()
        assert str(path) in str(error.value)


def test_a_virtual_bus_is_opened_from_rig_toml(tmp_path: Path) -> None:
    end = CanEnd()
    path = tmp_path / "rig.toml"
    path.write_text(toml(end.rig))
    rig = read_settings(path).connect()
    rig.write(0.0)
    assert packet.read_command(end.receive() or b"") is not None
    rig.close()
    rig.close()
    end.close()


def test_axes_on_one_bus_open_it_once_and_read_their_own_frames(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def frame(identifier: int, angle: float, number: int = 1) -> can.Message:
        seen = Readings(0.0, angle, *[0.0] * 4)
        data = packet.pack_reading(number, 1000 * number, seen)
        return can.Message(
            arbitration_id=identifier, is_extended_id=False, is_fd=True, data=data
        )

    bus = Broken([frame(0x121, 0.2), frame(0x111, 0.1), frame(0x121, 0.3, 2)])
    opened: list[can.BusABC] = []

    def once(**_: object) -> Broken:
        assert not opened
        opened.append(bus)
        return bus

    monkeypatch.setattr(can, "Bus", once)
    ended: list[bool] = []
    monkeypatch.setattr(bus, "shutdown", lambda: ended.append(True))
    buses: can_bus.CanBuses = {}
    hip = CanRig(CanAddress("can7"), buses)
    knee = CanRig(CanAddress("can7", command_id=0x120, reading_id=0x121), buses)
    found = hip.read(), knee.read()
    assert [seen and seen.motor_angle for seen in found] == [0.1, 0.3]
    assert knee.ignored["overtaken"] == 1 and not hip.ignored.total()
    hip.write(0.5)
    knee.write(0.7)
    assert [each.arbitration_id for each in bus.sent] == [0x110, 0x120]
    hip.close()
    assert not ended
    bus.frames = [frame(0x111, 0.4, 2), frame(0x121, 0.5, 3)]
    seen = knee.read()
    assert seen is not None and seen.motor_angle == 0.5
    knee.close()
    knee.close()
    assert ended == [True]
