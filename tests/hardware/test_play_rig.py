"""The rig that plays in real time obeys statics, and its instruments tell of it."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driven import HAND, Bench, Instruments
from play_rig import PERIOD, SILENCE, ServedHost, UdpEnd, Worn, WornRig, ends_of

from cc_mujoco.errors import CableError
from cc_mujoco.hardware import Readings, Status, read_settings
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._packet import Command
from hardware import lagging
from hardware.peers import toml
from rig import make_rig


def held(torque: float, seconds: float = 1.5) -> Bench:
    """Return a bench with a slowly increased motor torque and a held joint."""
    bench = Bench(make_rig(1, make="guides"), {}, PERIOD)
    steps = round(seconds / PERIOD)
    for k in range(steps):
        bench.advance(torque * min(1.0, 2.0 * k / steps), 0.0, 0.0)
    return bench


@pytest.mark.study
@pytest.mark.parametrize("torque", [3.5, -3.5])
def test_a_held_joint_gets_what_friction_leaves(torque: float) -> None:
    bench = held(torque)
    plant, felt = bench.plant, bench.joint_torque
    assert np.abs(bench.state[[1, 3]]).max() < 1e-3  # at rest
    near = plant.bench.motor_radius * (bench.ends[0] - bench.ends[1])
    assert near == pytest.approx(torque, rel=1e-3)
    assert felt == pytest.approx(HAND[0] * bench.state[2], rel=1e-3)
    assert 0.0 < felt / torque < 1.0
    # Capstan equation of cables that slid all along: one tighter at the motor.
    mine, other = (0, 1) if torque > 0.0 else (1, 0)
    wraps = plant.friction * plant.bend.sum(axis=1)
    assert bench.ends[mine] / bench.ends[2 + mine] == pytest.approx(
        math.exp(wraps[mine]), rel=0.02
    )
    assert bench.ends[2 + other] / bench.ends[other] == pytest.approx(
        math.exp(wraps[other]), rel=0.02
    )


@pytest.mark.parametrize("name", ["joint_gravity", "sensor_delay"])
def test_what_it_does_not_play_is_refused(name: str) -> None:
    with pytest.raises(CableError, match=f"cannot hide {name}"):
        Bench(make_rig(1, make="guides"), {name: 0.1}, PERIOD)


@pytest.mark.study
def test_a_torque_below_friction_does_not_reach_the_joint() -> None:
    assert abs(held(0.5).joint_torque) < 0.02


def test_instruments_tell_the_speed_of_a_turning_motor() -> None:
    instruments = Instruments(0, PERIOD)
    for k in range(200):
        state = np.array([2.0 * 0.002 * k, 2.0, -1.0 * 0.002 * k, -1.0])
        seen = instruments.readings(state, 1.0, Status.ENABLED)
    assert seen.motor_velocity == pytest.approx(2.0, abs=0.2)
    assert seen.joint_velocity == pytest.approx(-1.0, abs=0.6)
    assert seen.joint_torque == pytest.approx(1.0, abs=0.2)


ADDRESS = ("127.0.0.1", 5)


def taken(host: ServedHost, *commands: tuple[int, float, Status], now: float) -> float:
    for sequence, torque, status in commands:
        data = packet.pack_command(Command(sequence, 0, torque, status))
        host.take(data, ADDRESS, now)
    host.watch(now)
    return host.torque


def test_a_rig_does_what_the_page_says_that_it_owes() -> None:
    on, none = Status.ENABLED, Status.NONE
    host = ServedHost()
    assert taken(host, (5, 1.0, on), now=0.0) == 0.0  # left over from another run
    assert host.address is None
    assert taken(host, (1, 0.0, none), (2, 1.0, on), now=0.1) == 1.0
    assert host.enabled and host.address == ADDRESS
    assert taken(host, (2, 2.0, on), (1, 2.0, on), now=0.1) == 1.0
    host.take(b"CCMC", ADDRESS, 0.1)
    assert taken(host, now=0.1 + 0.9 * SILENCE) == 1.0
    assert taken(host, now=0.1 + 1.1 * SILENCE) == 0.0
    assert taken(host, (3, 1.0, on), now=0.2) == 0.0 and not host.enabled
    assert taken(host, (1, 0.0, none), (2, 0.5, on), now=0.2) == 0.5
    assert taken(host, (3, 0.5, Status.STOPPED), (2, 0.5, on), now=0.2) == 0.0
    assert host.address is None


@pytest.mark.parametrize(
    "rig",
    ['address = "127.0.0.1:0"', 'address = "can:played"\ninterface = "virtual"'],
)
def test_it_is_where_rig_toml_says(rig: str, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        rig = rig.replace(":0", f":{free.getsockname()[1]}")
    path = tmp_path / "rig.toml"
    path.write_text(toml(rig))
    settings = read_settings(path)
    (end,), made = ends_of([settings]), settings.connect()
    assert end.receive() is None
    made.write(0.0)
    found = arrived(end.receive)
    assert packet.read_command(found[0]) == Command(1, 0, 0.0, Status.NONE)
    end.send(packet.pack_reading(1, 5, Readings(0.0, 0.5, *[0.0] * 4)), found[1])
    assert arrived(made.read).motor_angle == 0.5
    made.close()
    end.close()


def arrived(read: Callable[[], Any]) -> Any:
    """Return the first result within a second."""
    for _ in range(1000):
        if (found := read()) is not None:
            return found
        time.sleep(1e-3)
    raise AssertionError("nothing came")


def test_a_class_of_ones_own_cannot_be_played(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(toml('class = "my_rig:Rig"'))
    with pytest.raises(CableError, match="names a class of its own"):
        ends_of([read_settings(path)])


def test_a_device_is_played_with_the_torque_of_the_axes_that_are_driven() -> None:
    played = WornRig(Worn("exosuit"), ["ankle"], 1, 0.002)
    assert played.period == pytest.approx(0.002)
    for _ in range(25):
        played.advance([0.5])
    (seen,) = played.readings([Status.ENABLED])
    others = WornRig(Worn("exosuit"), ["hip", "ankle"], 1, 0.002)
    for _ in range(25):
        others.advance([0.0, 0.5])
    hip, ankle = others.readings([Status.NONE, Status.ENABLED])
    assert ankle.motor_angle == pytest.approx(seen.motor_angle, abs=2e-3)
    assert (hip.status, ankle.status) == (Status.NONE, Status.ENABLED)
    assert abs(ankle.motor_angle - hip.motor_angle) > 0.01


def test_a_port_in_use_is_one_sentence() -> None:
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with contextlib.closing(taken):
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(CableError, match=f"{port} cannot be used .* already"):
            UdpEnd("127.0.0.1", port)


SECONDS = 2.0
"""Length of a run whose error is compared [s]."""


@pytest.mark.parametrize(
    "law",
    [
        lagging.NOTHING,
        *(pytest.param(law, marks=pytest.mark.study) for law in ("none", "pi")),
    ],
)
def test_the_example_of_the_page_does_its_task(law: str) -> None:
    """With a third of the error of a motor that is off, and of simple controllers."""
    settings = lagging.page_settings()
    found, other = (
        lagging.bench(each, settings, seconds=SECONDS)[0]
        for each in ("predictive", law)
    )
    assert 3.0 * found < other


def test_bristles_that_the_rotor_contradicts_are_not_planned_with() -> None:
    """They predict the torque at the joint better, and the error was 1.3 N m."""
    settings = lagging.page_settings()
    assert lagging.bench("predictive", settings, seed=3, seconds=SECONDS)[0] < 0.15


def test_a_limit_of_the_rate_that_the_plan_knows_costs_little() -> None:
    """At a rate at which a plan that does not know it swings."""
    settings = lagging.page_settings({"torque_rate": "40.0"})
    known, kept = lagging.bench("predictive", settings, seconds=3.0)
    unknown, cut = lagging.bench("predictive", settings, seconds=3.0, rate_known=False)
    assert known < 0.25
    assert 4.0 * known < unknown
    assert kept.rate_limited < 0.05 * kept.cycles
    # The guard lets the joint go for the rest of the time.
    assert cut.rate_limited > 0.3 * cut.cycles


@pytest.mark.study
@pytest.mark.parametrize("lag", [0.003, 0.005])
def test_a_lag_that_the_plan_knows_costs_little(lag: float) -> None:
    settings = lagging.page_settings()
    known, unknown = (
        lagging.bench(
            "predictive",
            dataclasses.replace(settings, motor_lag=believed),
            lag=lag,
            seconds=SECONDS,
        )[0]
        for believed in (lag, 0.0)
    )
    assert known < 0.2
    assert 2.0 * known < unknown


def test_a_pair_of_cables_is_not_worse_off_for_a_lag_that_the_plan_knows() -> None:
    """It was: 0.13 N m of a controller that knew 1 ms, and 0.07 of one that did not."""
    assert lagging.device("predictive", "wrist", 1e-3, True, 3) < 0.1
