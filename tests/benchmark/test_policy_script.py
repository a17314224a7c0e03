"""The policy in the benchmark's table: trained by the script, a name like others."""

from __future__ import annotations

import dataclasses
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.benchmark import SUITES, Cell, play

SCRIPT = Path(__file__).parents[2] / "scripts" / "train_policy.py"


def test_script_trains_a_policy_that_the_benchmark_takes(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    words = [sys.executable, "-P", str(SCRIPT), "--out", str(tmp_path)]
    more = ["--steps", "512", "--envs", "8", "--seconds", "0.3"]
    told = subprocess.run(
        [*words, *more], check=True, capture_output=True, cwd=SCRIPT.parents[1]
    )
    assert b"steps/s" in told.stdout
    curve = (tmp_path / "0" / "progress.csv").read_text().splitlines()
    assert "rollout/ep_rew_mean" in curve[0] and len(curve) > 1
    again = subprocess.run(words, capture_output=True, cwd=SCRIPT.parents[1])
    assert b"is there already" in again.stderr
    condition = dataclasses.replace(SUITES["v1"].conditions("wrist")[0], duration=1.2)
    path = str(tmp_path / "0.safetensors")
    trained, none = (play(Cell(condition, law)).scores for law in (path, "none"))
    assert trained["failed"][0] == 0.0
    assert np.isfinite(trained["rms_torque_error"][0])
    assert trained["rms_motor_torque"][0] != none["rms_motor_torque"][0]


def test_script_says_what_to_install_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"cc_mujoco\[policy\]"):
        runpy.run_path(str(SCRIPT), run_name="__main__")
