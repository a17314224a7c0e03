"""Simulated time that goes with the clock on the wall.

pace = RealTimePacer()
pace.begin(0.0)
pace.keep(time)                    # returns when the wall is there, too
pace.factor                        # 1 in real time, less where that is too fast
"""

from __future__ import annotations

import math
import time as wall
from collections.abc import Callable

MAX_LEAD = 0.004
"""Simulated time that may lead the wall, so that sleeps are worth their while [s]."""
MAX_LAG = 0.1
"""Lag that is not made up for: where real time is too fast, time slows down [s]."""
FACTOR_WINDOW = 0.5
"""Time over which `RealTimePacer.factor` is taken [s]."""


class RealTimePacer:
    """Waits wherever the simulation is ahead."""

    def __init__(
        self,
        now: Callable[[], float] = wall.perf_counter,
        sleep: Callable[[float], object] = wall.sleep,
    ) -> None:
        """Prepare; `now` never goes back and `sleep` lets it go on by so much [s]."""
        self._now, self._sleep = now, sleep
        self.factor = math.nan
        """Ratio of simulated to real time of late; NaN before there is any."""

    def begin(self, time: float) -> None:
        """Restart the pace here, after an interruption."""
        self._time = self._since = time
        self._wall_time = self._interval_start = self._now()

    def keep(self, time: float) -> None:
        """Wait until the wall has come as far."""
        now = self._now()
        ahead = (time - self._time) - (now - self._wall_time)
        if ahead > MAX_LEAD:
            self._sleep(ahead)
        elif ahead < -MAX_LAG:
            self._time, self._wall_time = time, now
        now = self._now()
        if now - self._interval_start >= FACTOR_WINDOW:
            self.factor = (time - self._since) / (now - self._interval_start)
            self._since, self._interval_start = time, now
