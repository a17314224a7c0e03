"""A study on a Dask cluster: workers that die, lag behind, or are none at all."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import cli
from cc_mujoco._workers import cluster as connecting
from cc_mujoco.benchmark import BenchmarkPlan as Benchmark
from cc_mujoco.benchmark import run as play_all
from cc_mujoco.design import Execution, Plan, StudySpec, carry_out, make_plan

pytestmark = [
    pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not here"),
    pytest.mark.filterwarnings("ignore"),  # of Dask and Tornado, none of ours
]

HOME = Path(cc_mujoco.__file__).parents[1]
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


class Cluster:
    """A scheduler, and workers as they are asked for."""

    def __init__(self, folder: Path) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []
        self._folder, self._file = folder, folder / "scheduler.json"
        self._start("dask_scheduler", HOME, "--port", "0")
        with self.client() as client:
            self.address = client.scheduler.address

    def work(self, *homes: Path) -> None:
        """Start a worker that finds its modules in these folders, and await it."""
        with self.client() as client:
            workers = len(client.nthreads())
            self._start("dask_worker", *homes, "--nthreads", "1", "--no-nanny")
            client.wait_for_workers(workers + 1, timeout=90)

    def stop(self, first: int) -> None:
        """Stop all processes from this one on, the scheduler being 0."""
        for process in self.processes[first:]:
            process.kill()
            process.wait()
        del self.processes[first:]

    def client(self) -> Any:
        import distributed  # takes long, and every worker collects this file

        return distributed.Client(scheduler_file=str(self._file), timeout="60s")

    def _start(self, module: str, *words: str | Path) -> None:
        options = [word for word in words if isinstance(word, str)]
        command = [sys.executable, "-P", "-m", f"distributed.cli.{module}", *options]
        command += ["--host", "127.0.0.1", "--no-dashboard"]
        command += ["--scheduler-file", str(self._file)]
        homes = os.pathsep.join(str(word) for word in words if isinstance(word, Path))
        environment = {
            **os.environ, "PYTHONPATH": homes, "OPENBLAS_NUM_THREADS": "1",
            # Not the 30 s in which Dask tries to reach a worker that was killed.
            "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s",
        }  # fmt: skip
        self.processes.append(
            subprocess.Popen(command, cwd=self._folder, env=environment, **QUIET)
        )


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Without workers as yet."""
    started = Cluster(tmp_path_factory.mktemp("cluster"))
    yield started
    started.stop(0)


@pytest.fixture
def cluster(
    served: Cluster, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Cluster]:
    """With one worker, of the same code; rid of what a test adds to it."""
    if len(served.processes) == 1:
        laws = tmp_path_factory.mktemp("laws")
        _write_law(laws, 0.1)
        served.work(HOME, laws)
    yield served
    served.stop(2)
    with served.client() as client:
        while len(client.nthreads()) > 1:
            time.sleep(0.01)


def _write_law(folder: Path, gain: float) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "law_of_mine.py").write_text(
        f"def make(drive):\n    return lambda seen: {gain} * seen['joint_angle_rad']\n"
    )


def _plan() -> Plan:
    return make_plan(
        StudySpec(
            "wrist",
            {"friction": "0.05:0.2:8", "loops": [1, 2]},
            duration=0.2,
            metrics=("rms_torque_error", "slack_margin"),
        )
    )


Asked = Callable[..., str]


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Asked:
    """Return a function that runs a study and returns the sentence that refuses it."""

    def ask(address: str, *words: str) -> str:
        arguments = ["whatif", "--vary", "friction=0.1,0.2", "--duration", "0.2"]
        arguments += ["--metric", "rms_torque_error", "--scheduler", address]
        arguments += ["--out", str(tmp_path / "refused"), *words]
        assert cli.main(arguments) == 2
        *before, said = capsys.readouterr().err.splitlines()
        assert said.startswith("cc-mujoco: ")
        assert all(line.startswith("timing ") for line in before)
        return said

    return ask


def test_no_workers_are_not_waited_for_without_end(
    served: Cluster, refusal: Asked
) -> None:
    served.stop(1)
    with served.client() as client:
        while client.nthreads():
            time.sleep(0.01)
    started = time.monotonic()
    said = refusal(served.address, "--worker-timeout", "1")
    assert "no worker for 1 s; start one with `dask worker tcp://" in said
    assert time.monotonic() - started < 15.0


def test_a_killed_worker_loses_nothing(tmp_path: Path, cluster: Cluster) -> None:
    cluster.work(HOME)
    plan = _plan()
    expected = carry_out(plan)
    killed: list[float] = []

    def kill(done: float) -> None:
        if done >= len(plan.designs) / 2 and not killed:
            killed.append(done)
            cluster.processes[-1].kill()

    started = time.monotonic()
    table = carry_out(
        plan, tmp_path / "s", Execution(scheduler=cluster.address), progress=kill
    )
    assert killed and killed[0] < len(plan.designs)
    assert cluster.processes[-1].wait(timeout=10) != 0
    assert table.equals(expected)
    assert time.monotonic() - started < 120


def test_cases_have_the_same_bytes_on_a_cluster(
    tmp_path: Path, cluster: Cluster
) -> None:
    plan = make_plan(
        StudySpec(
            "ankle",
            {"friction": [0.05, 0.1]},
            duration=0.2,
            metrics=["rms_torque_error", "slack_margin"],
            across={"wearer": [0.5, 2.0], "gait_speed": [0.9, 1.3]},
            rank="p90",
        )
    )
    carry_out(plan, tmp_path / "here")
    carry_out(plan, tmp_path / "there", Execution(scheduler=cluster.address))
    here, there = (
        (tmp_path / place / "table.parquet").read_bytes() for place in ("here", "there")
    )
    assert here == there


@pytest.fixture
def other_code(tmp_path: Path) -> Path:
    """Return a copy of the package with one metric doubled."""
    home = tmp_path / "other"
    for name in ("cc_mujoco", "envs", "assets"):
        shutil.copytree(HOME / name, home / name)
    path = home / "cc_mujoco" / "metrics" / "_formulas.py"
    text = path.read_text()
    path.write_text(text.replace("return found", "return 2.0 * found", 1))
    assert path.read_text() != text
    return home


@pytest.fixture
def no_package(tmp_path: Path) -> Path:
    """Return a folder in which the package cannot be imported."""
    home = tmp_path / "bare"
    home.mkdir()
    (home / "cc_mujoco.py").write_text("raise ImportError('it is not here')\n")
    return home


@pytest.mark.study
def test_a_worker_without_the_package_is_refused(
    cluster: Cluster, refusal: Asked, no_package: Path
) -> None:
    cluster.work(no_package)
    why = "cannot import this version of cc_mujoco (it is not here)"
    assert why in refusal(cluster.address)


@pytest.mark.study
def test_a_worker_of_other_code_is_refused_that_joins_later_or_is_there(
    tmp_path: Path, cluster: Cluster, other_code: Path, refusal: Asked
) -> None:
    def join(done: float) -> None:
        if done and len(cluster.processes) == 2:
            # Else the first worker might be done before the other has joined.
            cluster.processes[1].send_signal(signal.SIGSTOP)
            try:
                cluster.work(other_code)
            finally:
                cluster.processes[1].send_signal(signal.SIGCONT)

    plan, why = _plan(), "differs in the sources of cc_mujoco"
    with pytest.raises(ValueError, match=why):
        carry_out(
            plan, tmp_path / "s", Execution(scheduler=cluster.address), progress=join
        )
    assert why in refusal(cluster.address)


def test_the_controller_of_a_worker_is_that_of_the_client(
    tmp_path: Path,
    cluster: Cluster,
    refusal: Asked,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, gain in (("here", 0.1), ("other", 0.2)):
        _write_law(tmp_path / name, gain)
    monkeypatch.chdir(tmp_path / "here")
    plan = make_plan(
        StudySpec(
            "wrist",
            {"loops": [1, 2]},
            duration=0.2,
            controllers=["law_of_mine:make"],
            metrics=["rms_torque_error"],
        )
    )
    assert carry_out(plan, execution=Execution(scheduler=cluster.address)).equals(
        carry_out(plan)
    )
    monkeypatch.delitem(sys.modules, "law_of_mine")
    monkeypatch.chdir(tmp_path / "other")
    words = ("--controllers", "law_of_mine:make")
    assert "differs in law_of_mine.py" in refusal(cluster.address, *words)


@pytest.mark.parametrize("greeting", [b"SSH-2.0-OpenSSH_9.6\r\n", b"HTTP/1.1 400\r\n"])
def test_another_protocol_is_one_sentence(greeting: bytes, refusal: Asked) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def greet() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                with connection:
                    connection.sendall(greeting)
                    connection.recv(1)

        threading.Thread(target=greet, daemon=True).start()
        started = time.monotonic()
        said = refusal(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        assert "no Dask scheduler answers at tcp://127.0.0.1:" in said
        assert time.monotonic() - started < 10.0


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "127.0.0.1:9", "nowhere", "tcp://", "ftp://a:1"]
)
def test_a_wrong_address_is_one_sentence(
    address: str, refusal: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert connecting.CONNECT_TIMEOUT <= 5.0
    monkeypatch.setattr(connecting, "CONNECT_TIMEOUT", 0.5)
    started = time.monotonic()
    assert f"no Dask scheduler answers at {address}" in refusal(address)
    assert time.monotonic() - started < 5.0


def test_a_benchmark_plays_on_a_cluster_as_it_does_here(
    tmp_path: Path, cluster: Cluster
) -> None:
    plan = Benchmark(("none",), "v1", ("wrist",), ("ordinary-rough",), 1, duration=1.05)
    here = play_all(plan, tmp_path / "a")
    there = play_all(plan, tmp_path / "b", scheduler=cluster.address)
    for (one, found), (other, same) in zip(here, there, strict=True):
        assert one == other
        for name, mine in found.scores.items():
            assert np.array_equal(mine, same.scores[name], equal_nan=True)


def test_a_worker_is_no_scheduler(cluster: Cluster, refusal: Asked) -> None:
    with cluster.client() as client:
        (address,) = client.nthreads()
    assert "no Dask scheduler but a Worker" in refusal(address)


@pytest.mark.study
def test_a_scheduler_that_dies_is_one_sentence_and_a_new_one_goes_on(
    tmp_path: Path,
) -> None:
    plan = _plan()
    first, second = (tmp_path / name for name in ("first", "second"))
    clusters: list[Cluster] = []

    def begin(folder: Path) -> str:
        folder.mkdir()
        clusters.append(Cluster(folder))
        clusters[-1].work(HOME)
        return clusters[-1].address

    def kill(done: float) -> None:
        if done:
            clusters[0].processes[0].kill()

    try:
        address = begin(first)
        with pytest.raises(ValueError, match="gave up a piece of the work") as told:
            carry_out(plan, tmp_path / "s", Execution(scheduler=address), progress=kill)
        assert "\n" not in str(told.value) and address in str(told.value)
        kept = len(list((tmp_path / "s" / "parts").iterdir()))
        assert 0 < kept < len(plan.batches)
        table = carry_out(plan, tmp_path / "s", Execution(scheduler=begin(second)))
    finally:
        for each in clusters:
            each.stop(0)
    assert table.equals(carry_out(plan))


@pytest.mark.study
def test_a_worker_that_lags_behind_is_waited_for_and_the_others_go_on(
    tmp_path: Path, cluster: Cluster
) -> None:
    cluster.work(HOME)
    plan, reached = _plan(), []

    def lag(done: float) -> None:
        reached.append(done)
        if done and len(reached) == 2:
            slow = cluster.processes[-1]
            slow.send_signal(signal.SIGSTOP)
            threading.Timer(6.0, slow.send_signal, (signal.SIGCONT,)).start()

    table = carry_out(
        plan, tmp_path / "s", Execution(scheduler=cluster.address), progress=lag
    )
    assert table.equals(carry_out(plan))
