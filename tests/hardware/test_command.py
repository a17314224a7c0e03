"""`cc-mujoco run` as a process of its own: what it leaves, and what ends it."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.diagnosis import load
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import Readings, RunLog, require_free, watch_for_stop
from cc_mujoco.hardware._loop import SIGNALS
from cc_mujoco.hardware._run_log import RUN_COLUMNS
from cc_mujoco.simulation._log_columns import AXIS_COLUMNS, TIME_COLUMN
from hardware.ends import End, MulticastEnd, UdpEnd
from hardware.fakes import add_row
from hardware.peers import NOWHERE, Peer, toml

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[1])}
WORDS = [sys.executable, "-m", "cc_mujoco.cli"]


@pytest.fixture(params=[UdpEnd, pytest.param(MulticastEnd, marks=pytest.mark.study)])
def end(request: pytest.FixtureRequest) -> Iterable[End]:
    """Yield the rig's end of a link to the process of a host."""
    made: End = request.param()
    yield made
    made.close()


def words(folder: Path, rig: str, duration: float) -> list[str]:
    (folder / "rig.toml").write_text(toml(rig), encoding="utf-8")
    where = ["--rig", str(folder / "rig.toml"), "--out", str(folder / "out")]
    return ["run", *where, "--controller", "pi", "--duration", str(duration)]


def rows(path: Path) -> list[dict[str, float]]:
    """Return all whole lines; a process may be killed in the middle of one."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def about(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / "run.json").read_text())
    return found


def started(peer: Peer, process: subprocess.Popen[str], count: int) -> None:
    """Wait until the rig got so many commands."""
    end = time.monotonic() + 60.0
    while len(peer.commands) < count:
        assert process.poll() is None and time.monotonic() < end
        time.sleep(0.01)


def test_a_run_leaves_its_log_and_how_it_went(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: End
) -> None:
    with Peer(end=end) as peer:
        assert cli.main(words(tmp_path, peer.end.rig, 0.3)) == 0
    said = capsys.readouterr().out
    assert "cycles of 2 ms" in said and "the 0.3 s are over." in said
    found = rows(tmp_path / "out" / "log.csv")
    assert tuple(found[0]) == RUN_COLUMNS
    assert all(np.diff([row["time_s"] for row in found]) > 0.0)
    commands = [row["command_torque_nm"] for row in found]
    assert max(commands) > 0.1
    assert set(commands) <= set(peer.torques)  # what was written, bit for bit
    written = about(tmp_path)
    assert written["outcome"] == "the 0.3 s are over." and written["exit_code"] == 0
    assert written["controller"] == "pi" and 'scene = "bench"' in written["rig"]
    # More where the machine was busy when the time was over.
    assert written["cycles"] + written["missed_cycles"] >= 149
    assert peer.stopped()


def test_a_controller_that_plans_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Peer() as peer:
        given = words(tmp_path, peer.end.rig, 0.05)
        given[given.index("pi")] = "predictive"
        assert cli.main(given) == 0
    assert "it may swing up" in capsys.readouterr().err


def test_a_model_is_refused_where_a_joint_is_not_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = words(tmp_path, NOWHERE, 0.05)
    given[given.index("pi")] = "stiction"
    rig = tmp_path / "rig.toml"
    rig.write_text(rig.read_text().replace('"bench"', '"exosuit"'))
    assert cli.main(given) == 2
    assert (
        "rig.toml needs `axis`, one of hip, ankle, or a table"
        in capsys.readouterr().err
    )
    rig.write_text('axis = "hip"\n' + rig.read_text())
    assert cli.main(given) == 2
    assert "how joint knee winds the cable too" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_columns_are_those_of_an_episode_and_data_for_a_diagnosis(
    tmp_path: Path,
) -> None:
    assert {name for name in RUN_COLUMNS[:8]} <= {
        column.name for column in (TIME_COLUMN, *AXIS_COLUMNS)
    }
    log = RunLog(tmp_path / "out", {}, 50)
    for k in range(1000):
        turn = 0.3 * np.sin(0.02 * k)
        seen = Readings(5.0 + 0.002 * k, turn, 0.0, turn - 1e-3, 0.0, 0.5 * turn)
        add_row(log, seen, 0.6 * turn)
    log.close({})
    dataset, _ = load([tmp_path / "out" / "log.csv"])
    (trial,) = dataset.trials
    assert len(trial.time) == 1000 and trial.time[0] == 0.0


def test_measured_data_are_never_replaced(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "out", {}, 1)
    add_row(log, Readings(0.0, *[0.1] * 5))
    log.close({})
    with pytest.raises(CableError, match="measured data are never replaced"):
        require_free(tmp_path / "out")
    with pytest.raises(CableError, match="measured data are never replaced"):
        RunLog(tmp_path / "out", {}, 1)
    assert cli.main(words(tmp_path, NOWHERE, 0.3)) == 2
    for file in (tmp_path / "out").iterdir():
        file.unlink()
    (tmp_path / "out" / "notes.txt").touch()
    with pytest.raises(CableError, match=r"holds notes\.txt, which no such run wrote"):
        require_free(tmp_path / "out")
    require_free(tmp_path / "out", "motion_01")  # among the trials of a plan


def test_a_log_survives_the_death_of_the_host(tmp_path: Path, end: End) -> None:
    with Peer(end=end) as peer:
        process = subprocess.Popen(
            [*WORDS, *words(tmp_path, peer.end.rig, 60.0)], env=ENVIRONMENT, text=True
        )
        started(peer, process, 200)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        sent = len(peer.commands)
    assert not peer.stopped()
    found = rows(tmp_path / "out" / "log.csv")
    # All but the last block of 50 and what came before the first cycle.
    assert sent >= len(found) >= 100
    assert all(len(row) == len(RUN_COLUMNS) and None not in row for row in found)
    assert about(tmp_path)["outcome"] == "running, or killed"


@pytest.mark.parametrize("count", [49, 50, 1234])
def test_a_log_without_an_end_lacks_less_than_a_block(
    tmp_path: Path, count: int
) -> None:
    log = RunLog(tmp_path / "out", {}, 50)
    for k in range(count):
        add_row(log, Readings(0.002 * k, *[0.1] * 5))
    found = rows(tmp_path / "out" / "log.csv")
    assert len(found) == count - count % 50
    assert all(len(row) == len(RUN_COLUMNS) for row in found)
    log.close({})
    assert len(rows(tmp_path / "out" / "log.csv")) == count


class FullDisk(io.RawIOBase):
    """A file on a disk that takes so many bytes more."""

    def __init__(self, file: io.FileIO, left: int) -> None:
        self._file, self._left = file, left

    def write(self, data: Any) -> int:
        if not self._left:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = self._file.write(data[: self._left]) or 0
        self._left -= done
        return done

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


@pytest.mark.parametrize("left", [0, 1, 4321, 9999])
def test_a_full_disk_leaves_whole_lines_and_the_outcome(
    tmp_path: Path, left: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RunLog(tmp_path / "out", {"duration_s": 1.0}, 50)
    log._file = FullDisk(log._file, left)  # type: ignore[assignment, arg-type]
    path, written = tmp_path / "out" / "log.csv", 0
    seen = Readings(0.0, *[0.1] * 5)
    with pytest.raises(CableError, match=rf"{path} cannot be written: No space left"):
        for k in range(10_000):
            add_row(log, seen._replace(time=0.002 * k))
            written = k
    for k in range(100):  # while the torque goes down
        add_row(log, seen._replace(time=k))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    size = (tmp_path / "out" / "run.json").stat().st_size
    log.close({"outcome": "it is full", "exit_code": 3})
    found = rows(path)
    assert path.read_bytes().endswith(b"\n") and len(found) <= written
    assert all(len(row) == len(RUN_COLUMNS) and None not in row for row in found)
    assert about(tmp_path)["outcome"] == "it is full"
    assert about(tmp_path)["duration_s"] == 1.0
    assert (tmp_path / "out" / "run.json").stat().st_size == size


def test_a_disk_that_is_full_before_the_first_row_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(log: RunLog, data: bytes) -> None:
        raise CableError("cannot be written")

    monkeypatch.setattr(RunLog, "_write", full)
    with pytest.raises(CableError, match="cannot be written"):
        RunLog(tmp_path / "out", {}, 50)
    assert list((tmp_path / "out").iterdir()) == []


def test_a_full_disk_is_exit_code_3_and_names_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: End
) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Peer(end=end) as peer:
        given = words(tmp_path, peer.end.rig, 60.0)
        resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, before[1]))
        try:
            assert cli.main(given) == 3
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    path = tmp_path / "out" / "log.csv"
    said = (
        f"{path} cannot be written: File too large; it ends with its last whole line."
    )
    assert capsys.readouterr().err == f"cc-mujoco: {said}\n"
    assert about(tmp_path)["outcome"] == said
    assert about(tmp_path)["exit_code"] == 3
    assert peer.stopped() and not any(peer.torques[-14:])
    assert 11_000 < path.stat().st_size <= 12_000
    assert all(None not in row for row in rows(path))


def test_an_interruption_takes_the_torque_to_zero(tmp_path: Path, end: End) -> None:
    number = signal.SIGINT
    with Peer(end=end) as peer:
        process = subprocess.Popen(
            [*WORDS, *words(tmp_path, peer.end.rig, 60.0)],
            env=ENVIRONMENT,
            stderr=subprocess.PIPE,
            text=True,
        )
        started(peer, process, 100)
        process.send_signal(number)
        process.send_signal(number)  # a second one changes nothing
        _, said = process.communicate(timeout=60.0)
    assert process.returncode == 128 + number
    assert said == f"cc-mujoco: stopped by {number.name}.\n"
    assert peer.stopped() and not any(peer.torques[-14:])
    steps = np.abs(np.diff(peer.torques))
    assert steps.max() <= 20.0 * 0.002 + 1e-12
    assert max(peer.torques) > 0.05
    assert about(tmp_path)["exit_code"] == 128 + number


def test_a_lost_rig_is_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: End
) -> None:
    with Peer(lambda count, data: [data] if count < 50 else [], end) as peer:
        given = words(tmp_path, peer.end.rig, 5.0)
        (tmp_path / "rig.toml").write_text(
            toml(peer.end.rig).replace(
                "missed_readings = 99999", "missed_readings = 25"
            )
        )
        assert cli.main(given) == 3
    assert capsys.readouterr().err == (
        "cc-mujoco: the rig is silent: no new reading in 25 cycles.\n"
    )


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_signal_counts_and_handlers_come_back(number: int) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    with watch_for_stop() as stop:
        assert stop() is None
        signal.raise_signal(number)
        signal.raise_signal(SIGNALS[0])
        ending = stop()
        assert ending is not None and ending is stop()
    assert ending.code == 128 + number
    assert signal.Signals(number).name in str(ending)
    assert [signal.getsignal(each) for each in SIGNALS] == before


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such terminal")
def test_the_return_key_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    keyboard, terminal = os.openpty()
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with watch_for_stop() as stop:
            assert stop() is None
            os.write(keyboard, b"\n")
            ending = stop()
        assert ending is not None and (ending.code, ending is stop()) == (3, True)
        assert str(ending) == "stopped by the return key."
    os.close(keyboard)
