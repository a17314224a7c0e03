"""The policy in the benchmark's table: trained by the script, a name like others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.benchmark import Cell, play

SCRIPT = Path(__file__).parents[2] / "scripts" / "train_policy.py"


@pytest.mark.slow
def test_script_trains_a_policy_that_the_benchmark_takes(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    path = tmp_path / "policy.zip"
    words = [sys.executable, "-P", str(SCRIPT), "--steps", "1", "--out", str(path)]
    subprocess.run(words, check=True, capture_output=True, cwd=SCRIPT.parents[1])
    cells = [
        Cell("wrist", law, "sine", "spring", duration=1.2)
        for law in (str(path), "none")
    ]
    trained, none = (play(cell).scores for cell in cells)
    assert trained["failed"][0] == 0.0
    assert np.isfinite(trained["rms_error"][0])
    assert trained["effort"][0] != none["effort"][0]


def test_script_says_what_to_install_where_it_is_missing(tmp_path: Path) -> None:
    code = (
        "import runpy, sys; sys.modules['stable_baselines3'] = None; "
        f"sys.argv = ['train_policy.py', '--out', {str(tmp_path / 'p.zip')!r}]; "
        f"runpy.run_path({str(SCRIPT)!r}, run_name='__main__')"
    )
    words = [sys.executable, "-P", "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, cwd=SCRIPT.parents[1])
    assert done.returncode == 1
    assert "cc_mujoco[policy]" in done.stderr
    assert "Traceback" not in done.stderr
