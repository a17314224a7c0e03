"""Address of a rig, as `[rig]` gives it: behind UDP, or on a CAN bus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.errors import CableError

MAX_SHORT_ID, MAX_LONG_ID = 0x7FF, 0x1FFFFFFF
"""Greatest identifiers of 11 and of 29 bits."""
_CAN_PREFIX = "can:"
_ID_KEYS = ("command_id", "reading_id")


@dataclass(frozen=True)
class UdpAddress:
    """A port of a machine."""

    host: str
    port: int


@dataclass(frozen=True)
class CanAddress:
    """A place on a CAN FD bus."""

    channel: str
    """Name of the channel at the interface, such as `can0`."""
    interface: str = "socketcan"
    """Interface of python-can."""
    command_id: int = 0x110
    """Identifier of frames with a command; of 29 bits if above 0x7ff."""
    reading_id: int = 0x111
    """Identifier of frames with a reading; of two at once the lower wins."""
    bus: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the interface, such as its bit rates."""

    def other_end(self) -> CanAddress:
        """Return the rig's own address, which hears commands and sends readings."""
        return replace(self, command_id=self.reading_id, reading_id=self.command_id)


def address_of(table: Table) -> UdpAddress | CanAddress:
    """Return the address in a table that has the key `address`.

    Raises:
        CableError: It cannot be, or the table has a key or a value that cannot.
    """
    address = table.text("address") or ""
    if address.startswith(_CAN_PREFIX):
        return _can(table, address.removeprefix(_CAN_PREFIX))
    table.only("address")
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise table.wrong(
            "address", 'HOST:PORT, such as "192.168.7.2:5005", or can:CHANNEL'
        )
    return UdpAddress(host.strip("[]"), int(port))


def _can(table: Table, channel: str) -> CanAddress:
    names = [each.name for each in fields(CanAddress) if each.name != "channel"]
    table.only("address", *names)
    if not channel:
        raise table.wrong("address", 'can:CHANNEL, such as "can:can0"')
    table.text("interface")
    if not isinstance(table.content.get("bus", {}), dict):
        raise table.wrong("bus", "a table, such as { data_bitrate = 5_000_000 }")
    for key in _ID_KEYS:
        value = table.content.get(key, 0)
        if type(value) is not int or not 0 <= value <= MAX_LONG_ID:
            raise table.wrong(key, f"a whole number from 0 to {MAX_LONG_ID:#x}")
    given = {key: value for key, value in table.content.items() if key != "address"}
    found = CanAddress(channel, **given)
    if found.command_id == found.reading_id:
        raise CableError(f"{table.where}: command_id and reading_id must differ.")
    return found
