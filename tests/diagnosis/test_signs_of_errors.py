"""Errors are measured minus simulated: in fits, in traces, and in what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cc_mujoco.cable import Cable, Section, Transmission
from cc_mujoco.datasets._channels import TORQUES
from cc_mujoco.diagnosis import Problem, prepare
from cc_mujoco.diagnosis._fit.problem import jacobian
from cc_mujoco.diagnosis._locate import describe_map, error_maps
from cc_mujoco.diagnosis._phrases import SIGN_NOTE
from cc_mujoco.diagnosis._report import sections
from cc_mujoco.diagnosis._rig.simulation import (
    TORQUE_OFFSETS,
    SimulatedRig,
    baseline_parameters,
)
from cc_mujoco.diagnosis._verdict import Evidence, Isolability, TrialTrace
from cc_mujoco.estimation import Measurement
from diagnosis.recorded import BENCH, dataset

MORE = 0.1
"""Torque that a rig shows beyond its simulation [N m]."""


def test_the_error_of_a_fit_is_positive_where_the_rig_shows_more() -> None:
    records, _ = prepare(dataset(duration=3.0, chosen=(0,)), BENCH)
    free = baseline_parameters(BENCH, records, {})
    plant = SimulatedRig(BENCH, records, 8)
    noise = tuple(np.full(r.measured.shape, 0.05) for r in records)
    at = np.zeros(len(free))
    shown = tuple(
        replace(record, measured=torque + MORE)
        for record, torque in zip(
            records,
            plant.simulate(Problem(plant, free, (), noise, noise).values(at)),
            strict=True,
        )
    )
    problem = Problem(SimulatedRig(BENCH, shown, 8), free, (), noise, noise)
    (error,) = problem.plainly(at)
    np.testing.assert_allclose(error, MORE / 0.05)
    counts = [record.counts for record in shown]
    slopes = jacobian(problem, at, counts)
    # A simulation that shows more leaves less.
    index = [parameter.name for parameter in free].index(TORQUE_OFFSETS[0])
    assert slopes[:, index].min() < 0.0 <= -slopes[:, index].max()


def test_the_residual_of_a_trial_is_positive_where_the_rig_shows_more() -> None:
    cable = Cable(friction=0.05, pretension=20.0, conduit=(Section(1.0, 0.3),))
    drive = Transmission.pull_pull(cable, 0.02, 0.05)
    angle = 0.2 * np.sin(np.linspace(0.0, 6.0, 200))
    inputs = {"motor_angle": 2.0 * angle, "joint_angle": angle}
    torque = drive.replay(0.01, **inputs).joint_torque + MORE
    trial = Measurement(0.01, inputs, {"joint_torque": torque}, {"joint_torque": 0.05})
    found = trial.residual(drive)["joint_torque"]
    np.testing.assert_allclose(found, MORE / 0.05)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_report_says_which_way_an_error_lies(side: float) -> None:
    """The rig shows more, or less, torque where the motor turns forwards."""
    time = np.arange(0.0, 20.0, 0.01)
    angle = np.sin(time)
    played = dict.fromkeys(TORQUES, np.zeros(time.size))
    measured = dict.fromkeys(TORQUES, side * MORE * (np.cos(time) > 0.0))
    counts = np.ones(time.size)
    trace = TrialTrace("one", time, angle, angle, measured, played, played, counts)
    assert np.all(side * trace.error(TORQUES[0]) >= 0.0)
    drawn = error_maps((trace,), seed=0)
    speed = next(m for m in drawn if "motor speed" in m.axis)
    fast = np.nanargmax(speed.centre)
    assert speed.before[fast] == pytest.approx(side * MORE)
    statement = describe_map(speed)
    low, high = ("\u22120.1000", "0.00") if side < 0.0 else ("0.00", "+0.1000")
    assert f"measured minus simulated is {low} N m" in statement
    assert f"and {high} N m" in statement
    turning = next(m for m in drawn if m.axis == "direction of motion")
    assert "(1 is forwards, \u22121 backwards)" in describe_map(turning)
    nothing = Isolability((), np.zeros((0, 0)), np.zeros(0))
    assert SIGN_NOTE in str(sections.maps(Evidence((trace,), drawn, nothing)))


def test_a_cable_of_another_stiffness_and_friction_keeps_its_ratio() -> None:
    """A baseline has one value of each; of equal cables it would name a difference."""
    one, two = BENCH.cables
    other = two.replace(
        axial_stiffness=0.8 * one.axial_stiffness, friction=1.5 * one.friction
    )
    bench = replace(BENCH, cables=(one, other))
    records, _ = prepare(dataset(duration=1.0, chosen=(0,)), bench)
    plant = SimulatedRig(bench, records, 8)
    for scale in (1.0, 1.3):
        first, second = plant.cables(
            {
                "axial_stiffness": scale * one.axial_stiffness,
                "friction": scale * one.friction,
                "friction_balance": 0.1,
            },
            (),
        )
        assert first.axial_stiffness == scale * one.axial_stiffness
        assert second.axial_stiffness == pytest.approx(scale * other.axial_stiffness)
        assert first.friction == pytest.approx(1.1 * scale * one.friction)
        assert second.friction == pytest.approx(0.9 * scale * other.friction)
