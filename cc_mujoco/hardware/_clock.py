"""Waiting for an absolute time."""

from __future__ import annotations

import time
from typing import Protocol

SPIN_TIME = 2e-4
"""Before a deadline the loop no longer sleeps [s]: a sleep ends late by 0.05 to 0.1 ms
on an idle Linux without real-time priority."""


class Clock(Protocol):
    """Time that goes on by itself, or in a test."""

    def now(self) -> float:
        """Return the time [s], never going back; only differences matter."""

    def wait(self, deadline: float) -> None:
        """Return at that time [s], at once if it is past."""


class SystemClock:
    """The machine's monotonic clock: sleep, then spin."""

    def now(self) -> float:
        """See `Clock`."""
        return time.perf_counter()

    def wait(self, deadline: float) -> None:
        """See `Clock`."""
        left = deadline - time.perf_counter() - SPIN_TIME
        if left > 0.0:
            time.sleep(left)
        while time.perf_counter() < deadline:
            pass
