"""Loop in simulated time: limits that hold, and all causes of a stop."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.control import CableModel
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    AxisRow,
    Ending,
    Limiter,
    Limits,
    Readings,
    Status,
    Watch,
    Watchdog,
    drive_of,
)
from cc_mujoco.hardware._loop import ZERO_TORQUE_CYCLES
from cc_mujoco.hardware._references import constant_course
from hardware.fakes import (
    LIMITS,
    PERIOD,
    RATIO,
    FakeRig,
    Played,
    Rows,
    SimulatedClock,
    law_of,
    play,
)

STEP = LIMITS.torque_rate * PERIOD
ROUNDING = 1e-12
FULL = 1e6


def require_within_limits(played: Played, limits: Limits = LIMITS) -> None:
    """Require that written torques keep their limits and end at zero."""
    written = [0.0, *played.rig.written]
    assert all(abs(torque) <= limits.torque for torque in written)
    step = limits.torque_rate * PERIOD + ROUNDING
    assert all(abs(b - a) <= step for a, b in pairwise(written))
    assert written[-1] == 0.0
    assert played.rig.closed == 1


def require_stopped(played: Played, why: str, code: int = 3) -> None:
    """Require that it ended for this reason, with zero torque within the stop time."""
    assert why in played.outcome.sentence
    assert played.outcome.code == code
    require_within_limits(played)
    ended = played.outcome.cycles
    # The commands of `_connect` come first; there is one here.
    down = played.rig.written[1 + ended :]
    zero = next(k for k, torque in enumerate(down, 1) if torque == 0.0)
    assert zero * PERIOD <= LIMITS.stop_time + ROUNDING
    assert len(down) - zero >= 4 and not any(down[zero - 1 :])
    sizes = [abs(torque) for torque in down]
    assert sizes == sorted(sizes, reverse=True)


def test_a_run_reaches_its_end_and_goes_down() -> None:
    played = play()
    require_stopped(played, "0.5 s are over", 0)
    assert played.outcome.cycles == 250
    assert (played.outcome.missed, played.outcome.without_reading) == (0, 0)
    # 2 N m at the joint are 1 N m of the motor.
    assert max(played.rig.written) == pytest.approx(1.0)
    assert len(played.rows.rows) >= 250


def test_a_controller_hears_what_the_motor_got_instead_of_its_wish() -> None:
    """The soft start changes the torque first, the rate limit later."""
    law = law_of(lambda seen: 1.5 if seen["motor_angle_rad"] < 0.1 else -1.5)
    heard: list[float] = []
    law.given = heard.append  # type: ignore[method-assign]
    played = play(law, duration=0.3)
    wanted = [row[-5:-3] for row in played.rows.rows if math.isfinite(row[-4])]
    assert heard == [torque for torque, wish in wanted if torque != wish]
    assert 10 < len(heard) < len(wanted) == 150


WISHES = st.lists(
    st.floats(allow_nan=True, allow_infinity=True) | st.floats(-5.0, 5.0),
    min_size=1,
    max_size=20,
)


@given(wishes=WISHES, torque=st.floats(0.01, 5.0), rate=st.floats(100.0, 1e4))
def test_whatever_the_controller_returns_what_is_written_is_within_limits(
    wishes: list[float], torque: float, rate: float
) -> None:
    limits = dataclasses.replace(LIMITS, torque=torque, torque_rate=rate)
    calls = iter(range(10**6))
    # Told infinite where it is: the warm-up may not be what ends it.
    law = law_of(lambda _: wishes[next(calls) // 25 % len(wishes)])
    law.limited = lambda wish: wish  # type: ignore[method-assign]
    played = play(law, limits=limits, duration=0.4)
    require_within_limits(played, limits)


@given(
    wishes=st.lists(st.floats(-1e9, 1e9), max_size=80),
    rate=st.floats(1.0, 1e4),
    soft=st.floats(0.0, 0.2),
)
def test_the_limiter_keeps_its_limits_and_goes_to_zero(
    wishes: list[float], rate: float, soft: float
) -> None:
    stop_time = math.ceil(LIMITS.torque / rate / PERIOD) * PERIOD
    limits = dataclasses.replace(
        LIMITS, torque_rate=rate, soft_start=soft, stop_time=min(stop_time, 10.0)
    )
    limiter = Limiter(limits, PERIOD)
    given_out = [0.0, *(limiter.limited(wish) for wish in wishes)]
    steps = limits.stop_steps(PERIOD)
    given_out += [limiter.stopping() for _ in range(steps)]
    assert given_out[-1] == 0.0
    assert all(abs(torque) <= limits.torque for torque in given_out)
    most = rate * PERIOD * (1.0 + 1e-9)
    assert all(abs(b - a) <= most for a, b in pairwise(given_out))


def test_a_saturated_controller_gets_the_limit_and_no_more() -> None:
    played = play(law_of(lambda _: FULL), limits=dataclasses.replace(LIMITS))
    assert max(played.rig.written) == LIMITS.torque
    require_within_limits(played)


def test_the_share_of_the_controller_grows_from_zero() -> None:
    limits = dataclasses.replace(LIMITS, torque_rate=1e6)
    played = play(law_of(lambda _: 1.0), limits=limits, duration=0.2)
    written = played.rig.written[1:101]
    soft = round(LIMITS.soft_start / PERIOD)
    wanted = [min(1.0, (k + 1) / soft) for k in range(100)]
    assert written == pytest.approx(wanted)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_controller_that_gives_no_number_ends_the_run(bad: float) -> None:
    calls = iter(range(10**6))
    played = play(law_of(lambda _: 1.0 if next(calls) < 120 else bad))
    require_stopped(played, "gave nan N m")


def test_a_controller_that_raises_ends_the_run() -> None:
    calls = iter(range(10**6))
    played = play(law_of(lambda _: 1.0 / (120 - next(calls))))
    require_stopped(played, "ZeroDivisionError")


FIELDS = Readings._fields[1:6]


@pytest.mark.parametrize("name", [*FIELDS, "time"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_reading_that_is_no_number_ends_the_run(name: str, bad: float) -> None:
    played = play(
        fault=lambda k, seen: seen if k < 100 else seen._replace(**{name: bad})
    )
    require_stopped(played, f"{name} is {bad!r}")
    assert played.outcome.cycles == 98  # at the first such reading


@pytest.mark.parametrize("name", [name for name in FIELDS if name != "joint_angle"])
@pytest.mark.parametrize("bad", [-1e7, 1e38, 1e308])
def test_a_reading_that_no_device_has_ends_the_run(name: str, bad: float) -> None:
    wide = dataclasses.replace(LIMITS, motor_speed=1e9, joint_torque=math.inf)
    played = play(
        fault=lambda k, seen: seen if k < 100 else seen._replace(**{name: bad}),
        limits=wide,
    )
    require_stopped(played, f"{name} is {bad:.4g} ")
    assert played.outcome.cycles == 98


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"joint_angle": 1.01}, "joint is at 1.01 rad, outside its range"),
        ({"joint_angle": -1.01}, "joint is at -1.01 rad, outside its range"),
        ({"motor_velocity": -31.0}, "motor_velocity is -31 rad/s, beyond its limit"),
        ({"joint_torque": 9.0}, "joint_torque is 9 N m, beyond its limit of 8"),
        ({"status": Status.FAULT}, "reports a fault"),
        ({"status": Status.STOPPED | Status.ENABLED}, "stopped at its own side"),
    ],
)
def test_a_reading_beyond_its_limit_ends_the_run(
    change: dict[str, float], why: str
) -> None:
    played = play(
        fault=lambda k, seen: seen._replace(**change) if k == 100 else seen,
        limits=dataclasses.replace(LIMITS, joint_torque=8.0),
    )
    require_stopped(played, why)
    assert played.outcome.cycles == 98


@pytest.mark.parametrize(("wish", "most"), [(5.0, 1.0), (0.5, 0.0)])
def test_cycles_at_the_limit_of_the_torque_are_counted(
    wish: float, most: float
) -> None:
    played = play(law_of(lambda _: wish), limits=LIMITS)
    written = played.outcome.to_json()
    assert written["cycles_at_torque_limit"] == pytest.approx(
        most * played.outcome.cycles, rel=0.25
    )


def test_the_reading_that_ends_the_run_is_logged() -> None:
    wild = 40.0

    def fault(count: int, seen: Readings) -> Readings:
        return seen._replace(motor_velocity=wild) if count == 100 else seen

    played = play(fault=fault)
    require_stopped(played, "motor_velocity")
    speeds = [row[2] for row in played.rows.rows]
    assert speeds.count(wild) == 1
    assert len({row[0] for row in played.rows.rows}) == len(speeds)


def test_a_silent_rig_ends_the_run() -> None:
    played = play(fault=lambda k, seen: seen if k < 100 else None)
    require_stopped(played, "silent: no new reading in 10 cycles")
    assert played.outcome.without_reading == 10


def test_readings_that_are_lost_now_and_then_do_not() -> None:
    played = play(fault=lambda k, seen: None if k > 1 and k % 10 else seen)
    require_stopped(played, "are over", 0)
    assert played.outcome.without_reading > 200
    stamps = [row[0] for row in played.rows.rows]
    assert stamps == sorted(set(stamps))  # no reading is recorded twice


def test_a_rig_that_never_answers_ends_the_run() -> None:
    played = play(fault=lambda k, seen: None)
    assert "gave no reading in 3 s" in played.outcome.sentence
    assert played.outcome.code == 3 and played.outcome.cycles == 0
    assert played.outcome.to_json()["work"] == {}  # no cycle has no median
    assert not any(played.rig.written) and played.rig.closed == 1


class Freezing:
    """Fault that freezes channels from the hundredth reading on, with new times."""

    def __init__(self, *names: str) -> None:
        self.names = names
        self.kept: Readings | None = None

    def __call__(self, count: int, seen: Readings) -> Readings:
        if count < 100:
            return seen
        self.kept = self.kept or seen
        return seen._replace(**{n: getattr(self.kept, n) for n in self.names})


def test_frozen_sensors_end_the_run_of_a_motor_that_is_commanded_to_move() -> None:
    ramp = law_of(lambda seen: 2.0 * math.sin(20.0 * seen["desired_torque_nm"]))

    class Rising:
        def torque(self, time: float, seen: Readings) -> float:
            return time

    played = play(ramp, desired=Rising(), fault=Freezing(*FIELDS))
    require_stopped(played, "the sensors are frozen: ")
    assert 98 + 20 <= played.outcome.cycles < 98 + 60


def test_equal_readings_of_a_motor_at_rest_do_not() -> None:
    rest = Readings(0.0, 0.1, 0.0, 0.1, 0.0, 0.0)
    played = play(
        desired=constant_course(0.0), fault=lambda k, s: rest._replace(time=s.time)
    )
    require_stopped(played, "are over", 0)


@pytest.mark.parametrize(
    ("frozen", "why"),
    [("motor", "encoder of the motor is frozen"), ("joint", "of the joint is frozen")],
)
def test_one_frozen_encoder_ends_the_run(frozen: str, why: str) -> None:
    freezing = Freezing(f"{frozen}_angle", f"{frozen}_velocity")

    def turning(count: int, seen: Readings) -> Readings:
        angle = 0.5 * math.sin(0.02 * count)
        return freezing(count, seen._replace(motor_angle=2 * angle, joint_angle=angle))

    require_stopped(play(fault=turning, duration=1.0), why)


@pytest.mark.parametrize("scale", [-1.0, 0.2, 3.0])
def test_motor_and_joint_that_go_apart_end_the_run(scale: float) -> None:
    def turning(count: int, seen: Readings) -> Readings:
        angle = 0.9 * math.sin(0.02 * count)
        return seen._replace(motor_angle=scale * RATIO * angle, joint_angle=angle)

    played = play(fault=turning, duration=1.0)
    require_stopped(played, "apart, at the joint, beyond twist = 0.5")
    assert f"ratio of {RATIO:g}" in played.outcome.sentence


@pytest.mark.parametrize("stretch", [-0.24, 0.24])
def test_play_and_stretch_do_not(stretch: float) -> None:
    def turning(count: int, seen: Readings) -> Readings:
        angle = 0.9 * math.sin(0.02 * count)
        motor = RATIO * (angle + stretch * math.sin(0.05 * count))
        return seen._replace(motor_angle=motor, joint_angle=angle)

    require_stopped(play(fault=turning, duration=1.0), "are over", 0)


def test_a_host_that_is_late_too_long_ends_the_run() -> None:
    waits = iter(range(10**6))

    def oversleep(clock: SimulatedClock) -> None:
        if next(waits) == 100:
            clock.time += 10.5 * PERIOD

    played = play(before=oversleep)
    require_stopped(played, "late: 10 cycles in a row were missed")


def test_a_late_host_skips_cycles_and_makes_no_larger_steps() -> None:
    waits = iter(range(10**6))

    def oversleep(clock: SimulatedClock) -> None:
        if next(waits) % 50 == 49:
            clock.time += 3.4 * PERIOD

    played = play(law_of(lambda _: FULL), before=oversleep)
    require_within_limits(played)
    assert played.outcome.code == 0
    # Cycles stay on the grid of the deadlines, so none are made up for.
    assert played.outcome.missed == 3 * (played.outcome.cycles // 50)
    assert played.outcome.cycles + played.outcome.missed == pytest.approx(250, abs=3)
    assert played.outcome.late.longest == pytest.approx(3.4 * PERIOD)


@pytest.mark.parametrize("stopped_at", [300, 301])
def test_a_stop_always_wins(stopped_at: int) -> None:
    """The stop comes before or after the controller runs; its torque is not written."""
    looks, calls = iter(range(10**6)), iter(range(10**6))

    def wish(_: dict[str, float]) -> float:
        next(calls)
        return 1.0

    played = play(
        law_of(wish),
        stop=lambda: (
            Ending("stopped by hand.", 130) if next(looks) >= stopped_at else None
        ),
    )
    require_stopped(played, "stopped by hand", 130)
    # One question before the rig answers, then two in every cycle.
    assert played.outcome.cycles == (stopped_at - 1) // 2


def test_what_the_class_of_a_rig_raises_ends_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def read(rig: FakeRig) -> Readings | None:
        if rig.reads == 100:
            rig.reads += 1
            raise OSError("bus off")
        return plain(rig)

    plain = FakeRig.read
    monkeypatch.setattr(FakeRig, "read", read)
    require_stopped(play(), "OSError: bus off")


@pytest.mark.parametrize(
    ("error", "why"),
    [(OSError("gone"), "OSError: gone"), (CableError("it is gone."), "it is gone.")],
)
def test_a_rig_that_raises_for_good_gets_zero_until_the_end(
    monkeypatch: pytest.MonkeyPatch, error: Exception, why: str
) -> None:
    sent: list[float] = []

    def write(rig: FakeRig, torque: float) -> None:
        sent.append(torque)
        if rig.reads >= 100:
            raise error
        plain(rig, torque)

    def read(rig: FakeRig) -> Readings | None:
        if rig.reads >= 100:
            raise error
        return reading(rig)

    plain, reading = FakeRig.write, FakeRig.read
    monkeypatch.setattr(FakeRig, "write", write)
    monkeypatch.setattr(FakeRig, "read", read)
    played = play()
    assert (played.outcome.sentence, played.outcome.code) == (why, 3)
    assert (
        sent[-ZERO_TORQUE_CYCLES:] == [0.0] * ZERO_TORQUE_CYCLES
        and played.rig.closed == 1
    )


def test_limits_that_cannot_be_kept_together_are_refused() -> None:
    with pytest.raises(CableError, match=r"must be at least 0\.05 s"):
        Limiter(dataclasses.replace(LIMITS, stop_time=0.04), PERIOD)
    with pytest.raises(CableError, match="joint_range"):
        dataclasses.replace(LIMITS, joint_range=(1.0, -1.0))
    with pytest.raises(CableError, match="missed_readings"):
        Watchdog(missed_readings=0)


def test_controllers_get_what_is_measured() -> None:
    seen: list[dict[str, float]] = []

    def keep(observation: dict[str, float]) -> float:
        seen.append(dict(observation))
        return 0.1

    played = play(law_of(keep), duration=0.1)
    last = played.rows.rows[played.outcome.cycles - 1]
    names = ("motor_angle_rad", "motor_velocity_rad_s", "joint_angle_rad")
    assert [seen[-1][name] for name in names] == list(last[1:4])
    assert seen[-1]["desired_torque_nm"] == 2.0
    assert set(seen[-1]) == set(MEASURED_COLUMNS)


def test_a_rig_that_takes_the_torque_away_ends_the_run() -> None:
    on, off = Status.ENABLED, Status.NONE
    played = play(fault=lambda k, s: s._replace(status=on if 5 < k < 100 else off))
    require_stopped(played, "the rig has disabled its motor")
    assert played.outcome.cycles == 98


def test_a_rig_that_never_gives_torque_ends_the_run() -> None:
    played = play(fault=lambda k, seen: seen._replace(status=Status.NONE))
    require_stopped(played, "does not enable its motor: 10 readings")


def test_a_log_that_cannot_be_written_ends_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def row(rows: Rows, axes: Sequence[AxisRow], *_: float) -> None:
        rows.rows.append(axes[0].seen[:6])
        if len(rows.rows) >= 100:
            raise OSError("no space left on device")

    monkeypatch.setattr(Rows, "row", row)
    require_stopped(play(), "no space left on device")


@pytest.mark.parametrize("step", [1.5, -1.5, 3600.0])
def test_a_step_of_the_rigs_clock_ends_the_run(step: float) -> None:
    def stepped(count: int, seen: Readings) -> Readings:
        return seen._replace(time=seen.time + (step if count > 100 else 0.0))

    played = play(fault=stepped)
    require_stopped(played, f"the rig's clock stepped by {step:+.4g} s")
    times = [row[0] for row in played.rows.rows]
    assert max(times) - min(times) < 0.5  # none of the wrong ones


@pytest.mark.parametrize("drift", [1e-3, -1e-3])
def test_a_rigs_clock_that_drifts_or_is_seen_late_does_not(drift: float) -> None:
    def drifted(count: int, seen: Readings) -> Readings | None:
        late = seen._replace(time=seen.time * (1.0 + drift) + 0.01 * (count % 7 == 0))
        return None if 100 < count < 105 else late

    assert play(fault=drifted).outcome.code == 0


@pytest.mark.parametrize(("rate", "share"), [(4.0, 0.4), (400.0, 0.0)])
def test_cycles_at_the_limit_of_the_rate_are_counted(rate: float, share: float) -> None:
    limits = dataclasses.replace(LIMITS, torque_rate=rate, stop_time=1.0)
    outcome = play(limits=limits).outcome
    assert outcome.rate_limited / outcome.cycles == pytest.approx(share, abs=0.15)
    assert outcome.to_json()["cycles_at_rate_limit"] == outcome.rate_limited


def test_a_cable_that_carries_too_much_by_the_model_ends_the_run() -> None:
    drive = drive_of("bench", Path(), PERIOD, 2.0)
    pretension = drive.cables[0].cable.pretension
    twist = 0.1 * np.sin(np.linspace(0.0, np.pi, 200))

    def said(limit: float) -> list[str]:
        """Return the stop reasons for a held joint and an oscillating motor."""
        watch = Watch(dataclasses.replace(LIMITS, tension=limit), Watchdog(), drive)
        model = CableModel(drive)
        found = []
        for k, angle in enumerate(twist.tolist()):
            seen = Readings(PERIOD * k, angle, 0.0, 1e-9 * k, 0.0, 125.0 * angle)
            model.follow([seen.motor_angle], [seen.joint_torque])
            peaks.append(max(float(model.tension(c).max()) for c in range(2)))
            if why := watch.reading(seen, 0.0, seen.time) or watch.transmission(
                seen, {}
            ):
                found.append(why)
        return found

    peaks: list[float] = []
    assert said(math.inf) == []
    most = max(peaks)
    assert most > pretension + 50.0
    assert said(1.01 * most) == []
    first, *_ = said(0.99 * most)
    assert re.fullmatch(
        r"cable [12] carries \S+ N by the scene's model, beyond its limit of \S+\.",
        first,
    )


def test_the_tension_of_a_cable_that_another_joint_winds_is_not_limited() -> None:
    drive = drive_of("exosuit", Path(), PERIOD, 2.0, axis="hip")
    limits = dataclasses.replace(LIMITS, tension=100.0)
    with pytest.raises(CableError, match=r"\[limits\] tension needs to know how joint"):
        Watch(limits, Watchdog(), drive)
    bench = drive_of("bench", Path(), PERIOD, 2.0)
    with pytest.raises(CableError, match="above the scene's pretension of 80 N"):
        Watch(dataclasses.replace(LIMITS, tension=80.0), Watchdog(), bench)
    with pytest.raises(CableError, match="tension must be above 0 N, not 0"):
        dataclasses.replace(LIMITS, tension=0.0)
