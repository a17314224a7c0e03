"""A rig, a clock and a list of rows for loops in simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from cc_mujoco.control import Controller, External, controller
from cc_mujoco.device import Drive
from cc_mujoco.hardware import (
    AxisRow,
    DrivenAxis,
    Ending,
    Limits,
    Loop,
    Readings,
    RunLog,
    RunOutcome,
    Watchdog,
)
from cc_mujoco.hardware._references import Desired, constant_course

PERIOD = 0.002
LIMITS = Limits(
    torque=2.0,
    torque_rate=40.0,
    motor_speed=30.0,
    joint_range=(-1.0, 1.0),
    soft_start=0.1,
    stop_time=0.05,
)
RATIO = 2.0


class SimulatedClock:
    """Clock whose time passes only while the loop waits or when it is set."""

    def __init__(self) -> None:
        self.time = 100.0
        self.before: Callable[[], None] = lambda: None

    def now(self) -> float:
        return self.time

    def wait(self, deadline: float) -> None:
        self.time = max(self.time, deadline)
        self.before()


@dataclass
class FakeRig:
    """Fake of a motor with inertia and a joint that follows it, with faults."""

    clock: SimulatedClock
    fault: Callable[[int, Readings], Readings | None] = lambda count, seen: seen
    """Function of the reading's number and the reading; it returns None to lose it."""
    written: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    reads: int = 0
    closed: int = 0
    angle: float = 0.0
    velocity: float = 0.0

    def read(self) -> Readings | None:
        self.reads += 1
        torque = self.written[-1] if self.written else 0.0
        self.velocity += PERIOD * (torque - 5.0 * self.angle - 0.2 * self.velocity)
        self.angle += PERIOD * self.velocity
        # The last digits of a torque sensor are never at rest.
        noise = 1e-4 * math.sin(7.0 * self.reads)
        turned = self.angle / RATIO
        seen = Readings(
            self.clock.now(),
            self.angle,
            self.velocity,
            turned,
            self.velocity / RATIO,
            RATIO * torque + noise,
        )
        return self.fault(self.reads, seen)

    def write(self, torque: float) -> None:
        self.written.append(torque)
        self.times.append(self.clock.now())

    def close(self) -> None:
        self.closed += 1


@dataclass
class Rows:
    """Log that keeps its rows in memory."""

    rows: list[tuple[float, ...]] = field(default_factory=list)

    def row(
        self, axes: Sequence[AxisRow], late: float, work: float, cycle: int
    ) -> None:
        values = [value for seen, *rest in axes for value in (*seen[:6], *rest)]
        self.rows.append((*values, late, work, cycle))


def add_row(
    log: RunLog, seen: Readings, before: float = 0.0, desired: float = 0.0
) -> None:
    """Add a row of one axis to a log."""
    log.row([AxisRow(seen, before, desired, 0.0, 0.0)], 0.0, 0.0, 0)


def drive(period: float = PERIOD) -> Drive:
    return Drive(RATIO, -LIMITS.torque, LIMITS.torque, period)


def law_of(torque: Callable[[dict[str, float]], object]) -> Controller:
    return External(drive(), lambda _: torque)


@dataclass
class Played:
    """Outcome, rig and log of a loop in simulated time."""

    outcome: RunOutcome
    rig: FakeRig
    rows: Rows


def play(
    law: Controller | None = None,
    *,
    fault: Callable[[int, Readings], Readings | None] = lambda _, seen: seen,
    limits: Limits = LIMITS,
    watchdog: Watchdog = Watchdog(),  # noqa: B008
    desired: Desired | None = None,
    duration: float = 0.5,
    before: Callable[[SimulatedClock], None] = lambda clock: None,
    stop: Callable[[], Ending | None] = lambda: None,
) -> Played:
    clock = SimulatedClock()
    clock.before = lambda: before(clock)
    rig, rows = FakeRig(clock, fault), Rows()
    law = law or controller("none", drive())
    goal = desired or constant_course(2.0)
    axis = DrivenAxis(rig, law.drive, goal, limits, watchdog)
    loop = Loop([axis], law, clock=clock, log=rows, stop=stop)
    return Played(loop.run(duration), rig, rows)
