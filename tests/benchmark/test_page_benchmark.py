"""The page's benchmark: its writer leaves nothing out, its recipe works."""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path

import fill_readme
import pytest

from cc_mujoco import cli
from cc_mujoco.benchmark import REFERENCES, SCORES, SUITES
from cc_mujoco.benchmark import _page as drawing
from cc_mujoco.benchmark._page import CAPTIONS
from cc_mujoco.report import figure
from page_blocks import BLOCKS

ROOMS = Path(__file__).parents[2] / "cc_mujoco"
PAGE = (ROOMS / "benchmark" / "README.md").read_text(encoding="utf-8")
BLOCK = PAGE.partition("<!-- benchmark: begin -->")[2].partition("<!-- benchmark")[0]
NUMBER = r"-?\d+(?:\.\d+)?"


def tables(text: str) -> list[dict[str, dict[str, str]]]:
    """Every table: entries by row and column."""
    found = []
    for lines in re.findall(r"(?:^\|.*\n)+", text, re.M):
        head, _, *rows = (
            [entry.strip() for entry in line.strip().strip("|").split(" | ")]
            for line in lines.splitlines()
        )
        found.append(
            {row[0].strip("`*"): dict(zip(head, row, strict=True)) for row in rows}
        )
    return found


def test_the_page_has_every_row_condition_and_score() -> None:
    overview = tables(BLOCK)[0]
    assert list(overview) == [*REFERENCES, "none", *fill_readme.ENTRIES]
    for row in overview["none"].items():
        if row[0] in SUITES["v1"].scenes:
            assert row[1].startswith("1.000")
    scenes = [name for name in SUITES["v1"].scenes if name in overview["none"]]
    assert scenes
    with (ROOMS / "benchmark" / "v1-conditions.csv").open(encoding="utf-8") as file:
        played = list(csv.DictReader(file))
    found = [tuple(row.values())[:3] for row in played]
    players = [*REFERENCES, "none", *fill_readme.ENTRIES]
    assert found == [
        (scene, condition.name, player)
        for scene in scenes
        for condition in SUITES["v1"].conditions(scene)
        for player in players
    ]
    assert {score.name for score in SCORES} < set(played[0])
    with (ROOMS / "benchmark" / "v1-ranks.csv").open(encoding="utf-8") as file:
        ranked = {(row["scene"], row["controller"]) for row in csv.DictReader(file)}
    controllers = ("none", *fill_readme.ENTRIES)
    assert ranked == {(scene, name) for scene in scenes for name in controllers}
    for name, reference in REFERENCES.items():
        assert f"- *{name}*: {reference.meaning}" in BLOCK


@pytest.mark.study
def test_new_controller_of_the_readme_enters_with_the_command_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = BLOCKS["cc_mujoco/control/README.md"]
    (code,) = (block for block in blocks if block.file == "my_controller.py")
    command = blocks[blocks.index(code) + 1].commands("cc-mujoco")[0]
    assert len(code.code.splitlines()) <= 15
    (tmp_path / code.file).write_text(code.code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_controller", raising=False)
    blank = figure(1.0, 1.0)
    for stem in CAPTIONS:  # what it scores is drawn as all else is
        monkeypatch.setattr(drawing, stem, lambda *_: blank)
    assert cli.main([*command, "--duration", "1.05", "--workers", "1"]) == 0
    overview = tables(capsys.readouterr().out)[0]
    entries = ["none", "pi", "stiction", "my_controller:lead"]
    assert list(overview) == [*REFERENCES, *entries]
    assert re.match(NUMBER, overview["my_controller:lead"]["wrist"])
