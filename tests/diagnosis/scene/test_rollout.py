"""Rollouts of MuJoCo along a motion agree with the replay and the formulas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import repair_scene, rollout, write
from cc_mujoco.errors import CableError
from diagnosis.rigs import BENCH, DT, EFFECTS, JOINT, MOTOR, TIME, alone, late

PLAIN = BENCH.transmission.replay(DT, motor_angle=MOTOR, joint_angle=JOINT)
LARGEST = np.abs(PLAIN.motor_torque).max()


def error(found: np.ndarray, wanted: np.ndarray) -> float:
    """Return the largest difference over the largest torque."""
    return float(np.abs(found - wanted).max() / LARGEST)


def test_without_effects_it_is_the_replay() -> None:
    motor, joint = rollout(BENCH.path, TIME, MOTOR, JOINT)
    assert LARGEST > 3.0
    assert error(motor, PLAIN.motor_torque) < 1e-12
    assert error(joint, PLAIN.joint_torque) < 1e-12


@settings(max_examples=10)
@given(
    sizes=st.tuples(*[st.floats(-0.5, 0.5) for _ in range(4)]),
    rate=st.floats(0.5, 20.0),
    start=st.floats(-3.0, 3.0),
)
def test_any_motion_starts_at_rest_and_follows_the_replay(
    sizes: tuple[float, ...], rate: float, start: float
) -> None:
    a, b, c, d = sizes
    time = DT * np.arange(100)
    motor = start + a * np.sin(rate * time) + b * np.sin(3 * rate * time)
    joint = -start + c * np.sin(rate * time + 1.0) + d * np.sin(2 * rate * time)
    played = BENCH.transmission.replay(DT, motor_angle=motor, joint_angle=joint)
    found = rollout(BENCH.path, time, motor, joint)
    assert found[0] == pytest.approx(played.motor_torque, abs=1e-9)
    assert found[1] == pytest.approx(played.joint_torque, abs=1e-9)


def test_a_scene_without_instruments_gets_them() -> None:
    bench = Bench.of(scene_path("wrist"))
    motor, joint = rollout(bench.path, TIME, 0.2 * MOTOR, 0.2 * JOINT)
    played = bench.transmission.replay(
        DT, motor_angle=0.2 * MOTOR, joint_angle=0.2 * JOINT
    )
    assert motor == pytest.approx(played.motor_torque, abs=1e-9)
    assert joint == pytest.approx(played.joint_torque, abs=1e-9)


def test_a_single_cable_is_a_bench_too(tmp_path: Path) -> None:
    path = alone(tmp_path)
    played = Bench.of(path).transmission.replay(
        DT, motor_angle=MOTOR, joint_angle=JOINT
    )
    found = rollout(path, TIME, MOTOR, JOINT)
    assert error(found[0], played.motor_torque) < 1e-12
    assert error(found[1], played.joint_torque) < 1e-12


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_adds_what_its_formula_says(tmp_path: Path, effect: str) -> None:
    values, formula = EFFECTS[effect]
    wanted = formula(PLAIN.motor_torque, PLAIN.joint_torque)
    plain = (PLAIN.motor_torque, PLAIN.joint_torque)
    assert max(error(a, b) for a, b in zip(wanted, plain, strict=True)) > 5e-4
    spec = repair_scene(BENCH, BENCH.cables, {effect: values})
    found = rollout(spec, TIME, MOTOR, JOINT)
    assert max(error(a, b) for a, b in zip(found, wanted, strict=True)) < 1e-9
    # The file has six digits.
    write(tmp_path / "scene.xml", spec)
    found = rollout(tmp_path / "scene.xml", TIME, MOTOR, JOINT)
    assert max(error(a, b) for a, b in zip(found, wanted, strict=True)) < 2e-6


@pytest.mark.parametrize("lead_in", [None, 1.0])
def test_a_turned_rig_has_its_weight_elsewhere(lead_in: float | None) -> None:
    spec = repair_scene(
        BENCH, BENCH.cables, {"joint_gravity": EFFECTS["joint_gravity"][0]}
    )
    plain = rollout(spec, TIME, MOTOR, JOINT, lead_in)
    turned = rollout(spec, TIME, MOTOR, JOINT, lead_in, tilt=0.7)
    there = 0.3 * np.cos(JOINT + 0.7) - 0.5 * np.sin(JOINT + 0.7)
    here = 0.3 * np.cos(JOINT) - 0.5 * np.sin(JOINT)
    assert error(turned[1] - plain[1], there - here) < 1e-9
    assert error(turned[0], plain[0]) < 1e-12


def test_effects_add_up_with_sensors_last() -> None:
    names = ["sensor_delay", "torque_sensor_gain", "joint_gravity", "motor_cogging"]
    effects = {name: EFFECTS[name][0] for name in names}
    motor, joint = rollout(
        repair_scene(BENCH, BENCH.cables, effects), TIME, MOTOR, JOINT
    )
    wanted = PLAIN.motor_torque, PLAIN.joint_torque
    for name in reversed(names):
        wanted = EFFECTS[name][1](*wanted)
    assert error(motor, wanted[0]) < 1e-9
    assert error(joint, wanted[1]) < 1e-9


def test_a_torque_that_comes_early_delays_everything_else() -> None:
    values = {
        "joint_delay": 0.0,
        "motor_torque_delay": -0.004,
        "joint_torque_delay": 0.002,
    }
    spec = repair_scene(BENCH, BENCH.cables, {"sensor_delay": values})
    assert spec.sensor("motor_angle_rad").delay == pytest.approx(0.004)
    motor, joint = rollout(spec, TIME, MOTOR, JOINT)
    assert error(motor[:-2], late(PLAIN.motor_torque, -0.004)[:-2]) < 1e-9
    assert error(joint, late(PLAIN.joint_torque, 0.002)) < 1e-9


def test_a_delay_shorter_than_a_sample_counts() -> None:
    slow = TIME[:200]
    motor, joint = 0.02 * np.sin(3.0 * slow), 0.0 * slow
    values = {
        "joint_delay": 0.0,
        "motor_torque_delay": 0.0005,
        "joint_torque_delay": 0.0,
    }
    spec = repair_scene(BENCH, BENCH.cables, {"sensor_delay": values})
    played = BENCH.transmission.replay(DT, motor_angle=motor, joint_angle=joint)
    wanted = np.interp(slow - 0.0005, slow, played.motor_torque)
    found = rollout(spec, slow, motor, joint)[0]
    whole = np.abs(wanted - played.motor_torque)[2:].max()
    assert np.abs(found - wanted)[2:].max() < 0.1 * whole


def test_a_delay_that_no_step_resolves_is_none() -> None:
    values = {
        "joint_delay": 0.0,
        "motor_torque_delay": 2e-5,
        "joint_torque_delay": -1e-5,
    }
    spec = repair_scene(BENCH, BENCH.cables, {"sensor_delay": values})
    assert not any(sensor.delay for sensor in spec.sensors)
    found = rollout(spec, TIME, MOTOR, JOINT)
    assert error(found[0], PLAIN.motor_torque) < 1e-12


FRICTIONLESS = tuple(cable.replace(friction=0.0) for cable in BENCH.cables)
SPRING = 2.0 * 50e3 / 2.0 * 0.05**2
"""Stiffness of both cables without friction about the pulleys [N m/rad]."""


@pytest.mark.parametrize("play", [0.01, 0.05])
def test_backlash_of_a_frictionless_bench_is_a_dead_zone(play: float) -> None:
    time = TIME[:350]
    joint = 0.02 * np.sin(6.3 * time)
    motor = 0.03 * np.sin(9.4 * time) + 0.002 * np.sin(40.0 * time)
    spec = repair_scene(BENCH, FRICTIONLESS, {"backlash": {"backlash": play}})
    found = rollout(spec, time, motor, joint)
    beyond = motor - joint
    beyond = beyond - np.clip(beyond, -play / 2.0, play / 2.0)
    wanted = SPRING * beyond
    inside = wanted == 0.0
    assert 0.05 < inside.mean() < 0.95
    for torque in found:
        assert np.std(torque - wanted) < 0.01
        assert np.abs(torque[inside]).max() < 0.06


def test_lost_motion_of_a_bench_with_friction_is_the_play() -> None:
    # The motor holds still; the joint is taken to and fro, at the same speed.
    play, reach, rate = 0.04, 0.06, 0.3
    legs = np.array([0.0, reach, -reach, reach])
    joint = np.interp(
        np.arange(0.0, 5.0 * reach / rate, DT),
        np.concatenate([[0.0], np.cumsum(np.abs(np.diff(legs)))]) / rate,
        legs,
    )
    time = DT * np.arange(joint.size)
    plain = rollout(BENCH.path, time, np.zeros(joint.size), joint)[1]
    spec = repair_scene(BENCH, BENCH.cables, {"backlash": {"backlash": play}})
    found = rollout(spec, time, np.zeros(joint.size), joint)[1]
    assert np.mean(np.abs(plain) < 0.05) < 0.1
    free = np.abs(found) < 0.05
    back = (time > reach / rate) & (time < 3.0 * reach / rate)
    # Moving one way, torque vanishes over the whole play.
    assert rate * DT * np.count_nonzero(free & back) == pytest.approx(play, rel=0.05)


def test_the_time_that_drifts_is_the_one_given() -> None:
    values = {
        "motor_torque_bias": 0.0,
        "joint_torque_bias": 0.0,
        "motor_torque_drift": 0.1,
        "joint_torque_drift": 0.0,
    }
    spec = repair_scene(BENCH, BENCH.cables, {"torque_sensor_offset": values})
    early = rollout(spec, TIME, MOTOR, JOINT)[0]
    later = rollout(spec, TIME + 20.0, MOTOR, JOINT)[0]
    assert later - early == pytest.approx(np.full(TIME.size, 2.0))


@pytest.mark.parametrize(
    ("time", "motor", "joint", "message"),
    [
        (TIME, MOTOR[1:], JOINT, "shapes"),
        (TIME[:2], MOTOR[:2], JOINT[:2], "3 or more"),
        (TIME**1.01, MOTOR, JOINT, "evenly spaced"),
        (-TIME, MOTOR, JOINT, "evenly spaced"),
        (TIME, np.where(TIME > 0.1, np.nan, MOTOR), JOINT, "finite"),
    ],
)
def test_a_motion_that_cannot_be_played_is_refused(
    time: np.ndarray, motor: np.ndarray, joint: np.ndarray, message: str
) -> None:
    with pytest.raises(CableError, match=message):
        rollout(BENCH.path, time, motor, joint)


def test_a_scene_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="is no file"):
        rollout(tmp_path / "none.xml", TIME, MOTOR, JOINT)
    (tmp_path / "bad.xml").write_text("<mujoco>", encoding="utf-8")
    with pytest.raises(CableError, match="does not load"):
        rollout(tmp_path / "bad.xml", TIME, MOTOR, JOINT)


def test_the_radii_of_the_bench_become_the_gears() -> None:
    wide = replace(BENCH, motor_radius=0.04, joint_radius=0.06)
    played = wide.transmission.replay(DT, motor_angle=MOTOR, joint_angle=JOINT)
    found = rollout(repair_scene(wide, wide.cables, {}), TIME, MOTOR, JOINT)
    assert error(found[0], played.motor_torque) < 1e-9
    assert error(found[1], played.joint_torque) < 1e-9
