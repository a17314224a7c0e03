"""Opening layout of the Rerun recording of an episode: its scene, lines and plots."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from cc_mujoco.metrics._metric import Key, driven_cables
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz._plot_axes import plot, time_axis
from cc_mujoco.viz._scene3d import TIMELINE, WORLD, viewpoint

# Okabe and Ito's colours, as in the summary figure.
BLUE, ORANGE, GREEN, PURPLE = 0x0072B2FF, 0xD55E00FF, 0x009E73FF, 0xCC79A7FF
SKY, YELLOW = 0x56B4E9FF, 0xE69F00FF

SERIES = (
    ("torque/joint", "delivered", "joint_torque_nm", BLUE),
    ("torque/desired", "desired", "desired_torque_nm", ORANGE),
    ("torque/motor", "motor", "motor_torque_nm", GREEN),
    ("torque/wearer", "wearer", "wearer_torque_nm", PURPLE),
    ("angle/joint", "joint", "joint_angle_rad", BLUE),
    ("angle/reference", "wearer aims for", "reference_angle_rad", ORANGE),
    ("angle/motor", "motor", "motor_angle_rad", GREEN),
)
# No spaces in paths: Rerun shows them with a backslash before.
CABLE_SERIES = (
    ("tension/{}/motor_end", "tension_{}_proximal_n", 0),
    ("tension/{}/joint_end", "tension_{}_distal_n", 1),
    ("moving/{}", "moving_{}_fraction", 0),
)


class Series(NamedTuple):
    path: tuple[str, ...]
    name: str
    values: NDArray[np.float64]  # values of all samples (T,)
    color: int


def plotted_series(log: EpisodeLog) -> Iterator[Series]:
    for axis, own in log.each_axis():
        ratio = own.metadata.get(Key.RATIO)
        for path, name, column, color in SERIES:
            values = own[column]
            if column.endswith("_rad"):
                values = np.degrees(values)
            if column == "motor_angle_rad" and ratio is not None:
                # Beside it a joint that turns a tenth as far would seem to rest.
                name, values = f"{name}, at the joint", ratio * values
            kind, line = path.split("/")
            yield Series((kind, *([axis] if axis else []), line), name, values, color)
    # Motor end and joint end of the first, second, ... cable of an axis
    ends = (BLUE, SKY), (ORANGE, YELLOW), (GREEN, PURPLE)
    places = {cable: number for number, cable in enumerate(log.cables)}
    if log.axes:  # the plots of each show its own cables
        for _, own in log.each_axis():
            places |= {cable: n for n, cable in enumerate(driven_cables(own))}
    for cable in log.cables:
        colors = ends[places[cable] % 3]
        for path, column, shade in CABLE_SERIES:
            parts = tuple(part.format(cable) for part in path.split("/"))
            name = ", ".join(parts[1:]).replace("_", " ")
            yield Series(parts, name, log[column.format(cable)], colors[shade])


View = rrb.View | rrb.Container


def blueprint(log: EpisodeLog, model: mujoco.MjModel) -> rrb.Blueprint:
    scene = scene_view(log, model)
    about = rrb.TextDocumentView(origin="/about", name="About")
    heights = (6, 4, 6, 6, 7)  # of the plots of an axis and of its cables
    if log.axes:
        tabs = []
        left = dict.fromkeys(log.cables)
        for axis, own in log.each_axis():
            cables = driven_cables(own)
            parts = [*_axis_plots(log, axis), *_cable_plots(log, cables)]
            tabs.append(rrb.Vertical(*parts, row_shares=heights, name=axis))
            left = {cable: None for cable in left if cable not in cables}
        if left:
            tabs.append(rrb.Vertical(*_cable_plots(log, [*left]), name="other cables"))
        plots: rrb.Tabs | rrb.Vertical = rrb.Tabs(*tabs)
    else:
        parts = [*_axis_plots(log, ""), *_cable_plots(log, log.cables)]
        plots = rrb.Vertical(*parts, row_shares=heights)
    return playing(rrb.Horizontal(rrb.Tabs(scene, about), plots, column_shares=[1, 1]))


def playing(content: rrb.Container) -> rrb.Blueprint:
    """Return a layout that shows only `content` and plays as soon as it opens."""
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing")
    return rrb.Blueprint(content, time, collapse_panels=True)


def _axis_plots(log: EpisodeLog, axis: str) -> list[View]:
    of = f"/{axis}" if axis else ""

    def torques(title: str, *names: str) -> rrb.TimeSeriesView:
        paths = [f"torque{of}/{name}" for name in names]
        return lines(log, f"{title} [N m]", "torque", paths)

    motor = torques("Motor torque", "motor")
    wearer = torques("Wearer's torque", "wearer")
    joint = torques("Joint torque", "joint", "desired")
    return [joint, rrb.Tabs(motor, wearer), lines(log, "Angle [deg]", f"angle{of}")]


def _cable_plots(log: EpisodeLog, cables: Sequence[str]) -> list[View]:
    ends = [(c, f"{end}_end") for c in cables for end in ("motor", "joint")]
    tensions = [f"tension/{cable}/{end}" for cable, end in ends]
    moving = [f"moving/{cable}" for cable in cables]
    states = rrb.StateTimelineView(
        origin="/slip",
        contents=[rr.new_entity_path(["slip", *end]) for end in ends],
        name="Stick, slip, slack",
        time_view=time_axis(log["time_s"]),
    )
    slipping = lines(log, "Part of the cable that slips", "moving", moving)
    pulls = lines(log, "Tension at the ends [N]", "tension", tensions)
    return [pulls, rrb.Tabs(states, slipping)]


def lines(
    log: EpisodeLog, name: str, origin: str, paths: Sequence[str] = ()
) -> rrb.TimeSeriesView:
    """Return a plot of the series at `paths`, by default of all below `origin`."""
    shown = line_values(log, origin, paths)
    contents = [rr.new_entity_path(path.split("/")) for path in paths]
    return plot(f"/{origin}", name, log["time_s"], shown, contents=contents)


def line_values(log: EpisodeLog, origin: str, paths: Sequence[str] = ()) -> list[Array]:
    """Return the values (T,) of the series at `paths`, or of all below `origin`."""
    drawn = {"/".join(line.path): line.values for line in plotted_series(log)}
    shown = paths or [path for path in drawn if path.startswith(f"{origin}/")]
    return [drawn[path] for path in drawn if path in shown]


def scene_view(
    log: EpisodeLog, model: mujoco.MjModel, root: str = "", name: str = ""
) -> rrb.Spatial3DView:
    """Return a 3-D view of the scene that is logged under `root`.

    By default its title has scene, trajectory and, for a single axis, task.
    """
    position, target = viewpoint(model)
    eye = rrb.EyeControls3D(
        position=position, look_target=target, eye_up=(0.0, 0.0, 1.0)
    )
    # The tasks of several axes would push the tab beside it out of sight.
    keys = ("scene", "trajectory", *(() if log.axes else ("task",)))
    known = [str(log.metadata[key]) for key in keys if key in log.metadata]
    name = name or " · ".join(known)
    return rrb.Spatial3DView(origin=f"{root}/{WORLD}", name=name, eye_controls=eye)
