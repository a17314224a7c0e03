"""Plots of a Rerun recording: how far their axes reach, and room for their legends."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cc_mujoco.native import FloatArray as Array

LEGEND_SHARE = 0.35
"""Room for a legend, before the curves, over the time that they take."""


def plot(
    origin: str,
    name: str,
    time: Array,
    lines: Iterable[Array],
    *,
    contents: Sequence[str] = (),
    reach: tuple[float, float] | None = None,
    room: float = LEGEND_SHARE,
) -> rrb.TimeSeriesView:
    """Show lines over the whole of their time, with the legend before them.

    `time` (T,) rises [s]; `lines` are (T,). `contents` are paths of what is shown, all
    below the `origin` unless given. `reach` are the ends of the axis, those of
    `axis_limits` unless given. For `room` see `LEGEND_SHARE`; it is less where the plot
    is as wide as the window.
    """
    found = reach or axis_limits(time, lines)
    return rrb.TimeSeriesView(
        origin=origin,
        contents=list(contents) or "$origin/**",
        name=name,
        axis_x=time_axis(time, room),
        axis_y=found and rrb.ScalarAxis(range=found, zoom_lock=False),
        plot_legend=rrb.Corner2D.LeftTop,
    )


def time_axis(time: Array, room: float = LEGEND_SHARE) -> rrb.TimeAxis | None:
    """Return an axis over the whole time and a legend before it, if any passes."""
    start, end = float(time[0]), float(time[-1])
    if not end > start:
        return None
    # Behind the curves the last number of the axis needs room.
    begin, finish = start - room * (end - start), end + 0.02 * (end - start)
    ends = (rr.TimeRangeBoundary.absolute(seconds=each) for each in (begin, finish))
    return rrb.TimeAxis(view_range=rr.TimeRange(*ends))


def axis_limits(time: Array, lines: Iterable[Array]) -> tuple[float, float] | None:
    """Return limits of an axis without the start of the lines if it would flatten them.

    A motor that is not where the motion begins catches up within moments, and may need
    many times the torque of all that follows. None where all samples together show the
    lines (T,) well.
    """
    values = np.stack([np.where(np.isfinite(line), line, np.nan) for line in lines])
    later = values[:, time - time[0] > 0.3]
    if np.isfinite(later).sum() < 2:
        return None
    low, high = float(np.nanmin(later)), float(np.nanmax(later))
    if not 0.0 < 2.0 * (high - low) < float(np.nanmax(values) - np.nanmin(values)):
        return None
    margin = 0.1 * (high - low)
    return low - margin, high + margin
