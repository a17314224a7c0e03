"""A rig as the loop sees it, and the one at the other end of UDP."""

from __future__ import annotations

import socket
import time
from collections import Counter
from typing import Protocol, runtime_checkable

from cc_mujoco.errors import CableError
from cc_mujoco.hardware import packet
from cc_mujoco.hardware.packet import Command, Readings, Status

FAREWELLS = 10
"""Packets that say that the run is over; some may be lost."""
_APART = 1e-3
"""Time between them [s]."""


@runtime_checkable
class Rig(Protocol):
    """What drives a motor and reads its sensors.

    A class of your own needs these three methods and is made by `module:Class` with the
    other keys of `[rig]` as keywords. No method may block for long: the loop waits for
    it. It may have a `ignored`, a `Counter` of what was received and not used, by why.
    """

    def read(self) -> Readings | None:
        """The newest reading, None if none came since the last call."""

    def write(self, torque: float) -> None:
        """Ask the motor for a torque [Nm]."""

    def close(self) -> None:
        """Leave the motor without torque, for good."""


class UdpRig:
    """A rig behind a UDP address; packets of others never reach it.

    The rig answers whom it got its last command from, so a zero command comes first.
    """

    def __init__(self, host: str, port: int) -> None:
        """Open a socket; nothing is sent yet.

        Raises:
            CableError: The address means no machine.
        """
        self.ignored: Counter[str] = Counter()
        """Packets that were not used: corrupt, repeated, reordered, overtaken."""
        self._sequence = 0
        self._last: packet.Packet | None = None
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

    def read(self) -> Readings | None:
        """The newest reading that is whole and newer than the last; see `Rig`."""
        newest = None
        while (data := self._receive()) is not None:
            found = packet.read_reading(data)
            if found is None:
                self.ignored["corrupt"] += 1
                continue
            last = self._last
            if last is not None and not packet.is_newer(found.sequence, last.sequence):
                same = found.sequence == last.sequence
                self.ignored["repeated" if same else "reordered"] += 1
                continue
            if last is not None and found.stamp <= last.stamp:
                self.ignored["stamp stands still"] += 1
                continue
            self.ignored["overtaken"] += newest is not None
            self._last, newest = found, found.readings
        return newest

    def write(self, torque: float) -> None:
        """Send a command, enabled once the rig has been heard; see `Rig`."""
        heard = self._last is not None
        self._send(torque, Status.ENABLED if heard else Status.NONE)

    def close(self) -> None:
        """Say several times that the run is over; see `Rig`."""
        if self._socket.fileno() < 0:
            return
        for _ in range(FAREWELLS):
            self._send(0.0, Status.STOPPED)
            time.sleep(_APART)
        self._socket.close()

    def _receive(self) -> bytes | None:
        try:
            return self._socket.recv(1024)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:  # nobody listens there, as the system was told
            self.ignored["unreachable"] += 1
            return None

    def _send(self, torque: float, status: Status) -> None:
        self._sequence += 1
        echo = 0 if self._last is None else self._last.stamp
        try:
            self._socket.send(
                packet.command(Command(self._sequence, echo, torque, status))
            )
        except OSError:
            # As good as lost on the way; readings stop, too, and that is watched.
            self.ignored["unsent"] += 1
