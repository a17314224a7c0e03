"""Pieces of a job on processes: each is done once, by fresh interpreters."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cc_mujoco._workers.local_executor import run_here
from jobs import Doubling, Sleeping


def test_processes_do_every_piece_once_and_tell_how_much_is_done() -> None:
    pieces = {number: float(number) for number in range(5)}
    done: list[float] = []
    found = dict(run_here(Doubling(), pieces, done.append, count=2, processes=True))
    assert {number: value for number, (value, _) in found.items()} == {
        number: 2.0 * number for number in pieces
    }
    workers = {process for _, process in found.values()}
    assert os.getpid() not in workers and len(workers) <= 2
    assert done == sorted(done) and done[-1] == 5.0
    (one,) = dict(run_here(Doubling(), {0: 1.0}, processes=True)).values()
    assert one == (2.0, os.getpid())


def test_processes_end_with_the_run_that_wants_them() -> None:
    running = run_here(Sleeping(), {0: 0.0, 1: 600.0}, count=2, processes=True)
    assert next(running) == (0, 0.0)
    begun = time.monotonic()
    running.close()
    assert time.monotonic() - begun < 60.0


PROGRAM = """
import signal
from cc_mujoco._workers.local_executor import run_here
from jobs import Sleeping

if __name__ == "__main__":
    # A shell starts what runs in its background with the signal ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number, _ in run_here(Sleeping(), {0: 0.0, 1: 600.0}, count=2, processes=True):
        print("begun", flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="no signals for a group of processes")
def test_an_interruption_is_told_of_by_the_run_alone(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    started = subprocess.Popen(
        [sys.executable, tmp_path / "program.py"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent)},
        start_new_session=True,
        text=True,
    )
    assert started.stdout is not None
    assert started.stdout.readline() == "begun\n"
    os.killpg(started.pid, signal.SIGINT)
    _, errors = started.communicate(timeout=60.0)
    assert errors.count("Traceback") == 1 and "KeyboardInterrupt" in errors
    assert "SpawnProcess" not in errors
