"""The statement of what a set of instruments can show is true on simulated rigs."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.datasets._rig_table import fit_angle_pairs
from cc_mujoco.datasets._trials import TORQUE_SENSORS, Instruments
from cc_mujoco.diagnosis import Options, run_inference
from cc_mujoco.diagnosis._phrases import describe_mode
from diagnosis.instrumented import angles_only, loaded
from diagnosis.recorded import BENCH, DT, dataset, motions

MOTORS = ("torque sensor", "load cells", "motor current", None)
JOINTS = ("torque sensor", "load cells", "known load", None)
CABLE = {"friction": 0.13, "axial_stiffness": 47e3, "pretension": 82.0}


def test_every_mode_but_two_torque_sensors_states_what_it_cannot_show() -> None:
    assert describe_mode(TORQUE_SENSORS) == ""
    for motor, joint in itertools.product(MOTORS, JOINTS):
        mode = Instruments(motor, joint)
        if mode not in (TORQUE_SENSORS, Instruments(None, None)):
            assert "cannot show" in describe_mode(mode) or "cannot tell" in (
                describe_mode(mode)
            )
    assert "ends held" in describe_mode(Instruments("load cells", "load cells"), True)
    assert "Angles only" in describe_mode(Instruments(None, "known load"))


SUSPECTS = Options(("end_compliance", "backlash", "viscous_friction"))


@pytest.mark.study
def test_angles_and_a_declared_spring_show_play() -> None:
    data = angles_only(loaded(CABLE, duration=4.0, play=0.02))
    found = run_inference(data, BENCH, SUSPECTS).diagnosis
    assert [effect.id for effect in found.missing] == ["backlash"], found.statement
    size = found.effects[0].parameters["backlash"].value
    assert size == pytest.approx(0.02, rel=0.1)
    assert found.instruments.startswith("Angles only")


@pytest.mark.study
def test_angles_and_a_declared_spring_do_not_show_where_a_cable_stretches() -> None:
    data = angles_only(loaded({**CABLE, "end_compliance": 2e-5}, duration=4.0))
    found = run_inference(data, BENCH, SUSPECTS).diagnosis
    assert (found.verdict, found.missing) == ("none", ())
    off = {each.parameter for each in found.deviating}
    assert off & {"pretension", "axial_stiffness"}


@pytest.mark.study
def test_angle_pairs_stand_in_for_the_geometry_of_a_lever() -> None:
    joint = np.linspace(-0.9, 0.9, 12)
    motor = joint + 0.1 * joint**2  # an arm of 1 + 0.2 q
    pairs = fit_angle_pairs(np.array([motor, joint]).T.tolist(), "pairs")
    lever = BENCH.known(pairs)
    random = np.random.default_rng(2)
    recorded = dataset({}, 2.4)
    trials = []
    for trial, (wound, turned) in zip(
        recorded.trials, motions(4.0, 0)[:3], strict=True
    ):
        wound, turned = wound - wound[0], turned - turned[0]  # at rest in pose 0
        true = lever.following(turned) + wound - turned
        played = lever.replay(DT, true, turned)
        noise = random.normal(0.0, 1.0, (4, true.size))
        trials.append(
            replace(
                trial,
                motor_angle=true + 2e-5 * noise[0],
                motor_torque=played.motor_torque + 0.02 * noise[1],
                joint_angle=turned + 2e-5 * noise[2],
                joint_torque=played.joint_torque + 0.02 * noise[3],
            )
        )
    data = replace(recorded, trials=tuple(trials))
    without = run_inference(data, BENCH, SUSPECTS).diagnosis
    assert without.verdict != "none"
    told = run_inference(replace(data, constants=pairs), BENCH, SUSPECTS).diagnosis
    assert (told.verdict, told.missing) == ("none", ())
    assert "angle pairs" in told.instruments
