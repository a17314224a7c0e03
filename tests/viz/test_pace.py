"""Simulated time beside the wall's."""

from __future__ import annotations

import math

import pytest

from cc_mujoco.viz._live_controls import RealTimePacer

MAX_LEAD, MAX_LAG = RealTimePacer.max_lead, RealTimePacer.max_lag
WINDOW = RealTimePacer.window

STEP = 0.001


class Wall:
    """A clock that goes on by what is slept and by what is worked."""

    def __init__(self) -> None:
        self.time, self.naps = 50.0, 0

    def now(self) -> float:
        return self.time

    def sleep(self, duration: float) -> None:
        assert duration > 0.0
        self.time, self.naps = self.time + duration, self.naps + 1


def played(
    wall: Wall, pace: RealTimePacer, work: float, since: float, steps: int
) -> float:
    """Go steps that take so much work [s] each; the simulated time after them."""
    for step in range(1, steps + 1):
        wall.time += work
        pace.keep(since + step * STEP)
    return since + steps * STEP


def test_quick_steps_wait_for_the_wall() -> None:
    wall = Wall()
    pace = RealTimePacer(wall.now, wall.sleep)
    pace.begin(0.0)
    assert math.isnan(pace.factor)
    end = played(wall, pace, 0.2 * STEP, 0.0, 2000)
    assert wall.time - 50.0 == pytest.approx(end, abs=2 * MAX_LEAD)
    assert pace.factor == pytest.approx(1.0, abs=2 * MAX_LEAD / WINDOW)
    assert wall.naps < 2000 * STEP / MAX_LEAD + 2  # and not after every step


def test_slow_steps_never_wait_and_the_factor_says_so() -> None:
    wall = Wall()
    pace = RealTimePacer(wall.now, wall.sleep)
    pace.begin(0.0)
    played(wall, pace, 2.0 * STEP, 0.0, 2000)
    assert wall.naps == 0
    assert pace.factor == pytest.approx(0.5, rel=0.01)


def test_a_short_lag_is_made_up_for_and_a_long_one_is_not() -> None:
    for lag, lost in (
        (0.5 * MAX_LAG, 0.0),
        (20.0 * MAX_LAG, 20.0 * MAX_LAG),
    ):
        wall = Wall()
        pace = RealTimePacer(wall.now, wall.sleep)
        pace.begin(0.0)
        wall.time += lag
        end = played(wall, pace, 0.2 * STEP, 0.0, 2000)
        assert wall.time - 50.0 - lost == pytest.approx(end, abs=2 * MAX_LEAD)


def test_a_pause_is_not_made_up_for() -> None:
    wall = Wall()
    pace = RealTimePacer(wall.now, wall.sleep)
    pace.begin(0.0)
    end = played(wall, pace, 0.2 * STEP, 0.0, 500)
    wall.time += 30.0
    pace.begin(end)
    before = wall.time
    played(wall, pace, 0.2 * STEP, end, 1000)
    assert wall.time - before == pytest.approx(1.0, abs=2 * MAX_LEAD)
    assert pace.factor == pytest.approx(1.0, abs=2 * MAX_LEAD / WINDOW)
