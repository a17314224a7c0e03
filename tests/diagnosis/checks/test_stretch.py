"""A cable that pulls is longer: what denies it is swapped, what follows it is late."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.datasets import Bench, Trial
from cc_mujoco.datasets._data_findings import errors
from cc_mujoco.diagnosis import load
from cc_mujoco.diagnosis._checks.mechanics import check_lead
from diagnosis.instrumented import ANKLE, SPRING, loaded, walked
from diagnosis.recorded import BENCH, dataset

CHANNELS = ("motor_angle_rad", "joint_angle_rad", "motor_torque_nm", "joint_torque_nm")


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


def late(trial: Trial, channel: str, by: float) -> Trial:
    """Return a trial in which a channel comes later by `by` seconds."""
    moved = np.interp(trial.time - by, trial.time, trial.channel(channel))
    return replace(trial, **{channel.rsplit("_", 1)[0]: moved})


def delay_in(statement: str) -> float:
    """Return the delay that a sentence advises to declare [s]."""
    return float(statement.partition("delay = ")[2].partition(")")[0])


def test_a_single_trial_is_a_warning_and_of_a_mixture_the_swapped_are_named() -> None:
    trials = sprung()
    (told,) = check_lead([swapped(trials[0])], BENCH)
    assert told.severity == "warning"
    assert told.trial == trials[0].name
    (wrong,) = errors(check_lead([swapped(trials[0]), *trials[1:]], BENCH))
    assert wrong.trial == trials[0].name
    assert "but not in the other trials" in wrong.statement


@pytest.mark.parametrize("by", [-1.9, -0.3, 0.3, 1.2])
@pytest.mark.parametrize("channel", CHANNELS[1:])
def test_a_channel_beyond_the_delay_of_any_sensor_is_late(
    channel: str, by: float
) -> None:
    trials = dataset(duration=10.0).trials
    assert not check_lead(trials, BENCH)
    (wrong,) = errors(check_lead([late(t, channel, by) for t in trials], BENCH))
    assert wrong.channel == channel
    assert delay_in(wrong.statement) == pytest.approx(by, abs=0.06)


def test_a_single_late_trial_is_named() -> None:
    first, *rest = dataset(duration=10.0).trials
    (wrong,) = errors(check_lead([late(first, CHANNELS[3], 0.6), *rest], BENCH))
    assert first.path in wrong.statement and "later" in wrong.statement
    assert delay_in(wrong.statement) == pytest.approx(0.6, abs=0.06)


def hung(trial: Trial, speed: float, play: float) -> Trial:
    """Return a trial of friction at the motor, and of play that a weight takes up."""
    noise = np.random.default_rng(0).normal(0.0, 1.0, (4, trial.time.size))
    motor = 0.6 * np.sin(speed * trial.time)
    load = 0.3 * np.sin(motor)
    rub = 1.3 * np.tanh(np.gradient(motor, trial.time) / 0.05)
    return replace(
        trial,
        motor_angle=motor + 2e-5 * noise[0],
        joint_angle=motor - 0.5 * play * np.tanh(load / 0.02) + 2e-5 * noise[1],
        motor_torque=load + rub + 2e-3 * noise[2],
        joint_torque=load + 2e-3 * noise[3],
    )


@pytest.mark.parametrize("speeds", [(1.0, 4.0, 2.6), (2.0, 3.0)])
@pytest.mark.parametrize("play", [0.02, 0.07])
def test_play_and_friction_are_no_delay(speeds: tuple[float, ...], play: float) -> None:
    """They shift a torque by a quarter of a period, another time in every motion."""
    known = dataset(duration=16.0).trials
    trials = [hung(t, w, play) for t, w in zip(known, speeds, strict=False)]
    assert not check_lead(trials, BENCH)


@pytest.mark.study
@pytest.mark.parametrize("make", ["bristles", "guides", "elements"])
@pytest.mark.parametrize("trials", ["rich", "human", "restful", "ramps"])
def test_of_a_rig_only_the_late_channel_is_late(
    make: str, trials: str, tmp_path: Path
) -> None:
    from rig.generate import generate

    generate(tmp_path / "rig", [], 0.0, trials, 41, make)
    bench = BENCH.known({})
    known = load([tmp_path / "rig" / "data"], None, bench)[0].trials
    assert not errors(check_lead(known, bench))
    random = np.random.default_rng(5)
    for channel in CHANNELS:
        by = float(random.choice([-1.0, 1.0]) * random.uniform(0.2, 1.9))
        (wrong,) = errors(check_lead([late(t, channel, by) for t in known], bench))
        lag = delay_in(wrong.statement)
        if channel == CHANNELS[0]:  # either of the angles may be
            channel, lag = CHANNELS[1], -lag
        assert wrong.channel == channel
        assert lag == pytest.approx(by, abs=0.06)


def test_a_lever_s_own_shape_is_no_lead() -> None:
    assert not check_lead(walked({}, 1.5).trials, ANKLE)


def test_play_and_a_wrong_ratio_are_no_swap() -> None:
    off = replace(BENCH, motor_radius=1.02 * BENCH.motor_radius)
    data = dataset({"backlash": {"backlash": 0.02}}, 1.6, 3)
    for bench in (BENCH, off):
        assert isinstance(bench, Bench)
        assert not errors(check_lead(data.trials, bench))
