"""The rig that a table of `rig.toml` names, and whether two tables name the same."""

from __future__ import annotations

import contextlib
import itertools
import socket

from cc_mujoco._utils.toml_table import Table
from cc_mujoco._utils.user_code import named_object, user_errors
from cc_mujoco.errors import CableError, naming
from cc_mujoco.hardware._address import (
    Address,
    CanAddress,
    CanPlace,
    DriveAddress,
    UdpAddress,
    address_of,
)
from cc_mujoco.hardware._can_bus import CanBuses, CanRig
from cc_mujoco.hardware._drive_rig import DriveRig, MotorDrive
from cc_mujoco.hardware._dynamixel import Dynamixel
from cc_mujoco.hardware._moteus import Moteus
from cc_mujoco.hardware._odrive import Odrive
from cc_mujoco.hardware._rig import Rig, UdpRig


def rig_address(table: Table) -> Address | None:
    """Return the address in a table, None where it has a class."""
    return address_of(table) if "address" in table.content else None


def connect_rig(table: Table, buses: CanBuses) -> Rig:
    """Make the rig of a table with an address or a class; nothing is sent yet.

    `buses` are open CAN buses that it shares with other rigs.
    """
    address = rig_address(table)
    if address is None:
        return _user_rig(table, table.code("class") or "")
    with naming(table.where):
        if isinstance(address, UdpAddress):
            return UdpRig(address.host, address.port)
        if isinstance(address, CanAddress):
            return CanRig(address, buses)
    joint = connect_rig(address.joint, buses)
    with contextlib.ExitStack() as closing, naming(table.where):
        closing.callback(joint.close)
        rig = DriveRig(_drive(address, buses), joint, address.gear, address.zero)
        closing.pop_all()
    return rig


def require_distinct(pair: str, one: Table, other: Table) -> None:
    """Refuse two axes whose commands would reach the same motor."""
    if one.content == other.content:
        raise CableError(
            f"{pair} have the same rig; give each its own address, or keys, in its "
            "[axes.NAME.rig]."
        )
    for mine, theirs in itertools.product(_addresses(one), _addresses(other)):
        _require_distinct(pair, mine, theirs)


def _addresses(rig: Table) -> list[Address]:
    """Return the addresses of a rig, and of its sensors at the joint."""
    address = rig_address(rig)
    joint = rig_address(address.joint) if isinstance(address, DriveAddress) else None
    return [each for each in (address, joint) if each is not None]


def _require_distinct(pair: str, mine: Address, theirs: Address) -> None:
    """Refuse addresses of two axes that reach the same rig."""
    if isinstance(mine, UdpAddress) and isinstance(theirs, UdpAddress):
        if mine.port == theirs.port and _machine(mine) == _machine(theirs):
            raise CableError(f"{pair} have the same address.")
    if isinstance(mine, DriveAddress) and isinstance(theirs, DriveAddress):
        if isinstance(mine.place, str) and mine.place == theirs.place:
            raise CableError(f"{pair} are on the same port; give each servo its own.")
    bus, other = _bus(mine), _bus(theirs)
    if bus is None or other is None:
        return
    if (bus.channel, bus.interface) != (other.channel, other.interface):
        return
    if bus.bus != other.bus:
        raise CableError(
            f"{pair} are on the same CAN bus and open it differently; give `bus` "
            "once, in [rig]."
        )
    if isinstance(mine, DriveAddress) and isinstance(theirs, DriveAddress):
        if (mine.protocol, mine.node) == (theirs.protocol, theirs.node):
            raise CableError(
                f"{pair} both are {mine.protocol} {mine.node} on {bus.channel!r}; give "
                "each axis the `node` of its drive."
            )
    if isinstance(mine, CanAddress) and isinstance(theirs, CanAddress):
        same = {mine.command_id, mine.reading_id} & {
            theirs.command_id,
            theirs.reading_id,
        }
        if same:
            raise CableError(
                f"{pair} both use the identifier {min(same):#x} on {mine.channel!r}; "
                "give each axis a command_id and a reading_id of its own."
            )


def _bus(address: Address) -> CanPlace | None:
    place = address.place if isinstance(address, DriveAddress) else address
    return place if isinstance(place, CanPlace) else None


def _machine(address: UdpAddress) -> str:
    """Return the number of a machine; its name where nobody knows it."""
    try:
        return str(socket.getaddrinfo(address.host, address.port)[0][4][0])
    except OSError:
        return address.host


def _drive(address: DriveAddress, buses: CanBuses) -> MotorDrive:
    if isinstance(address.place, str):
        return Dynamixel(
            address.place, address.node, address.baud_rate, address.torque_per_ampere
        )
    if address.protocol == "odrive":
        return Odrive(address.place, address.node, buses)
    return Moteus(address.place, address.node, buses)


def _user_rig(table: Table, name: str) -> Rig:
    """Return a rig of a class that is importable, also from the current folder."""
    others = {key: value for key, value in table.content.items() if key != "class"}
    kind = named_object(f"{table.where}, class", name, "class")
    with user_errors(f"{table.where}, class {name!r}"):
        made = kind(**others)
    if not isinstance(made, Rig):
        raise CableError(
            f"{table.where}, class {name!r} makes no rig; it needs read(), "
            "write(torque) and close()."
        )
    return made
