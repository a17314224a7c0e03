"""Signs, units and names of the written data follow the data contract."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.dataset import make_dataset, make_trials, run, truth_of
from rig.nominal import NOMINAL, Rig, make_rig
from rig.sensors import BASIC, CHANNELS, Chain, sampled
from rig.trials import SETS, Trial

Data = list[dict[str, NDArray[np.float64]]]


@pytest.fixture(scope="module")
def session() -> Data:
    return make_dataset(make_rig(3), {}, "rich", seed=3, tensions=True)


def test_columns_clock_and_length(session: Data) -> None:
    basic = ["time_s", *(CHANNELS[name].column for name in BASIC)]
    assert basic[1:] == [
        "motor_angle_rad", "motor_torque_nm", "joint_angle_rad", "joint_torque_nm",
    ]  # fmt: skip
    assert len(session) == 8
    for columns in session:
        assert list(columns)[:5] == basic
        assert columns["time_s"][0] == 0.0
        assert np.allclose(np.diff(columns["time_s"]), 0.002)
        assert {values.size for values in columns.values()} == {4000}


def test_positive_motor_rotation_pulls_the_joint_positive(session: Data) -> None:
    for columns in session:
        motor, joint = columns["motor_angle_rad"], columns["joint_angle_rad"]
        assert np.corrcoef(motor, joint)[0, 1] > 0.95


def test_torques_are_those_of_the_tensions(session: Data) -> None:
    """Positive motor torque winds cable a, and cable a pulls the joint positive."""
    rig = make_rig(3)
    columns = session[0]
    a, b = columns["tension_a_proximal_n"], columns["tension_b_proximal_n"]
    motor = rig.motor_radius * (a - b) + rig.motor_torque_offset
    assert np.mean(columns["motor_torque_nm"] - motor) == pytest.approx(0, abs=0.005)
    a, b = columns["tension_a_distal_n"], columns["tension_b_distal_n"]
    joint = rig.joint_radius * (a - b) + rig.joint_torque_offset
    assert np.mean(columns["joint_torque_nm"] - joint) == pytest.approx(0, abs=0.005)


def test_joint_torque_bends_a_spring_at_the_joint(session: Data) -> None:
    """The ladder works against 6 N m/rad: torque put into the joint goes there."""
    columns = session[0]
    slope = np.polyfit(columns["joint_angle_rad"], columns["joint_torque_nm"], 1)[0]
    assert slope == pytest.approx(6.0, rel=0.03)


def test_more_power_goes_in_than_comes_out(session: Data) -> None:
    for columns in session:
        put = np.gradient(columns["motor_angle_rad"]) * columns["motor_torque_nm"]
        got = np.gradient(columns["joint_angle_rad"]) * columns["joint_torque_nm"]
        assert put.sum() - got.sum() > 5.0


def test_repeated_trial_shows_the_noise_floor(session: Data) -> None:
    again = next(k for k, t in enumerate(make_trials("rich", 3)) if t.repeat_of)
    first = make_trials("rich", 3)[again].repeat_of
    assert first is not None
    for name in ("motor_torque", "joint_torque", "joint_angle"):
        channel = CHANNELS[name]
        # After the first second, when how the trial was approached is forgotten.
        twice = session[again][channel.column] - session[first][channel.column]
        assert np.std(twice[500:]) == pytest.approx(1.414 * channel.floor, rel=0.05)


@pytest.mark.parametrize("name", list(SETS))
def test_sets_stay_within_the_bench(name: str) -> None:
    for trial in make_trials(name, seed=5):
        assert trial.command.shape == trial.target.shape == (8601, 2)
        assert np.abs(trial.command[:, 0]).max() < 2.2
        assert np.abs(trial.command[:, 1]).max() < 6.0


def test_late_clock_shows_earlier_labels(rig: Rig, lively: Trial) -> None:
    truth = truth_of(rig, {}, 3)
    records = run(truth, rig, lively)
    usual = sampled(records, rig, Chain(), BASIC)
    late = sampled(records, rig, Chain(delay=0.01), BASIC)
    shifted = np.interp(np.arange(500, 700) - 5, np.arange(750), usual[:, 2])
    assert np.abs(late[500:700, 2] - shifted).max() < 2e-3
    assert np.array_equal(late[:, :2], usual[:, :2])


def test_rigs_are_near_nominal_and_each_its_own() -> None:
    rigs = [make_rig(seed) for seed in range(40)]
    stiffness = np.array([r.axial_stiffness for r in rigs])
    friction = np.array([r.friction_a for r in rigs])
    for values, nominal in ((stiffness, NOMINAL.axial_stiffness), (friction, 0.12)):
        ratio = values / nominal
        assert np.abs(ratio - 1).max() < 0.2
        assert np.std(ratio) > 0.02
    assert make_rig(7) == make_rig(7)
    assert make_rig(0, spread=0).pretension == NOMINAL.pretension
