"""Lost motion is measured where there is some, and nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.cable import Transmission
from cc_mujoco.datasets import Bench, Dataset, Trial
from cc_mujoco.diagnosis import prepare
from cc_mujoco.diagnosis._fit.dead_zone import DeadZone, dead_zones, describe_dead_zones
from diagnosis.recorded import BENCH, DT, NOISE, dataset

TRAVEL = 0.05
"""Amplitude of the motor with the joint locked [rad]."""


def driven(play: float, joint: float = 0.0, noise: float = 0.0) -> Dataset:
    """Return a trial of a motor with play in its coupling, the joint turned a share.

    The drum rests while the motor crosses the play, each time that the pull changes
    sides. The joint moves by `joint` times the drum.
    """
    time = np.arange(0.0, 6.0, DT)
    drum = TRAVEL * np.sin(4.0 * time) + joint * np.sin(1.1 * time)
    turned = joint * np.sin(1.1 * time)
    drive = Transmission(BENCH.cables, BENCH.motor_radius, BENCH.joint_radius)
    played = drive.replay(DT, motor_angle=drum, joint_angle=turned)
    signals = np.array([drum, turned, played.motor_torque, played.joint_torque])
    pull = played.motor_torque
    motor = drum + 0.5 * play * np.sign(pull)
    rests = np.flatnonzero(np.diff(np.sign(pull)) != 0.0)[::-1]
    for place in rests if play else ():
        crossed = np.linspace(motor[place], motor[place + 1], 20)[1:-1]
        held = np.repeat(signals[:, place : place + 1], crossed.size, axis=1)
        held[2:] = np.linspace(0.5, -0.5, crossed.size) * 1e-3
        signals = np.insert(signals, [place + 1] * crossed.size, held, axis=1)
        motor = np.insert(motor, [place + 1] * crossed.size, crossed)
    random = np.random.default_rng(0)
    torques = signals[2:] + noise * random.normal(size=signals[2:].shape)
    clock = DT * np.arange(motor.size)
    whole = (slice(0, motor.size),)
    trial = Trial(
        "locked", clock, motor, torques[0], signals[1], torques[1], whole, DT,
        path="locked.csv",
    )  # fmt: skip
    return Dataset((trial,), noise=NOISE)


def measured(trials: Dataset, bench: Bench = BENCH) -> tuple[DeadZone, ...]:
    return dead_zones(trials, bench, prepare(trials, bench)[0])


@pytest.mark.parametrize("play", [0.02, 0.04, 0.06])
@pytest.mark.parametrize("joint", [0.0, 0.2])
def test_play_is_measured_in_each_cycle(play: float, joint: float) -> None:
    trials = driven(play, joint, noise=0.02)
    (zone,) = measured(trials)
    assert zone.lost == pytest.approx(BENCH.motor_radius * play, rel=0.2)
    assert zone.travel.size >= 6
    assert (zone.travel > 0.9 * zone.lost).all()
    assert abs(zone.pull) < 6.0
    assert "locked has a dead zone" in zone.statement
    assert "in 1 of 1 trials" in describe_dead_zones((zone,), 1)


@pytest.mark.parametrize("joint", [0.0, 0.2])
def test_springs_and_friction_are_no_dead_zone(joint: float) -> None:
    assert measured(driven(0.0, joint, noise=0.02)) == ()
    assert describe_dead_zones((), 1) == ""


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"end_compliance": {"end_compliance": 1e-4}},
        {"viscous_friction": {"viscous_friction": 10.0}},
        {
            "motor_cogging": {
                "cogging_sine": 0.3,
                "cogging_cosine": 0.0,
                "cogging_order": 7,
            }
        },
    ],
)
def test_no_effect_within_a_stiff_drive_is_taken_for_one(
    effects: Mapping[str, Mapping[str, float]],
) -> None:
    slack = BENCH.cables[0].replace(pretension=5.0)
    for bench in (BENCH, replace(BENCH, cables=(slack, slack))):
        trials = dataset(effects, duration=12.0, chosen=(0, 1, 2, 3), bench=bench)
        assert measured(trials, bench) == ()


def test_play_of_the_joint_is_a_dead_zone_of_loose_cables() -> None:
    slack = BENCH.cables[0].replace(pretension=5.0)
    loose = replace(BENCH, cables=(slack, slack))
    effects = {"backlash": {"backlash": 0.03}}
    trials = dataset(effects, duration=12.0, chosen=(2,), bench=loose)
    (zone,) = measured(trials, loose)
    assert zone.lost == pytest.approx(0.03 * BENCH.joint_radius, rel=0.2)
