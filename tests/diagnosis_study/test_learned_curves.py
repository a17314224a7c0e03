"""Curves learned on rigs of other equations, whose effect no library has."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnose_benchmark import run

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import diagnose
from cc_mujoco.diagnosis._report.output import LEARNED_FILE, REPORT_PAGE, SCENE_FILE
from rig.dataset import make_dataset
from rig.generate import facts_of, write_data
from rig.nominal import make_rig

BENCH = Bench.of(scene_path("bench"))


@pytest.mark.study
def test_a_catch_at_one_angle_is_learned_and_acts_in_the_scene(tmp_path: Path) -> None:
    """The rig's catch pulls the joint towards, or away from, one angle."""
    rig, data = make_rig(27003, make="guides"), tmp_path / "data"
    trials = make_dataset(rig, {"unknown_catch": 0.4}, "rich", 27003)
    write_data(data, trials, facts_of("rich", 27003))
    found = diagnose("bench", [data], tmp_path / "out")
    assert found.verdict == "unknown" and found.learned is not None
    (curve, *_) = found.learned.curves
    assert (curve.over, list(curve.torque)) == ("joint angle", ["joint_torque_nm"])
    assert found.learned.ci95[0] > 0.6
    assert curve.formula.startswith("a catch at")
    (compared,) = [p for p in found.problems if "differs from the replay" in p]
    assert float(compared.partition(" replay by ")[2].split()[0]) < 0.02
    out = tmp_path / "out"
    assert "learned_joint_angle" in (out / SCENE_FILE).read_text("utf-8")
    assert "What curves take" in (out / REPORT_PAGE).read_text("utf-8")
    again = diagnose(
        "bench", [data], tmp_path / "again",
        effects=[f"{out / LEARNED_FILE}:LearnedJointAngle"],
    )  # fmt: skip
    assert [each.id for each in again.missing] == ["learned_joint_angle"]
    (share,) = again.effects[0].parameters.values()
    assert share.value == pytest.approx(1.0, abs=0.05)  # penalties shrink a table
    assert any("learned curve is in the model" in each for each in again.problems)
    assert again.remaining < 1.6


@pytest.mark.study
def test_a_rig_that_hides_nothing_has_no_curves() -> None:
    record = run("guides", "bare", "none", 0.0, 27100, proposals=0)
    assert record["steps"][0]["verdict"] == "none"
    assert record["learned"]["curves"] == ""
