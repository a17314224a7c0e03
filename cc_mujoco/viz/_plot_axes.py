"""Time-series plots of a Rerun recording: axis limits, and room for their legends."""

from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cc_mujoco.native import FloatArray as Array

LEGEND_SHARE = 0.35  # room for a legend, before the curves, over their time


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
    """Return a plot of lines (T,) over the whole `time` (T,) [s], legend at its left.

    `contents` are entity paths of the lines, by default all below `origin`. `reach` is
    the range of the vertical axis, by default `axis_limits`. `room` is the legend's
    width over that of the curves; a plot as wide as the window needs less.
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
    """Return an axis over the time and a legend before it; None for a single moment."""
    start, end = float(time[0]), float(time[-1])
    if not end > start:
        return None
    # Behind the curves the last number of the axis needs room.
    begin, finish = start - room * (end - start), end + 0.02 * (end - start)
    ends = (rr.TimeRangeBoundary.absolute(seconds=each) for each in (begin, finish))
    return rrb.TimeAxis(view_range=rr.TimeRange(*ends))


def axis_limits(time: Array, lines: Iterable[Array]) -> tuple[float, float] | None:
    """Return limits (low, high) that leave out a larger transient in the first 0.3 s.

    A motor that starts away from the motion catches up at once, with perhaps many times
    the torque of all that follows. None if it does not double the range of the lines
    (T,).
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
