"""Baselines that follow from rotor, cables and delay."""

from __future__ import annotations

import dataclasses
from itertools import product
from typing import Any

import numpy as np
import pytest
import tune_baselines

from cc_mujoco.benchmark import SUITES, Cell, play
from cc_mujoco.benchmark._cell import prepare_episodes
from cc_mujoco.control import (
    CONTROLLERS,
    BacklashInverse,
    CableModel,
    Controller,
    FrictionFeedForward,
    LinearQuadraticGaussian,
    TunedFeedback,
    controller,
)
from cc_mujoco.control._cable_model import cable_table, full_slip_balance
from cc_mujoco.control._controller import motor_limits
from cc_mujoco.control._feedback import loop_gains
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.simulation import run
from control.devices import pull_pull, single

LAWS = (TunedFeedback, FrictionFeedForward, BacklashInverse, LinearQuadraticGaussian)
ORDINARY = {
    scene: SUITES["v2"].conditions(scene)[0] for scene in ("wrist", "ankle", "finger")
}


@pytest.mark.parametrize("kind", LAWS)
def test_rotor_and_cables_must_be_known(kind: type[Controller]) -> None:
    with pytest.raises(CableError, match="rotor and cables"):
        kind(pull_pull())
    with pytest.raises(CableError, match="rotor and cables"):
        kind(Drive(1.0, -1.0, 1.0, 0.001, inertia=1e-4))


def test_a_late_drive_and_a_light_rotor_have_less_gain() -> None:
    heavy = dataclasses.replace(pull_pull(), inertia=1e-2)
    gains = loop_gains(heavy)
    for other in (
        loop_gains(dataclasses.replace(heavy, delay=5)),
        loop_gains(dataclasses.replace(heavy, motor_lag=5e-3)),
        loop_gains(dataclasses.replace(heavy, inertia=1e-4)),
    ):
        assert other.proportional < gains.proportional
        assert other.settling < gains.settling


@pytest.mark.parametrize("drive", [pull_pull(), single()])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_balance_is_that_of_the_model_when_all_slips(
    drive: Drive, sense: float
) -> None:
    """The kernel, drawn by the joint as a motor that turns the other way would."""
    desired = 0.3 * drive.reach[1]
    cables = cable_table(drive.cables, motor_limits(drive))
    torque, stretch = full_slip_balance(cables, sense, desired)
    model: Any = CableModel(drive)
    for share in np.linspace(0.2 if sense < 0.0 else 2.5, 1.0, 60):
        model.follow(np.zeros(1), np.array([share * desired]))
    # The motor holds still, so the joint gives way by as much.
    assert -model.joint[0] == pytest.approx(stretch, rel=0.02)
    assert model.motor_torque()[0] == pytest.approx(torque, rel=0.02)


@pytest.mark.parametrize(
    ("scene", "duration", "seeds"),
    [
        ("wrist", 1.2, 1),
        # `inverse` swings about a foot at rest: 0.9 to 1.8 times `pi` in a second of
        # one seed, 0.73 times in 4 s of four.
        pytest.param("ankle", 4.0, 4, marks=pytest.mark.study),
        pytest.param("finger", 1.2, 1, marks=pytest.mark.study),
    ],
)
def test_they_are_stable_on_a_light_winch_and_better_than_the_gains_of_the_thesis(
    scene: str, duration: float, seeds: int
) -> None:
    condition = dataclasses.replace(ORDINARY[scene], duration=duration)

    def errors(name: str) -> FloatArray:
        found = play(Cell(condition, name, tuple(range(seeds)))).scores
        assert not np.any(found["failed"])
        return found["rms_torque_error"]

    usual = np.mean(errors("pi"))
    names = [name for name, kind in CONTROLLERS.items() if kind in LAWS]
    assert len(names) == len(LAWS)
    for name in names:
        assert np.mean(errors(name)) < 0.8 * usual, name


def test_a_rotor_of_a_tenth_of_the_inertia_does_not_swing() -> None:
    """The gains of the thesis do: they know nothing of the rotor."""
    short = dataclasses.replace(ORDINARY["wrist"], duration=1.01)
    made = prepare_episodes([Cell(short, "none", (0,))])
    ((drive,),) = made.drives
    light = dataclasses.replace(drive, inertia=0.1 * drive.inertia)
    torques: list[float] = []
    made.batch.devices[0].model.dof_armature[:] *= 0.1
    run(
        made.batch,
        TunedFeedback(light),
        lambda step, columns, torque: torques.append(float(torque[0])),
        measure=made.sensors.measure,
    )
    assert np.std(np.diff(torques[300:])) < 0.05


@pytest.mark.parametrize("law", tune_baselines.NUMBERS)
def test_every_number_that_is_tuned_changes_its_law(
    law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With two cables or one, noisy enough for a dead zone, at 1 or 5 kHz."""

    def numbers() -> list[Any]:
        found = []
        for drive, period in product((pull_pull(), single()), (1e-3, 2e-4)):
            own = dataclasses.replace(
                drive, torque_noise=0.2, inertia=1e-3, delay=0, period=period
            )
            law_of: Any = controller(law, own)
            gains = [each for each in vars(law_of).values() if isinstance(each, float)]
            found.append((gains, law_of.law_tables().numbers))
        return found

    usual = numbers()
    for number in tune_baselines.NUMBERS[law]:
        owner, name = tune_baselines.place(number)
        with monkeypatch.context() as changed:
            changed.setattr(owner, name, 0.7 * getattr(owner, name))
            assert numbers() != usual, number
