"""Comparison of two episodes in one figure and one Rerun recording, on equal axes."""

import hashlib
import os
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report._figures import figure, style
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz._film_plots import draw_lines, highest_tension, tensions
from cc_mujoco.viz._plot_axes import axis_limits, plot
from cc_mujoco.viz._rerun_file import log_episode, recording, recording_id
from cc_mujoco.viz._rerun_plots import line_values, playing, scene_view
from cc_mujoco.viz._scene3d import Branch
from cc_mujoco.viz._summary import draw_loop

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class LabelledEpisode(NamedTuple):
    """One of several episodes that are compared; all have the same cables."""

    name: str  # name of the episode, distinct from the others
    log: EpisodeLog
    model: mujoco.MjModel  # the model that it was played on


def draw_side_by_side(episodes: Sequence[LabelledEpisode]) -> "Figure":
    """Draw a column per episode: torque-angle loops, and tension at both cable ends."""
    cables = episodes[0].log.cables
    loops = [episode.log.each_axis() for episode in episodes]
    count = len(loops[0])
    with style():
        heights = [*[3.6] * count, *[1.8] * len(cables)]
        drawing = figure(5.2 * len(episodes), sum(heights))
        grid = drawing.add_gridspec(
            len(heights), len(episodes), height_ratios=heights
        ).subplots(sharey="row", squeeze=False)
        for row, each in zip(grid[:count], zip(*loops, strict=True), strict=True):
            for axes, episode, (axis, own) in zip(row, episodes, each, strict=True):
                draw_loop(axes, own)
                of = f", {axis}" if axis else ""
                axes.set_title(f"{episode.name}: torque-angle loop{of}")
                if axes is not row[0]:
                    axes.sharex(row[0])
        drawn = [tensions(episode.log) for episode in episodes]
        for row, panels in zip(grid[count:], zip(*drawn, strict=True), strict=True):
            for axes, episode, panel in zip(row, episodes, panels, strict=True):
                time = episode.log["time_s"]
                draw_lines(axes, time, panel.lines)
                axes.set(title=panel.title, xlim=(time[0], time[-1]))
            row[0].set_ylabel(f"tension [{panels[0].unit}]")
            drawn_lines = [[line.values for line in panel.lines] for panel in panels]
            times = [episode.log["time_s"] for episode in episodes]
            row[0].set_ylim(common_limits(zip(times, drawn_lines, strict=True)))
        grid[count, 0].legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.95))
        for axes in grid[:count, 1:].flat:
            axes.set_ylabel("")
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
    return drawing


def write_side_by_side(
    path: str | os.PathLike[str], episodes: Sequence[LabelledEpisode], about: str
) -> None:
    digest = hashlib.sha256(about.encode())
    for episode in episodes:
        digest.update(f"{episode.name}/{recording_id(episode.log)}/".encode())
    highest = max(highest_tension(episode.log) for episode in episodes)
    identity = digest.hexdigest()[:32]
    with recording(path, identity, _blueprint(episodes)) as rec:
        page = rr.TextDocument(about, media_type=rr.MediaType.MARKDOWN)
        rec.log("about", page, static=True)
        for episode in episodes:
            branch = Branch(rec, _episode_root(episode))
            log_episode(branch, episode.log, episode.model, highest)


def common_limits(groups: Iterable[tuple[Array, list[Array]]]) -> tuple[float, float]:
    """Return common axis limits of several episodes: their times (T,) and lines."""
    ends = []
    for time, lines in groups:
        found = axis_limits(time, lines)
        ends.append(found or (float(np.nanmin(lines)), float(np.nanmax(lines))))
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    margin = 0.04 * (high - low) or 0.5
    return low - margin, high + margin


def _episode_root(episode: LabelledEpisode) -> str:
    # Rerun shows a space in a path with a backslash before.
    return rr.new_entity_path([episode.name.replace(" ", "_")])


def _blueprint(episodes: Sequence[LabelledEpisode]) -> rrb.Blueprint:
    def plots(title: str, origin: str, paths: Sequence[str] = ()) -> rrb.Horizontal:
        drawn = [line_values(episode.log, origin, paths) for episode in episodes]
        times = [episode.log["time_s"] for episode in episodes]
        reach = common_limits(zip(times, drawn, strict=True))
        views = []
        for episode, time, shown in zip(episodes, times, drawn, strict=True):
            root, name = _episode_root(episode), f"{episode.name}: {title}"
            own = [f"{root}/{path}" for path in paths]
            place = f"{root}/{origin}"
            views.append(plot(place, name, time, shown, contents=own, reach=reach))
        return rrb.Horizontal(*views)

    scenes = [
        scene_view(one.log, one.model, _episode_root(one), name=one.name)
        for one in episodes
    ]
    # Torques are looked at first.
    rows = [rrb.Horizontal(*scenes)]
    for axis, _ in episodes[0].log.each_axis():
        of, place = (f", {axis}", f"torque/{axis}") if axis else ("", "torque")
        paths = [f"{place}/{name}" for name in ("joint", "desired")]
        rows.append(plots(f"joint torque{of} [N m]", "torque", paths))
    rows.append(plots("tension at the ends [N]", "tension"))
    shares = [3, *(2 for _ in rows[1:])]
    together = rrb.Vertical(*rows, row_shares=shares, name="Side by side")
    about = rrb.TextDocumentView(origin="/about", name="About")
    return playing(rrb.Tabs(together, about))
