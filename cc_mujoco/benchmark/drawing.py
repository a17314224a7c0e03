"""Figures of the benchmark: errors, loops side by side, error against effort."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cc_mujoco.benchmark.report import Results, interval, over_conditions
from cc_mujoco.figures import BLUE, COLORS, GREY, ORANGE, figure, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _laws(results: Results, scene: str) -> list[str]:
    return list(
        dict.fromkeys(cell.controller for cell, _ in results if cell.scene == scene)
    )


def errors(results: Results, scene: str) -> Figure:
    """RMS error of every controller, by trajectory and task, with intervals."""
    laws = _laws(results, scene)
    plays = list(
        dict.fromkeys(
            (cell.trajectory, cell.task) for cell, _ in results if cell.scene == scene
        )
    )
    found = {
        (cell.controller, cell.trajectory, cell.task): played.scores["rms_error"]
        for cell, played in results
        if cell.scene == scene
    }
    with style():
        drawing = figure(9.0, 0.6 + 0.34 * len(laws) + 0.25 * len(plays))
        axes = drawing.add_subplot()
        for place, play in enumerate(plays):
            offset = 0.6 * ((place + 0.5) / len(plays) - 0.5)
            stats = [interval(found[(law, *play)]) for law in laws]
            axes.errorbar(
                [s.mean for s in stats],
                np.arange(len(laws)) + offset,
                xerr=np.nan_to_num([s.half for s in stats]),
                fmt="o",
                markersize=4,
                color=COLORS[place % len(COLORS)],
                label=f"{play[0]}, {play[1]}",
            )
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_yticks(range(len(laws)), [law.rpartition("/")[2] for law in laws])
        axes.invert_yaxis()
        axes.set(title=f"{scene}: error of the joint torque", xlabel="RMS error [Nm]")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawing


def loops(results: Results, scene: str) -> Figure:
    """Torque against angle of the first seed, controllers side by side."""
    laws = _laws(results, scene)
    first = next(cell for cell, _ in results if cell.scene == scene)
    shown = {
        cell.controller: played.trace
        for cell, played in results
        if (cell.scene, cell.trajectory, cell.task)
        == (scene, first.trajectory, first.task)
    }
    across = min(4, len(laws))
    down = -(-len(laws) // across)
    with style():
        drawing = figure(2.8 * across, 2.6 * down + 0.3)
        panels = drawing.subplots(down, across, sharex=True, sharey=True, squeeze=False)
        for axes in panels.flat[len(laws) :]:
            axes.set_visible(False)
        for axes, law in zip(panels.flat, laws, strict=False):
            trace = shown[law]
            axes.plot(
                trace["joint_angle_rad"], trace["joint_torque_nm"], color=BLUE, lw=0.8
            )
            axes.plot(
                trace["joint_angle_rad"],
                trace["desired_torque_nm"],
                color=ORANGE,
                lw=0.9,
            )
            axes.set_title(law.rpartition("/")[2])
        drawing.supxlabel("joint angle [rad]", fontsize=9)
        drawing.supylabel("joint torque [Nm], orange: desired", fontsize=9)
        drawing.suptitle(
            f"{scene}, {first.trajectory}, {first.task}", x=0.01, ha="left", fontsize=11
        )
    return drawing


def pareto(results: Results, scene: str) -> Figure:
    """Error against effort, mean over trajectories and tasks; the best are joined."""
    laws = _laws(results, scene)
    points = {}
    for law in laws:
        error = interval(over_conditions(results, scene, law, "rms_error")).mean
        effort = interval(over_conditions(results, scene, law, "effort")).mean
        if np.isfinite(error) and np.isfinite(effort):
            points[law] = (effort, error)
    best = [
        point
        for point in points.values()
        if not any(
            other != point and other[0] <= point[0] and other[1] <= point[1]
            for other in points.values()
        )
    ]
    with style():
        drawing = figure(6.4, 4.2)
        axes = drawing.add_subplot()
        line = np.array(sorted(best))
        if line.size:
            axes.plot(line[:, 0], line[:, 1], color=GREY, lw=0.8, zorder=1)
        for place, (law, point) in enumerate(points.items()):
            color = COLORS[place % len(COLORS)]
            axes.plot(
                *point,
                "os"[place // len(COLORS) % 2],
                color=color,
                markersize=6,
                label=law.rpartition("/")[2],
            )
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.set(
            title=f"{scene}: error against effort",
            xlabel="RMS torque of the motor [Nm]",
            ylabel="RMS error [Nm]",
        )
        if points:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawing
