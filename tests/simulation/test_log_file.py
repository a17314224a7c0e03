"""A log that is written while its episode runs: the same bits, in constant memory."""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from cc_mujoco import Plant, simulate
from cc_mujoco.errors import CableError
from cc_mujoco.metrics import METRICS, expand_cable_metrics, measure
from cc_mujoco.simulation import EpisodeLog, columns_for, log_file
from cc_mujoco.simulation import _episode_log as episode_log
from cc_mujoco.simulation._episode_log import _FileColumns

NODES = 5
PIECE = 512
"""Rows of a piece."""
METRIC_NAMES = ("rms_torque_error", "slack_margin", "slack_time_{cable}")


def sample(step: int) -> dict[str, Any]:
    """Return made-up columns of a control step."""
    value = np.sin(0.01 * step)
    row: dict[str, Any] = {c.name: value for c in columns_for(("one",))}
    row["time_s"] = 0.001 * step
    row["qpos"] = np.array([value, -value])
    row["tension_one_nodes_n"] = np.maximum(value + 0.1 * np.arange(NODES), 0.0)
    row["slip_one_direction"] = np.sign(np.arange(NODES - 1) - step % 3)
    return row


def write(path: Path, steps: int) -> EpisodeLog:
    with log_file(path, ("one",), {"scene": "made up"}) as file:
        for step in range(steps):
            file.keep(step, sample(step), None)
    return EpisodeLog.open(path)


@pytest.mark.parametrize("device", ["wrist", "exosuit"])
def test_episode_in_a_file_has_the_bits_and_bytes_of_one_in_memory(
    tmp_path: Path, device: str
) -> None:
    kept = simulate(device, "pi", duration=0.2)
    opened = simulate(device, "pi", duration=0.2, file=tmp_path / "run.parquet")
    kept.write(tmp_path / "kept.parquet")
    assert opened == kept
    assert (opened.axes, opened.prefixes) == (kept.axes, kept.prefixes)
    assert kept == opened
    assert len(opened) == 201
    written = [
        (tmp_path / name).read_bytes() for name in ("run.parquet", "kept.parquet")
    ]
    assert written[0] == written[1]


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write pieces of few rows."""
    monkeypatch.setattr(episode_log, "PIECE_ROWS", PIECE)


@pytest.mark.usefixtures("small_pieces")
def test_long_log_reads_the_same_in_parts(tmp_path: Path) -> None:
    steps = 2 * PIECE + 100
    log = write(tmp_path / "log.parquet", steps)
    whole = EpisodeLog.read(tmp_path / "log.parquet")
    assert len(log) == steps
    assert log == whole
    samples = np.array([0, 7, PIECE - 1, PIECE, steps - 1])
    for name in ("time_s", "tension_one_nodes_n", "slip_one_direction"):
        assert np.array_equal(np.concatenate([*log.pieces(name)]), whole[name])
        assert max(len(piece) for piece in log.pieces(name)) == PIECE
        for one in (log, whole):
            assert np.array_equal(one.rows(name, samples), whole[name][samples])
            thin = one.thinned(100)
            assert len(thin) <= 100
            assert np.array_equal(thin[name], whole[name][:: math.ceil(steps / 100)])
            assert np.array_equal(thin.rows(name, samples[:2]), thin[name][samples[:2]])
    assert whole.thinned(steps) is whole
    metrics = [METRICS[name] for name in METRIC_NAMES]
    chosen = expand_cable_metrics(metrics, log.cables)
    assert measure(log, chosen) == measure(whole, chosen)
    whole.write(tmp_path / "again.parquet")
    log.write(tmp_path / "copy.parquet")
    for name in ("again", "copy"):
        again = (tmp_path / f"{name}.parquet").read_bytes()
        assert again == (tmp_path / "log.parquet").read_bytes()


def test_memory_does_not_grow_with_the_duration(tmp_path: Path) -> None:
    def peak(do: Callable[[], object]) -> int:
        tracemalloc.start()
        before = pa.total_allocated_bytes()
        most = 0
        try:
            do()
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        for _ in range(500):  # threads of Arrow release it a little later
            if pa.total_allocated_bytes() - before < 1e6:
                return most
            time.sleep(0.01)
        raise AssertionError("Arrow keeps memory")

    def used(pieces: int) -> tuple[int, int]:
        path = tmp_path / f"{pieces}.parquet"
        rows = {
            name: np.repeat(np.asarray(value)[None], episode_log.PIECE_ROWS, axis=0)
            for name, value in sample(1).items()
        }
        rows["slip_one_direction"] = rows["slip_one_direction"].astype(np.int8)

        def record() -> None:
            with log_file(path, ("one",), {}) as file:
                for _ in range(pieces):
                    file.append(rows)

        def read() -> None:
            log = EpisodeLog.open(path)
            for column in log.schema:
                for _ in log.pieces(column.name):
                    pass
                log.thinned(1000)[column.name]

        return peak(record), peak(read)

    used(1)  # imports
    short, long = used(2), used(12)
    for few, many in zip(short, long, strict=True):
        assert many < few + 0.5e6


@pytest.mark.usefixtures("small_pieces")
def test_file_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    with (
        pytest.raises(KeyboardInterrupt),
        log_file(path, ("one",), {}) as file,
    ):
        for step in range(PIECE + 1):
            file.keep(step, sample(step), None)
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(CableError, match="nothing was recorded"):
        write(path, 0)
    assert list(tmp_path.iterdir()) == []
    old = write(path, 3)["time_s"]
    with pytest.raises(CableError, match="nothing was recorded"):
        write(path, 0)
    assert np.array_equal(EpisodeLog.open(path)["time_s"], old)
    with pytest.raises(CableError, match=r"must end in \.parquet"):
        write(tmp_path / "notes.txt", 3)


def test_file_is_for_one_plant(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="file takes the log of one plant"):
        simulate([Plant("wrist")], duration=0.01, file=tmp_path / "a")  # type: ignore[call-overload]


def test_an_axis_reads_no_column_but_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = simulate("exosuit", "pi", duration=0.05, file=tmp_path / "run.parquet")
    read: list[str] = []
    columns = log._columns
    assert isinstance(columns, _FileColumns)
    whole = columns.rows

    def noted(name: str, *rest: Any) -> Any:
        read.append(name)
        return whole(name, *rest)

    monkeypatch.setattr(columns, "rows", noted)
    axis = log.axis("ankle")
    cable = axis.cables[0]
    pieces = [*axis.pieces(f"tension_{cable}_nodes_n")]
    assert len(axis["joint_torque_nm"]) == len(axis["time_s"]) == len(pieces[0])
    wanted = [f"tension_{cable}_nodes_n", "ankle.joint_torque_nm", "time_s"]
    assert read == wanted
    assert METRICS["slack_margin"].compute(axis) >= 0.0
