"""A second process draws the same files, is no duty, and leaves nothing behind."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from cc_mujoco.diagnosis._report import drawer as drawer_module
from cc_mujoco.diagnosis._report.drawer import RECORDING_FILE, Drawer
from cc_mujoco.diagnosis._report.drawings import FIGURE_STEMS, save_figures
from cc_mujoco.diagnosis._report.output import write_report
from diagnosis.report_examples import DIAGNOSES, evidence, isolability

NAMED = DIAGNOSES["named"]
BESIDE = {f"{stem}.png" for stem in FIGURE_STEMS} - {"learned.png"}


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Keep temporary files in a folder, which has to be empty after the test."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setattr(drawer_module, "THREADS", 2)
    yield folder
    assert list(folder.iterdir()) == []


def test_the_process_draws_what_the_caller_would(tmp_path: Path) -> None:
    save_figures(tmp_path, NAMED, evidence())
    out = tmp_path / "out"
    with Drawer() as drawer:
        drawer.start()
        drawer.begin(NAMED.gap, evidence())
        write_report(out, NAMED, evidence(), drawer)
    drawn = {file.name for file in out.iterdir()}
    assert drawn == {*BESIDE, "learned.png", RECORDING_FILE, "report.html"}
    for name in (*BESIDE, "learned.png"):
        assert (out / name).read_bytes() == (tmp_path / name).read_bytes()
    assert drawer._process.returncode == 0


def test_an_interrupt_ends_the_process() -> None:
    with pytest.raises(KeyboardInterrupt), Drawer() as drawer:
        drawer.start()
        drawer.begin(NAMED.gap, evidence())
        raise KeyboardInterrupt
    assert drawer._process.returncode


def test_the_process_ends_with_its_caller(temporary: Path) -> None:
    program = (
        "import os; from cc_mujoco.diagnosis._report import drawer; "
        "drawer.THREADS = 2; own = drawer.Drawer(); own.start(); "
        "print(own._process.pid, own._folder, flush=True); os._exit(1)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    number, folder = done.stdout.split()
    Path(folder).rmdir()
    if Path("/proc").is_dir():
        command = Path("/proc", number, "cmdline")
        while command.exists() and b"drawer" in command.read_bytes():
            pass


@pytest.mark.parametrize("lacks", ["begin", "start", "executable", "core", "name"])
def test_what_the_process_does_not_draw_is_left_to_the_caller(
    lacks: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = evidence()
    if lacks == "executable":
        monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    if lacks == "core":
        monkeypatch.setattr(drawer_module, "THREADS", 1)
    if lacks == "name":  # of an effect of the user
        ids = ("own", *isolability().ids[1:])
        shown = replace(shown, isolability=replace(isolability(), ids=ids))
    with Drawer() as drawer:
        if lacks != "start":
            drawer.start()
        if lacks != "begin":
            drawer.begin(NAMED.gap, shown)
        write_report(tmp_path / "out", NAMED, shown, drawer)
    drawn = {file.name for file in (tmp_path / "out").iterdir()}
    assert drawn == {*BESIDE, "learned.png", "report.html"}


def test_a_process_that_hangs_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawer_module, "_LONGEST", 0.01)
    with Drawer() as drawer:
        drawer.start()
        drawer.begin(NAMED.gap, evidence())
        out = tmp_path / "out"
        out.mkdir()
        drawer.finish(out)
    assert not any(out.iterdir())
