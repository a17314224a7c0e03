"""The evidence as a Rerun recording, read back and checked by Rerun's own tool."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import strict_mode

from cc_mujoco.diagnosis._report import recording as recording_module
from cc_mujoco.diagnosis._report.recording import (
    TIMELINE,
    recording_id,
    write_recording,
)
from cc_mujoco.diagnosis._verdict import Evidence
from cc_mujoco.errors import CableError
from diagnosis.report_examples import NOTHING, TITLES, evidence, trace


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("evidence") / "evidence.rrd"
    write_recording(file, evidence())
    return file


def rerun(*arguments: object) -> subprocess.CompletedProcess[str]:
    # `python -m rerun_cli` would drop the exit code.
    program = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def entities(path: Path) -> set[str]:
    reader = RrdReader(path)
    chunks = reader.stream(store=reader.recordings()[0])
    return {str(chunk.entity_path) for chunk in chunks}


def rows(path: Path, entity: str, component: str) -> tuple[list[float], list[Any]]:
    times: list[float] = []
    found: list[Any] = []
    for chunk in RrdReader(path).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if component not in batch.schema.names:
            continue
        if not chunk.is_static:
            stamp = batch.column(TIMELINE).cast("int64").to_numpy()
            times += (stamp * 1e-9).tolist()
        found += batch.column(component).to_pylist()
    return times, found


def test_rerun_finds_no_fault(path: Path) -> None:
    checked = rerun("verify", path)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_every_sample_of_every_series_is_there(path: Path) -> None:
    for each in evidence().traces:
        for name in each.measured:
            for kind in ("measured", "before", "after"):
                entity = rr.new_entity_path(["trials", each.trial, name, kind])
                time, values = rows(path, entity, "Scalars:scalars")
                np.testing.assert_allclose(time, each.time, atol=1e-9)
                expected = getattr(each, kind)[name]
                np.testing.assert_array_equal(np.ravel(values), expected)
        entity = rr.new_entity_path(
            ["trials", each.trial, "joint_torque_nm_error", "after"]
        )
        error = each.measured["joint_torque_nm"] - each.after["joint_torque_nm"]
        _, values = rows(path, entity, "Scalars:scalars")
        np.testing.assert_array_equal(np.ravel(values), error)


def test_maps_are_bars_without_empty_bins(path: Path) -> None:
    each = evidence().maps[0]
    assert np.isnan(each.before).sum() == 1
    entity = rr.new_entity_path(["maps", each.channel, each.axis, "before"])
    _, values = rows(path, entity, "BarChart:values")
    buffer = values[0][0]["buffer"]
    shown = (
        next(v for v in buffer.values() if v) if isinstance(buffer, dict) else buffer
    )
    np.testing.assert_array_equal(shown, each.before[np.isfinite(each.before)])


def test_text_names_shares_and_pairs(path: Path) -> None:
    _, texts = rows(path, "/about", "TextDocument:text")
    text = texts[0][0]
    assert "| Motor torque | joint speed [rad/s] | 62 % | 4 % |" in text
    assert f"| {TITLES['presliding']} | {TITLES['stribeck_friction']} | 0.98 |" in text


def test_every_entity_is_shown_by_just_one_view(path: Path) -> None:
    reader = RrdReader(path)
    origins = []
    for chunk in reader.stream(store=reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        if "ViewBlueprint:space_origin" in batch.schema.names:
            origins += batch.column("ViewBlueprint:space_origin").to_pylist()[0]
    logged = entities(path)
    assert len(logged) == 1 + 2 * (2 * 5 + 2) + 2 * len(evidence().maps)
    for entity in logged:
        inside = [o for o in origins if entity == o or entity.startswith(f"{o}/")]
        assert len(inside) == 1, entity


def test_a_model_that_did_not_change_has_no_after(tmp_path: Path) -> None:
    file = tmp_path / "open.rrd"
    write_recording(file, evidence(closed=False))
    assert not any(entity.endswith("/after") for entity in entities(file))


def test_nothing_can_be_recorded(tmp_path: Path) -> None:
    write_recording(tmp_path / "empty.rrd", NOTHING)
    assert rerun("verify", tmp_path / "empty.rrd").returncode == 0


def test_equal_evidence_compares_equal(path: Path, tmp_path: Path) -> None:
    write_recording(tmp_path / "again.rrd", evidence())
    compared = rerun("compare", path, tmp_path / "again.rrd")
    assert compared.returncode == 0, compared.stderr


def test_equal_evidence_has_equal_ids_and_other_evidence_another() -> None:
    one = Evidence((trace("a", 3.0, True),), (), NOTHING.isolability)
    assert recording_id(one) == recording_id(
        Evidence((trace("a", 3.0, True),), (), NOTHING.isolability)
    )
    others = [
        Evidence((trace("b", 3.0, True),), (), NOTHING.isolability),
        Evidence((trace("a", 3.0, False),), (), NOTHING.isolability),
        replace(one, maps=evidence().maps),
        replace(one, isolability=evidence().isolability),
    ]
    assert len({recording_id(each) for each in [one, *others]}) == 5


def test_file_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("disk full")

    file = tmp_path / "evidence.rrd"
    file.write_bytes(b"old")
    before = strict_mode()
    monkeypatch.setattr(recording_module, "_log_map", fail)
    with pytest.raises(CableError, match=r"evidence.rrd: disk full"):
        write_recording(file, evidence())
    assert file.read_bytes() == b"old" and list(tmp_path.iterdir()) == [file]
    assert strict_mode() == before
