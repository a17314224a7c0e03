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


@pytest.mark.slow
def test_script_trains_a_policy_that_the_benchmark_takes(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    path = tmp_path / "policy.zip"
    words = [sys.executable, "-P", str(SCRIPT), "--steps", "1", "--out", str(path)]
    subprocess.run(words, check=True, capture_output=True, cwd=SCRIPT.parents[1])
    condition = dataclasses.replace(SUITES["v1"].conditions("wrist")[0], duration=1.2)
    cells = [Cell(condition, law) for law in (str(path), "none")]
    trained, none = (play(cell).scores for cell in cells)
    assert trained["failed"][0] == 0.0
    assert np.isfinite(trained["rms_error"][0])
    assert trained["effort"][0] != none["effort"][0]


def test_script_says_what_to_install_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "--out", str(tmp_path / "p.zip")])
    with pytest.raises(SystemExit, match=r"cc_mujoco\[policy\]"):
        runpy.run_path(str(SCRIPT), run_name="__main__")
