"""The summary figure of an episode: torque, angle, their loop, tension in the cable."""

import os
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Cable
from cc_mujoco.cable._conduit import node_places
from cc_mujoco.report import _figures as figures
from cc_mujoco.report._figures import BLUE, GREEN, GREY, ORANGE, TENSION_COLORS, style
from cc_mujoco.simulation._episode_log import AxisLog, EpisodeLog
from cc_mujoco.viz._film_plots import MAX_SAMPLES, PlotLine, axis_angles, draw_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


GUARD_METADATA_KEY = "guard"  # sentences of `Guards.findings` in a log's metadata


def write_summary(path: str | os.PathLike[str], log: EpisodeLog) -> None:
    """Draw the summary of an episode (see `draw_summary`) into a PNG file."""
    figures.save(path, draw_summary(log))


def draw_summary(log: EpisodeLog) -> "Figure":
    """Draw the summary of an episode.

    Torque and angle over time, the torque-angle loop, and for each cable the tension
    along it over time, on one colour scale; grey is a slack cable.
    """
    log = log.thinned(MAX_SAMPLES)
    with style():
        rows, axes = len(log.cables), log.each_axis()
        drawing = figures.figure(11, 5.0 * len(axes) + 0.2 + 2.1 * rows)
        heights = [5.0 * len(axes), 0.3 + 2.1 * rows]
        parts: Any = drawing.subfigures(2, 1, height_ratios=heights)
        top, bottom = parts
        grid = top.add_gridspec(2 * len(axes), 2, width_ratios=[3, 2])
        for row, (axis, own) in enumerate(axes):
            torque = top.add_subplot(grid[2 * row, 0])
            angle = top.add_subplot(grid[2 * row + 1, 0], sharex=torque)
            _draw_over_time(torque, angle, own, axis)
            draw_loop(top.add_subplot(grid[2 * row : 2 * row + 2, 1]), own)
        _draw_tensions(bottom, log)
        lines = [episode_title(log)]
        for sentence in guard_sentences(log):
            lines += textwrap.wrap(sentence, 110)
        drawing.suptitle("\n".join(lines), x=0.012, ha="left", fontsize=13)
    return drawing


def episode_title(log: EpisodeLog) -> str:
    about = log.metadata
    parts = [str(about[key]) for key in ("scene", "trajectory", "task") if key in about]
    if "controller" in about:
        parts.append(f"controller {about['controller']}")
    # Those of several axes are long, and may break.
    parts = [part.replace(",", ", ") for part in parts]
    if "seed" in about:
        parts.append(f"seed {about['seed']}")
    return "  ·  ".join(parts)


def guard_sentences(log: EpisodeLog) -> list[str]:
    """Return what the guard did, for those who see the episode and not the terminal."""
    return [f"Here {sentence}" for sentence in log.metadata.get(GUARD_METADATA_KEY, ())]


def _draw_over_time(
    torque: "Axes", angle: "Axes", log: EpisodeLog | AxisLog, axis: str
) -> None:
    time = log["time_s"]
    motor = PlotLine("motor pulley", log["motor_torque_nm"], GREEN)
    joint = PlotLine("joint", log["joint_torque_nm"], BLUE)
    desired = PlotLine("desired", log["desired_torque_nm"], ORANGE, dashed=True)
    for axes, lines in (torque, (motor, joint, desired)), (angle, axis_angles(log)):
        axes.axhline(0, color=GREY, linewidth=0.6)
        for line in lines:
            width = 0.9 if line.color == GREEN else None
            draw_lines(axes, time, [line], linewidth=width)
        axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 0.98))
    torque.set(title=f"Torque, {axis}" if axis else "Torque", ylabel="torque [N m]")
    torque.tick_params(labelbottom=False)
    angle.set(title="Angle", xlabel="time [s]", ylabel="angle [deg]")
    angle.set_xlim(time[0], time[-1])


def draw_loop(axes: "Axes", log: EpisodeLog | AxisLog) -> None:
    """Draw desired and delivered torque over the joint angle."""
    angle = np.degrees(log["joint_angle_rad"])
    axes.axhline(0, color=GREY, linewidth=0.6)
    axes.axvline(0, color=GREY, linewidth=0.6)
    axes.plot(angle, log["joint_torque_nm"], color=BLUE, label="joint", linewidth=1.0)
    desired = log["desired_torque_nm"]
    axes.plot(angle, desired, color=ORANGE, label="desired", linewidth=0.9)
    axes.set(title="Torque-angle loop", xlabel="joint angle [deg]")
    axes.set_ylabel("torque [N m]")
    axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.98))


def _nearest_nodes(log: EpisodeLog, cable: str, nodes: int) -> NDArray[np.intp]:
    """Return the nearest of `nodes` nodes at 501 even places along a cable (501,)."""
    shares = np.linspace(0.0, 1.0, nodes)
    config = log.metadata.get("cables", {}).get(cable)
    if config is not None:
        described = Cable.from_config(config)
        shares = node_places(described) / described.length
    along = np.linspace(0.0, 1.0, 501)
    return np.rint(np.interp(along, shares, np.arange(shares.size))).astype(np.intp)


def _tension_means(
    log: EpisodeLog, cable: str, every: int
) -> tuple[NDArray[np.float64], float]:
    """Return means of `every` samples (blocks, nodes), peak of all [N]."""
    # In parts, as all samples would be the largest array of a long episode.
    means, highest = [], 0.0
    left: list[NDArray[np.float64]] = []
    for piece in log.pieces(f"tension_{cable}_nodes_n"):
        rows = np.concatenate([*left, piece])
        highest = max(highest, float(piece.max()))
        whole = len(rows) // every * every
        means.append(rows[:whole].reshape(-1, every, rows.shape[1]).mean(axis=1))
        left = [rows[whole:]]
    return np.concatenate(means), highest


def _draw_tensions(part: Any, log: EpisodeLog) -> None:
    """Draw a heat map of tension per cable: time to the right, joint end at the top."""
    import matplotlib

    time = log["time_s"]
    every = max(1, len(time) // 600)  # columns of a heat map, each a mean
    means: dict[str, NDArray[np.float64]] = {}
    highest = 1e-9
    for cable in log.cables:
        means[cable], peak = _tension_means(log, cable, every)
        highest = max(highest, peak)
    colors = matplotlib.colormaps[TENSION_COLORS].with_extremes(bad="#BDBDBD")
    panels = part.subplots(len(means), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (cable, values) in zip(panels, means.items(), strict=True):
        rows = _nearest_nodes(log, cable, values.shape[1])
        shown = np.ma.masked_less_equal(values.T[rows], 0.0)
        look: dict[str, Any] = {"cmap": colors, "vmin": 0.0, "vmax": highest}
        look |= {"aspect": "auto", "origin": "lower", "interpolation": "nearest"}
        image = axes.imshow(shown, extent=(time[0], time[-1], 0.0, 1.0), **look)
        axes.grid(False)
        axes.set_yticks([0, 1], ["motor end", "joint end"])
        axes.set_title(f"Tension along cable {cable}")
    panels[-1].set_xlabel("time [s]")
    part.colorbar(image, ax=list(panels), label="tension [N]  (grey: slack)", pad=0.01)
