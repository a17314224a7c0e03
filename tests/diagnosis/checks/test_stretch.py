"""A cable that pulls is longer: angles that deny it are those of the other side."""

from __future__ import annotations

from dataclasses import replace

from cc_mujoco.datasets import Bench, Trial
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis._checks.lead_check import check_lead
from diagnosis.instrumented import ANKLE, SPRING, loaded, walked
from diagnosis.recorded import BENCH, dataset


def sprung() -> list[Trial]:
    """Trials in which the joint turns a spring, with a sensor of its torque."""
    return [
        replace(trial, joint_torque=SPRING * trial.joint_angle)
        for trial in loaded({}).trials
    ]


def swapped(trial: Trial) -> Trial:
    return replace(trial, motor_angle=trial.joint_angle, joint_angle=trial.motor_angle)


def test_angles_of_the_other_side_are_told_though_pulleys_are_alike() -> None:
    assert BENCH.motor_radius == BENCH.joint_radius
    trials = sprung()
    assert not check_lead(trials, BENCH)
    (wrong,) = errors(check_lead([swapped(trial) for trial in trials], BENCH))
    assert "motor_angle_rad and joint_angle_rad are swapped" in wrong.statement


def test_a_single_trial_is_a_warning_and_a_mixture_says_nothing() -> None:
    trials = sprung()
    (told,) = check_lead([swapped(trials[0])], BENCH)
    assert told.severity == "warning"
    assert told.trial == trials[0].name
    assert not check_lead([swapped(trials[0]), *trials[1:]], BENCH)


def test_a_lever_s_own_shape_is_no_lead() -> None:
    assert not check_lead(walked({}, 1.5).trials, ANKLE)


def test_play_and_a_wrong_ratio_are_no_swap() -> None:
    off = replace(BENCH, motor_radius=1.02 * BENCH.motor_radius)
    data = dataset({"backlash": {"backlash": 0.02}}, 1.6, 3)
    for bench in (BENCH, off):
        assert isinstance(bench, Bench)
        assert not errors(check_lead(data.trials, bench))
