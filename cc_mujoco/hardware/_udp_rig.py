"""A rig behind a UDP address."""

from __future__ import annotations

import socket
from collections import Counter

from cc_mujoco.errors import CableError
from cc_mujoco.hardware._rig import PacketRig


class _UdpLink:
    """A packet in a datagram; those of others never reach it."""

    def __init__(self, host: str, port: int) -> None:
        """Open a socket; nothing is sent yet."""
        self.ignored: Counter[str] = Counter()
        self.where = f"{host}:{port}"
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
            family, _, _, _, address = found[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            self._socket.connect(address)
        except OSError as error:
            raise CableError(
                f"cannot reach the rig at {host}:{port}: {error.strerror}; `address` "
                "must be HOST:PORT of a machine that is there."
            ) from None

    def receive(self) -> bytes | None:
        """See `Link`; fails if the system reports that nobody listens there."""
        try:
            return self._socket.recv(1024)
        except (BlockingIOError, InterruptedError):
            return None

    def send(self, data: bytes) -> None:
        self._socket.send(data)

    def close(self) -> None:
        self._socket.close()


class UdpRig(PacketRig):
    """A rig behind UDP; it answers the sender of its last command."""

    def __init__(self, host: str, port: int) -> None:
        """Open a socket; nothing is sent yet.

        Raises:
            CableError: The address means no machine.
        """
        super().__init__(_UdpLink(host, port))
