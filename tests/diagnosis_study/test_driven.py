"""The bench in lockstep: the loop of a real run, without socket and without waiting."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from controlled import LIMITS, SECONDS, task
from driven import Bench, Lockstep, errors, play

from cc_mujoco.control import StictionCompensation, controller
from cc_mujoco.device import Drive
from cc_mujoco.hardware import DrivenAxis, Limits, Loop, Watchdog, drive_of
from cc_mujoco.hardware._references import constant_course
from hardware.fakes import Rows
from rig import make_rig


def played(seed: int, limits: Limits = LIMITS) -> tuple[Lockstep, np.ndarray]:
    drive = Drive(1.0, -10.0, 10.0, 0.002)
    bench = Bench(make_rig(1, make="guides"), {}, drive.period)
    rig, rows = (
        Lockstep(bench, seed, lambda now: (0.1 * np.sin(3.0 * now), 0.0)),
        Rows(),
    )
    law = controller("none", drive)
    axis = DrivenAxis(rig, drive, constant_course(1.0), limits, Watchdog())
    loop = Loop([axis], law, clock=rig, log=rows)
    assert loop.run(0.4).code == 0
    assert loop.outcome.missed == loop.outcome.without_reading == 0
    return rig, np.array(rows.rows)


def test_a_run_in_lockstep_is_the_same_again_and_every_cycle_has_a_reading() -> None:
    rig, rows = played(3)
    assert np.array_equal(rows, played(3)[1], equal_nan=True)
    assert not np.array_equal(rows[:, 5], played(4)[1][:, 5])
    assert np.diff(rows[:, 0]) == pytest.approx(0.002)
    # The sensor shows what the joint truly got, and noise.
    first = round(rows[0, 0] / 0.002) - 1
    true = np.array(rig.torques)[first : first + len(rows)]
    assert np.std(rows[:, 5] - true) == pytest.approx(0.025, rel=0.2)


def test_its_torque_keeps_the_limits_of_the_loop() -> None:
    limits = dataclasses.replace(LIMITS, torque=0.3, torque_rate=5.0)
    _, rows = played(3, limits)
    assert np.abs(rows[:, 8]).max() == pytest.approx(0.3)
    assert np.abs(np.diff(rows[:, 8])).max() <= 5.0 * 0.002 + 1e-12


def test_it_hides_what_is_at_the_motor_and_in_the_pretension() -> None:
    rig = make_rig(1, make="guides")
    found = []
    for hidden in ({}, {"pretension_loss": 0.3}, {"motor_cogging": 0.5}):
        bench = Bench(rig, hidden, 0.002)
        for _ in range(250):
            bench.advance(1.0, 0.0, 0.0)
        found.append((bench.ends.mean(), bench.state[0]))
    usual, lost, cogging = found
    assert lost[0] < 0.95 * usual[0]
    assert abs(cogging[1] - usual[1]) > 1e-4


@pytest.mark.study
def test_a_controller_that_knows_the_drag_tracks_three_times_better() -> None:
    """The best that a diagnosis could do, by the loop that asks what it does."""
    desired, swing = task()
    found = []
    for drag in (0.0, 75.0):
        plain = drive_of("bench", Path(), 0.0005, LIMITS.torque)
        row = tuple(
            dataclasses.replace(each, cable=each.cable.replace(viscous_friction=drag))
            for each in plain.cables
        )
        law = StictionCompensation(dataclasses.replace(plain, cables=row))
        hidden = {"viscous_friction": 150.0}
        bench = Bench(make_rig(1, make="guides"), hidden, 0.0005)
        rig = Lockstep(bench, 1, swing)
        play(rig, law, desired, LIMITS, SECONDS)
        found.append(np.std(errors(rig, desired, SECONDS, 2.0)))
    assert found[1] < found[0] / 3.0


@pytest.mark.parametrize("wiper", [10.0, 30.0])
def test_friction_that_needs_no_tension_holds_slack_cables_and_breaks_nothing(
    wiper: float,
) -> None:
    """Newton's method alone went kilometres where a guide of slack pieces slid."""
    hidden = {"load_independent_friction": wiper}
    bench = Bench(make_rig(1, make="guides"), hidden, 0.001, hand=(200.0, 5.0))
    random = np.random.default_rng(0)
    slack, work = False, [0.0]
    for now in np.arange(0.0, 0.6, 0.001):
        torque = 8.0 * np.sign(np.sin(7.0 * now)) + random.standard_normal()
        bench.advance(torque, 0.3 * np.sin(3.0 * now), 0.9 * np.cos(3.0 * now))
        slack |= bool(np.any(bench.cables.tension == 0.0))
        work.append(float(bench.cables.work.sum()))
        assert 0.0 <= bench.ends.min() and bench.ends.max() < 600.0
    assert slack and np.all(np.diff(work) > -1e-6)
    for _ in range(800):
        bench.advance(5.0, 0.0, 0.0)
    carried = bench.plant.bench.motor_radius * (bench.ends[0] - bench.ends[1])
    assert abs(bench.state[1]) < 1e-2 and carried == pytest.approx(5.0, rel=1e-2)
