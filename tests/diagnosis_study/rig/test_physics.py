"""The rig obeys what is known of cables: capstan, power, slack, friction at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.bristles import LAW, plant_of
from rig.dataset import run, truth_of
from rig.engine import COLUMNS, RECORD_TIME, Asked, integrate
from rig.nominal import Rig
from rig.trials import STIFF, Trial

Array = NDArray[np.float64]


def column(records: Array, name: str) -> Array:
    return records[:, COLUMNS.index(name)]


def pulled(rig: Rig, speed: float, seconds: float, **changes: float) -> Array:
    """Return the records of a steadily turning motor, the handle held by a spring."""
    time = np.arange(round(1000 * seconds) + 1) / 1000
    command = np.stack([speed * time, np.full_like(time, speed)], axis=1)
    plant = plant_of(rig)._replace(**changes)
    spring = np.array([2.0, 0.5])
    servo = np.array(STIFF)
    asked = Asked(servo, spring, command, np.zeros_like(command))
    return integrate(LAW, plant, rig.pretension, asked, 1)


def test_ends_of_a_sliding_cable_obey_the_capstan_equation(rig: Rig) -> None:
    records = pulled(rig, speed=0.4, seconds=2.0)[-1000:]
    a = column(records, "tension_a_proximal") / column(records, "tension_a_distal")
    b = column(records, "tension_b_distal") / column(records, "tension_b_proximal")
    assert a == pytest.approx(math.exp(rig.friction_a * rig.wrap), rel=0.01)
    assert b == pytest.approx(math.exp(rig.friction_b * rig.wrap), rel=0.01)


def test_sliding_friction_does_not_depend_on_speed(rig: Rig) -> None:
    slow = pulled(rig, speed=0.1, seconds=5.0)[-200:]
    fast = pulled(rig, speed=1.0, seconds=0.5)[-200:]
    ratios = [
        column(records, "tension_a_proximal").mean()
        / column(records, "tension_a_distal").mean()
        for records in (slow, fast)
    ]
    assert ratios[1] == pytest.approx(ratios[0], rel=0.002)


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"viscous_friction": 80.0},
        {"stribeck_friction": 0.4},
        {"presliding": 1e-3},
        {"pulley_eccentricity": 0.1},
    ],
)
def test_work_in_is_work_out_and_losses_and_what_is_stored(
    rig: Rig, lively: Trial, effects: dict[str, float]
) -> None:
    records = run(truth_of(rig, effects, seed=3), rig, lively)
    rise = records[-1] - records[500]
    change = dict(zip(COLUMNS, rise, strict=True))
    spent = change["work_friction"] + change["work_damping"] + change["energy_stored"]
    assert spent > 0.5
    balance = change["work_in"] - change["work_out"] - spent
    assert abs(balance) < 1e-3 * spent


@pytest.mark.parametrize(
    "effect", ["asymmetric_friction", "backlash", "dwell_dependent_stiction"]
)
def test_a_closed_cycle_of_both_ends_takes_work(rig: Rig, effect: str) -> None:
    time = np.arange(4001) / 1000
    angle = 0.3 * np.sin(2 * np.pi * 0.5 * time)
    command = np.stack([angle, np.gradient(angle, 1e-3)], axis=1)
    target = np.roll(command, 300, axis=0)
    plant = truth_of(rig, {effect: 0.01}, seed=1).plant
    hand = np.array([4.0, 0.1])
    servo = np.array(STIFF)
    asked = Asked(servo, hand, command, target)
    records = integrate(LAW, plant, rig.pretension, asked, 2)
    cycle = round(2.0 / RECORD_TIME)
    taken = column(records, "work_in") - column(records, "work_out")
    assert taken[-1] - taken[-1 - cycle] > 0.1


def test_friction_takes_work_at_all_times(rig: Rig, lively: Trial) -> None:
    """Apart from the little that bristles give back at a reversal."""
    lost = column(run(truth_of(rig, {}, 3), rig, lively), "work_friction")
    assert np.max(np.maximum.accumulate(lost) - lost) < 1e-3


def test_a_cable_goes_slack_and_never_pushes(rig: Rig, lively: Trial) -> None:
    plant = plant_of(rig)
    hand = np.array([8.0, 0.2])
    asked = Asked(np.array(STIFF), hand, lively.command, -lively.command)
    records = integrate(LAW, plant, 8.0, asked, 1)
    ends = records[:, 5:9]
    assert ends.min() == 0.0
    assert np.mean(ends == 0.0) > 0.1


def test_friction_holds_at_rest(rig: Rig, dwelling: Trial) -> None:
    """Torque does not creep while nothing moves: no chatter of bristles."""
    still = np.zeros_like(dwelling.command)
    still[:, 0] = 0.4
    moved = dwelling.command[:1500].copy()
    moved[:, 0] += 0.4 - moved[-1, 0]
    moved[-200:, 0] = 0.4
    moved[-200:, 1] = 0.0
    command = np.concatenate([moved, still])
    spring = np.array([6.0, 0.03])
    servo = np.array(STIFF)
    asked = Asked(servo, spring, command, 0 * command)
    records = integrate(LAW, plant_of(rig), rig.pretension, asked, 1)
    torque = column(records, "motor_torque")[-15000:]
    assert abs(torque[-1]) > 0.5
    assert np.ptp(torque) < 2e-3


def test_ageing_makes_the_first_move_after_a_longer_rest_harder(rig: Rig) -> None:
    """The break-away torque grows with the logarithm of the rest."""
    peaks = []
    for rest in (0.2, 0.8, 3.2):
        time = np.arange(round(1000 * (rest + 1.2)) + 1) / 1000
        # Move, rest, and move on the same way: no friction is turned round.
        path = 0.1 * np.minimum(time, 0.6) + 0.1 * np.maximum(time - 0.6 - rest, 0)
        command = np.stack([path, np.gradient(path, 1e-3)], axis=1)
        plant = plant_of(rig)._replace(ageing=0.1)
        hand = np.array([0.0, 0.5])
        asked = Asked(np.array(STIFF), hand, command, 0 * command)
        records = integrate(LAW, plant, rig.pretension, asked, 1)
        peaks.append(column(records, "motor_torque")[-3000:].max())
    steps = np.diff(peaks)
    assert steps[0] > 0.05
    assert steps[1] == pytest.approx(steps[0], rel=0.3)
