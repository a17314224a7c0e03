"""Diagnoses of devices that users describe: logs of runs, and axes of several."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.control import axes_controller
from cc_mujoco.datasets import Bench
from cc_mujoco.device import Device
from cc_mujoco.diagnosis import diagnose
from cc_mujoco.diagnosis._loading import load
from cc_mujoco.diagnosis._report import output
from cc_mujoco.diagnosis._report.output import Earlier, carry_description
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    DrivenAxis,
    Limits,
    Loop,
    Readings,
    RunLog,
    TorqueTable,
    Watchdog,
    drive_of,
)
from hardware.devices import ARM, KNEE, SimulatedDevice, written
from hardware.fakes import add_row


def log_of_a_knee(folder: Path, scene: Path, marked: bool = True) -> Path:
    """Return a log in which the knee bends from 0.5 to 1.5 rad, as in the scene."""
    about = {"rig": f'scene = "{scene}"'} if marked else {}
    log = RunLog(folder, about, 100)
    for k, time in enumerate(np.arange(0.0, 4.0, 0.002).tolist()):
        knee = 1.0 - 0.5 * np.cos(2.0 * time)
        torque = -2.0 - np.sin(3.0 * time)
        noise = 1e-6 * np.sin(7.0 * k)
        seen = Readings(time, -4.5 * knee + noise, 0.0, knee - noise, 0.0, torque)
        add_row(log, seen, 0.5 + 0.2 * np.sin(3.0 * time), torque)
    log.close({"outcome": "", "exit_code": 0})
    return folder / "log.csv"


def test_a_log_of_a_run_counts_the_joint_as_its_scene_does(tmp_path: Path) -> None:
    """A diagnosis counts positive where the cable pulls, which straightens the knee."""
    scene = written(tmp_path, KNEE)
    bench = Bench.of(scene)
    log = log_of_a_knee(tmp_path / "run", scene)
    (trial,) = load(log, None, bench)[0].trials
    assert trial.joint_angle.max() == pytest.approx(-0.5, abs=1e-3)
    assert trial.joint_angle.min() == pytest.approx(-1.5, abs=1e-3)
    assert trial.joint_torque is not None and np.all(trial.joint_torque > 0.9)
    toml = tmp_path / "dataset.toml"
    toml.write_text("[columns.joint_angle_rad]\nsign = -1\n")
    (declared,) = load(log, toml, bench)[0].trials
    assert np.array_equal(declared.joint_angle, trial.joint_angle)
    other = log_of_a_knee(tmp_path / "other", scene, marked=False)
    (theirs,) = load(other, None, bench)[0].trials
    assert theirs.joint_angle.min() == pytest.approx(0.5, abs=1e-3)


def test_the_command_takes_the_scene_first_and_asks_for_the_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = str(written(tmp_path, ARM))
    out = ["--plan", "--out", str(tmp_path / "plan")]
    assert cli.main(["diagnose", scene, *out]) == 2
    assert "has the axes elbow, shoulder; name one." in capsys.readouterr().err
    assert cli.main(["diagnose", *out]) == 2
    assert "no scene given; name it first" in capsys.readouterr().err
    assert cli.main(["diagnose", scene, "--out", str(tmp_path / "out")]) == 2
    assert "no data given" in capsys.readouterr().err


def test_a_folder_does_not_hide_the_scene_of_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrist").mkdir()
    assert cli.main(["diagnose", "wrist", "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert "wrist is taken for the built-in scene" in said and "no data given" in said
    with pytest.raises(CableError, match="no data"):
        diagnose(Path("wrist"), (), "out")


def test_a_repaired_scene_keeps_the_limits_of_the_description(tmp_path: Path) -> None:
    scene = written(tmp_path, KNEE)
    scene.with_suffix(".device.toml").write_text("[axis]\nsafe_torque = 7.5\n")
    repaired = tmp_path / "out" / "scene.xml"
    repaired.parent.mkdir()
    repaired.write_text(scene.read_text())
    carry_description(scene, repaired)
    assert Device(repaired).description.axis().safe_torque == 7.5
    own = repaired.with_suffix(".device.toml")
    own.write_text("mine")
    carry_description(scene, repaired)
    assert own.read_text() == "mine"


@pytest.mark.study
def test_an_axis_is_diagnosed_by_the_log_of_a_run_of_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rotor, which takes part of the command that a log has, is what is missing."""
    monkeypatch.setattr(output.drawings, "save_figures", lambda *_: set())
    scene = written(tmp_path, ARM)
    times = np.arange(0.0, 7.0, 0.01)
    torques = 5.0 + 3.0 * np.sin(2.0 * times) + np.sin(7.3 * times)
    device, names = SimulatedDevice(scene, noise=1e-5), ("elbow", "shoulder")
    about = {"rig": f'scene = "{scene}"\n[axes.elbow]\n[axes.shoulder]'}
    log = RunLog(tmp_path / "run", about, 100, axes=names)
    limits = Limits(5.0, 1e4, 100.0, (-1.6, 2.4), soft_start=0.5)
    drives = [drive_of(str(scene), tmp_path, 1e-3, 5.0, axis=name) for name in names]
    axes = [
        DrivenAxis(device.rig(name), drive, goal, limits, Watchdog(), name)
        for name, drive, goal in zip(
            names,
            drives,
            [TorqueTable(times, torques), TorqueTable(times, 0.0 * torques)],
            strict=True,
        )
    ]
    law = axes_controller("none", drives, ("elbow.", "shoulder."))
    log.close(Loop(axes, law, clock=device, log=log).run(6.0).to_json())
    out = tmp_path / "out"
    found = diagnose(scene, tmp_path / "run" / "log.csv", out, axis="elbow")
    assert "motor_inertia" in [effect.id for effect in found.effects]
    provenance = json.loads((out / "verdict.json").read_text())["provenance"]
    assert provenance["scene"]["axis"] == "elbow"
    assert Earlier.of(out).axis == "elbow"
    written_scene = Bench.of(out / "scene.xml", "elbow")
    assert written_scene.names == ("biceps",)
