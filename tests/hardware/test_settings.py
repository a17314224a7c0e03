"""`rig.toml`: what it gives, and one sentence for each thing that is wrong in it."""

from __future__ import annotations

import math
import re
from dataclasses import fields, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco import hardware
from cc_mujoco.assets import scene_path
from cc_mujoco.control import controller
from cc_mujoco.device import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    Limits,
    Readings,
    Rig,
    Stiffness,
    TorqueTable,
    Watchdog,
    drive_of,
    read_axes,
    read_settings,
)
from cc_mujoco.human import TRAJECTORIES
from hardware.peers import toml

REST = Readings(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
PLAIN = toml()


class Own:
    """A rig of one's own."""

    def __init__(self, bus: str = "can0") -> None:
        self.bus = bus

    def read(self) -> Readings | None:
        return None

    def write(self, torque: float) -> None:
        pass

    def close(self) -> None:
        pass


class Half:
    """Lacks all that a rig has."""


def test_the_example_has_every_key_and_the_defaults() -> None:
    path = Path(hardware.__file__).with_name("rig.toml")
    (found,) = read_axes(path)
    text = path.read_text(encoding="utf-8")
    for kind in (Limits, Watchdog, Stiffness):
        for key in fields(kind):
            assert re.search(rf"^(# )?{key.name} = ", text, re.MULTILINE), key.name
    assert found.watchdog == Watchdog()
    for key in fields(Limits):
        if key.name in ("soft_start", "stop_time"):
            assert getattr(found.limits, key.name) == key.default


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_gives_its_limits_and_the_rest_its_defaults(tmp_path: Path) -> None:
    settings = read_settings(written(tmp_path, PLAIN))
    assert (settings.scene, settings.period) == ("bench", 0.002)
    assert settings.limits.torque_rate == 20.0
    assert settings.limits.joint_range == (-1.0, 1.0)
    assert settings.watchdog.missed_readings == 99999
    assert settings.watchdog.frozen_readings == 20
    assert settings.desired(1.0).torque(0.3, REST) == 0.5


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("", "x = ", "is not a TOML file"),
        ('scene = "bench"', "", "needs `scene`"),
        ("period = 0.002", "", "needs `period`"),
        ("period = 0.002", "period = 0.01", "period must be 0.0005 to 0.002 s"),
        ("period = 0.002", "period = nan", "period must be a finite number"),
        ("period", "perod", "did you mean 'period'"),
        ("period = 0.002", "period = 0.002\nmotor_lag = 3", "motor_lag must be 0 to"),
        ("period = 0.002", "period = 0.002\nmotor_lag = -1e-3", "3 ms are 0.003"),
        ("torque = 1.0", "", r"\[limits\] needs `torque`"),
        ("torque = 1.0", "torque = -1", r"\[limits\]: Limits.torque must be"),
        ("torque = 1.0", "torque = '1'", r"\[limits\], torque must be a finite"),
        ("torque_rate = 20.0", "torque_rate = 2", "at least 0.5 s"),
        ("[-1.0, 1.0]", "[1.0, -1.0]", "joint_range must be two finite angles"),
        ("[-1.0, 1.0]", "[-60, 60]", "a turn to either side.*60 degrees are 1.05 rad"),
        ("[-1.0, 1.0]", "[-inf, 1.0]", "joint_range must be two angles"),
        ("[-1.0, 1.0]", "1.0", "joint_range must be two angles"),
        ("soft_start", "softstart", "did you mean 'soft_start'"),
        ("torque_rate", "torque_rat", "did you mean 'torque_rate'"),
        ("missed_readings = 99999", "missed_readings = 2.5", "whole number of cycles"),
        ("missed_readings = 99999", "missed_readings = 0", r"\[watchdog\]: Watchdog"),
        ("127.0.0.1:5005", "127.0.0.1", 'address must be HOST:PORT'),
        ("127.0.0.1:5005", "can:", 'address must be can:CHANNEL'),
        ("[limits]", "interface = 'pcan'\n[limits]", "unknown key .* in"),
        ("127.0.0.1:5005", "rig:70000", 'address must be HOST:PORT'),
        ("address", "adress", "needs either `address` or `class`"),
        ("torque = 0.5", "", r"\[task\] needs one of torque, csv, name"),
        ("torque = 0.5", "torque = 1\nname = 'spring'", "needs one of"),
        ("torque = 0.5", "torque = 1\namplitude = 1", "belongs to `trajectory`"),
        ("torque = 0.5", "trajectory = 'sine'", "belongs to `trajectory`"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_file_and_key(
    old: str, new: str, why: str, tmp_path: Path
) -> None:
    assert old in PLAIN
    text = PLAIN.replace(old, new, 1) if old else new
    path = written(tmp_path, text)
    with pytest.raises(CableError, match=why) as error:
        read_settings(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(CableError, match=r"cannot read .*no\.toml"):
        read_settings(tmp_path / "no.toml")


@pytest.mark.parametrize(
    ("task", "why"),
    [
        ("name = 'sprig'", "did you mean 'spring'"),
        ("name = 'assist'", "follows the phase of a gait"),
        ("name = 'assist:20'", "follows the phase of a gait"),
        ("name = 'hold:x'", "'x' must be a number, the pull of 'hold'"),
        ("trajectory = 'sin'\namplitude = 1", "did you mean 'sine'"),
        ("csv = 'no.csv'", r"cannot read .*no\.csv"),
        (
            "csv = 'bad.csv'",
            r"bad\.csv, column torque_nm, row 2 .*: 'x' must be",
        ),
        (
            "csv = 'back.csv'",
            r"back\.csv, column time_s, row 2 .*: 1 must be above",
        ),
        ("csv = 'other.csv'", r"no column 'torque_nm'"),
        ("csv = 'empty.csv'", "no row of data"),
    ],
)
def test_a_task_that_cannot_be_is_said(task: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("time_s,torque_nm\n0,1\n1,x\n")
    (tmp_path / "back.csv").write_text("time_s,torque_nm\n1,1\n1,2\n")
    (tmp_path / "other.csv").write_text("time_s,torque\n1,1\n")
    (tmp_path / "empty.csv").write_text("time_s,torque_nm\n")
    settings = read_settings(written(tmp_path, toml(task=task)))
    with pytest.raises(CableError, match=why):
        settings.desired(1.0)


@pytest.mark.parametrize(
    ("wanted", "ratio", "one_way", "why"),
    [
        (
            (0.0, 5.0),
            2.0,
            False,
            "asks for 5 N m .* torque = 1 N m .* gives at most 2;",
        ),
        ((0.0, -5.0), -2.0, False, "asks for -5 N m"),
        ((0.0, 1.8), 2.0, False, r"beyond \[limits\] joint_torque = 1.5 N m"),
        ((-1.0, -0.5), 2.0, True, "one cable only pulls: 0 to 2 N m"),
        ((1.0,), -2.0, True, "one cable only pulls: -2 to 0 N m"),
        ((-1.5, 1.5), 2.0, False, ""),
        ((-1.0, 1.0), -2.0, True, ""),
        ((0.0,), 2.0, True, ""),
    ],
)
def test_a_torque_that_cannot_be_given_is_refused(
    wanted: tuple[float, ...], ratio: float, one_way: bool, why: str
) -> None:
    course = TorqueTable(np.arange(len(wanted), dtype=float), np.array(wanted))
    drive = Drive(ratio, -1.0, 1.0, 0.002, one_way)
    limits = Limits(1.0, 20.0, 30.0, (-1.0, 1.0), joint_torque=1.5)
    if not why:
        course.require_within(drive, limits)
        return
    wide = limits if "joint_torque" in why else replace(limits, joint_torque=math.inf)
    with pytest.raises(CableError, match=why):
        course.require_within(drive, wide)


def test_a_course_is_linear_between_its_points_and_held(tmp_path: Path) -> None:
    (tmp_path / "course.csv").write_text("torque_nm,time_s\n1,0\n\n3,1\n")
    text = toml(task="csv = 'course.csv'")
    desired = read_settings(written(tmp_path, text)).desired(9.0)
    found = [desired.torque(time, REST) for time in (0.0, 0.25, 1.0, 7.0)]
    assert found == [1.0, 1.5, 3.0, 3.0]


def test_a_trajectory_is_a_course_of_that_amplitude(tmp_path: Path) -> None:
    text = toml(task="trajectory = 'sine'\namplitude = 0.7")
    desired = read_settings(written(tmp_path, text)).desired(10.0)
    found = [desired.torque(time, REST) for time in np.arange(0.0, 10.0, 0.002)]
    motion = TRAJECTORIES["sine"].sample(10.0, 0.002, np.random.default_rng(0))
    scale = 0.7 / TRAJECTORIES["sine"].amplitude
    assert found == pytest.approx(scale * motion.angle[:-1], abs=1e-9)
    assert max(map(abs, found)) <= 0.7


def test_a_virtual_environment_follows_the_joint(tmp_path: Path) -> None:
    text = toml(task="name = 'spring'")
    desired = read_settings(written(tmp_path, text)).desired(1.0)
    assert desired.torque(0.0, REST._replace(joint_angle=0.25)) == -0.25


def test_a_rig_of_ones_own_is_made_with_its_keys(tmp_path: Path) -> None:
    address = 'address = "127.0.0.1:5005"'

    def rig(keys: str) -> Rig:
        text = PLAIN.replace(address, keys)
        allow = [f"hardware.test_settings:{name}" for name in ("Own", "Half", "None_")]
        path = written(tmp_path, text)
        return read_settings(path, [*allow, "no_such_module:Rig"]).connect()

    made = rig('class = "hardware.test_settings:Own"\nbus = "vcan1"')
    assert made.bus == "vcan1"  # type: ignore[attr-defined]
    for keys, why in (
        ('class = "hardware.test_settings:Half"', "makes no rig; it needs read"),
        ('class = "hardware.test_settings:None_"', "has no class 'None_'"),
        ('class = "no_such_module:Rig"', "there is no module 'no_such_module'"),
        ('class = "hardware.test_settings:Own"\nbuss = 1', "TypeError"),
    ):
        with pytest.raises(CableError, match=why):
            rig(keys)


def test_the_drive_of_the_bench_is_that_of_its_scene(tmp_path: Path) -> None:
    drive = drive_of("bench", tmp_path, 0.001, 1.5)
    assert (drive.ratio, drive.low, drive.high) == (1.0, -1.5, 1.5)
    assert (drive.period, drive.one_way, drive.delay) == (0.001, False, 1)
    arms = [(cable.proximal, cable.distal) for cable in drive.cables]
    assert arms == [(-0.05, -0.05), (0.05, 0.05)]
    # Diagonal inertia of the scene's motor, about its axis.
    assert drive.inertia == pytest.approx(3e-4)
    seen = {
        "motor_angle_rad": 0.0, "motor_velocity_rad_s": 0.0, "joint_angle_rad": 0.0,
        "joint_velocity_rad_s": 0.0, "joint_torque_nm": 0.0, "desired_torque_nm": 0.5,
        "phase_sine": 0.0, "phase_cosine": 1.0,
    }  # fmt: skip
    for name in ("pi", "model"):
        assert controller(name, drive).torque(seen) > 0.1


def test_a_device_gives_its_drive_and_others_are_refused(tmp_path: Path) -> None:
    drive = drive_of("wrist", tmp_path, 0.002, 0.3)
    assert drive.ratio > 1.0 and (drive.low, drive.high) == (-0.3, 0.3)
    assert len(drive.cables) == 2 and drive.sensors == ()
    with pytest.raises(CableError, match="did you mean 'bench'"):
        drive_of("bensh", tmp_path, 0.002, 1.0)


def test_the_controller_knows_the_lag_of_the_motor_and_the_limit_of_its_rate(
    tmp_path: Path,
) -> None:
    settings = read_settings(written(tmp_path, toml()))
    assert settings.drive().torque_rate == settings.limits.torque_rate == 20.0
    assert settings.drive().motor_lag == 0.0
    spec = mujoco.MjSpec.from_file(str(scene_path("bench")))
    motor = next(one for one in spec.actuators if one.target == "motor")
    motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    motor.dynprm[0] = 0.004
    spec.compile()
    spec.to_file(str(tmp_path / "lags.xml"))
    text = toml().replace('"bench"', '"lags.xml"')
    slow = read_settings(written(tmp_path, text)).drive()
    assert slow.motor_lag == 0.004
    firm, firmer = Stiffness.of(slow), Stiffness.of(settings.drive())
    assert firm.damping < 0.5 * firmer.damping
    own = text.replace("period = 0.002", "period = 0.002\nmotor_lag = 0.001")
    assert read_settings(written(tmp_path, own)).drive().motor_lag == 0.001
