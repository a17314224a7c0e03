"""Position control: inverses of hysteresis, their fits, and the device they are for."""

from __future__ import annotations

import dataclasses
import itertools
import math
import tomllib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import brentq

from cc_mujoco.cable import Cable, Section
from cc_mujoco.cli import main
from cc_mujoco.control import (
    CONTROLLERS,
    FITTED,
    POSITION_CONTROLLERS,
    HysteresisTrial,
    controller,
    fit_hysteresis,
)
from cc_mujoco.control._hysteresis import (
    BoucWen,
    HysteresisModel,
    PrandtlIshlinskii,
    SmoothBacklash,
    inverse_plays,
)
from cc_mujoco.control._position import CableParameters, course_of, fit_cable
from cc_mujoco.device import Device, Drive, find_device
from cc_mujoco.device._device_files import write_hysteresis
from cc_mujoco.device._drive import CableDrive
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import calibration_trials, simulate

Array = NDArray[np.float64]

TURNS = st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=6)
SIZES = st.floats(0.01, 0.3)

CABLE = Cable(
    friction=0.1,
    conduit=(Section(2.0, 1.0 / math.pi),),
    axial_stiffness=9e3,
    pretension=6.0,
    segments=12,
)
DRIVE = Drive(
    0.8,
    -0.4,
    0.4,
    1e-3,
    cables=(CableDrive(CABLE, -0.005, -0.004),),
    inertia=3e-5,
    joint_sensor=False,
    commands_angle=True,
)
EXACT = CableParameters(1.3, 0.9, 0.03)


def course(turns: list[float], steps: int = 12) -> Array:
    """Return a course from 0 through the turning points, in small steps."""
    points = itertools.pairwise([0.0, *turns])
    parts = [np.linspace(a, b, steps)[1:] for a, b in points]
    return np.concatenate([[0.0], *parts])


def loops() -> Array:
    """Return a course of the joint in loops that shrink [rad]."""
    share = np.linspace(0.0, 1.0, 600)
    return np.asarray(0.5 * (1.0 - 0.8 * share) * np.sin(10.0 * math.pi * share))


def inverse_course(model: HysteresisModel, joint: Array) -> Array:
    """Return the course of the motor for a course of the joint."""
    state = model.rest(1)
    return np.concatenate([model.invert(state, angle) for angle in joint[:, None]])


def joint_of_backlash(model: SmoothBacklash, motor: Array) -> Array:
    """Return the course of the joint for one of the motor, by bisection."""

    def after(joint: float, z: float, moved: float) -> tuple[float, float, float]:
        """Return joint, blend and motor after the joint has moved."""
        way = np.sign(moved)
        joint, z = (
            joint + moved,
            way + (z - way) * np.exp(-abs(moved) / model.transition),
        )
        up = model.slope_up * joint + model.offset_up
        down = model.slope_down * joint + model.offset_down
        return joint, z, 0.5 * ((1.0 + z) * up + (1.0 - z) * down)

    def left(moved: float, joint: float, z: float, wanted: float) -> float:
        return float(after(joint, z, moved)[2]) - wanted

    joint, z, motor_now, found = (
        0.0,
        0.0,
        0.5 * (model.offset_up + model.offset_down),
        [],
    )
    for angle in motor:
        if abs(angle - motor_now) > 1e-12:
            way = 100.0 * np.sign(angle - motor_now)
            moved = brentq(left, 0.0, way, (joint, z, angle), xtol=1e-12)
            joint, z, motor_now = after(joint, z, moved)
        found.append(joint)
    return np.array(found)


def joint_of_plays(model: PrandtlIshlinskii, motor: Array) -> Array:
    """Return the course of the joint for one of the motor, play by play."""
    sums = np.zeros(motor.size)
    for half_width, weight in zip(model.thresholds, model.weights, strict=True):
        play = 0.0
        for place, angle in enumerate(motor):
            play = min(max(play, angle - half_width), angle + half_width)
            sums[place] += weight * play
    slope = np.diff(model.knots) / np.diff(model.values)
    inside = np.interp(sums, model.values, model.knots)
    below = np.minimum(sums - model.values[0], 0.0) * slope[0]
    return np.asarray(
        inside + below + np.maximum(sums - model.values[-1], 0) * slope[-1]
    )


def joint_of_bouc_wen(model: BoucWen, motor: Array) -> Array:
    """Return the course of the joint for one of the motor, by the midpoint rule."""
    z, before, found, steps = 0.0, 0.0, [], 100

    def slope(z: float, turn: float) -> float:
        return 1.0 - abs(z) * (model.beta * np.sign(z * turn) + model.gamma)

    for angle in motor:
        turn = (angle - before) / steps
        for _ in range(steps):
            z += turn * slope(z + 0.5 * turn * slope(z, turn), turn)
        before = angle
        found.append(model.gain * angle - model.hysteresis * z + model.offset)
    return np.array(found)


@given(TURNS, st.floats(0.5, 2.0), st.floats(0.5, 2.0), SIZES, SIZES)
@settings(max_examples=25, deadline=None)
def test_the_smooth_inverse_undoes_its_backlash(
    turns: list[float], up: float, down: float, width: float, transition: float
) -> None:
    model = SmoothBacklash(up, down, width, -width, transition)
    wanted = course(turns)
    motor = inverse_course(model, wanted)
    # Lines that cross would make the motor turn back while the joint goes on.
    if np.all(np.diff(motor) * np.diff(wanted) >= 0.0):
        assert joint_of_backlash(model, motor) == pytest.approx(wanted, abs=1e-6)


@given(TURNS, st.lists(SIZES, min_size=1, max_size=5), SIZES)
@settings(max_examples=25, deadline=None)
def test_the_inverse_of_plays_is_exact(
    turns: list[float], weights: list[float], first: float
) -> None:
    thresholds = 0.1 * np.arange(len(weights) + 1)
    model = PrandtlIshlinskii(
        tuple(thresholds), (first, *weights), (-1.0, 0.0, 1.0), (-0.9, 0.0, 1.2)
    )
    wanted = course(turns)
    motor = inverse_course(model, wanted)
    assert joint_of_plays(model, motor) == pytest.approx(wanted, abs=1e-9)
    there = inverse_plays(thresholds, np.array([first, *weights]))
    back = inverse_plays(*there)
    assert back[0] == pytest.approx(thresholds, abs=1e-9)
    assert back[1] == pytest.approx([first, *weights])


@given(TURNS, st.floats(0.0, 0.8), st.floats(3.0, 20.0), st.floats(-0.5, 0.9))
@settings(max_examples=15, deadline=None)
def test_the_feed_forward_undoes_its_bouc_wen_model(
    turns: list[float], share: float, beta: float, asymmetry: float
) -> None:
    # Of more hysteresis the joint would turn against the motor after a reversal.
    most = 0.8 * 0.5 * (1.0 + asymmetry)
    model = BoucWen(0.8, share * most, 0.0, beta, beta * asymmetry)
    wanted = course(turns, 60)
    reached = joint_of_bouc_wen(model, inverse_course(model, wanted))
    assert np.abs(reached - wanted).max() < 0.01


def test_a_fit_recovers_backlash_and_bouc_wen() -> None:
    joint = loops()
    lines = SmoothBacklash(1.6, 1.3, 0.14, -0.09, 0.01)
    trial = HysteresisTrial(inverse_course(lines, joint), joint)
    found = SmoothBacklash.fit(trial)
    assert found.slope_up == pytest.approx(1.6, abs=0.02)
    assert found.slope_down == pytest.approx(1.3, abs=0.02)
    assert found.offset_up == pytest.approx(0.14, abs=0.005)
    assert found.offset_down == pytest.approx(-0.09, abs=0.005)
    model = BoucWen(0.7, 0.5, 0.02, 6.0, 2.0)
    motor = 1.4 * joint
    again = BoucWen.fit(HysteresisTrial(motor, joint_of_bouc_wen(model, motor)))
    assert dataclasses.astuple(again) == pytest.approx(
        dataclasses.astuple(model), rel=1e-3
    )


def test_a_fit_of_plays_explains_plays() -> None:
    motor = 1.4 * loops()
    model = PrandtlIshlinskii(
        (0.0, 0.1, 0.2), (0.4, 0.3, 0.2), (-1.0, 0.0, 1.0), (-0.9, 0.0, 1.1)
    )
    joint = joint_of_plays(model, motor)
    found = PrandtlIshlinskii.fit(HysteresisTrial(motor, joint))
    assert np.abs(joint_of_plays(found, motor) - joint).max() < 0.02 * np.ptp(joint)


def test_a_fit_recovers_friction_and_spring_of_a_cable() -> None:
    joint = loops()[::2]
    trial = HysteresisTrial(course_of(DRIVE.cables, EXACT, joint), joint)
    found = fit_cable(trial, DRIVE)
    assert dataclasses.astuple(found) == pytest.approx(
        dataclasses.astuple(EXACT), rel=0.02
    )


def test_many_environments_get_the_torque_of_each_alone() -> None:
    joint = loops()[::3]
    trial = HysteresisTrial(course_of(DRIVE.cables, EXACT, joint), joint)
    drive = dataclasses.replace(DRIVE, hysteresis=fit_hysteresis(trial, DRIVE))
    for name in (*FITTED, "none"):
        many, alone = controller(name, drive), controller(name, drive)
        for angle in joint[:40:2]:
            seen: dict[str, Any] = {
                "reference_angle_rad": angle,
                "motor_angle_rad": 0.9 * angle,
                "motor_velocity_rad_s": 0.1,
            }
            both = {key: np.array([value, -value]) for key, value in seen.items()}
            assert many.torque(both)[0] == alone.torque(seen)


def test_a_name_that_the_task_does_not_ask_for_is_refused() -> None:
    assert "none" in CONTROLLERS
    with pytest.raises(CableError, match=r"'pi' follows a torque.*take one of none"):
        controller("pi", DRIVE)
    torque = dataclasses.replace(DRIVE, commands_angle=False, joint_sensor=True)
    with pytest.raises(CableError, match="'bouc_wen' follows an angle"):
        controller("bouc_wen", torque)
    with pytest.raises(CableError, match="measures nothing there"):
        controller("pi", dataclasses.replace(torque, joint_sensor=False))
    with pytest.raises(CableError, match="'distal_feedback' reads the angle"):
        controller("distal_feedback", DRIVE)
    with pytest.raises(CableError, match="needs parameters of a trial"):
        controller("linear", DRIVE)
    wrong = dataclasses.replace(DRIVE, hysteresis={"linear": {"slope": 1.0}})
    with pytest.raises(CableError, match="'linear' needs a parameter 'offset'"):
        controller("linear", wrong)
    assert set(POSITION_CONTROLLERS) == {"none", "distal_feedback", *FITTED}


def test_a_trial_that_says_nothing_is_refused() -> None:
    still = np.zeros(100)
    with pytest.raises(CableError, match="the joint does not move"):
        HysteresisTrial.of(np.linspace(0.0, 1.0, 100), still, 0.8)
    with pytest.raises(CableError, match="turns against the motor"):
        HysteresisTrial.of(np.linspace(0.0, 1.0, 100), np.linspace(0, -1, 100), 0.8)
    with pytest.raises(CableError, match="at least 50 samples"):
        HysteresisTrial.of(still[:10], still[:10], 0.8)


def test_parameters_of_a_trial_are_read_beside_the_scene(tmp_path: Path) -> None:
    built_in = find_device("endoscope")
    scene = tmp_path / "scope.xml"
    scene.write_text(built_in.xml())
    assert not Device(scene).description.hysteresis
    file = tmp_path / "scope.hysteresis.toml"
    found = {"linear": {"slope": 1.5, "offset": 0.1}}
    write_hysteresis(file, "bend", found)
    device = find_device(str(scene))
    assert device.description.hysteresis == {"bend": found}
    assert file in device.files
    with pytest.raises(CableError, match="is not overwritten"):
        write_hysteresis(file, "bend", found)
    file.write_text("[knee.linear]\nslope = 1.0\n")
    with pytest.raises(CableError, match="unknown axis in the hysteresis"):
        Device(scene)
    file.write_text("[bend.linear]\nslope = 'much'\n")
    with pytest.raises(CableError, match="slope must be a finite number"):
        Device(scene)


@pytest.mark.study
def test_the_endoscope_follows_a_course_by_its_inverses_alone() -> None:
    errors = {}
    for name in ("none", "backlash_inverse", "cable_inverse"):
        log = simulate("endoscope", name, duration=1.5)
        error = log["joint_angle_rad"] - log["reference_angle_rad"]
        errors[name] = float(np.sqrt(np.mean(error[500:] ** 2)))
    assert errors["backlash_inverse"] < errors["none"] / 8.0
    assert errors["cable_inverse"] < errors["none"] / 8.0


@pytest.mark.study
def test_a_short_trial_on_the_device_finds_its_friction_and_spring() -> None:
    (trial,) = calibration_trials(["endoscope"], duration=2.5)
    model = find_device("endoscope")
    cable = model.cables["tendon"]
    drive = dataclasses.replace(DRIVE, cables=(CableDrive(cable, -0.005, -0.004),))
    found = fit_cable(trial, drive)
    assert found.friction == pytest.approx(1.0, abs=0.1)
    assert found.joint_stiffness == pytest.approx(0.03, rel=0.1)


def test_a_suite_of_torques_refuses_a_device_that_follows_an_angle() -> None:
    from cc_mujoco.benchmark._suites import SUITES

    assert "endoscope" not in SUITES["generic"].scenes
    with pytest.raises(CableError, match="an angle; `--suite position` plays it"):
        SUITES["generic"].conditions("endoscope")


def test_an_impedance_is_about_the_motion_and_an_angle_is_observed() -> None:
    log = simulate("wrist", "pi", task="impedance:2,damping=0.1", duration=0.2)
    away = log["joint_angle_rad"] - log["reference_angle_rad"]
    desired = -2.0 * away - 0.1 * log["joint_velocity_rad_s"]
    assert np.array_equal(desired, log["desired_torque_nm"])
    env: Any = gymnasium.make("cc_mujoco/Device-v1", device="endoscope", duration=0.1)
    env.reset(seed=0)
    assert env.unwrapped.exo.observed[0].columns[-1] == "reference_angle_rad"
    *_, info = env.step(np.ones(1, dtype=np.float32))
    error = abs(info["joint_angle_rad"] - info["reference_angle_rad"])
    assert info["reward_tracking"] == pytest.approx(-1e-3 * error / 0.05)


def test_a_measured_trial_is_fitted_on_the_command_line(tmp_path: Path) -> None:
    joint = loops()
    motor = 0.8 * (1.5 * joint + 0.1 * np.sign(np.gradient(joint)))
    rows = np.stack([motor, joint], axis=1)
    file, out = tmp_path / "trial.csv", tmp_path / "found.hysteresis.toml"
    np.savetxt(
        file, rows, delimiter=",", header="motor_angle_rad,joint_angle_rad", comments=""
    )
    words = ["calibrate", "endoscope", "--trial", str(file), "--out", str(out)]
    assert main([*words, "--controllers", "linear"]) == 0
    assert 1.3 < tomllib.loads(out.read_text())["bend"]["linear"]["slope"] < 1.7
    assert main(words) == 2


@pytest.mark.parametrize(
    ("header", "change", "says"),
    [
        (
            "joint_angle_rad,motor_angle_rad",
            lambda rows: rows,
            "the joint leads",
        ),
        ("motor_angle_rad,angle_rad", lambda rows: rows, "no column 'joint_angle_rad'"),
        (
            "motor_angle_rad,joint_angle_rad",
            lambda rows: np.where(rows == rows[70, 1], np.nan, rows),
            "row 71 of the data is missing",
        ),
        (
            "motor_angle_rad,joint_angle_rad,time_s",
            lambda rows: np.column_stack([rows, np.arange(len(rows)) % 90]),
            "column time_s, row 91 of the data: 0 must be above the 89",
        ),
    ],
)
def test_a_trial_that_is_none_is_refused(
    header: str, change: Any, says: str, tmp_path: Path, capsys: Any
) -> None:
    joint = loops()
    motor = 0.8 * (1.5 * joint + 0.1 * np.sign(np.gradient(joint)))
    file, rows = tmp_path / "trial.csv", change(np.stack([motor, joint], axis=1))
    np.savetxt(file, rows, delimiter=",", header=header, comments="")
    out = tmp_path / "found.hysteresis.toml"
    assert (
        main(["calibrate", "endoscope", "--trial", str(file), "--out", str(out)]) == 2
    )
    assert says in capsys.readouterr().err
    assert not out.exists()
