"""Metrics on signals whose answer is known."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.cable import Cable, Section, replay
from cc_mujoco.metrics import METRICS, ArrayLog, Metric, expand_cable_metrics, measure
from cc_mujoco.metrics._formulas import (
    efficiency,
    loop_opening,
    loop_width,
    signal_lag,
    twist_backlash,
)
from cc_mujoco.viz._episode_files import EPISODE_METRICS, write_metrics

TIME = np.linspace(0.0, 6.0, 6001)


def capstan(make_log: Any, loss: float, joint_power: Any) -> Any:
    """Log of steady transmission that loses a factor, whichever side drives.

    The task asks for what arrives.
    """
    joint_power = np.broadcast_to(joint_power, TIME.shape)
    motor_power = np.where(joint_power > 0, joint_power / loss, joint_power * loss)
    lost = motor_power - joint_power
    steps = 0.5 * np.diff(TIME) * (lost[1:] + lost[:-1])
    one = np.ones_like(TIME)
    return make_log(
        cables=("one",),
        rows=len(TIME),
        time_s=TIME,
        motor_velocity_rad_s=one,
        joint_velocity_rad_s=one,
        motor_torque_nm=motor_power,
        joint_torque_nm=joint_power,
        desired_torque_nm=joint_power,
        dissipated_one_j=np.concatenate([[0.0], np.cumsum(steps)]),
    )


def replaced(log: Any, make_log: Any, **columns: Any) -> Any:
    return make_log(cables=("one",), **{**log.columns, **columns})


def pulled(cable: Cable, reach: float, motor: bool) -> ArrayLog:
    """Log of one cable that one end pulls slowly after the other, on pulleys of 1 m.

    The first half, in which the tension finds its slope, is left out.
    """
    way = np.linspace(0.0, reach if motor else -reach, len(TIME))
    played = replay(cable, TIME[1], u_proximal=-way, u_distal=-way)
    speed = np.gradient(way, TIME)
    half = slice(len(TIME) // 2, None)
    columns = {
        "time_s": TIME,
        "motor_velocity_rad_s": speed,
        "joint_velocity_rad_s": speed,
        "motor_torque_nm": played.tension_proximal,
        "joint_torque_nm": played.tension_distal,
        "desired_torque_nm": np.ones_like(TIME),
        "dissipated_one_j": played.dissipated,
    }
    half = len(TIME) // 2
    columns = {name: values[half:] for name, values in columns.items()}
    return ArrayLog(columns, ("one",))


@settings(max_examples=15, deadline=None)
@given(
    friction=st.floats(0.01, 0.3),
    more=st.floats(1.05, 3.0),
    wrap=st.floats(0.5, 4.0),
    motor=st.booleans(),
)
def test_efficiency_of_a_slow_pull_is_the_capstan_ratio_and_falls_with_friction(
    friction: float, more: float, wrap: float, motor: bool
) -> None:
    found = []
    for mu in (friction, friction * more):
        cable = Cable(friction=mu, pretension=50.0, conduit=(Section(1.0, 1.0 / wrap),))
        driven = efficiency(pulled(cable, 0.5, motor))
        way = driven.motor_drives if motor else driven.wearer_drives
        other = driven.wearer_drives if motor else driven.motor_drives
        assert way == pytest.approx(math.exp(-mu * wrap), rel=1e-4)
        assert driven.overall == way
        assert math.isnan(other)
        found.append(way)
    assert found[1] < found[0]


def test_efficiency_of_steady_motion_is_the_ratio_of_powers(make_log: Any) -> None:
    ratio = math.exp(-0.9)
    forward = efficiency(capstan(make_log, ratio, 2.0))
    assert forward.motor_drives == pytest.approx(ratio, rel=1e-9)
    assert math.isnan(forward.wearer_drives)
    assert forward.motor_share == 1.0
    backward = efficiency(capstan(make_log, ratio, -2.0))
    assert backward.wearer_drives == pytest.approx(ratio, rel=1e-9)
    assert math.isnan(backward.motor_drives)
    assert backward.motor_share == 0.0


def test_friction_of_a_cable_that_another_motor_winds_does_not_count(
    make_log: Any,
) -> None:
    log = capstan(make_log, 0.5, 2.0)
    columns = log.columns | {"dissipated_other_j": 9.0 * TIME}
    for metadata, counts in (({}, True), ({"driven": ["one"]}, False)):
        found = efficiency(ArrayLog(columns, ("one", "other"), metadata)).overall
        assert found < 0.2 if counts else found == pytest.approx(0.5, rel=1e-9)


def test_efficiency_of_both_directions_in_turn(make_log: Any) -> None:
    both = efficiency(capstan(make_log, 0.6, np.sin(2 * np.pi * TIME)))
    assert both.motor_drives == pytest.approx(0.6, rel=1e-3)
    assert both.wearer_drives == pytest.approx(0.6, rel=1e-3)
    assert both.overall == pytest.approx(0.6, rel=1e-3)
    assert both.motor_share == pytest.approx(1 / (1 + 0.6), rel=1e-3)


def test_storage_does_not_make_energy(make_log: Any) -> None:
    # The wearer loads a lossless spring against a locked motor, and gets it all back.
    log = capstan(make_log, 1.0, -np.sin(2 * np.pi * TIME))
    log = replaced(log, make_log, motor_torque_nm=0.0 * TIME)
    assert efficiency(log).motor_drives == pytest.approx(1.0)
    rest = replaced(log, make_log, joint_torque_nm=0.0 * TIME)
    assert math.isnan(efficiency(rest).motor_drives)
    assert math.isnan(efficiency(rest).motor_share)


def test_nothing_is_delivered_where_the_task_asks_for_nothing(make_log: Any) -> None:
    for power in (2.0, -2.0, np.sin(2 * np.pi * TIME)):
        log = capstan(make_log, 0.5, power)
        driven = efficiency(replaced(log, make_log, desired_torque_nm=0.0 * TIME))
        assert math.isnan(driven.overall)
        assert math.isnan(driven.motor_drives)
        assert math.isnan(driven.wearer_drives)


def test_work_at_the_side_that_is_not_meant_to_receive_it_does_not_count(
    make_log: Any,
) -> None:
    # The wearer drives the motor backwards while the task means to help the motion.
    log = capstan(make_log, 0.5, -2.0)
    driven = efficiency(replaced(log, make_log, desired_torque_nm=np.ones_like(TIME)))
    assert math.isnan(driven.overall)


def test_a_motor_that_must_help_receives_nothing(make_log: Any) -> None:
    helped = replaced(
        capstan(make_log, 0.5, -2.0),
        make_log,
        motor_torque_nm=np.full_like(TIME, 0.5),
        dissipated_one_j=2.5 * TIME,
    )
    assert math.isnan(efficiency(helped).wearer_drives)
    assert math.isnan(efficiency(helped).overall)


def test_the_loss_of_winding_up_is_the_motor_s(make_log: Any) -> None:
    # For half of the time the motor works against friction before anything is asked.
    log, before = capstan(make_log, 0.5, 2.0), TIME < 3.0
    late = replaced(
        log,
        make_log,
        joint_torque_nm=np.where(before, 0.0, 2.0),
        desired_torque_nm=np.where(before, 0.0, 2.0),
    )
    assert efficiency(late).motor_drives == pytest.approx(1.0 / 3.0, rel=1e-3)


@pytest.mark.parametrize("width", [0.02, 0.1, 0.4])
def test_loop_width_of_hysteresis(width: float) -> None:
    drive = np.sin(2 * np.pi * 0.5 * TIME)
    centre = np.empty_like(drive)
    state = 0.0
    for k, angle in enumerate(drive):
        state = min(max(state, angle - width / 2), angle + width / 2)
        centre[k] = state
    # The play operator: torque follows the angle at half a width behind it.
    assert loop_width(drive, 3.0 * centre) == pytest.approx(width, abs=2e-3)


@pytest.mark.parametrize("width", [0.02, 0.1, 0.4])
def test_loop_width_of_a_dead_zone(width: float) -> None:
    angle = np.sin(2 * np.pi * 0.5 * TIME)
    torque = 2.0 * (angle - np.clip(angle, -width / 2, width / 2))
    assert loop_width(angle, torque) == pytest.approx(width, abs=5e-3)
    # A cable that only pulls: slack on one side of the loop.
    pulling = np.minimum(torque, 0.0)
    reach = 1.0 + width / 2
    assert loop_width(angle, pulling) == pytest.approx(reach, abs=5e-3)


def test_loop_width_ignores_chatter_and_needs_a_loop() -> None:
    angle = np.sin(2 * np.pi * 0.5 * TIME)
    noisy = angle + 1e-3 * np.random.default_rng(1).normal(size=len(angle))
    assert loop_width(angle, noisy) < 0.01
    assert math.isnan(loop_width(TIME, TIME - 3.0))
    assert math.isnan(loop_width(angle, 0.0 * angle))
    assert math.isnan(loop_width(angle, 1.0 + angle**2))


def test_backlash_is_in_the_twist_not_in_the_task(make_log: Any) -> None:
    joint = 0.5 * np.sin(2 * np.pi * 0.5 * TIME)
    torque = np.cos(2 * np.pi * 0.5 * TIME)
    twist = 0.3 * torque + 0.05 * np.sign(np.gradient(torque))
    columns = {
        "time_s": TIME,
        "joint_angle_rad": joint,
        "joint_torque_nm": torque,
        "motor_angle_rad": (twist + joint) / 0.4,
    }
    log = make_log(rows=len(TIME), metadata={"ratio": 0.4}, **columns)
    assert twist_backlash(log) == pytest.approx(0.1, abs=1e-3)
    unknown = make_log(rows=len(TIME), metadata={}, **columns)
    assert math.isnan(twist_backlash(unknown))


@pytest.mark.parametrize("delay", [0.0, 0.0124, 0.25])
def test_lag_of_a_shifted_signal(delay: float) -> None:
    def wave(time: Any) -> Any:
        return np.sin(3.1 * time) + 0.4 * np.sin(7.7 * time + 1.0)

    assert signal_lag(TIME, wave(TIME), 0.3 * wave(TIME - delay)) == pytest.approx(
        delay, abs=2e-4
    )


def test_lag_is_zero_for_a_leader_and_unknown_for_a_stranger() -> None:
    wave = np.sin(9.0 * TIME)
    assert signal_lag(TIME, wave, np.sin(9.0 * (TIME + 0.02))) == 0.0
    assert math.isnan(signal_lag(TIME, np.sin(TIME), -np.sin(TIME)))
    noise = np.random.default_rng(2).normal(size=(2, len(TIME)))
    assert math.isnan(signal_lag(TIME, noise[0], noise[1]))
    assert math.isnan(signal_lag(TIME, 0.0 * TIME, np.sin(TIME)))
    assert math.isnan(signal_lag(TIME[:4], TIME[:4], TIME[:4]))


@settings(max_examples=10)
@given(shift=st.floats(-0.3, 0.3))
def test_lag_has_a_sign_where_it_is_asked_for(shift: float) -> None:
    late = np.sin(3.1 * (TIME - shift)) + 0.4 * np.sin(7.7 * (TIME - shift) + 1.0)
    wave = np.sin(3.1 * TIME) + 0.4 * np.sin(7.7 * TIME + 1.0)
    assert signal_lag(TIME, wave, late, signed=True) == pytest.approx(shift, abs=1e-3)


@settings(max_examples=20)
@given(friction=st.floats(0.01, 0.4), chatter=st.floats(0.0, 0.005))
def test_loop_opens_by_twice_friction_over_stiffness(
    friction: float, chatter: float
) -> None:
    angle = 0.5 * np.sin(2.0 * TIME)
    torque = -angle - friction * np.cos(2.0 * TIME)
    torque += chatter * (-1.0) ** np.arange(TIME.size)
    # Where the spring's -angle meets friction that falls with the speed.
    expected = 2.0 * 0.5 * friction / math.hypot(0.5, friction)
    assert loop_opening(angle, torque) == pytest.approx(expected, abs=0.01)


def test_a_torque_that_never_turns_opens_no_loop() -> None:
    angle = np.sin(TIME)
    assert math.isnan(loop_opening(angle, np.ones_like(TIME)))
    assert math.isnan(loop_opening(TIME, np.sin(TIME)))


def test_simple_numbers(make_log: Any) -> None:
    wave = np.sin(2 * np.pi * 0.5 * TIME)
    log = make_log(
        cables=("one",),
        rows=len(TIME),
        time_s=TIME,
        joint_torque_nm=3.0 * wave,
        desired_torque_nm=3.0 * wave - 0.25,
        joint_angle_rad=wave,
        reference_angle_rad=0.0 * wave,
        dissipated_one_j=0.5 + 0.2 * TIME,
        tension_one_nodes_n=np.where(TIME < 1.5, 0.0, 5.0)[:, None] + [0.0, 1.0],
    )
    metrics = expand_cable_metrics(
        (METRICS[name] for name in EPISODE_METRICS), log.cables
    )
    found = {metric.name: value for metric, value in measure(log, metrics).items()}
    assert found["peak_joint_torque"] == pytest.approx(3.0)
    assert found["rms_joint_torque"] == pytest.approx(3.0 / math.sqrt(2), rel=1e-3)
    assert found["rms_torque_error"] == pytest.approx(0.25)
    assert found["rms_angle_error"] == pytest.approx(math.sqrt(0.5), rel=1e-3)
    assert found["dissipated_energy_one"] == pytest.approx(1.2)
    assert found["slack_time_one"] == pytest.approx(1.5, abs=2e-3)
    assert found["torque_lag"] == pytest.approx(0.0, abs=1e-6)


def test_json_has_null_for_what_is_unknown(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    a, b = (Metric(*words, len) for words in (("a", "s", "x"), ("b", "N", "y")))
    write_metrics(path, {a: math.nan, b: 2.5})
    text = path.read_text()
    assert "NaN" not in text
    assert json.loads(text) == {
        "a": {"value": None, "unit": "s", "meaning": "x"},
        "b": {"value": 2.5, "unit": "N", "meaning": "y"},
    }
