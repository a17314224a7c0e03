"""The rig's end of the protocol: its UDP port, watchdog and enabling."""

from __future__ import annotations

import contextlib
import math
import socket

from cc_mujoco.errors import CableError
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._packet import Status

SILENCE = 0.05
"""Time without a command after which there is no torque [s]."""
Sender = tuple[str, int]
"""Sender of a packet; on CAN, where nobody has an address, the bus."""


class UdpEnd:
    def __init__(self, host: str, port: int) -> None:
        self.name = f"{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise CableError(
                f"port {self.name} cannot be used ({error}); is a rig there already?"
            ) from error
        self._socket.setblocking(False)

    def receive(self) -> tuple[bytes, Sender] | None:
        """Return the next packet and its sender, None if there is none."""
        try:
            return self._socket.recvfrom(1024)
        except OSError:
            return None

    def send(self, data: bytes, to: Sender) -> None:
        """Send a packet; it may be lost."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, to)

    def close(self) -> None:
        self._socket.close()


class ServedHost:
    """The host that commands the rig, with watchdog, sequence check and enabling."""

    def __init__(self) -> None:
        self.address: Sender | None = None
        """Address to which readings go."""
        self.enabled = False
        self.torque = 0.0
        self._sequence: int | None = None
        self._heard = -math.inf

    def take(self, data: bytes, sender: Sender, now: float) -> None:
        """Take a packet; a new host begins with a command that is not enabled."""
        command = packet.read_command(data)
        if command is None:
            return
        if self._sequence is None:
            if command.status != Status.NONE:
                return
        elif not packet.is_newer(command.sequence, self._sequence):
            return
        self._sequence, self._heard, self.address = command.sequence, now, sender
        self.enabled = bool(command.status & Status.ENABLED)
        self.torque = command.torque if self.enabled else 0.0
        if command.status & Status.STOPPED:
            self._let_go()
            self.address = None

    def watch(self, now: float) -> None:
        """Set the torque to 0 if the host has been silent too long."""
        if now - self._heard > SILENCE:
            self._let_go()

    def _let_go(self) -> None:
        self.enabled, self.torque, self._sequence = False, 0.0, None
