"""The log keeps what it was given, and files are whole or not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cc_mujoco._utils.atomic_io import replacing, replacing_folder
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import EpisodeLog, Recorder, columns_for


def sample(value: float, nodes: int = 3) -> dict[str, Any]:
    row: dict[str, Any] = {c.name: value for c in columns_for(("one",))}
    row["qpos"] = [value, -value]
    row["tension_one_nodes_n"] = np.full(nodes, value)
    row["slip_one_direction"] = np.array([1, -1], dtype=np.int8)
    return row


def test_parquet_returns_every_bit(make_log: Any, tmp_path: Path) -> None:
    odd = np.tile([np.nan, -0.0, np.inf, 5e-324, 0.1 + 0.2], 60)
    log = make_log(wearer_torque_nm=odd, metadata={"seed": 3, "versions": {"a": "1"}})
    log.write(tmp_path / "log.parquet")
    back = EpisodeLog.read(tmp_path / "log.parquet")
    assert back == log
    assert back["slip_flexor_direction"].dtype == np.int8
    assert back["tension_flexor_nodes_n"].shape == (300, 9)
    assert back.cables == ("flexor", "extensor")
    assert back.metadata == log.metadata


def test_parquet_names_units(make_log: Any, tmp_path: Path) -> None:
    make_log().write(tmp_path / "log.parquet")
    schema = pq.read_schema(tmp_path / "log.parquet")
    units = {field.name: field.metadata[b"unit"] for field in schema}
    assert units["joint_torque_nm"] == b"N m"
    assert units["slack_extensor_m"] == b"m"
    assert all(field.metadata[b"meaning"] for field in schema)


def test_recorder_copies_what_it_is_given() -> None:
    recorder = Recorder(("one",), {})
    nodes = np.zeros(3)
    for value in (1.0, 2.0):
        nodes[:] = value
        recorder.record(sample(value) | {"tension_one_nodes_n": nodes, "extra": "no"})
    log = recorder.log()
    assert len(log) == 2
    assert log["tension_one_nodes_n"].tolist() == [[1.0] * 3, [2.0] * 3]
    assert log["qpos"].tolist() == [[1.0, -1.0], [2.0, -2.0]]
    with pytest.raises(ValueError, match="read-only"):
        log["time_s"][0] = 5.0


def test_recorder_names_the_missing_column() -> None:
    row = sample(1.0)
    row["joint_torque"] = row.pop("joint_torque_nm")
    recorder = Recorder(("one",), {})
    with pytest.raises(CableError, match=r"'joint_torque_nm'.*'joint_torque'"):
        recorder.record(row)
    with pytest.raises(CableError, match="nothing was recorded"):
        recorder.log()


def test_recorder_refuses_another_node_count_and_keeps_rows_together() -> None:
    recorder = Recorder(("one",), {})
    recorder.record(sample(1.0))
    with pytest.raises(CableError, match=r"tension_one_nodes_n.*\(4,\)"):
        recorder.record(sample(2.0, nodes=4))
    with pytest.raises(CableError, match=r"time_s.*a number"):
        recorder.record(sample(2.0) | {"time_s": [2.0]})
    assert len(recorder.log()) == 1


def test_wrong_columns_are_named(make_log: Any) -> None:
    log = make_log()
    with pytest.raises(CableError, match="did you mean 'joint_torque_nm'"):
        log["joint_torqe_nm"]
    with pytest.raises(CableError, match="unknown log column 'speed'"):
        make_log(speed=np.zeros(300))
    with pytest.raises(CableError, match="equal lengths"):
        make_log(time_s=np.zeros(4))
    with pytest.raises(CableError, match="plain JSON"):
        make_log(metadata={"scene": object()})
    with pytest.raises(CableError, match="plain JSON"):
        make_log(metadata={"scale": float("nan")})


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("not parquet, but long enough to look at")
    with pytest.raises(CableError, match="not a Parquet file"):
        EpisodeLog.read(tmp_path / "text")


def test_failed_write_leaves_the_old_file(
    make_log: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "log.parquet"
    old = make_log(rows=20)
    old.write(target)

    def fail(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pq.ParquetWriter, "write_table", fail)
    with pytest.raises(KeyboardInterrupt):
        make_log().write(target)
    assert EpisodeLog.read(target) == old
    assert list(tmp_path.iterdir()) == [target]


def test_replacing_folder_appears_whole(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "run"
    with replacing_folder(target) as partial:
        (partial / "a").write_text("new")
        assert not target.exists()
    assert (target / "a").read_text() == "new"
    assert list(target.parent.iterdir()) == [target]


def test_replacing_folder_keeps_what_it_does_not_write(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "a").write_text("old")
    (tmp_path / "run" / "notes").write_text("mine")
    with pytest.raises(RuntimeError), replacing_folder(tmp_path / "run") as partial:
        (partial / "a").write_text("half")
        raise RuntimeError
    assert (tmp_path / "run" / "a").read_text() == "old"
    with replacing_folder(tmp_path / "run") as partial:
        (partial / "a").write_text("new")
    assert (tmp_path / "run" / "a").read_text() == "new"
    assert (tmp_path / "run" / "notes").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_replacing_needs_its_folder(tmp_path: Path) -> None:
    with (
        pytest.raises(CableError, match="cannot write"),
        replacing(tmp_path / "no" / "file") as path,
    ):
        path.write_text("x")
