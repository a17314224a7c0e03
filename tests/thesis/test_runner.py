"""Runner of experiments: order, lines for claims, unknown names."""

from __future__ import annotations

from pathlib import Path

import pytest

from thesis import reproduce as runner
from thesis._outcome import Finding


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return names of experiments run, in place of which stand-ins find something."""
    names: list[str] = []

    def run(name: str) -> tuple[Finding, ...]:
        names.append(name)
        return (Finding("2.0 N m", "agrees"),) * 3

    monkeypatch.setattr(runner, "run", run)
    return names


def test_experiments_run_in_the_order_of_the_thesis_with_a_line_for_every_claim(
    ran: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    runner.main(["loops", "pretension", "loops"])
    assert ran == ["pretension", "loops"]
    lines = capsys.readouterr().out.splitlines()
    assert [lines[0], lines[4]] == ran
    assert lines[1] == "  agrees     2.4.3, Fig. 2.9: 2.0 N m"
    assert len(lines) == 8


def test_an_unknown_name_runs_nothing(
    ran: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        runner.main(["pretension", "lops"])
    assert "no experiment is called lops" in capsys.readouterr().err
    assert ran == []


def test_every_module_has_an_experiment() -> None:
    folder = Path(runner.__file__).parent / "_experiments"
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert modules == {runner.TOGETHER.get(name, name) for name in runner.EXPERIMENTS}
