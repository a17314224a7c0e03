"""Opening layout of the Rerun recording of an episode: its scene and plots."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz._axis import plot, time_axis
from cc_mujoco.viz._rerun_series import plotted_series
from cc_mujoco.viz._scene3d import TIMELINE, WORLD, viewpoint

Array = NDArray[np.float64]


def blueprint(log: EpisodeLog, model: mujoco.MjModel) -> rrb.Blueprint:
    """Lay out an episode that is logged at the root.

    Args:
        log: The episode.
        model: The model that it was played on.
    """
    scene = scene_view(log, model)
    about = rrb.TextDocumentView(origin="/about", name="About")
    axes = [_axis_plots(log, axis) for axis, _ in log.each_axis()]
    plots = rrb.Vertical(
        axes[0] if len(axes) == 1 else rrb.Tabs(*axes),
        lines(log, "Tension at the ends [N]", "tension"),
        rrb.Tabs(
            rrb.StateTimelineView(
                origin="/slip",
                name="Stick, slip, slack",
                time_view=time_axis(log["time_s"]),
            ),
            lines(log, "Part of the cable that slips", "moving"),
        ),
        row_shares=[16, 6, 7],
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(scene, about), plots, column_shares=[1, 1]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing"),
        collapse_panels=True,
    )


def _axis_plots(log: EpisodeLog, axis: str) -> rrb.Vertical:
    """Return the plots of torque and angle of an axis; its name is "" if single."""

    def paths(*names: str) -> tuple[str, ...]:
        kind = f"torque/{axis}" if axis else "torque"
        return tuple(f"{kind}/{name}" for name in names)

    angle = f"angle/{axis}" if axis else "angle"
    return rrb.Vertical(
        lines(log, "Joint torque [N m]", "torque", paths("joint", "desired")),
        rrb.Tabs(
            lines(log, "Motor torque [N m]", "torque", paths("motor")),
            lines(log, "Wearer's torque [N m]", "torque", paths("wearer")),
        ),
        lines(log, "Angle [deg]", angle),
        row_shares=[6, 4, 6],
        name=axis or None,
    )


def lines(
    log: EpisodeLog, name: str, origin: str, paths: Sequence[str] = ()
) -> rrb.TimeSeriesView:
    """Return a plot of lines of the episode.

    Args:
        log: The episode.
        name: Title.
        origin: First parts of the paths of the lines.
        paths: Those that are shown, all of them unless given.
    """
    shown = line_values(log, origin, paths)
    contents = [f"/{path}" for path in paths]
    return plot(f"/{origin}", name, log["time_s"], shown, contents=contents)


def line_values(log: EpisodeLog, origin: str, paths: Sequence[str] = ()) -> list[Array]:
    """Return the values of such lines, each (T,); see `lines`."""
    return [
        line.values
        for line in plotted_series(log)
        if "/".join(line.path).startswith(f"{origin}/")
        and (not paths or "/".join(line.path) in paths)
    ]


def scene_view(
    log: EpisodeLog, model: mujoco.MjModel, root: str = "", name: str = ""
) -> rrb.Spatial3DView:
    """Return a view of the scene of an episode.

    Args:
        log: The episode.
        model: The model that it was played on.
        root: Path under which it is logged.
        name: Of the view; scene, trajectory and task unless given.
    """
    position, target = viewpoint(model)
    eye = rrb.EyeControls3D(
        position=position, look_target=target, eye_up=(0.0, 0.0, 1.0)
    )
    name = name or " · ".join(
        str(log.metadata[key])
        for key in ("scene", "trajectory", "task")
        if key in log.metadata
    )
    return rrb.Spatial3DView(origin=f"{root}/{WORLD}", name=name, eye_controls=eye)
