"""A rig on a CAN FD bus: a packet is the data of one frame, with bit-rate switch."""

from __future__ import annotations

from cc_mujoco.hardware._address import MAX_SHORT_ID, CanAddress
from cc_mujoco.hardware._can_bus import CanBuses, CanPort
from cc_mujoco.hardware._rig import PacketRig, pending


class CanLink:
    """A packet in a CAN FD frame; frames with other identifiers are left alone."""

    def __init__(self, address: CanAddress, buses: CanBuses | None = None) -> None:
        """Open the bus, unless it is open already; nothing is sent yet."""
        self._address = address
        self._port = CanPort(address, [address.reading_id], fd=True, buses=buses)
        self.ignored, self.where = self._port.ignored, self._port.where

    def receive(self) -> bytes | None:
        """See `Link`."""
        for frame in pending(self._port.receive):
            if frame.is_extended_id == (frame.arbitration_id > MAX_SHORT_ID):
                return bytes(frame.data)
        return None

    def send(self, data: bytes) -> None:
        """See `Link`."""
        self._port.send(self._address.command_id, data)

    def close(self) -> None:
        """See `Link`; the last one closes the bus."""
        self._port.close()


class CanRig(PacketRig):
    """A rig on a CAN FD bus."""

    def __init__(self, address: CanAddress, buses: CanBuses | None = None) -> None:
        """Open the bus, unless it is open already; nothing is sent yet."""
        super().__init__(CanLink(address, buses))
