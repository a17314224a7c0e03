"""Plots of a recording show what comes after the start."""

from __future__ import annotations

import numpy as np
import pytest
from rerun.blueprint import Corner2D

from cc_mujoco.viz._plot_axes import axis_limits, plot, time_axis

TIME = np.linspace(5.0, 8.0, 3001)


@pytest.mark.parametrize("peak", [-50.0, 50.0])
def test_a_start_that_dwarfs_the_rest_is_out_of_sight(peak: float) -> None:
    calm = np.sin(TIME)
    start = calm + np.where(TIME < 5.1, peak, 0.0)
    view = plot("/torque", "Torque", TIME, [calm, start])
    reach = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()
    low, high = np.ravel(reach)
    assert -1.3 < low < calm.min() and calm.max() < high < 1.3


def test_all_else_is_left_to_the_viewer() -> None:
    calm = np.sin(TIME)
    assert axis_limits(TIME, [calm]) is None
    assert axis_limits(TIME, [np.where(TIME > 6.0, 50.0, calm)]) is None
    assert axis_limits(TIME, [np.where(TIME < 5.1, 50.0, 0.0)]) is None  # nothing else
    assert axis_limits(TIME, [np.full_like(TIME, np.nan)]) is None
    assert axis_limits(TIME[:50], [calm[:50]]) is None


def test_a_legend_stands_before_all_curves_that_are_seen_to_their_end() -> None:
    view = plot("/torque", "Torque", TIME, [np.sin(TIME)], room=0.5)
    assert view.properties["PlotLegend"].corner.as_arrow_array().to_pylist() == [
        Corner2D.LeftTop.value
    ]
    (reach,) = view.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()
    begin, end = reach["start"] * 1e-9, reach["end"] * 1e-9
    assert begin == pytest.approx(TIME[0] - 0.5 * (TIME[-1] - TIME[0]))
    assert TIME[-1] < end < TIME[-1] + 0.5
    assert time_axis(TIME[:1]) is None
