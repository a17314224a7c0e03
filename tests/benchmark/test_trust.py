"""Integrity of benchmark results against changes by an entrant."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cc_mujoco import cli
from cc_mujoco._utils.provenance import read_provenance, with_provenance
from cc_mujoco.benchmark import SUITES, BenchmarkPlan, Cell, _runner, play, run
from cc_mujoco.benchmark._cell import prepare_episodes
from cc_mujoco.benchmark._plant import new_key, sample_plants
from cc_mujoco.benchmark._results import (
    _digest,
    join_results,
    read_results,
    write_results,
)
from cc_mujoco.benchmark._runner import CELLS_FOLDER
from cc_mujoco.benchmark._user_entry import controller_provenance
from cc_mujoco.errors import CableError

SHORT = BenchmarkPlan(
    ("none",), scenes=("wrist",), conditions=("ordinary-rough",), seeds=2, duration=1.05
)
CHEAT = "benchmark.entries:cheat"
UNTIMED = (1e-6, 2e-6)


def test_an_entry_changes_neither_its_own_scores_nor_the_judge() -> None:
    """It commands no torque, so its scores are those of a motor without current."""
    usual = next(c for c in SUITES["v1"].conditions("wrist") if c.usual)
    usual = dataclasses.replace(usual, duration=1.05)
    honest = play(Cell(usual, "motor-off", (0, 1)))
    cheated = play(Cell(usual, CHEAT, (0, 1)))
    again = play(Cell(usual, "motor-off", (0, 1)))
    for name, values in honest.scores.items():
        assert np.array_equal(values, cheated.scores[name], equal_nan=True)
        assert np.array_equal(values, again.scores[name], equal_nan=True)
    assert honest.scores["rms_torque_error"].min() > 0.1
    assert "entries.py" in "".join(controller_provenance(CHEAT)["files"])


LINUX = pytest.mark.skipif(sys.platform != "linux", reason="Linux does it")


def entered(name: str, **changes: Any) -> Cell:
    """Return a short cell of an entry of `entries.py`."""
    usual = next(c for c in SUITES["v1"].conditions("wrist") if c.usual)
    usual = dataclasses.replace(usual, duration=1.05)
    return Cell(usual, f"benchmark.entries:{name}", **changes)


@LINUX
def test_an_entry_reaches_neither_its_judge_nor_files_nor_what_it_left_before() -> None:
    for _ in range(2):
        with pytest.raises(CableError, match=r"seed 0: .* ways: \[\]"):
            play(entered("prying"))
    assert not Path("left").exists()


@LINUX
def test_the_process_of_an_entry_holds_beliefs_and_no_number_of_the_plant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = entered("scanning")
    (drawn,) = sample_plants(cell.condition, (0,))
    made = prepare_episodes([dataclasses.replace(cell, controller="none")])
    names = "friction", "axial_stiffness", "pretension"
    actual = drawn.plant.cables["flexor"]
    believed = made.drives[0][0].cables[0].cable
    numbers = [getattr(cable, n) for cable in (actual, believed) for n in names]
    searched = np.array([*numbers, drawn.bias[0][0]]).view(np.uint64)
    (searched ^ np.uint64(0x5A5A5A5A5A5A5A5A)).tofile(tmp_path / "searched")
    monkeypatch.setenv("SEARCHED", str(tmp_path / "searched"))
    with pytest.raises(CableError, match=r"held: \[3, 4, 5\]"):
        play(cell)


def test_no_entry_reads_finished_cells_while_the_key_is_secret(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_runner, "time_steps", lambda _: UNTIMED)
    monkeypatch.setenv("CELLS", str(tmp_path / CELLS_FOLDER))
    plan = dataclasses.replace(
        SHORT, controllers=("benchmark.entries:reading",), seeds=1
    )
    assert len(run(dataclasses.replace(plan, key=new_key()), tmp_path)) == 6
    for cell in (tmp_path / CELLS_FOLDER).iterdir():
        cell.unlink()
    with pytest.raises(CableError, match="finished: wrist-"):
        run(plan, tmp_path)  # whose plants are known


@LINUX
def test_the_judge_measures_the_time_of_a_step_whatever_the_entry_says() -> None:
    median, _ = _runner.time_steps(entered("idle"))
    assert 0.8e-3 < median < 2e-3  # of processor time, so not of other processes
    assert 0.0 < _runner.time_steps(entered("strong"))[0] < 1e-3


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a results file with two seeds that the entrant did not choose."""
    plan = dataclasses.replace(SHORT, first_seed=7)
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_runner, "time_steps", lambda _: UNTIMED)
        found = run(plan, folder)
    assert (folder / CELLS_FOLDER).is_dir()
    path = folder / "results.parquet"
    write_results(path, found, plan.suite, controller_provenance(*plan.controllers))
    return path


def test_a_file_is_verified_by_random_rows(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pq.read_table(results)["seed"].to_pylist() == [7, 8] * 5
    assert cli.main(["benchmark", "--verify", str(results), "--rows", "2"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("2 random rows of 10, and with them all ")
    assert said.endswith("are what a replay gives, bit for bit.\n")
    assert cli.main(["benchmark", "--verify", str(results), "--rows", "11"]) == 2


def rewritten(
    path: Path,
    change: Callable[[str, list[Any]], list[Any]],
    *,
    signed: bool,
    **told: Any,
) -> Path:
    """Write a copy with changed columns, and a digest that fits where `signed`."""
    table = pq.read_table(path)
    about = read_provenance(table) | told
    table = pa.table({n: change(n, table[n].to_pylist()) for n in table.column_names})
    if signed:
        about["digest"] = _digest(table, about)
    other = path.with_name("changed.parquet")
    pq.write_table(with_provenance(table, about), other)
    return other


@pytest.mark.parametrize("column", ["rms_torque_error", "error", "failed", "seed"])
def test_an_edited_file_is_refused(results: Path, column: str) -> None:
    def edit(name: str, values: list[Any]) -> list[Any]:
        return [*values[:-1], values[-1] * 2 + 1] if name == column else values

    path = rewritten(results, edit, signed=False)
    with pytest.raises(CableError, match="was changed after it was written"):
        read_results(path)
    with pytest.raises(CableError, match="was changed after it was written"):
        read_results(rewritten(results, lambda name, v: v[::-1], signed=False))


def test_a_forged_file_is_found_out_by_a_replay(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def better(name: str, values: list[Any]) -> list[Any]:
        return [0.5 * v for v in values] if name == "rms_torque_error" else values

    path = rewritten(results, better, signed=True)
    assert cli.main(["benchmark", "--verify", str(path), "--rows", "1"]) == 2
    said = capsys.readouterr().err
    assert "is not what a replay gives: rms_torque_error of" in said

    def flattering(name: str, values: list[Any]) -> list[Any]:
        return [0.0 for _ in values] if name == "error" else values

    path = rewritten(results, flattering, signed=True)
    assert cli.main(["benchmark", "--verify", str(path), "--rows", "1"]) == 2
    assert "its RMS errors make it" in capsys.readouterr().err


def test_files_of_other_seeds_are_not_compared(results: Path) -> None:
    def later(name: str, values: list[Any]) -> list[Any]:
        return [v + 1 for v in values] if name == "seed" else values

    one, other = (
        read_results(results),
        read_results(rewritten(results, later, signed=True)),
    )
    assert len(join_results(one, one)[0]) == 1
    with pytest.raises(CableError, match="--first-seed"):
        join_results(one, other)

    def one_later(name: str, values: list[Any]) -> list[Any]:
        return [*values[:-1], 9] if name == "seed" else values

    with pytest.raises(CableError, match="has not played the conditions and seeds of"):
        read_results(rewritten(results, one_later, signed=True))


def test_a_plant_of_a_run_with_a_key_follows_from_no_seed_alone() -> None:
    usual = next(c for c in SUITES["v1"].conditions("ankle") if c.usual)
    key, other = new_key(), new_key()
    assert key != other and len(key) == 32
    plain, again, keyed, secret = (
        sample_plants(usual, (3,), own)[0] for own in ("", "", key, other)
    )
    assert plain == again
    assert keyed == sample_plants(usual, (3,), key)[0]
    for one, two in ((plain, keyed), (keyed, secret)):
        assert one.plant.cables != two.plant.cables
        assert one.seed != two.seed and one.bias != two.bias
    # Trying them all, as an entry could try those of a suite, never ends.
    assert plain.seed < 2**32 and min(keyed.seed, secret.seed) > 2**64
    for wrong in ("5", key.upper() + "0", "g" * 32):
        with pytest.raises(CableError, match="32 hexadecimal digits"):
            dataclasses.replace(SHORT, key=wrong).cells()


@pytest.mark.skipif(sys.platform != "linux", reason="others have no /proc")
@pytest.mark.parametrize("joined", [False, True], ids=["words", "joined"])
def test_no_entry_reads_seeds_or_key_off_the_command_line(joined: bool) -> None:
    secret = {"--key": new_key(), "--first-seed": "83017", "--seeds": "250"}
    given = [part for pair in secret.items() for part in pair]
    if joined:
        given = [f"{name}={value}" for name, value in secret.items()]
    judge = (
        "import sys; from cc_mujoco.benchmark import _user_entry as entry; "
        f"entry.blank_command_line(*{[*secret]}); print(sys.argv[1:], flush=True); "
        "input()"
    )
    command = [sys.executable, "-c", judge, "wrist", *given, "--out", "runs/ü"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        own = process.stdout.readline()
        seen = Path(f"/proc/{process.pid}/cmdline").read_bytes().decode()
        process.stdin.write("\n")
    assert repr(given).strip("[]") in own  # it still has its own words
    words = seen.partition("wrist")[2]
    assert words.endswith("--out\0runs/ü\0") and all(name in words for name in secret)
    assert not any(value in words for value in secret.values())


@pytest.mark.usefixtures("undrawn")
def test_the_key_of_a_run_is_published_in_its_results_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(_runner, "time_steps", lambda _: UNTIMED)
    command = [
        "benchmark", "wrist", "--conditions", "ordinary-rough", "--seeds",
        "1", "--duration", "1.05", "--controllers", CHEAT, "--workers", "1",
    ]  # fmt: skip
    file, found = tmp_path / "results.parquet", []
    for _ in range(2):  # the second run keeps the cells of the first
        key = ["--key", *found] if found else []
        assert cli.main([*command, "--out", str(tmp_path), *key]) == 0
        said = capsys.readouterr()
        found.append(read_results(file)[1]["key"])
        assert f"key:        {found[-1]}" in said.out
        for cell in (tmp_path / CELLS_FOLDER).iterdir():
            assert found[-1].encode() not in cell.read_bytes()
    assert found[0] == found[1]
    assert "6 of 6 cells kept" in said.out
    verify = ["benchmark", "--verify", str(file), "--allow", CHEAT, "--rows", "1"]
    assert cli.main(verify) == 0
    other = rewritten(file, lambda _, values: values, signed=True, key=new_key())
    with pytest.raises(CableError, match="different secret keys"):
        join_results(read_results(file), read_results(other))


ORPHAN = """
import os, subprocess, sys
child = "import os, threading; from cc_mujoco.benchmark import _user_entry as own; "
child += "threading.Thread(target=own._end_with_parent, daemon=True).start(); "
child += "print(os.getpid(), flush=True)\\nwhile True: pass"
process = subprocess.Popen([sys.executable, "-c", child], stdout=subprocess.PIPE)
print(process.stdout.readline().decode().strip(), flush=True)
os._exit(0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_an_entry_that_never_returns_ends_with_its_judge() -> None:
    judge = [sys.executable, "-c", ORPHAN]
    child = subprocess.run(judge, capture_output=True, text=True, check=True).stdout
    place = Path("/proc") / child.strip()
    until = time.monotonic() + 10.0
    while place.exists() and time.monotonic() < until:
        time.sleep(0.05)
    assert not place.exists()
