"""The loop: read, check, control, limit, write; at absolute times.

    outcome = Loop(rig, law, desired, settings, clock=SystemClock(), ...).run(10.0)

However a run ends, the torque goes to zero on a ramp and the rig is informed. The clock
and the rig are arguments, so a test runs it in simulated time.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller
from cc_mujoco.device._moment_arm import MeasuredWinding
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._clock import Clock
from cc_mujoco.hardware._limits import Limiter, Limits
from cc_mujoco.hardware._packet import Readings
from cc_mujoco.hardware._references import Desired
from cc_mujoco.hardware._rig import Rig
from cc_mujoco.hardware._watchdog import Watch, Watchdog

CONNECT_TIME = 3.0
"""Longest time that a rig may take until its first reading [s]."""
ZERO_TORQUE_CYCLES = 5
"""Cycles at zero torque after the ramp of a stop."""
WARM_UP_CALLS = 20
"""Calls of a controller before the first cycle; the first load what is compiled."""


class Ending(Exception):
    """Reason why a run ends, in one sentence, with the exit code."""

    def __init__(self, sentence: str, code: int = 3) -> None:
        """Keep both.

        Args:
            sentence: Why.
            code: Of the process; 3 says that something was amiss.
        """
        super().__init__(sentence)
        self.code = code


class Rows(Protocol):
    """Receiver of the rows of a run; `RunLog` is one."""

    def row(self, seen: Readings, before: float, *others: float) -> None:
        """See `RunLog.row`."""


class TimeHistogram:
    """Histogram of times: bins of a microsecond, up to 20 ms."""

    def __init__(self) -> None:
        """Begin with none."""
        self._bins: NDArray[np.int64] = np.zeros(20_001, dtype=np.int64)
        self.longest = 0.0
        """[s]"""

    def add(self, time: float) -> None:
        """Count a time [s]."""
        self.longest = max(self.longest, time)
        self._bins[min(max(int(time * 1e6), 0), 20_000)] += 1

    def quantile(self, share: float) -> float:
        """Return the quantile of the cycle times [s] to 1 us, NaN without cycles."""
        total = np.cumsum(self._bins)
        if not total[-1]:
            return math.nan
        return float(np.searchsorted(total, math.ceil(share * total[-1])) + 1) * 1e-6

    def told(self) -> dict[str, float]:
        """Return the median, quantiles and longest [us]; nothing of no cycle."""
        if not self._bins.any():
            return {}
        found = {f"p{p:g}_us": self.quantile(p / 100) * 1e6 for p in (50, 99, 99.9)}
        return {k: round(v, 1) for k, v in found.items()} | {
            "longest_us": round(self.longest * 1e6, 1)
        }


@dataclass
class RunOutcome:
    """Outcome of a run."""

    sentence: str = ""
    """Why it ended."""
    code: int = 0
    """Exit code: 0 the time was over, 3 something was amiss, 128 + number a signal."""
    cycles: int = 0
    """Cycles that the controller had a say in."""
    missed: int = 0
    """Cycles that were skipped because the host was late."""
    limited: int = 0
    """Number of `cycles` in which the motor got all torque that its limit allows."""
    rate_limited: int = 0
    """Number of `cycles` in which its torque changed as fast as the limit of the rate
    allows, and the controller, of its full share, wished for more."""
    without_reading: int = 0
    """Cycles in which no new reading came."""
    ignored: Counter[str] = field(default_factory=Counter)
    """Packets that were not used, by why."""
    late: TimeHistogram = field(default_factory=TimeHistogram)
    """Lateness of the cycles' beginnings."""
    work: TimeHistogram = field(default_factory=TimeHistogram)
    """Time from there until the command was out."""

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as plain JSON."""
        return {
            "outcome": self.sentence,
            "exit_code": self.code,
            "cycles": self.cycles,
            "missed_cycles": self.missed,
            "cycles_at_torque_limit": self.limited,
            "cycles_at_rate_limit": self.rate_limited,
            "cycles_without_reading": self.without_reading,
            "ignored_packets": dict(self.ignored),
            "late": self.late.told(),
            "work": self.work.told(),
        }


class Loop:
    """One run of a rig."""

    def __init__(
        self,
        rig: Rig,
        law: Controller,
        desired: Desired,
        limits: Limits,
        watchdog: Watchdog,
        *,
        clock: Clock,
        log: Rows,
        stop: Callable[[], Ending | None] = lambda: None,
        winding: MeasuredWinding | None = None,
    ) -> None:
        """Prepare; nothing is sent yet.

        Args:
            rig: What is driven.
            law: The controller; the period is that of its drive.
            desired: Torque at the joint.
            limits: That are kept.
            watchdog: How long something may be amiss.
            clock: That the cycles follow.
            log: Takes the rows.
            stop: Called twice a cycle; returns whether to end, and why.
            winding: How far the joint winds cables that pull no round pulley.

        Raises:
            CableError: A stop cannot be as fast as requested.
        """
        self._rig, self._law, self._desired = rig, law, desired
        self._clock, self._log, self._stop = clock, log, stop
        self._winding = winding
        self._period = law.drive.period
        self._limiter = Limiter(limits, self._period)
        self._watch = Watch(limits, watchdog, law.drive, winding)
        self._limits = limits
        self._deadline = 0.0
        self._late = 0.0
        self._seen: Readings | None = None
        self.outcome = RunOutcome()

    def run(self, duration: float) -> RunOutcome:
        """Run for this time [s], or until something ends it; the rig is closed then."""
        try:
            try:
                self._connect()
                cycles = max(1, round(duration / self._period))
                while self.outcome.cycles + self.outcome.missed < cycles:
                    self._cycle()
                raise Ending(f"the {duration:g} s are over.", 0)
            except Ending as ending:
                self._end(ending)
            except Exception as error:  # of the rig's class, or of a full disk
                self._end(Ending(_error_text(error)))
        finally:
            # Also after an unexpected error: zero torque is commanded first.
            self._rig.close()
        self.outcome.ignored = Counter(getattr(self._rig, "ignored", ()))
        return self.outcome

    def _connect(self) -> None:
        """Load compiled code; then send zero torque until the rig answers."""
        # First, since a rig that has been heard must not wait for its next command.
        for _ in range(WARM_UP_CALLS):
            self._control_torque(0.0, Readings(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        self._law.reset()
        end = self._clock.now() + CONNECT_TIME
        self._deadline = self._clock.now()
        while self._seen is None:
            if self._clock.now() > end:
                where = getattr(self._rig, "where", "")
                at = f" at {where}" if where else ""
                raise Ending(f"the rig{at} gave no reading in {CONNECT_TIME:g} s.")
            self._stop_requested()
            self._rig.write(0.0)
            self._deadline += self._period
            self._clock.wait(self._deadline)
            self._seen = self._rig.read()
        self._check(self._watch.reading(self._seen, 0.0, self._clock.now()))

    def _cycle(self) -> None:
        outcome = self.outcome
        self._next()
        began = self._clock.now()
        fresh = self._rig.read()
        outcome.without_reading += fresh is None
        before = self._limiter.torque
        self._stop_requested()
        if (amiss := self._watch.reading(fresh, before, began)) is not None:
            self._log_without_control(fresh, before, before)
            raise Ending(amiss)
        self._seen = seen = fresh or self._seen
        assert seen is not None  # `_connect` waited for one
        time = (outcome.cycles + outcome.missed) * self._period
        desired, wish = self._control_torque(time, seen)
        # Whatever came while the controller was at work: a stop always wins.
        self._stop_requested()
        torque = self._limiter.limited(wish)
        self._rig.write(torque)
        outcome.rate_limited += self._limiter.is_rate_limited
        if torque != wish:
            self._law.given(torque)
        outcome.limited += abs(torque) >= self._limits.torque
        work = self._clock.now() - began
        outcome.cycles += 1
        outcome.work.add(work)
        if fresh is not None:
            number = outcome.cycles + outcome.missed
            late = self._late
            self._log.row(seen, before, desired, torque, wish, late, work, number)

    def _end(self, ending: Ending) -> None:
        """Ramp the torque to zero, then command zero; nothing can end this early."""
        self.outcome.sentence, self.outcome.code = str(ending), ending.code
        left = ZERO_TORQUE_CYCLES
        while left:
            left -= self._limiter.torque == 0.0
            self._next(stopping=True)
            before = self._limiter.torque
            torque = self._limiter.stopping()
            self._log_without_control(self._write_until_zero(torque), before, torque)

    def _log_without_control(
        self, fresh: Readings | None, before: float, torque: float
    ) -> None:
        """Log a reading that no controller saw; a non-finite one is only reported."""
        if fresh is None or not all(map(math.isfinite, fresh[:6])):
            return
        if self._watch.has_stepped:
            return
        number = self.outcome.cycles + self.outcome.missed
        nan = math.nan
        # A full disk is no reason to stay.
        with contextlib.suppress(OSError, CableError):
            self._log.row(fresh, before, nan, torque, nan, self._late, 0.0, number)

    def _write_until_zero(self, torque: float) -> Readings | None:
        """Write and read, whatever the rig raises: it has to be tried until zero."""
        with contextlib.suppress(Exception):
            self._rig.write(torque)
        with contextlib.suppress(Exception):
            return self._rig.read()
        return None

    def _next(self, stopping: bool = False) -> None:
        """Wait for the next deadline; skip those that are past."""
        self._deadline += self._period
        self._clock.wait(self._deadline)
        self._late = self._clock.now() - self._deadline
        missed = max(0, int(self._late / self._period))
        self._deadline += missed * self._period
        if stopping:
            return
        self.outcome.late.add(self._late)
        self.outcome.missed += missed
        self._check(self._watch.deadline(missed))

    def _control_torque(self, time: float, seen: Readings) -> tuple[float, float]:
        """Return the desired torque at the joint and the controller's request [N m]."""
        try:
            desired = self._desired.torque(time, seen)
            wish = float(
                self._law.torque(
                    {
                        "motor_angle_rad": seen.motor_angle,
                        "motor_velocity_rad_s": seen.motor_velocity,
                        "joint_angle_rad": seen.joint_angle,
                        "joint_velocity_rad_s": seen.joint_velocity,
                        "joint_torque_nm": seen.joint_torque,
                        "desired_torque_nm": desired,
                        # No rig measures a gait: it stands at its beginning.
                        "phase_sine": 0.0,
                        "phase_cosine": 1.0,
                        **self._wound(seen),
                    }
                )
            )
        except Exception as error:
            raise Ending(f"the controller failed: {_error_text(error)}") from error
        if not math.isfinite(wish):
            raise Ending(f"the controller asked for {wish} N m.")
        return desired, wish

    def _wound(self, seen: Readings) -> dict[str, float]:
        """Return what a controller with a model needs besides, of a lever."""
        if self._winding is None:
            return {}
        return self._winding.read([seen.joint_angle], [seen.joint_velocity])

    def _stop_requested(self) -> None:
        if (ending := self._stop()) is not None:
            raise ending

    @staticmethod
    def _check(sentence: str | None) -> None:
        if sentence is not None:
            raise Ending(sentence)


def _error_text(error: Exception) -> str:
    """Return the text of an error, with its type if it is not of this package."""
    kind = "" if isinstance(error, CableError) else f"{type(error).__name__}: "
    return f"{kind}{error}"
