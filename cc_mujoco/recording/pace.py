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

AHEAD = 0.004
"""Simulated time that may lead the wall, so that sleeps are worth their while [s]."""
BEHIND = 0.1
"""Lag that is not made up for: where real time is too fast, time slows down [s]."""
SPAN = 0.5
"""Time over which `RealTimePacer.factor` is taken [s]."""


class RealTimePacer:
    """Waits wherever the simulation is ahead."""

    def __init__(
        self,
        now: Callable[[], float] = wall.perf_counter,
        sleep: Callable[[float], object] = wall.sleep,
    ) -> None:
        """Prepare.

        Args:
            now: Time on the wall [s], never going back.
            sleep: Lets it go on by so much [s].
        """
        self._now, self._sleep = now, sleep
        self.factor = math.nan
        """Ratio of simulated to real time of late; NaN before there is any."""

    def begin(self, time: float) -> None:
        """Go on from here, after whatever took the wall's time.

        Args:
            time: Simulated time [s].
        """
        self._time = self._since = time
        self._wall = self._from = self._now()

    def keep(self, time: float) -> None:
        """Wait until the wall has come as far.

        Args:
            time: Simulated time [s], later than that of `begin`.
        """
        now = self._now()
        ahead = (time - self._time) - (now - self._wall)
        if ahead > AHEAD:
            self._sleep(ahead)
        elif ahead < -BEHIND:
            self._time, self._wall = time, now
        now = self._now()
        if now - self._from >= SPAN:
            self.factor = (time - self._since) / (now - self._from)
            self._since, self._from = time, now
