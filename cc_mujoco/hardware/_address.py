"""Addresses of rigs in the table `[rig]`: UDP, CAN FD, or a motor drive."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.errors import CableError

MAX_SHORT_ID, MAX_LONG_ID = 0x7FF, 0x1FFFFFFF
"""Greatest identifiers of 11 and of 29 bits."""


@dataclass(frozen=True)
class UdpAddress:
    """UDP port of a host."""

    host: str
    port: int


@dataclass(frozen=True)
class CanPlace:
    """CAN bus: a python-can interface and channel, with its options."""

    channel: str  # name of the channel at the interface, such as `can0`
    interface: str = "socketcan"  # interface of python-can
    bus: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the interface, such as its bit rates."""


@dataclass(frozen=True)
class CanAddress(CanPlace):
    """Identifiers of a rig's commands and readings on a CAN FD bus."""

    command_id: int = 0x110  # of frames with a command; of 29 bits if above 0x7ff
    reading_id: int = 0x111  # of frames with a reading; of two at once the lower wins

    def other_end(self) -> "CanAddress":
        """Return the rig's own address: the two identifiers exchanged."""
        return replace(self, command_id=self.reading_id, reading_id=self.command_id)


@dataclass(frozen=True)
class DriveAddress:
    """Motor drive with its maker's protocol, and a separate rig for joint sensors."""

    protocol: str  # one of `DRIVE_NODES`
    place: CanPlace | str  # the CAN bus, or the serial port
    node: int  # number of the drive on it
    joint: Table  # table with the address or class of the rig that measures the joint
    gear: float = 1.0  # turns of its encoder per turn of the scene's motor, signed [-]
    zero: float = 0.0  # angle of the motor in the scene where that encoder is 0 [rad]
    baud_rate: int = 57_600  # of the serial port [1/s]
    torque_per_ampere: float = 0.0  # at its shaft, if it takes a current [N m/A]


Address = UdpAddress | CanAddress | DriveAddress
DRIVE_NODES = {"odrive": range(63), "moteus": range(1, 128), "dynamixel": range(253)}
"""Numbers that a drive may have on its bus, by protocol."""


def address_of(table: Table) -> Address | None:
    """Return the address in a table; None if it names a user's class instead."""
    if (address := table.text("address")) is None:
        return None
    protocol, colon, place = address.partition(":")
    if protocol == "can" and colon:
        return _can(table, place)
    if protocol in DRIVE_NODES:
        return _drive(table, protocol, place)
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise table.wrong(
            "address",
            'HOST:PORT, such as "192.168.7.2:5005", can:CHANNEL, '
            f"or PROTOCOL:PLACE of a drive ({', '.join(DRIVE_NODES)})",
        )
    table.only("address")
    return UdpAddress(host.strip("[]"), int(port))


def _can(table: Table, channel: str) -> CanAddress:
    names = [each.name for each in fields(CanAddress) if each.name != "channel"]
    table.only("address", *names)
    _require_bus(table, "can", channel)
    for key in ("command_id", "reading_id"):
        _whole(table, key, range(MAX_LONG_ID + 1), 0, f"{MAX_LONG_ID:#x}")
    given = {key: value for key, value in table.content.items() if key != "address"}
    found = CanAddress(channel, **given)
    if found.command_id == found.reading_id:
        raise CableError(f"{table.where}: command_id and reading_id must differ.")
    return found


def _drive(table: Table, protocol: str, place: str) -> DriveAddress:
    keys = ("address", "node", "gear", "zero", "joint")
    is_serial = protocol == "dynamixel"
    needed = "`joint`, a table with the `address` or `class` of what measures the joint"
    if not place:
        kind, example = ("PORT", "/dev/ttyUSB0") if is_serial else ("CHANNEL", "can0")
        more = "" if "joint" in table.content else f", and {needed}"
        wanted = f'{protocol}:{kind}, such as "{protocol}:{example}"{more}'
        raise table.wrong("address", wanted)
    nodes = DRIVE_NODES[protocol]
    node = _whole(table, "node", nodes, nodes.start, str(nodes.stop - 1))
    gear = table.number("gear")
    if gear == 0.0:
        raise table.wrong("gear", "a number other than 0")
    joint = table.table("joint")
    if "class" not in joint.content:
        if "address" not in joint.content:
            raise CableError(
                f"{table.where} needs {needed}: a drive reads its motor only."
            )
        if (joint.text("address") or "").partition(":")[0] in DRIVE_NODES:
            raise joint.wrong("address", "that of a rig with sensors at the joint")
        address_of(joint)
    common = node, joint, gear or 1.0, table.number("zero") or 0.0
    if not is_serial:
        table.only(*keys, "interface", "bus")
        _require_bus(table, protocol, place)
        bus = {k: table.content[k] for k in ("interface", "bus") if k in table.content}
        return DriveAddress(protocol, CanPlace(place, **bus), *common)
    table.only(*keys, "baud_rate", "torque_per_ampere")
    torque = table.number("torque_per_ampere", 1e-6)
    if torque is None:
        raise CableError(
            f"{table.where} needs `torque_per_ampere` [N m/A], of the servo's "
            "performance graph: it takes a current."
        )
    baud = _whole(table, "baud_rate", range(9600, 10_500_001), 57_600, "10500000")
    return DriveAddress(protocol, place, *common, baud, torque)


def _require_bus(table: Table, protocol: str, channel: str) -> None:
    if not channel:
        raise table.wrong("address", f'{protocol}:CHANNEL, such as "{protocol}:can0"')
    table.text("interface")
    if not isinstance(table.content.get("bus", {}), dict):
        raise table.wrong("bus", "a table, such as { data_bitrate = 5_000_000 }")


def _whole(table: Table, key: str, allowed: range, usual: int, most: str) -> int:
    value = table.content.get(key, usual)
    if type(value) is not int or value not in allowed:
        raise table.wrong(key, f"a whole number from {allowed.start} to {most}")
    return value
