"""The commands `whatif` and `whatif-show`: what they write and say."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from cc_mujoco import cli
from cc_mujoco.metrics import METRICS
from cc_mujoco.simulation import EpisodeLog
from cc_mujoco.viz import EPISODE_FILES

GOAL = ["--objective", "slack_margin"]


@pytest.fixture(autouse=True)
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_study_leaves_table_ranking_effects_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["whatif", "wrist", "--duration", "0.3", "--out", "study"]
    vary = ["--vary", "friction=0.05:0.2:3", "--vary", "loops=1,2"]
    metrics = ("slack_margin", "peak_tension", "rms_torque_error", "efficiency")
    words += ["--controllers", "pi"]
    words += [word for name in metrics for word in ("--metric", name)]
    goals = ["--objective", "slack_margin", "--objective", "max:peak_tension"]
    assert cli.main([*words, *vary, *goals, "--around"]) == 0
    said = capsys.readouterr()
    assert said.err == "" and "6 designs, 0 of which failed" in said.out
    out = tmp_path / "study"
    assert sorted(path.name for path in out.iterdir()) == [
        ".written",
        "answer.png",
        "around.parquet",
        "effects.parquet",
        "effects.png",
        "effects_all.png",
        "heatmaps.png",
        "pareto.parquet",
        "ranking.md",
        "report.html",
        "sobol.parquet",
        "study.json",
        "table.parquet",
    ]
    table = pq.read_table(out / "table.parquet")
    assert table["design"].to_pylist() == list(range(6))
    assert table["loops"].to_pylist() == [1.0, 2.0] * 3
    ranking = (out / "ranking.md").read_text()
    assert "exact over the grid of 6 designs" in ranking
    assert all(METRICS[name].meaning in ranking for name in metrics)
    best = pq.read_table(out / "pareto.parquet")["design"].to_pylist()
    rows = [line for line in ranking.splitlines() if line.startswith("| ")]
    starred = [int(row.split()[1][:-1]) for row in rows if row.split()[1][-1] == "*"]
    assert sorted(starred) == best != []
    around = pq.read_table(out / "around.parquet").to_pylist()
    assert {(row["metric"], row["variable"]) for row in around} == {
        (name, variable)
        for name in ("slack_margin", "peak_tension")
        for variable in ("friction", "loops")
    }
    for told in (ranking, (out / "report.html").read_text()):
        assert "tried" in told and "promised" in told
    effects = pq.read_table(out / "effects.parquet").to_pylist()
    slack = {
        (row["variable"], row["value"]): row["mean"]
        for row in effects
        if row["metric"] == "slack_margin"
    }
    assert slack["friction", "0.05"] == pytest.approx(
        sum(table["slack_margin"].to_pylist()[:2]) / 2
    )

    capsys.readouterr()
    assert cli.main(["whatif-show", "study", "4"]) == 0
    told = dict(line.split()[:2] for line in capsys.readouterr().out.splitlines()[:6])
    assert list(told) == ["friction", "loops", *metrics]
    # Of a task that asks for nothing so early.
    assert told.pop("efficiency") == "-"
    assert table["efficiency"].null_count == 6
    for name, number in told.items():
        assert float(number) == pytest.approx(table[name][4].as_py(), rel=1e-3)
    assert sorted(p.name for p in (out / "design-4").iterdir()) == sorted(EPISODE_FILES)
    log = EpisodeLog.read(out / "design-4" / "log.parquet")
    assert log.metadata["variables"] == {"friction": 0.2, "loops": 1.0}
    assert cli.main(["whatif-show", "study", "6"]) == 2
    assert "designs 0 to 5, not 6" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
def test_what_was_done_is_kept_until_it_is_asked_for_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["whatif", "--vary", "friction=0.1,0.2", "--duration", "0.2", "--metric"]
    words += ["slack_margin", "--trajectory", "sine", "--out", "study"]
    kept = "2 of 2 designs kept; --again runs them anew."
    assert cli.main(words) == 0 and kept not in capsys.readouterr().out
    written = Path("study/table.parquet").stat().st_mtime_ns
    before = {path.name: path.read_bytes() for path in Path("study").iterdir()}
    assert cli.main(words) == 0 and kept in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in Path("study").iterdir()} == before
    assert Path("study/table.parquet").stat().st_mtime_ns == written
    assert cli.main([*words, "--again"]) == 0
    assert kept not in capsys.readouterr().out
    assert Path("study/table.parquet").stat().st_mtime_ns > written


@pytest.mark.usefixtures("undrawn")
def test_a_file_of_designs_and_no_objectives(tmp_path: Path) -> None:
    rows = "".join(f"{0.05 + 0.01 * i},2:{0.2 + 0.01 * (i % 3)}\n" for i in range(12))
    Path("mine.csv").write_text("friction,conduit\n" + rows)
    words = ["whatif", "--designs", "mine.csv", "--duration", "0.4", "--metric"]
    words += ["slack_margin", "--trajectory", "sine", "--out", "study"]
    assert cli.main(words) == 0
    ranking = (tmp_path / "study" / "ranking.md").read_text()
    assert "No objectives were given" in ranking
    assert "thin-plate spline fitted to 12 designs" in ranking


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        (["--vary", "friction"], "VARIABLE=VALUES"),
        (["--vary", "friction=1", "--vary", "friction=2"], "twice"),
        (["--vary", "friction=0.1", "--workers", "-1"], "--workers"),
        (["--designs", "none.csv"], "cannot read the designs none.csv"),
        (["--vary", "friction=0.1", "--around"], "goes by an --objective"),
        (["--vary", "friction=0.1,0.1"], "is given 0.1 more than once"),
        (
            ["--vary", "friction=0:1", "--optimise", "0", *GOAL],
            "at least 1 design, not 0",
        ),
        ([], "neither `vary`"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    words: list[str], wrong: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["whatif", *words]) == 2
    said = capsys.readouterr()
    assert wrong in said.err and said.err.count("\n") == 1
    assert not Path("runs").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_report_that_a_user_has_changed_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["whatif", "wrist", "--duration", "0.1", "--out", "study"]
    words += ["--vary", "friction=0.1,0.2", "--metric", "rms_torque_error"]
    assert cli.main(words) == 0
    assert "2 designs from the best to the worst give" in Path(
        "study/ranking.md"
    ).read_text(encoding="utf-8")
    assert cli.main(words) == 0
    capsys.readouterr()
    Path("study/heatmaps.png").write_text("my own")
    for more in ([], ["--again"]):
        assert cli.main([*words, *more]) == 2
        assert "heatmaps.png is not as an earlier run" in capsys.readouterr().err
    assert Path("study/heatmaps.png").read_text() == "my own"
