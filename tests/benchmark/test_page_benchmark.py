"""The page's benchmark: its writer leaves nothing out, its numbers are today's."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import fill_readme
import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.benchmark import (
    SCORES,
    Cell,
    CellResult,
    Plan,
    drawing,
    interval,
    play,
)
from cc_mujoco.benchmark.runner import FIGURES
from cc_mujoco.control import CONTROLLERS
from cc_mujoco.devices import DEVICES
from cc_mujoco.figures import figure

ROOMS = Path(__file__).parents[2] / "cc_mujoco"
PAGE = (ROOMS / "benchmark" / "README.md").read_text(encoding="utf-8")
CONTROL = (ROOMS / "control" / "README.md").read_text(encoding="utf-8")
BLOCK = PAGE.partition("<!-- benchmark: begin -->")[2].partition("<!-- benchmark")[0]
POLICY = "runs/policy.zip"
NUMBER = r"-?\d+(?:\.\d+)?"
NONE_FAILED = {"failed": np.zeros(5)}
ENTRY = re.compile(rf"-|{NUMBER}%|{NUMBER}(?: ± {NUMBER})?(?: \(\d of \d\))?")


def tables(text: str) -> list[dict[str, dict[str, str]]]:
    """Every table: entries by row and column."""
    found = []
    for lines in re.findall(r"(?:^\|.*\n)+", text, re.M):
        head, _, *rows = (
            [entry.strip() for entry in line.strip().strip("|").split(" | ")]
            for line in lines.splitlines()
        )
        found.append(
            {row[0].strip("`"): dict(zip(head, row, strict=True)) for row in rows}
        )
    return found


def errors(scene: str, block: str = BLOCK) -> dict[str, dict[str, str]]:
    """RMS errors of a scene by controller, then by trajectory and task."""
    return tables(block.partition(f"**{scene}**, RMS error")[2])[0]


@pytest.fixture(scope="module")
def block() -> str:
    """What would be written of made-up scores, some of which are missing."""
    plans = (
        Plan(tuple(DEVICES), tuple(CONTROLLERS)),
        Plan(("wrist",), (POLICY,)),
    )
    random = np.random.default_rng(0)

    def values() -> np.ndarray:
        found = 10.0 ** random.uniform(-3.0, 2.5, 5)
        return np.where(random.random(5) < 0.1, np.nan, found)

    return fill_readme.tables(
        [
            (
                cell,
                CellResult({s.name: values() for s in SCORES} | NONE_FAILED, {}, None),
            )
            for plan in plans
            for cell in plan.cells()
        ]
    )


def test_tables_have_every_controller_scene_and_score_and_the_policy(
    block: str,
) -> None:
    overview = tables(block)[0]
    assert list(overview) == [*CONTROLLERS, POLICY]
    for scene, device in DEVICES.items():
        plays = [f"{a}, {b}" for a in device.trajectories for b in device.tasks]
        known = [*CONTROLLERS, *([POLICY] if scene == "wrist" else [])]
        assert list(errors(scene, block)) == known
        scores = tables(block.partition(f"**{scene}**, mean over")[2])[0]
        assert list(scores) == known
        for law in known:
            assert list(errors(scene, block)[law]) == ["controller", *plays]
            assert overview[law][scene] == scores[law]["rms error [Nm]"] != "-"
    for score in SCORES:
        assert f"- `{score.name}` [{score.unit}]: {score.meaning}" in block


def test_every_entry_is_a_number_or_nothing(block: str) -> None:
    for table in tables(block):
        for row in table.values():
            for entry in list(row.values())[1:]:
                assert ENTRY.fullmatch(entry), entry


def same(text: str, values: np.ndarray) -> bool:
    """Whether a printed entry is the mean of these values, within 2 %."""
    now = str(interval(values))
    numbers = [
        np.array(re.findall(NUMBER, entry), dtype=float) for entry in (text, now)
    ]
    return numbers[0].shape == numbers[1].shape and np.allclose(*numbers, rtol=0.02)


@pytest.mark.slow
def test_a_cell_with_noise_gives_the_interval_printed() -> None:
    cell = Cell("ankle", "model", "walk", "transparent", seeds=(0, 1, 2, 3, 4))
    found = play(cell).scores["rms_error"]
    printed = errors("ankle")["model"]["walk, transparent"]
    assert same(printed, found) and not same(printed, 1.1 * found)


def test_new_controller_of_the_readme_enters_with_the_command_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    section = CONTROL.partition("## A new controller in fifteen lines")[2]
    code = section.partition("```python\n")[2].partition("```")[0]
    command = section.partition("```sh\n")[2].partition("\n```")[0]
    assert len(code.splitlines()) <= 15
    (tmp_path / "my_controller.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_controller", raising=False)
    for stem in FIGURES:  # what it scores is drawn as all else is
        monkeypatch.setattr(drawing, stem, lambda *_: figure(1.0, 1.0))
    short = "--trajectories sine --tasks spring --seeds 1 --duration 1.05 --workers 1"
    program, *words = f"{command} {short}".split()
    assert program == "cc-mujoco"
    assert cli.main(words) == 0
    overview = tables(capsys.readouterr().out)[0]
    assert list(overview) == ["pi", "stiction", "my_controller:lead"]
    assert re.match(NUMBER, overview["my_controller:lead"]["wrist"])
