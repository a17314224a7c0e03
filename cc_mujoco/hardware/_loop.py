"""Control loop of a rig: read, check, control, limit, write, at fixed deadlines.

    axis = DrivenAxis(rig, drive, desired, limits, Watchdog())
    outcome = Loop([axis], law, clock=SystemClock(), log=log).run(10.0)

At the end of a run, for whatever reason, the torque ramps to zero and the rig is told.
Clock and rig are arguments, so that a test can run in simulated time.
"""

import contextlib
import math
import select
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import FrameType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._drive_model import Windings
from cc_mujoco.hardware._limits import Limiter, Limits
from cc_mujoco.hardware._packet import Readings
from cc_mujoco.hardware._references import Desired
from cc_mujoco.hardware._rig import Rig
from cc_mujoco.hardware._run_log import AxisRow
from cc_mujoco.hardware._watchdog import Watch, Watchdog


class Clock(Protocol):
    """Clock of a loop: a real one, or that of a test."""

    def now(self) -> float:
        """Return the time [s], which never decreases; only differences matter."""

    def wait(self, deadline: float) -> None:
        """Return at the time `deadline` [s], at once if it is past."""


class SystemClock:
    """Monotonic clock of the machine, which sleeps and then polls until a deadline."""

    def now(self) -> float:
        return time.perf_counter()

    def wait(self, deadline: float) -> None:
        # A sleep ends late by 0.05 to 0.1 ms on an idle Linux without real-time
        # priority.
        left = deadline - time.perf_counter() - 2e-4
        if left > 0.0:
            time.sleep(left)
        while time.perf_counter() < deadline:
            pass


CONNECT_TIME, ZERO_TORQUE_CYCLES = 3.0, 5
"""Longest time that a rig may take until its first reading [s]; cycles at zero torque
after the ramp of a stop."""


class Ending(Exception):
    """End of a run: its reason in one sentence, and the exit code."""

    def __init__(self, sentence: str, code: int = 3) -> None:
        super().__init__(sentence)
        self.code = code


class Rows(Protocol):
    """Receiver of the rows of a run, such as `RunLog`."""

    def row(
        self, axes: Sequence[AxisRow], late: float, work: float, cycle: int
    ) -> None: ...


class TimeHistogram:
    """Histogram of times up to 20 ms, in bins of a microsecond."""

    def __init__(self) -> None:
        self._bins: NDArray[np.int64] = np.zeros(20_001, dtype=np.int64)
        self.longest = 0.0  # [s]

    def add(self, time: float) -> None:
        self.longest = max(self.longest, time)
        self._bins[min(max(int(time * 1e6), 0), 20_000)] += 1

    def quantiles(self) -> dict[str, float]:
        """Return the 50, 99, 99.9 % quantiles and the longest time [us], or {}."""
        total = np.cumsum(self._bins)
        if not total[-1]:
            return {}
        found = {}
        for percent in (50, 99, 99.9):
            place = np.searchsorted(total, math.ceil(percent / 100 * total[-1]))
            found[f"p{percent:g}_us"] = float(place + 1)
        return found | {"longest_us": round(self.longest * 1e6, 1)}


@dataclass
class RunOutcome:
    """Outcome of a run: its reason to end, counts of cycles, histograms of times."""

    sentence: str = ""  # why it ended
    code: int = 0  # exit code: 0 the time was over, 3 a fault, 128 + number a signal
    cycles: int = 0  # cycles with a torque of the controller
    missed: int = 0  # cycles that were skipped because the host was late
    limited: int = 0  # cycles in which a motor was at the limit of its torque
    rate_limited: int = 0
    """Number of `cycles` in which the limit of its rate kept a torque from the one that
    was requested, as the soft start fades it in."""
    without_reading: int = 0  # cycles in which one axis or more had no new reading
    ignored: Counter[str] = field(default_factory=Counter)  # unused packets, by reason
    late: TimeHistogram = field(default_factory=TimeHistogram)  # of the beginnings
    work: TimeHistogram = field(default_factory=TimeHistogram)  # until commands left

    def to_json(self) -> dict[str, Any]:
        return {
            "outcome": self.sentence,
            "exit_code": self.code,
            "cycles": self.cycles,
            "missed_cycles": self.missed,
            "cycles_at_torque_limit": self.limited,
            "cycles_at_rate_limit": self.rate_limited,
            "cycles_without_reading": self.without_reading,
            "ignored_packets": dict(self.ignored),
            "late": self.late.quantiles(),
            "work": self.work.quantiles(),
        }


@dataclass(frozen=True)
class DrivenAxis:
    """Axis to be driven: its rig, drive, desired torque and limits."""

    rig: Rig
    drive: Drive  # prior knowledge about the axis, with the period of the loop
    desired: Desired  # torque at the joint
    limits: Limits
    watchdog: Watchdog  # longest durations of faults
    name: str = ""
    """Name in sentences, and in the columns that a controller sees, of several axes."""


class _AxisState:
    """Axis during a run: its last readings, limiter and watch."""

    def __init__(self, axis: DrivenAxis, missing: Sequence[str], alone: bool) -> None:
        self.axis = axis
        self.limiter = Limiter(axis.limits, axis.drive.period)
        self.watch = Watch(axis.limits, axis.watchdog, axis.drive, missing)
        self.prefix = "" if alone else f"{axis.name}."
        self.fresh: Readings | None = None  # that of this cycle, None if none came
        self.seen: Readings | None = None  # the newest; there is one after `_connect`

    def sentence(self, text: str) -> str:
        return f"axis {self.axis.name}: {text}" if self.prefix else text

    def read(self) -> None:
        self.fresh = self.axis.rig.read()
        self.seen = self.fresh or self.seen


class Loop:
    """Run of a rig: a cycle reads all axes, then checks, controls and writes all."""

    def __init__(
        self,
        axes: Sequence[DrivenAxis],
        law: Controller,
        *,
        clock: Clock,
        log: Rows,
        stop: Callable[[], Ending | None] = lambda: None,
        windings: Windings | None = None,
    ) -> None:
        """Prepare a run; nothing is sent yet.

        Args:
            axes: Axes to be driven, at least one; of several, each has a name.
            law: The controller, with the period of the loop. For several axes it is one
                of `control.axes_controller`, with the names of the axes.
            clock: Clock that the cycles follow.
            log: Receiver of the rows.
            stop: Called twice a cycle; returns the reason to end, or None.
            windings: Winding angles of cables without a round pulley.
        """
        self._law, self._clock, self._log, self._stop = law, clock, log, stop
        self._windings = windings
        self._period = law.drive.period
        unmeasured = [axis.drive.crossed for axis in axes]
        if windings is not None:
            unmeasured = windings.unmeasured
        pairs, alone = zip(axes, unmeasured, strict=True), len(axes) == 1
        self._axes = [_AxisState(axis, joints, alone) for axis, joints in pairs]
        self._wound: list[dict[str, float]] = [{} for _ in axes]
        self._deadline = self._late = 0.0
        self.outcome = RunOutcome()

    def run(self, duration: float) -> RunOutcome:
        """Run for `duration` [s] or until something ends it, then close the rigs."""
        # Also after an unexpected error: zero torque is commanded first.
        with contextlib.ExitStack() as closing:
            for one in self._axes:
                closing.callback(one.axis.rig.close)
            if len(self._axes) > 1:  # a rig takes its time to close
                closing.callback(self._write_until_zero, [0.0] * len(self._axes))
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
        self.outcome.ignored = Counter()
        for one in self._axes:
            for why, count in Counter(getattr(one.axis.rig, "ignored", ())).items():
                self.outcome.ignored[one.sentence(why)] = count
        return self.outcome

    def _connect(self) -> None:
        """Warm up compiled code, then send zero torque until all rigs have answered."""
        # First, since a rig that has been heard must not wait for its next command.
        rest = [Readings(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * len(self._axes)
        for _ in range(20):  # the first load what is compiled
            self._wind(rest)
            self._control_torques(0.0, rest)
        self._law.reset()
        end = self._clock.now() + CONNECT_TIME
        self._deadline = self._clock.now()
        while silent := [one for one in self._axes if one.seen is None]:
            if self._clock.now() > end:
                where = getattr(silent[0].axis.rig, "where", "")
                at = f" at {where}" if where else ""
                why = f"the rig{at} gave no reading in {CONNECT_TIME:g} s."
                raise Ending(silent[0].sentence(why))
            self._stop_requested()
            self._write([0.0] * len(self._axes))
            self._deadline += self._period
            self._clock.wait(self._deadline)
            self._read()
            for one in self._axes:
                # A first reading is looked at with those of the others.
                one.fresh = one.seen
        if (amiss := self._amiss(self._clock.now())) is not None:
            raise Ending(amiss)

    def _cycle(self) -> None:
        outcome = self.outcome
        self._next()
        began = self._clock.now()
        self._read()
        outcome.without_reading += any(one.fresh is None for one in self._axes)
        before = [one.limiter.torque for one in self._axes]
        self._stop_requested()
        if (amiss := self._amiss(began)) is not None:
            self._log_without_control(before, before)
            raise Ending(amiss)
        seen = self._readings()
        time = (outcome.cycles + outcome.missed) * self._period
        desired, wishes = self._control_torques(time, seen)
        # Whatever came while the controller was at work: a stop always wins.
        self._stop_requested()
        limiters = [one.limiter for one in self._axes]
        torques = [own.limited(w) for own, w in zip(limiters, wishes, strict=True)]
        self._write(torques)
        outcome.rate_limited += any(own.is_rate_limited for own in limiters)
        if torques != wishes:
            self._law.given(torques if len(torques) > 1 else torques[0])
        pairs = zip(self._axes, torques, strict=True)
        outcome.limited += any(abs(t) >= one.axis.limits.torque for one, t in pairs)
        work = self._clock.now() - began
        outcome.cycles += 1
        outcome.work.add(work)
        if self._axes[0].fresh is not None:
            rows = [*map(AxisRow, seen, before, desired, torques, wishes)]
            self._log.row(rows, self._late, work, outcome.cycles + outcome.missed)

    def _end(self, ending: Ending) -> None:
        """Ramp all torques to zero, then command zero torque; nothing stops this."""
        self.outcome.sentence, self.outcome.code = str(ending), ending.code
        left = ZERO_TORQUE_CYCLES
        while left:
            left -= all(one.limiter.torque == 0.0 for one in self._axes)
            self._next(stopping=True)
            before = [one.limiter.torque for one in self._axes]
            torques = [one.limiter.stopping() for one in self._axes]
            self._write_until_zero(torques)
            self._log_without_control(before, torques)

    def _log_without_control(
        self, before: Sequence[float], torques: Sequence[float]
    ) -> None:
        """Log finite readings that no controller received, as during a stop."""
        if self._axes[0].fresh is None:
            return
        rows = []
        for one, had, torque in zip(self._axes, before, torques, strict=True):
            seen, is_timed = one.seen, not one.watch.has_stepped
            if not (seen and is_timed and all(map(math.isfinite, seen[:6]))):
                return
            rows.append(AxisRow(seen, had, command=torque))
        number = self.outcome.cycles + self.outcome.missed
        # A full disk is no reason to stay.
        with contextlib.suppress(OSError, CableError):
            self._log.row(rows, self._late, 0.0, number)

    def _read(self) -> None:
        for one in self._axes:
            with self._named(one):
                one.read()

    def _readings(self) -> list[Readings]:
        return [one.seen for one in self._axes if one.seen is not None]

    def _write(self, torques: Sequence[float]) -> None:
        """Write to every rig, even if one fails; then raise the first failure."""
        failure: Ending | None = None
        for one, torque in zip(self._axes, torques, strict=True):
            try:
                with self._named(one):
                    one.axis.rig.write(torque)
            except Ending as ending:
                failure = failure or ending
        if failure is not None:
            raise failure

    def _write_until_zero(self, torques: Sequence[float]) -> None:
        """Write torques [N m] and read, ignoring every error, as a stop must go on."""
        for one, torque in zip(self._axes, torques, strict=True):
            with contextlib.suppress(Exception):
                one.axis.rig.write(torque)
        for one in self._axes:
            one.fresh = None
            with contextlib.suppress(Exception):
                one.read()

    def _next(self, stopping: bool = False) -> None:
        """Wait for the next deadline; skip and check missed ones."""
        self._deadline += self._period
        self._clock.wait(self._deadline)
        self._late = self._clock.now() - self._deadline
        missed = max(0, int(self._late / self._period))
        self._deadline += missed * self._period
        if stopping:
            return
        self.outcome.late.add(self._late)
        self.outcome.missed += missed
        for one in self._axes:
            if (amiss := one.watch.deadline(missed)) is not None:
                raise Ending(amiss)

    def _amiss(self, now: float) -> str | None:
        """Return a sentence on a fault in the new readings, or None."""
        for one in self._axes:
            why = one.watch.reading(one.fresh, one.limiter.torque, now)
            if why is not None:
                return one.sentence(why)
        if all(one.fresh is None for one in self._axes):
            return None
        self._wind(self._readings())
        for one, wound in zip(self._axes, self._wound, strict=True):
            if one.fresh is None:
                continue
            if (why := one.watch.transmission(one.fresh, wound)) is not None:
                return one.sentence(why)
        return None

    def _wind(self, seen: Sequence[Readings]) -> None:
        if self._windings is not None:
            angles = [each.joint_angle for each in seen]
            velocities = [each.joint_velocity for each in seen]
            self._wound = self._windings.read(angles, velocities)

    def _control_torques(
        self, time: float, seen: Sequence[Readings]
    ) -> tuple[list[float], list[float]]:
        """Return desired joint torques and requested motor torques [N m].

        `time` is that since the loop began [s], `seen` has the readings of each axis.
        """
        try:
            desired = []
            columns: dict[str, float] = {}
            for one, own, wound in zip(self._axes, seen, self._wound, strict=True):
                goal = one.axis.desired.torque(time, own)
                desired.append(goal)
                found = {
                    "motor_angle_rad": own.motor_angle,
                    "motor_velocity_rad_s": own.motor_velocity,
                    "joint_angle_rad": own.joint_angle,
                    "joint_velocity_rad_s": own.joint_velocity,
                    "joint_torque_nm": own.joint_torque,
                    "desired_torque_nm": goal,
                    # No rig measures a gait: it stands at its beginning.
                    "phase_sine": 0.0,
                    "phase_cosine": 1.0,
                    **wound,
                }
                columns |= {one.prefix + name: value for name, value in found.items()}
            wishes = _floats(self._law.torque(columns), len(self._axes))
        except Exception as error:
            raise Ending(f"the controller failed: {_error_text(error)}") from error
        for one, wish in zip(self._axes, wishes, strict=True):
            if not math.isfinite(wish):
                raise Ending(one.sentence(f"the controller gave {wish} N m."))
        return desired, wishes

    def _stop_requested(self) -> None:
        if (ending := self._stop()) is not None:
            raise ending

    @contextlib.contextmanager
    def _named(self, one: _AxisState) -> Iterator[None]:
        """End the run with a sentence that names the axis if its rig raises."""
        try:
            yield
        except Exception as error:
            raise Ending(one.sentence(_error_text(error))) from error


def _floats(torque: Any, count: int) -> list[float]:
    """Return a controller's torques as a list of `count` numbers, one per motor."""
    if count == 1:
        return [float(torque)]
    if np.shape(torque) != (count,):
        raise CableError(
            f"it must return {count} torques, one for each axis, not "
            f"an array of shape {np.shape(torque)}."
        )
    return [float(each) for each in torque]


def _error_text(error: Exception) -> str:
    kind = "" if isinstance(error, CableError) else f"{type(error).__name__}: "
    return f"{kind}{error}"


SIGNALS = [s for s in signal.Signals if s.name in ("SIGINT", "SIGTERM", "SIGHUP")]


class Stops:
    """Requests to stop a run, by signal or key; each cycle checks for the first."""

    def __init__(self, keyboard: bool) -> None:
        """Start without a request; with `keyboard` the return key is one too."""
        self._keyboard = keyboard
        self._found: Ending | None = None

    def __call__(self) -> Ending | None:
        if self._found is None and self._keyboard:
            ready, _, _ = select.select([sys.stdin], [], [], 0.0)
            # The end of a terminal is a reason to stop, too.
            if ready and sys.stdin.readline() is not None:
                self._found = Ending("stopped by the return key.")
        return self._found

    def handle_signal(self, number: int, _: FrameType | None = None) -> None:
        if self._found is None:
            name = signal.Signals(number).name
            self._found = Ending(f"stopped by {name}.", 128 + number)


@contextlib.contextmanager
def watch_for_stop() -> Iterator[Stops]:
    """Catch stop signals and, in a terminal, the return key, while a block runs."""
    # Windows selects sockets only.
    keyboard = sys.platform != "win32" and sys.stdin is not None and sys.stdin.isatty()
    stops = Stops(keyboard)
    before = {number: signal.signal(number, stops.handle_signal) for number in SIGNALS}
    try:
        yield stops
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
