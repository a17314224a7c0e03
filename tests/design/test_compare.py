"""`whatif-show --against`: two designs of a study side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cc_mujoco import cli
from cc_mujoco.design import study
from cc_mujoco.design._show import FILES, FinishedStudy, compare, write_comparison
from cc_mujoco.errors import CableError
from cc_mujoco.report import _figures as figures

METRICS = ["peak_tension", "slack_margin"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("study")
    vary = {"friction": [0.05, 0.2], "conduit": ["2:0.2", "1:0.2 1:inf"]}
    study(
        "wrist",
        vary,
        duration=0.2,
        controllers=["pi", "none"],
        metrics=METRICS,
        trajectory="sine",
        out=place,
    )
    return place


def test_the_table_is_that_of_the_study(folder: Path) -> None:
    pairs = {pair.name: pair for pair in compare(FinishedStudy(folder), 3, 0)}
    one, other = (FinishedStudy(folder).row(row) for row in (3, 0))
    units = {"peak_tension": "N", "slack_margin": "N", "rms_torque_error": "N m"}
    named = {name: f"{name} [{unit}]" for name, unit in units.items()}
    names = ["friction", "conduit", "controller", *METRICS, "rms_torque_error"]
    assert list(pairs) == [named.get(name, name) for name in names]
    for name in names:
        pair = pairs[named.get(name, name)]
        assert (pair.one, pair.other) == (one[name], other[name])
    assert pairs["friction"].difference == pytest.approx(0.15)
    assert pairs["conduit"].difference is None
    assert pairs["conduit"].cells == (one["conduit"], other["conduit"], "-")
    mirrored = compare(FinishedStudy(folder), 0, 3)
    for pair, back in zip(pairs.values(), mirrored, strict=True):
        assert (back.one, back.other) == (pair.other, pair.one)
        if pair.difference is not None:
            assert back.difference == -pair.difference


@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_and_prints_the_table_and_replaces_only_its_own(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["whatif-show", str(folder), "1", "--against", "2"]
    assert cli.main(words) == 0
    said = capsys.readouterr().out
    out = folder / "design-1-against-2"
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)
    text = (out / "comparison.md").read_text("utf-8")
    for pair in compare(FinishedStudy(folder), 1, 2):
        assert f"| {pair.name} | {' | '.join(pair.cells)} |" in text
        (line,) = [line for line in said.splitlines() if line.startswith(pair.name)]
        assert line.removeprefix(pair.name).split() == " ".join(pair.cells).split()
    (out / "comparison.png").write_bytes(b"a picture of theirs")
    assert cli.main(words) == 2
    assert "which no such run wrote" in capsys.readouterr().err
    assert (out / "comparison.png").read_bytes() == b"a picture of theirs"
    for more in ([], words[3:]):
        assert cli.main([*words[:3], *more, "--out", str(folder.parent)]) == 2
        assert "which no such run wrote" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["1", "--against", "1"],
            "1 is compared with itself; name another one.",
        ),
        (["1", "--against", "9"], "has designs 0 to 3, not 9."),
        (
            ["1", "--against", "2", "--video"],
            "--video and --html show one design; leave them out with --against.",
        ),
        (
            ["1", "--against", "2", "--case", "0"],
            "no cases, so none can be chosen.",
        ),
    ],
)
def test_what_cannot_be_compared_is_one_sentence(
    folder: Path, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.iterdir())
    assert cli.main(["whatif-show", str(folder), *words]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.endswith(sentence)
    assert sorted(folder.iterdir()) == before


def test_a_failed_episode_leaves_nothing(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise CableError("it diverged.")

    monkeypatch.setattr("cc_mujoco.design._show.show", fail)
    with pytest.raises(CableError, match=r"it diverged\."):
        write_comparison(tmp_path / "out", folder, 0, 1)
    assert not (tmp_path / "out").exists()


def test_designs_of_a_device_with_several_axes_are_drawn_by_axis(
    tmp_path: Path,
) -> None:
    study("exosuit", {"friction": [0.05, 0.1]}, duration=0.1, out=tmp_path / "study")
    drawn: list[str] = []
    save = figures.save

    def kept(path: Path, drawing: Any) -> None:
        drawn.extend(axes.get_title(loc="left") for axes in drawing.get_axes())
        save(path, drawing)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "save", kept)
        write_comparison(tmp_path / "both", tmp_path / "study", 0, 1)
    assert {f"design 1: torque-angle loop, {axis}" for axis in ("hip", "ankle")} <= {
        *drawn
    }
