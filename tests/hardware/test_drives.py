"""Drives by their makers' protocols: bytes of the documents, and runs with a peer."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import can
import pytest

from cc_mujoco.control import controller
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    DriveAddress,
    DrivenAxis,
    DriveRig,
    Loop,
    Readings,
    RunOutcome,
    Status,
    Watchdog,
    read_axes,
    read_settings,
)
from cc_mujoco.hardware import _can_drives as can_drives
from cc_mujoco.hardware import _dynamixel as dynamixel
from cc_mujoco.hardware._address import CanPlace
from cc_mujoco.hardware._references import constant_course
from cc_mujoco.hardware._rig import END_PACKETS, MotorDrive, end_safely
from hardware.drive_peers import (
    STEP,
    DynamixelServo,
    MoteusController,
    OdriveAxis,
    checksum,
)
from hardware.fakes import LIMITS, Rows, SimulatedClock, drive
from hardware.peers import toml

TURN = 2.0 * math.pi
Peer = OdriveAxis | MoteusController | DynamixelServo
_channels = (f"drives-{number}" for number in itertools.count())


class Joint:
    """Sensors of a joint at rest, with noise."""

    def __init__(self) -> None:
        self.status: Status | None = None
        self.silent = False
        self.commands: list[float] = []
        self.closed = 0

    def read(self) -> Readings | None:
        noise = 1e-4 * math.sin(7.0 * len(self.commands))
        seen = Readings(5.0, 9.0, 9.0, 0.1 + noise, 0.2, noise, self.status)
        return None if self.silent else seen

    def write(self, torque: float) -> None:
        self.commands.append(torque)

    def close(self) -> None:
        self.closed += 1


class Bench:
    """A drive, its peer, and a clock that steps the peer."""

    def __init__(self, name: str, closing: ExitStack, gear: float = 1.0) -> None:
        self.clock = SimulatedClock()
        self.joint = Joint()
        self.drive, self.peer = self._made(name, closing)
        self.rig = DriveRig(self.drive, self.joint, gear, 0.5)
        closing.callback(self.rig.close)
        self.quiet = False

    def _made(self, name: str, closing: ExitStack) -> tuple[MotorDrive, Peer]:
        now = self.clock.now
        if name == "dynamixel":
            servo = DynamixelServo(7)
            closing.callback(servo.close)
            return dynamixel.Dynamixel(servo.port, 7, 57_600, 2.0, now), servo
        place = CanPlace(next(_channels), "virtual")
        fd = name == "moteus"
        kind = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        bus = can.Bus(place.channel, "virtual", protocol=kind)
        closing.callback(bus.shutdown)
        if fd:
            return can_drives.Moteus(place, 9, None, now), MoteusController(bus, 9)
        return can_drives.Odrive(place, 3, None, now), OdriveAxis(bus, 3)

    def cycle(self, torque: float, steps: int = 1) -> Readings | None:
        seen = None
        for _ in range(steps):
            self.rig.write(torque)
            self.clock.time += STEP
            if not self.quiet:
                self.peer.step()
            seen = self.rig.read()
        return seen

    def run(self, duration: float = 0.6) -> RunOutcome:
        self.clock.before = lambda: None if self.quiet else self.peer.step()
        axis = DrivenAxis(self.rig, drive(), constant_course(0.1), LIMITS, Watchdog())
        law = controller("none", drive())
        return Loop([axis], law, clock=self.clock, log=Rows()).run(duration)


NAMES = ("odrive", "moteus", "dynamixel")


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def closing() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def is_on(peer: Peer) -> bool:
    if isinstance(peer, DynamixelServo):
        return peer.table[64] == 1 and peer.table[98] != 0xFF
    if isinstance(peer, OdriveAxis):
        return peer.state == 8
    return peer.mode == 10


def test_identifiers_of_an_odrive_are_those_of_its_document() -> None:
    # "an Axis ID of 0x01 with a command of 0x0C": 0x2C
    assert can_drives.identifier(1, 0x0C) == 0x2C
    assert can_drives.identifier(0x3E, 0x1F) == 0x7DF


def test_frames_of_a_moteus_are_those_of_its_document() -> None:
    # The reply in "CAN Protocol", example: 5 values of int16, 3 of int8.
    found = can_drives.registers(bytes.fromhex("2404000a005000000170ff230d181400"))
    assert found == {0: 10, 1: 80, 2: 256, 3: -144, 13: 24, 14: 20, 15: 0}
    # The command there begins with mode 10, and int8 registers are read by 0x11..0x13.
    assert can_drives.torque_command(0.5)[:3] == bytes.fromhex("01000a")
    assert can_drives.query() == bytes.fromhex("1f0111001 10f".replace(" ", ""))
    assert can_drives.stop_command() == bytes.fromhex("0100001f011100110f50 5050")
    # An error about register 0x02b (0x2b, error 1) hides no value; a cut reply does.
    assert can_drives.registers(bytes.fromhex("302b0121000a50")) == {0: 10}
    assert can_drives.registers(bytes.fromhex("2f0100000000")) is None


@pytest.mark.parametrize(
    ("made", "document"),
    [
        (dynamixel.instruction(1, 0x01, b""), "fffffd0001030001194e"),
        (dynamixel.instruction(0xFE, 0x01, b""), "fffffd00fe0300013142"),
        (dynamixel.read_instruction(1, 132, 4), "fffffd0001070002840004001d15"),
        (
            dynamixel.instruction(1, 0x03, bytes.fromhex("740000020000")),
            "fffffd0001090003740000020000ca89",
        ),
    ],
)
def test_packets_of_a_dynamixel_are_those_of_its_document(
    made: bytes, document: str
) -> None:
    assert made.hex() == document
    assert checksum(made[:-2]) == dynamixel.crc16(made[:-2])


def test_status_packets_of_a_dynamixel_are_found_in_what_is_received() -> None:
    document = bytes.fromhex("fffffd0001080055 00a60000008cc0")  # position 166
    ping = bytes.fromhex("fffffd000107005500060426655d")
    broken = document[:-1] + b"\0"
    received = bytearray(b"\xff\x12" + ping + broken + document + document[:9])
    assert dynamixel.take_status(received, 1) == (0, bytes.fromhex("060426"))
    assert dynamixel.take_status(received, 1) == (0, bytes.fromhex("a6000000"))
    assert dynamixel.take_status(received, 1) is None
    assert received == document[:9]
    received += document[9:]
    assert dynamixel.take_status(received, 2) is None and not received[3:]


def test_a_header_within_a_packet_is_stuffed() -> None:
    made = dynamixel.instruction(1, 0x03, b"\x74\0\xff\xff\xfd\0")
    assert made[5:7] == b"\x0a\0" and b"\xff\xff\xfd\xfd\0" in made[7:]


def test_a_motor_is_enabled_once_it_was_read_and_turns_by_the_torque(
    name: str, closing: ExitStack
) -> None:
    bench = Bench(name, closing, gear=-2.0)
    bench.quiet = True
    assert bench.cycle(0.3, 3) is None
    assert not is_on(bench.peer)
    bench.quiet = False
    for _ in range(20):
        first = bench.cycle(0.0)
        if first is not None:
            break
    assert first is not None and not is_on(bench.peer)
    assert first.motor_angle == 0.5 and first.motor_velocity == 0.0
    bench.cycle(0.0, 20)
    assert is_on(bench.peer)
    seen = bench.cycle(0.3, 40)
    assert seen is not None and seen.status == Status.ENABLED
    assert seen.joint_angle == pytest.approx(0.1, abs=1e-3)
    assert seen.joint_velocity == 0.2
    # The gear turns the sense of both torque and angle, so a rise is a rise.
    assert seen.motor_velocity > 0.0 and seen.motor_angle > 0.5
    assert set(bench.joint.commands) == {0.0}
    peer = bench.peer
    if isinstance(peer, DynamixelServo):
        # -0.15 N m at the shaft, 2 N m/A, 2.69 mA a unit; by the control table.
        assert peer.current == round(-0.15 / 2.0 / 2.69e-3) == -28
        speed = peer.table[128:132]
        turned = int.from_bytes(speed, "little", signed=True) * 0.229 * TURN / 60.0
        assert seen.motor_velocity == pytest.approx(turned / -2.0)
        assert peer.mode_writes == 1
        return
    given = peer.torque if isinstance(peer, OdriveAxis) else peer.command[0x22]
    assert given == pytest.approx(-0.15)
    # A moteus answers a command with what it had before it.
    late = STEP * -0.15 if name == "moteus" else 0.0
    assert seen.motor_velocity == pytest.approx(TURN * (peer.speed - late) / -2.0)


def test_a_run_ends_with_the_motor_off(name: str, closing: ExitStack) -> None:
    bench = Bench(name, closing)
    outcome = bench.run(0.2)
    assert outcome.code == 0, outcome.sentence
    assert bench.joint.closed == 1
    bench.peer.step()
    assert not is_on(bench.peer)


def broken_odrive(peer: Any) -> None:
    peer.fail(0x1000)


def broken_moteus(peer: Any) -> None:
    peer.mode, peer.fault = 1, 33


def broken_dynamixel(peer: Any) -> None:
    peer.alert, peer.table[64] = True, 0


@pytest.mark.parametrize(
    ("name", "breaks"),
    [
        ("odrive", broken_odrive),
        ("moteus", broken_moteus),
        ("dynamixel", broken_dynamixel),
    ],
)
def test_a_fault_of_the_drive_is_reported(
    name: str, breaks: Any, closing: ExitStack
) -> None:
    bench = Bench(name, closing)
    bench.cycle(0.0, 30)
    breaks(bench.peer)
    seen = bench.cycle(0.0, 12)
    assert seen is not None and seen.status == Status.FAULT


def test_a_host_that_is_silent_loses_the_torque_and_never_gets_it_back(
    name: str, closing: ExitStack
) -> None:
    bench = Bench(name, closing)
    bench.cycle(0.0, 30)
    assert is_on(bench.peer)
    for _ in range(40):  # 80 ms
        bench.peer.step()
    assert not is_on(bench.peer)
    seen = bench.cycle(0.3, 20)
    bench.clock.time += 2.0
    bench.cycle(0.3, 20)
    assert seen is not None and seen.status in (Status.NONE, Status.FAULT)
    assert not is_on(bench.peer)


def test_a_drive_that_is_silent_ends_the_run(
    name: str, closing: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(name, closing)
    end, step = bench.clock.time + 0.2, bench.peer.step

    def step_until_end() -> None:
        bench.quiet = bench.clock.time > end
        if not bench.quiet:
            step()

    monkeypatch.setattr(bench.peer, "step", step_until_end)
    outcome = bench.run()
    assert outcome.code == 3 and "the rig is silent" in outcome.sentence


def test_sensors_at_the_joint_end_a_run_by_silence_or_a_fault(
    closing: ExitStack,
) -> None:
    bench = Bench("moteus", closing)
    bench.cycle(0.0, 30)
    bench.joint.status = Status.FAULT
    seen = bench.cycle(0.0)
    assert seen is not None and seen.status == Status.FAULT | Status.ENABLED
    bench.joint.silent = True
    assert [bench.cycle(0.0) for _ in range(3)] == [None] * 3


def test_a_current_beyond_the_limit_of_a_servo_is_cut_and_counted(
    closing: ExitStack,
) -> None:
    bench = Bench("dynamixel", closing)
    bench.cycle(0.0, 30)
    bench.cycle(-9.0)
    assert isinstance(bench.peer, DynamixelServo) and bench.peer.current == -648
    assert bench.rig.ignored["torque beyond the servo's current limit"] == 1


def test_noise_on_a_serial_line_costs_no_reading(closing: ExitStack) -> None:
    bench = Bench("dynamixel", closing)
    assert isinstance(bench.peer, DynamixelServo)
    bench.peer.noise = b"\xff\xff\xfd\0\7\xff\xff\x00" + b"\xff\xff\xfd"
    bench.cycle(0.0, 30)
    assert is_on(bench.peer) and bench.cycle(0.0) is not None


def test_a_servo_is_not_talked_over(closing: ExitStack) -> None:
    bench = Bench("dynamixel", closing)
    bench.cycle(0.0, 30)
    bench.rig.write(0.1)
    bench.rig.write(0.2)
    assert bench.rig.ignored["unsent"] == 1
    bench.clock.time += 2.0 * dynamixel.REPLY_TIME
    bench.rig.write(0.2)
    assert bench.rig.ignored["unsent"] == 1


DRIVEN = """address = "{0}"
gear = 9.0
joint = {{ address = "127.0.0.1:5005" }}"""


def test_rig_toml_leads_to_a_drive(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    channel = next(_channels)
    plain = DRIVEN.format(f"odrive:{channel}") + '\ninterface = "virtual"'
    path.write_text(toml(f"{plain}\nnode = 4"))
    settings = read_settings(path)
    address = settings.address()
    assert isinstance(address, DriveAddress)
    assert (address.place, address.node) == (CanPlace(channel, "virtual"), 4)
    rig = settings.connect()
    assert isinstance(rig, DriveRig) and "ODrive 4 on the CAN bus" in rig.where
    rig.close()
    servo = DRIVEN.format("dynamixel:/dev/no_such_port")
    for text, why in (
        (f"{plain}\nnode = 63", "node must be a whole number from 0 to 62"),
        (plain.replace("9.0", "0"), "gear must be a number other than 0"),
        (plain.replace("odrive", "odrve"), "address must be HOST:PORT, .*odrive, mot"),
        (plain.replace("127.0.0.1:5005", "moteus:can0"), "joint.* sensors at the jo"),
        ('address = "odrive:can0"', "needs `joint`, a table with the `address`"),
        ('address = "odrive:"', 'as "odrive:can0", and `joint`, a table with the `a'),
        (DRIVEN.format("dynamixel:"), 'such as "dynamixel:/dev/ttyUSB0", not'),
        (f"{plain}\nbaud_rate = 9600", "key .*'baud_rate'"),
        (servo, "needs `torque_per_ampere`"),
        (f"{servo}\ntorque_per_ampere = 1.7", "no_such_port cannot be opened: .*plug"),
    ):
        path.write_text(toml(text))
        with pytest.raises(CableError, match=why) as error:
            read_settings(path).connect()
        assert str(path) in str(error.value)


def test_every_stop_is_tried_whatever_fails() -> None:
    tried: list[str] = []

    def stop() -> None:
        tried.append("stop")
        raise RuntimeError("an error that no interface documents")

    with pytest.raises(RuntimeError):
        end_safely(stop, 0.0, lambda: tried.append("drive"), lambda: tried.append("j"))
    assert tried == [*["stop"] * END_PACKETS, "drive", "j"]


def test_two_axes_have_drives_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    text = (
        toml("").replace("[rig]", "")
        + """
[axes.hip.rig]
address = "moteus:can0"
node = 1
joint = { address = "127.0.0.1:5001" }
[axes.knee.rig]
address = "moteus:can0"
node = 2
joint = { address = "127.0.0.1:5002" }
"""
    )
    path.write_text(text)
    assert len(read_axes(path)) == 2
    for old, new, why in (
        ("node = 2", "node = 1", "both are moteus 1 on 'can0'"),
        ("5002", "5001", "have the same address"),
        ("node = 2", "node = 2\nbus = {a = 1}", "open it differently"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(CableError, match=why):
            read_axes(path)


def test_a_bus_carries_one_kind_of_can(closing: ExitStack) -> None:
    place = CanPlace(next(_channels), "virtual")
    buses: dict[Any, Any] = {}
    one = can_drives.Odrive(place, 1, buses)
    closing.callback(one.close)
    with pytest.raises(CableError, match="CAN FD for one axis and classical CAN"):
        can_drives.Moteus(place, 1, buses)


def test_drives_on_one_bus_hear_their_own_frames(closing: ExitStack) -> None:
    place = CanPlace(next(_channels), "virtual")
    buses: dict[Any, Any] = {}
    made = []
    for node in (1, 2):
        kind = can.CanProtocol.CAN_FD
        bus = can.Bus(place.channel, "virtual", protocol=kind)
        closing.callback(bus.shutdown)
        one = can_drives.Moteus(place, node, buses)
        closing.callback(one.close)
        made.append((one, MoteusController(bus, node)))
    for _ in range(20):
        for one, _ in made:
            one.write(0.1 if one is made[0][0] else -0.2)
        for _, peer in made:
            peer.step()
        seen = [one.read() for one, _ in made]
    (first, one), (second, other) = made[0], made[1]
    assert [peer.command[0x22] for peer in (one, other)] == pytest.approx([0.1, -0.2])
    assert seen[0] is not None and seen[0].velocity > 0.0
    assert seen[1] is not None and seen[1].velocity < 0.0
    assert not first.ignored.total() and not second.ignored.total()
