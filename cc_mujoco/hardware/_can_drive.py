"""Parts that motor drives on a CAN bus share."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import ClassVar

from cc_mujoco.hardware._address import CanPlace
from cc_mujoco.hardware._can_bus import CanBuses, CanPort
from cc_mujoco.hardware._drive_rig import Enabling, Now


class CanDrive(ABC):
    """Connection to a drive on a CAN bus; a subclass makes it a `MotorDrive`."""

    title: ClassVar[str]
    """Name of the kind of drive in sentences."""
    fd: ClassVar[bool]
    """True if its frames are those of CAN FD."""

    def __init__(
        self,
        place: CanPlace,
        node: int,
        buses: CanBuses | None = None,
        now: Now = time.perf_counter,
    ) -> None:
        """Open the bus, unless it is open already; nothing is sent yet.

        `node` is the number of the drive on it, see `DRIVE_NODES`; for `buses` see
        `CanPort`, `now` is the clock of the host [s].
        """
        heard = self.identifiers(node)
        self._port = CanPort(place, heard, fd=self.fd, buses=buses)
        self.ignored = self._port.ignored
        self.where = f"{self.title} {node} on {self._port.where}"
        self._node, self._now = node, now
        self._enabling = Enabling(now)
        self._heard = False

    @staticmethod
    @abstractmethod
    def identifiers(node: int) -> list[int]: ...

    def close(self) -> None:
        self._port.close()
