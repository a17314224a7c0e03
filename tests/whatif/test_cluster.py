"""A study on a Dask cluster: a scheduler and two workers, one of which is killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import cc_mujoco
from cc_mujoco.whatif import carry_out, make_plan

distributed = pytest.importorskip("distributed")

pytestmark = pytest.mark.slow

ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": str(Path(cc_mujoco.__file__).parents[1]),
    "OPENBLAS_NUM_THREADS": "1",
}
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Processes to be ended after the test."""
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for process in started:
        process.kill()
        process.wait()


def _start(words: list[str], where: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", "-m", "distributed.cli." + words[0], *words[1:]]
    return subprocess.Popen(command, cwd=where, env=ENVIRONMENT, **QUIET)


@pytest.mark.filterwarnings("ignore")  # of Dask and Tornado, none of ours
def test_a_killed_worker_loses_nothing(
    tmp_path: Path, processes: list[subprocess.Popen[bytes]]
) -> None:
    file = tmp_path / "scheduler.json"
    local = ["--host", "127.0.0.1"]
    processes.append(
        _start(
            ["dask_scheduler", *local, "--port", "0", "--no-dashboard",
             "--scheduler-file", str(file)],
            tmp_path,
        )
    )  # fmt: skip
    for _ in range(2):
        processes.append(
            _start(
                ["dask_worker", *local, "--nthreads", "1", "--no-nanny",
                 "--no-dashboard", "--scheduler-file", str(file)],
                tmp_path,
            )
        )  # fmt: skip
    with distributed.Client(scheduler_file=str(file), timeout="60s") as client:
        client.wait_for_workers(2, timeout=90)
        address = client.scheduler.address

    plan = make_plan(
        "wrist",
        {"friction": "0.05:0.2:16", "loops": [1, 2]},
        duration=1.0,
        metrics=("efficiency", "tracking_error", "slack_margin"),
    )
    expected = carry_out(plan)
    killed: list[float] = []

    def kill(done: float) -> None:
        if done >= len(plan.designs) / 2 and not killed:
            killed.append(done)
            processes[-1].kill()

    started = time.monotonic()
    table = carry_out(plan, tmp_path / "study", scheduler=address, progress=kill)
    assert killed and killed[0] < len(plan.designs)
    assert processes[-1].wait(timeout=10) != 0
    assert table.equals(expected)
    assert time.monotonic() - started < 120
