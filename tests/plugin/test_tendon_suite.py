"""Tendons of this package on the tasks of the tendon suite, and its runner."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tendon_suite import run, tasks
from tendon_suite.ours import ENGINES

OURS = ENGINES["cc_mujoco"]


@pytest.mark.parametrize("task", tasks.TASKS)
def test_a_coarse_tendon_follows_the_closed_form(task: str) -> None:
    setting = OURS.settings(task, False)[0] | {"segments": 2}

    def build(machine: tasks.Machine) -> tasks.Simulation:
        return OURS.build(machine, setting)

    few = task == "cycles"
    quantities = list(tasks.cycles(build, 3) if few else tasks.TASKS[task](build))
    assert len(quantities) >= 3
    for quantity in quantities:
        assert quantity.error < 0.01, quantity


def test_results_of_several_runs_are_one_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    def refuse(machine: tasks.Machine, setting: tasks.Setting) -> tasks.Simulation:
        raise tasks.NotExpressible("it has no pulleys")

    without = tasks.Engine(lambda task, tune: [{}], refuse)
    monkeypatch.setattr(run, "engines", lambda: run_with)
    out = tmp_path / "suite.json"
    for name, engine in (("cc_mujoco", OURS), ("other", without)):
        run_with = {name: engine}
        monkeypatch.setattr(
            sys, "argv", ["run.py", "--task", "atwood", "--out", str(out)]
        )
        run.main()
    lines = capsys.readouterr().out.splitlines()[-4:]
    assert lines[0] == "| task | cc_mujoco | other |"
    assert lines[2].startswith("| atwood | 0.0") and lines[2].endswith("/s | - |")
    assert lines[3] == "other, atwood: it has no pulleys"
    assert json.loads(out.read_text())["atwood"]["cc_mujoco"]["error"] < 1e-4
