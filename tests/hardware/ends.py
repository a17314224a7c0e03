"""End of a link at the rig: loopback UDP, or a CAN bus within or between processes."""

from __future__ import annotations

import itertools
import socket
import time
from contextlib import closing
from typing import Protocol

import can
import pytest

from cc_mujoco.errors import CableError
from cc_mujoco.hardware import CanAddress, CanLink, CanRig, UdpRig
from cc_mujoco.hardware._rig import PacketRig

PATIENCE = 0.05
"""Time for which an end waits for a packet [s]."""
GROUP = "239.74.163.2"
"""Default multicast address of python-can."""
_numbers = itertools.count()


class End(Protocol):
    """Interface by which a peer sends and receives."""

    rig: str
    """Lines of `[rig]` that address this end."""

    def host(self) -> PacketRig:
        """Return the host's end of the link."""

    def receive(self) -> bytes | None:
        """Return the next packet of the host, or None if none came in `PATIENCE`."""

    def send(self, data: bytes) -> None:
        """Send to the sender of the last packet."""

    def stray(self, data: bytes) -> None:
        """Send data that the host must reject."""

    def close(self) -> None:
        """Close the end."""


class UdpEnd:
    """End on a UDP socket of the loopback interface."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(PATIENCE)
        self._port = self._socket.getsockname()[1]
        self.rig = f'address = "127.0.0.1:{self._port}"'

    def host(self) -> PacketRig:
        return UdpRig("127.0.0.1", self._port)

    def receive(self) -> bytes | None:
        try:
            data, self._host = self._socket.recvfrom(1024)
        except TimeoutError:
            return None
        return data

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._host)

    def stray(self, data: bytes) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(data, self._host)

    def close(self) -> None:
        self._socket.close()


class CanEnd:
    """End on a bus of python-can in this process."""

    def __init__(self) -> None:
        self.address = self._address()
        self._link = CanLink(self.address.other_end())
        bus = ", ".join(f"{key} = {value}" for key, value in self.address.bus.items())
        self.rig = (
            f'address = "can:{self.address.channel}"\n'
            f'interface = "{self.address.interface}"\nbus = {{{bus}}}'
        )

    def _address(self) -> CanAddress:
        return CanAddress(f"test-{next(_numbers)}", "virtual")

    def host(self) -> PacketRig:
        return CanRig(self.address)

    def receive(self) -> bytes | None:
        end = time.monotonic() + PATIENCE
        while (data := self._link.receive()) is None and time.monotonic() < end:
            time.sleep(2e-4)
        return data

    def send(self, data: bytes) -> None:
        self._link.send(data)

    def stray(self, data: bytes) -> None:
        identifier = self.address.reading_id
        frames = [
            can.Message(
                arbitration_id=0x7, is_extended_id=False, is_fd=True, data=data
            ),
            can.Message(arbitration_id=identifier, is_fd=True, data=data),
            can.Message(
                arbitration_id=identifier, is_extended_id=False, is_remote_frame=True
            ),
        ]
        for frame in frames:
            self._link._port._bus.send(frame)
        twin = CanLink(self.address)  # of the host: two of them on a bus
        twin.send(data)
        twin.close()

    def close(self) -> None:
        self._link.close()


class MulticastEnd(CanEnd):
    """End on a bus of python-can between processes of this machine."""

    def _address(self) -> CanAddress:
        pytest.importorskip("msgpack", reason="udp_multicast of python-can needs it")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            port = free.getsockname()[1]
        bus = {"port": port, "hop_limit": 0}
        address = CanAddress(GROUP, "udp_multicast", bus=bus)
        _require_multicast(address)
        return address


def _require_multicast(address: CanAddress) -> None:
    try:
        there = address.other_end()
        with closing(CanLink(address)) as one, closing(CanLink(there)) as other:
            one.send(b"?")
            time.sleep(PATIENCE)
            found = other.receive()
    except (OSError, CableError) as error:
        pytest.skip(f"this machine has no multicast: {error}")
    if found != b"?":
        pytest.skip("this machine does not carry multicast to itself")
