"""The figure is drawn without a display, for any number of cables."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from cc_mujoco.viz import draw_summary, write_summary


@pytest.mark.parametrize("cables", [("one",), ("flexor", "extensor")])
def test_every_axis_is_labelled(make_log: Any, cables: tuple[str, ...]) -> None:
    figure = draw_summary(make_log(cables=cables))
    titles = [axes.get_title(loc="left") for axes in figure.get_axes()]
    for cable in cables:
        assert f"Tension along cable {cable}" in titles
    labels = {axes.get_ylabel() for axes in figure.get_axes()}
    assert {"torque [N m]", "angle [deg]"} <= labels
    assert any("tension [N]" in label for label in labels)


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
