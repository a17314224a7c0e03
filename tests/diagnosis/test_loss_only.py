"""Diagnosis of a dynamometer: current, torque and joint angle, but no motor angle."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.diagnosis import diagnose, load, plan
from cc_mujoco.diagnosis._verdict import Diagnosis
from cc_mujoco.errors import CableError
from diagnosis.dynamometer import STEP, Dynamometer
from diagnosis.rigs import alone

CONSTANT, GEAR = 0.05, 8.0
"""Torque constant of the motor [N m/A] and its gear."""
DECLARED = f"""\
[columns.motor_angle_rad]
measured = false
[rig]
torque_constant = {CONSTANT}
gear_ratio = {GEAR}
"""


def recorded(folder: Path, rig: Dynamometer, **motion: bool | float) -> Path:
    """Write two recordings and what is declared of them; return their folder."""
    data = folder / "data"
    data.mkdir()
    for seed in range(2):
        angle, ideal, torque = rig.record(seed, **motion)
        time = STEP * np.arange(angle.size)
        columns = np.column_stack([time, angle, ideal / (CONSTANT * GEAR), torque])
        names = "time_s,joint_angle_rad,motor_current_a,joint_torque_nm"
        np.savetxt(
            data / f"run_{seed}.csv", columns, "%.7g", ",", header=names, comments=""
        )
    (data / "dataset.toml").write_text(DECLARED, encoding="utf-8")
    return data


def diagnosed(folder: Path, rig: Dynamometer, **motion: bool | float) -> Diagnosis:
    """Return the diagnosis of a cable of half a turn on the dynamometer."""
    return diagnose(alone(folder), recorded(folder, rig, **motion), folder / "out")


def test_loss_by_direction_and_load_is_in_all_results(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, Dynamometer(exponent=0.5, breakaway=0.4))
    assert found.verdict == "tie"
    assert ("load_independent_friction", "drive_friction") in found.ties
    assert found.deviating == ()
    assert ("stribeck_friction", "dwell_dependent_stiction") in found.ties
    values = found.baseline.parameters
    assert values["friction_exponent"].value == pytest.approx(0.5, rel=0.01)
    assert values["load_independent_loss"].value == pytest.approx(0.15, rel=0.06)
    assert values["breakaway_excess"].value == pytest.approx(0.4, rel=0.06)
    assert found.remaining < 1.5
    assert "cannot show stretch, play, slack or pretension" in found.instruments
    assert any("Stretch, play" in each for each in found.baseline.not_identifiable)
    written = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert written["baseline"]["parameters"]["exponent_driven"]["unit"] == "1"
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "friction exponent" in page
    assert "What the data do not determine" in page
    assert not (tmp_path / "out" / "scene.xml").exists()


def test_friction_of_the_scene_is_nothing_missing(tmp_path: Path) -> None:
    scene = 0.12 * math.pi
    found = diagnosed(tmp_path, Dynamometer(exponent=scene, loss=0.0))
    assert (found.verdict, found.deviating) == ("none", ())


def test_one_load_leaves_the_kind_of_loss_open(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, Dynamometer(), constant_load=True)
    assert found.ties == (("friction", "load_independent_friction"),)
    assert "friction_exponent" not in found.baseline.parameters


def test_one_direction_is_to_be_recorded_again(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, Dynamometer(), one_way=True)
    assert found.verdict == "fix-data"
    assert found.baseline.parameters == {}
    assert "record both directions" in found.statement


def test_what_needs_the_motor_angle_is_refused(tmp_path: Path) -> None:
    data = recorded(tmp_path, Dynamometer(), seconds=4.0)
    toml = data / "dataset.toml"
    with pytest.raises(CableError, match="motor's angle is not measured"):
        plan("bench", tmp_path / "plan", dataset_toml=toml)
    toml.write_text(
        f"{DECLARED}load_stiffness = 1.0\n[columns.joint_torque_nm]\n"
        "measured = false\n",
        encoding="utf-8",
    )
    with pytest.raises(CableError, match="record the torque at both ends"):
        diagnose(alone(tmp_path), data, tmp_path / "out")
    toml.write_text(DECLARED.replace("motor_angle", "joint_angle"), encoding="utf-8")
    with pytest.raises(CableError, match="the joint's angle must be recorded"):
        load([data])
