"""The figure is drawn without a display, for any number of cables."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from cc_mujoco.simulation import _episode_log as episode_log
from cc_mujoco.viz import draw_summary, write_summary
from cc_mujoco.viz._summary import _tension_means


@pytest.mark.parametrize("cables", [("one",), ("flexor", "extensor")])
def test_every_axis_is_labelled(make_log: Any, cables: tuple[str, ...]) -> None:
    figure = draw_summary(make_log(cables=cables))
    titles = [axes.get_title(loc="left") for axes in figure.get_axes()]
    for cable in cables:
        assert f"Tension along cable {cable}" in titles
    labels = {axes.get_ylabel() for axes in figure.get_axes()}
    assert {"torque [N m]", "angle [deg]"} <= labels
    assert any("tension [N]" in label for label in labels)


def test_what_the_guard_did_stands_above_the_plots(make_log: Any) -> None:
    about = {"scene": "wrist", "guard": ["the guard braked joint 'wrist': at 1 s."]}
    title = draw_summary(make_log(metadata=about)).get_suptitle()
    assert title.splitlines() == [
        "wrist",
        "Here the guard braked joint 'wrist': at 1 s.",
    ]


def test_png_is_written_and_not_blank(make_log: Any, tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.png", make_log())
    pixels = imread(tmp_path / "summary.png")
    assert pixels.shape[0] > 800 and pixels.shape[1] > 1200
    assert np.ptp(pixels[..., :3]) == 1.0
    assert list(tmp_path.iterdir()) == [tmp_path / "summary.png"]


def test_slack_all_the_time_can_be_drawn(make_log: Any) -> None:
    draw_summary(make_log(cables=("one",), tension_one_nodes_n=np.zeros((300, 9))))


def test_global_state_is_left_alone(make_log: Any) -> None:
    sys.modules.pop("matplotlib.pyplot", None)
    draw_summary(make_log())
    assert "matplotlib.pyplot" not in sys.modules


def test_mean_tensions_of_a_long_episode_are_taken_in_parts(
    make_log: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(episode_log, "PIECE_ROWS", 64)
    log = make_log(cables=("flexor",))
    nodes = log["tension_flexor_nodes_n"]
    for every in (1, 7, 100):
        means, highest = _tension_means(log, "flexor", every)
        whole = len(nodes) // every * every
        expected = nodes[:whole].reshape(-1, every, nodes.shape[1]).mean(axis=1)
        assert np.array_equal(means, expected)
        assert highest == nodes.max()
