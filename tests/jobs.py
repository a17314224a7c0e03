"""A job that other processes can import."""

from __future__ import annotations

import os
import time
from typing import Any

from cc_mujoco._utils import user_code
from cc_mujoco._workers.local_executor import Tick


class Doubling:
    """Job that doubles numbers, and says which process did."""

    def rehearse(self) -> None:
        """Need nothing."""

    def made_by(self) -> dict[str, Any]:
        """Return no provenance."""
        return {}

    def size(self, piece: float) -> int:
        """Count every piece as one."""
        return 1

    def do(self, piece: float, tick: Tick) -> tuple[float, int]:
        """Return twice the number, and the process."""
        return 2.0 * piece, os.getpid()


class NamesAllowed(Doubling):
    """Job that returns the names of code that its process may import."""

    def do(self, piece: float, tick: Tick) -> Any:
        """Return the names."""
        return user_code.allowed()


class Sleeping(Doubling):
    """Job that sleeps for so many seconds."""

    def do(self, piece: float, tick: Tick) -> Any:
        """Sleep; return the seconds."""
        time.sleep(piece)
        return piece
