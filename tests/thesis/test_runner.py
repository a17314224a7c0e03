"""Runner of experiments: resumed runs, complete output, reruns after code changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco.errors import CableError
from thesis import reproduce as runner
from thesis._outcome import Claim, Finding, Outcome, Panel
from thesis.reproduce import reproduce

CLAIM = Claim("Fig. 0", "two", "2.0 N m", "agrees", "a | b")
PANELS = [
    Panel("Loop", "time [s]", "torque [N m]", {"rig": ([0, 1], np.arange(2.0), "o")}),
    Panel("Share", "cable", "share [1]", {"a": (["one", "two"], [1, 2])}, "bar"),
]


class Experiments:
    """Stand-ins for experiments that record their runs."""

    def __init__(self) -> None:
        self.ran: list[str] = []
        self.failing = ""

    def function(self, name: str) -> Any:
        def run(progress: Any) -> Outcome:
            if name == self.failing:
                raise KeyboardInterrupt
            self.ran.append(name)
            progress(0.5)
            return Outcome((Finding(*CLAIM[2:5]),), {"loop": PANELS})

        return run


@pytest.fixture
def experiments(monkeypatch: pytest.MonkeyPatch, undrawn: None) -> Experiments:
    standing_in = Experiments()
    row = dict(zip(Claim._fields, CLAIM, strict=True))
    rows = [{"experiment": name, **row} for name in ("loops", "pretension")]
    monkeypatch.setattr("thesis._outcome.claim_table", lambda: rows)
    monkeypatch.setattr(runner, "function_of", standing_in.function)
    return standing_in


def test_an_experiment_leaves_figure_data_and_claims(
    experiments: Experiments, tmp_path: Path
) -> None:
    shares: list[tuple[str, float]] = []
    (record,) = reproduce(
        ["loops"], tmp_path, progress=lambda name, share: shares.append((name, share))
    )
    assert record.claims == (CLAIM,)
    assert record.fresh
    assert shares == [("loops", 0.0), ("loops", 0.5), ("loops", 1.0)]
    names = {path.name for path in (tmp_path / "loops").iterdir()}
    assert names == {"loop.png", "loop.csv", "result.json"}
    csv = (tmp_path / "loops" / "loop.csv").read_text().splitlines()
    assert csv == [
        "panel,curve,abscissa,ordinate,x,y",
        "Loop,rig,time [s],torque [N m],0,0.0",
        "Loop,rig,time [s],torque [N m],1,1.0",
        "Share,a,cable,share [1],one,1",
        "Share,a,cable,share [1],two,2",
    ]
    summary = (tmp_path / "summary.md").read_text()
    assert "| Fig. 0 | two | 2.0 N m | agrees | a \\| b |" in summary


def test_experiments_run_in_the_order_of_the_thesis_once_each(
    experiments: Experiments, tmp_path: Path
) -> None:
    reproduce(["loops", "pretension", "loops"], tmp_path)
    assert experiments.ran == ["pretension", "loops"]


def test_an_interrupted_run_goes_on_where_it_stopped(
    experiments: Experiments, tmp_path: Path
) -> None:
    experiments.failing = "loops"
    with pytest.raises(KeyboardInterrupt):
        reproduce(["pretension", "loops"], tmp_path)
    assert not (tmp_path / "loops").exists()
    assert "## pretension" in (tmp_path / "summary.md").read_text()
    experiments.failing = ""
    records = reproduce(["pretension", "loops"], tmp_path)
    assert [record.fresh for record in records] == [False, True]
    assert experiments.ran == ["pretension", "loops"]
    reproduce(["pretension", "loops"], tmp_path, again=True)
    assert experiments.ran == ["pretension", "loops"] * 2


def test_results_of_other_code_or_broken_ones_are_not_taken(
    experiments: Experiments, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reproduce(["loops"], tmp_path)
    (tmp_path / "loops" / "result.json").write_text('{"code": "", "claims": [{}]}')
    reproduce(["loops"], tmp_path)
    assert len(experiments.ran) == 2
    monkeypatch.setattr("cc_mujoco._utils.provenance.sources", lambda: "other")
    reproduce(["pretension"], tmp_path)
    assert "differs in the sources" in (tmp_path / "summary.md").read_text()
    said: list[str] = []
    reproduce(["loops", "pretension"], tmp_path, say=said.append)
    assert experiments.ran == ["loops", "loops", "pretension", "loops"]
    assert said == [
        "1 of 2 experiments kept; --again runs them anew. Earlier experiments are "
        "replaced: they differ in the sources of cc_mujoco."
    ]


def test_an_unknown_name_runs_nothing(experiments: Experiments, tmp_path: Path) -> None:
    with pytest.raises(CableError, match="did you mean 'loops'"):
        reproduce(["pretension", "lops"], tmp_path / "out")
    assert experiments.ran == []
    assert not (tmp_path / "out").exists()


def test_command_prints_a_line_for_every_claim_and_resumes(
    experiments: Experiments, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["loops", "pretension", "--out", str(tmp_path)]
    experiments.failing = "loops"
    assert runner.main(words) == 130
    said = capsys.readouterr()
    assert "experiments that were finished are kept" in said.err
    experiments.failing = ""
    assert runner.main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:4] == [
        "1 of 2 experiments kept; --again runs them anew.",
        "pretension  (done before)",
        "  agrees     Fig. 0: 2.0 N m",
        "loops",
    ]
    assert str(tmp_path / "summary.md") in lines[-1]


def test_every_experiment_has_a_function_and_every_module_is_one() -> None:
    folder = Path(runner.__file__).parent / "_experiments"
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert modules == {runner.TOGETHER.get(name, name) for name in runner.EXPERIMENTS}
    for name in runner.EXPERIMENTS:
        assert callable(runner.function_of(name))
