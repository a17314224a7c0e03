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


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--engine bogus", "--engine bogus: it is none of those found here: cc_mujoco"),
        ("--speed -3", "--speed -3: give a number of steps"),
        ("--speed 10", "--speed needs --out"),
        ("--speed 10 --out new.json", "--speed needs --out"),
        ("--out no/folder/x.json", "--out no/folder/x.json: No such file"),
        ("--out .", "--out .: Is a directory"),
        ("--out list.json", "--out list.json has no results of this script"),
        ("--out other.json", "no results of a task under 'atwood'"),
        ("--out text.json", "--out text.json has no results of this script"),
    ],
)
def test_a_mistake_is_refused_before_anything_runs(
    words: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    files = {"list.json": "[1, 2]", "other.json": '{"atwood": 3}', "text.json": "word"}
    for name, text in files.items():
        Path(name).write_text(text)
    monkeypatch.setattr(run, "engines", lambda: {"cc_mujoco": OURS})
    monkeypatch.setattr(run, "best", lambda *_: pytest.fail("it ran"))
    monkeypatch.setattr(sys, "argv", ["run.py", *words.split()])
    with pytest.raises(SystemExit, match="2"):
        run.main()
    assert reason in capsys.readouterr().err
    assert {file.name for file in tmp_path.iterdir()} == set(files)


def test_an_engine_that_is_not_installed_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "newton", None)
    monkeypatch.delitem(sys.modules, "tendon_suite.newton_tendons", raising=False)
    assert "cc_mujoco" in run.engines()
    sentence = "newton is not installed; its columns are left out"
    assert capsys.readouterr().err.strip() == sentence


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
