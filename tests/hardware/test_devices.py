"""Runs of devices that users describe: levers, and axes of several."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.control import as_round_pulley, controller
from cc_mujoco.device import find_device
from cc_mujoco.device._moment_arm import MeasuredWinding
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    DrivenAxis,
    Limits,
    Loop,
    RunLog,
    TorqueTable,
    Watchdog,
    Windings,
    drive_of,
    read_settings,
)
from cc_mujoco.hardware._drive_model import axis_model, device_of
from cc_mujoco.hardware._replay import as_episode, read_rows
from cc_mujoco.hardware._run_log import RUN_COLUMNS
from cc_mujoco.hardware._settings import RigAxes
from cc_mujoco.simulation import simulate
from hardware.devices import ARM, KNEE, SimulatedDevice, written
from hardware.fakes import Rows
from shared_folder import SHARED

CASES = SHARED / "cases" / "device"
LIMITS = Limits(15.0, 1e4, 100.0, (-0.1, 2.1), soft_start=0.3)
TIMES = np.arange(0.0, 5.0, 0.01)
RIG = """scene = "device.xml"
{axis}period = 0.001
[rig]
address = "127.0.0.1:5005"
[limits]
torque = 5.0
torque_rate = 200.0
motor_speed = 30.0
joint_range = [-1.0, 2.0]
[task]
torque = 0.5
"""


def error(scene: Path, law: str, with_winding: bool) -> float:
    """Return the RMS error of a run with a desired torque of a few N m [N m]."""
    drive = drive_of(scene.name, scene.parent, 1e-3, 15.0)
    windings: Windings | None = Windings([axis_model(find_device(scene))])
    if not with_winding:
        # A guard would stop it, as torque and stretch contradict each other.
        drive = dataclasses.replace(drive, lever=False, safe_torque=math.inf)
        windings = None
    desired = math.copysign(1.0, drive.ratio) * (8.0 + 4.0 * np.sin(2.0 * TIMES))
    device = SimulatedDevice(scene)
    rig = device.rig()
    goal = TorqueTable(TIMES, desired)
    axis = DrivenAxis(rig, drive, goal, LIMITS, Watchdog())
    loop = Loop(
        [axis], controller(law, drive), clock=device, log=Rows(), windings=windings
    )
    assert loop.run(4.0).code == 0
    times, torques = np.array(rig.torques).T
    settled = (times > 1.0) & (times < 4.0)
    wanted = np.interp(times, TIMES, desired)
    return float(np.sqrt(np.mean((torques - wanted)[settled] ** 2)))


@pytest.mark.study
def test_a_controller_with_a_model_is_right_on_a_lever(tmp_path: Path) -> None:
    scene = written(tmp_path, KNEE)
    assert error(scene, "stiction", True) < 0.3 * error(scene, "stiction", False)


def test_what_is_wound_follows_from_the_measured_angle(tmp_path: Path) -> None:
    device = find_device(written(tmp_path, KNEE))
    axis = axis_model(device)
    log = simulate(device, "none", seed=1, duration=2.0)
    windings = Windings([axis])
    assert windings.unmeasured == [()]
    angles, velocities = log["joint_angle_rad"], log["joint_velocity_rad_s"]
    assert np.ptp(angles) > 0.3
    for k in range(0, len(log), 100):
        (found,) = windings.read([float(angles[k])], [float(velocities[k])])
        # An episode brings the angle forward by a step.
        for name in WINDING_COLUMNS:
            assert found[name] == pytest.approx(log[name][k], abs=2e-3)


def test_a_lever_whose_angle_nobody_tells_is_refused(tmp_path: Path) -> None:
    drive = drive_of("device.xml", written(tmp_path, KNEE).parent, 1e-3, 15.0)
    measured = {"joint_angle_rad": 0.1, "joint_torque_nm": 1.0}
    with pytest.raises(CableError, match="the cables pull a lever"):
        as_round_pulley(measured, drive)


def test_a_joint_that_the_rig_does_not_measure_leaves_the_winding_unknown() -> None:
    axis = axis_model(device_of("exosuit", Path()), "hip")
    assert axis.crossed == ("knee",)
    assert Windings([axis]).unmeasured == [("knee",)]
    assert Windings([axis]).read([0.1], [0.0]) == [{}]
    assert axis.winding is not None
    both = MeasuredWinding(axis.model, axis.winding)
    assert set(both.joints) == {"hip", "knee"}
    columns = both.read([0.0, 0.0], [0.0, 0.0])
    assert columns[WINDING_COLUMNS[0]] == pytest.approx(0.0)
    assert columns[WINDING_COLUMNS[2]] == pytest.approx(1.0)


def test_a_device_with_several_axes_needs_the_name_of_one(tmp_path: Path) -> None:
    written(tmp_path, ARM)
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.format(axis=""))
    with pytest.raises(CableError, match=r"needs `axis`, one of elbow, shoulder, or"):
        read_settings(rig).drive()
    rig.write_text(RIG.format(axis='axis = "elbw"\n'))
    with pytest.raises(CableError, match="did you mean 'elbow'"):
        read_settings(rig).drive()
    rig.write_text(RIG.format(axis='axis = "elbow"\n'))
    settings = read_settings(rig)
    assert settings.drive().ratio == pytest.approx(2.5)
    axes = RigAxes([settings])
    assert (axes.names, axes.log_names, axes.prefixes) == (("elbow",),) * 2 + (("",),)
    assert axes.windings.read([0.1], [0.0]) == [{}]


def test_the_log_of_an_axis_has_its_name_and_can_be_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = written(tmp_path, ARM)
    (tmp_path / "rig.toml").write_text(RIG.format(axis='axis = "elbow"\n'))
    settings = read_settings(tmp_path / "rig.toml")
    device = SimulatedDevice(scene)
    about = {"rig": settings.path.read_text()}
    axes = RigAxes([settings])
    log = RunLog(tmp_path / "run", about, 50, axes=axes.log_names)
    driven = axes.driven([device.rig("elbow")], axes.desired(0.5))
    loop = Loop(driven, axes.controller("pi"), clock=device, log=log)
    log.close(loop.run(0.5).to_json())
    rows = tmp_path / "run" / "log.csv"
    header = rows.read_text().partition("\n")[0].split(",")
    assert header[:2] == ["time_s", "elbow.motor_angle_rad"]
    assert [name.rpartition(".")[2] for name in header] == list(RUN_COLUMNS)
    _, episode = as_episode(read_rows(rows), str(scene), rows)
    assert episode.axes == ("elbow", "shoulder")
    assert np.isfinite(episode["elbow.joint_torque_nm"]).all()
    assert np.isnan(episode["shoulder.joint_torque_nm"]).all()
    assert np.ptp(episode["tension_biceps_proximal_n"]) > 1.0
    assert np.isnan(episode["tension_deltoid_nodes_n"]).all()  # nobody knows it
    assert cli.main(["play", str(scene), "--replay", str(rows)]) == 0
    assert rows.with_name("summary.png").is_file()
    capsys.readouterr()


@pytest.mark.shared
@pytest.mark.parametrize("name", ["knee_exo", "knee4", "knee_mid", "elbow"])
def test_devices_of_others_have_a_drive_and_a_winding(name: str) -> None:
    scene = CASES / f"{name}.xml"
    drive = drive_of(str(scene), Path(), 1e-3, 2.0)
    assert (drive.low, drive.high, drive.crossed) == (-2.0, 2.0, ())
    windings = Windings([axis_model(find_device(scene))])
    (wound,) = windings.read([0.8], [0.0])
    assert windings.unmeasured == [()] and drive.lever is bool(wound)
    columns = {
        "motor_angle_rad": 0.0, "motor_velocity_rad_s": 0.0, "joint_angle_rad": 0.8,
        "joint_velocity_rad_s": 0.0, "joint_torque_nm": 0.0,
        "desired_torque_nm": math.copysign(3.0, drive.ratio),
        **wound,
    }  # fmt: skip
    assert controller("stiction", drive).torque(columns) > 0.1
