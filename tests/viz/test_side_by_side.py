"""Episodes beside each other: nothing of one is lost, and axes are the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from cc_mujoco.assets import scene_path
from cc_mujoco.viz._comparison import (
    LabelledEpisode,
    common_limits,
    draw_side_by_side,
    write_side_by_side,
)
from cc_mujoco.viz._rerun_file import write_recording


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(scene_path("wrist")))


@pytest.fixture
def episodes(make_log: Any, model: mujoco.MjModel) -> list[LabelledEpisode]:
    one = make_log(rows=40, nq=model.nq, nodes=21)
    other = make_log(
        rows=40,
        nq=model.nq,
        nodes=21,
        joint_torque_nm=3.0 * one["joint_torque_nm"],
        tension_flexor_proximal_n=5.0 * one["tension_flexor_proximal_n"],
    )
    return [
        LabelledEpisode("design 3", one, model),
        LabelledEpisode("design 14", other, model),
    ]


def entities(path: Path) -> dict[str, int]:
    """Rows that are logged at each path."""
    rows: dict[str, int] = {}
    for chunk in RrdReader(path).stream():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    return rows


def test_a_recording_of_two_holds_all_that_a_recording_of_each_has(
    episodes: list[LabelledEpisode], tmp_path: Path
) -> None:
    write_side_by_side(tmp_path / "both.rrd", episodes, "what they are")
    both = entities(tmp_path / "both.rrd")
    assert both.pop("/about")
    for episode in episodes:
        write_recording(tmp_path / "one.rrd", episode.log, episode.model)
        alone = entities(tmp_path / "one.rrd")
        del alone["/about"]
        root = "/" + episode.name.replace(" ", "_")
        mine = {
            place.removeprefix(root): rows
            for place, rows in both.items()
            if place.startswith(root + "/")
        }
        assert "/torque/joint" in mine
        assert mine == alone
    roots = {place.split("/")[1] for place in both}
    assert roots == {"design_3", "design_14"}


def test_every_view_looks_at_what_is_logged(
    episodes: list[LabelledEpisode], tmp_path: Path
) -> None:
    path = tmp_path / "both.rrd"
    write_side_by_side(path, episodes, "what they are")
    logged = entities(path)
    (store,) = RrdReader(path).blueprints()
    origins = []
    for chunk in RrdReader(path).stream(store=store):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.endswith("space_origin"):
                origins += [cell for (cell,) in batch.column(name).to_pylist()]
    assert len(origins) == 7
    for origin in origins:
        assert any(p == origin or p.startswith(f"{origin}/") for p in logged), origin


def test_columns_of_the_figure_have_the_same_axes(
    episodes: list[LabelledEpisode],
) -> None:
    drawing = draw_side_by_side(episodes)
    axes = np.array(drawing.axes).reshape(3, 2)
    for one, other in axes:
        assert one.get_ylim() == other.get_ylim()
        assert one.get_xlim() == other.get_xlim()
    for column, episode in enumerate(episodes):
        joint, desired = axes[0, column].get_lines()[2:4]
        assert np.array_equal(joint.get_ydata(), episode.log["joint_torque_nm"])
        assert np.array_equal(desired.get_ydata(), episode.log["desired_torque_nm"])
        ends = [line.get_ydata() for line in axes[1, column].get_lines()]
        assert np.array_equal(ends[0], episode.log["tension_flexor_proximal_n"])
        assert np.array_equal(ends[1], episode.log["tension_flexor_distal_n"])
    low, high = axes[1, 0].get_ylim()
    assert low <= 0.0
    assert high >= max(e.log["tension_flexor_proximal_n"].max() for e in episodes)


def test_common_limits_hold_every_line_and_are_never_empty() -> None:
    time = np.arange(5.0)
    low, high = common_limits([(time, [time, -time]), (time, [3.0 * time])])
    assert low < -4.0
    assert high > 12.0
    low, high = common_limits([(time, [np.zeros(5)])])
    assert low < 0.0 < high
