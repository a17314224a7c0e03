"""The Rerun recording of an episode: a file that opens as a finished layout.

Nothing is drawn here, so no display is needed. `rerun recording.rrd` opens it. The
recording id is a digest of the log: two runs with equal logs compare equal.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.error_utils import strict_mode

from cc_mujoco import engine, markdown
from cc_mujoco.files import replacing
from cc_mujoco.recording.axis import axis
from cc_mujoco.recording.branch import Branch
from cc_mujoco.recording.columns import MODEL_XML
from cc_mujoco.recording.conduit3d import conduit_points, conduit_shares, log_conduit
from cc_mujoco.recording.log import EpisodeLog
from cc_mujoco.recording.metrics import Metric
from cc_mujoco.recording.panels import highest_tension
from cc_mujoco.recording.scene3d import (
    TIMELINE,
    WORLD,
    log_motion,
    log_static,
    viewpoint,
)
from cc_mujoco.recording.tendon3d import log_tendons

APPLICATION = "cc_mujoco"
FRAMES_PER_SECOND = 60.0
"""Rate of what is drawn in space; the time series keep every sample."""

# Okabe and Ito's colours, as in the summary figure.
BLUE, ORANGE, GREEN, PURPLE = 0x0072B2FF, 0xD55E00FF, 0x009E73FF, 0xCC79A7FF
SKY, YELLOW = 0x56B4E9FF, 0xE69F00FF

SERIES = (
    ("torque/joint", "joint_torque_nm", BLUE),
    ("torque/desired", "desired_torque_nm", ORANGE),
    ("torque/motor", "motor_torque_nm", GREEN),
    ("torque/wearer", "wearer_torque_nm", PURPLE),
    ("angle/joint", "joint_angle_rad", BLUE),
    ("angle/reference", "reference_angle_rad", ORANGE),
    ("angle/motor", "motor_angle_rad", GREEN),
)
# No spaces in paths: Rerun shows them with a backslash before.
CABLE_SERIES = (
    ("tension/{}/motor_end", "tension_{}_proximal_n", 0),
    ("tension/{}/joint_end", "tension_{}_distal_n", 1),
    ("moving/{}", "moving_{}_fraction", 0),
)
CABLE_COLORS = ((BLUE, SKY), (ORANGE, YELLOW), (GREEN, PURPLE))
"""Motor end and joint end of the first, second, ... cable."""

STATES = {
    "stuck": 0x5F5F5FFF,
    "slips to joint": ORANGE,
    "slips to motor": SKY,
    "slack": 0xE0E0E0FF,
}
"""What an end of a cable does, and the colour of its lane in the timeline."""


def write_recording(
    path: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    metrics: Iterable[Metric] = (),
) -> None:
    """Write an episode as a `.rrd` file.

    Args:
        path: File to write; an older one stays until the new one is whole.
        log: The episode.
        model: The model that the episode was played on.
        metrics: Numbers to show on the page about the episode.
    """
    with recording(path, recording_id(log), _blueprint(log, model)) as rec:
        rec.log("about", _about(log, metrics), static=True)
        log_episode(Branch(rec), log, model, highest_tension(log))


def log_episode(
    rec: Branch, log: EpisodeLog, model: mujoco.MjModel, highest: float
) -> None:
    """Log all that an episode is.

    Args:
        rec: Where to, in an open recording.
        log: The episode.
        model: The model that the episode was played on.
        highest: Tension of the brightest colour [N].
    """
    frames = _frames(log["time_s"])
    _log_series(rec, log)
    _log_states(rec, log)
    _log_scene(rec, log, model, frames, highest)
    _log_nodes(rec, log, frames)


@contextmanager
def recording(
    path: str | os.PathLike[str], identity: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Yield a stream whose content becomes a file, whole or not at all.

    It is kept in memory until then: Rerun's own writer does not say when the disk is
    full, and then waits for ever.

    Args:
        path: Of the file.
        identity: Of the recording.
        blueprint: How it opens.
    """
    with replacing(path) as partial, strict():
        rec = rr.RecordingStream(
            APPLICATION, recording_id=identity, send_properties=False
        )
        memory = rec.memory_recording()
        rec.send_blueprint(blueprint, make_active=False, make_default=True)
        try:
            yield rec
            partial.write_bytes(memory.drain_as_bytes())
        finally:
            rec.disconnect()


def recording_id(log: EpisodeLog) -> str:
    """Return an id that is the same for equal logs, and only for them."""
    digest = hashlib.sha256(json.dumps(log.metadata, sort_keys=True).encode())
    for name, values in log.columns.items():
        digest.update(f"{name}{values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()[:32]


def _frames(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the samples to draw in space, at most about 60 for every second."""
    ticks = np.floor(time * FRAMES_PER_SECOND + 1e-6)
    return np.flatnonzero(np.diff(ticks, prepend=ticks[0] - 1) > 0)


def _log_series(rec: Branch, log: EpisodeLog) -> None:
    index = [rr.TimeColumn(TIMELINE, duration=log["time_s"])]
    for parts, values, color in series(log):
        path = rr.new_entity_path(list(parts))
        name = ", ".join(parts[1:]).replace("_", " ")
        look = rr.SeriesLines(names=[name], colors=[color], widths=[1.5])
        rec.log(path, look, static=True)
        rec.send_columns(path, index, [*rr.Scalars.columns(scalars=values)])


def series(
    log: EpisodeLog,
) -> Iterator[tuple[tuple[str, ...], NDArray[np.float64], int]]:
    """Every line of the plots: parts of its path, values and colour."""
    for path, column, color in SERIES:
        values = log[column]
        if column.endswith("_rad"):
            values = np.degrees(values)
        yield tuple(path.split("/")), values, color
    for number, cable in enumerate(log.cables):
        colors = CABLE_COLORS[number % len(CABLE_COLORS)]
        for path, column, shade in CABLE_SERIES:
            parts = tuple(part.format(cable) for part in path.split("/"))
            yield parts, log[column.format(cable)], colors[shade]


def _log_states(rec: Branch, log: EpisodeLog) -> None:
    """Log what each end of each cable does, whenever that changes."""
    names = np.array(list(STATES))
    colors = np.array(list(STATES.values()), dtype=np.uint32)
    for cable in log.cables:
        slip = log[f"slip_{cable}_direction"]
        for end, place, segment in (("motor", "proximal", 0), ("joint", "distal", -1)):
            slack = log[f"tension_{cable}_{place}_n"] <= 0
            # Directions 0, 1, -1 and slack are positions 0, 1, 2 and 3 in STATES.
            state = np.where(slack, 3, slip[:, segment] % 3)
            changed = np.flatnonzero(np.diff(state, prepend=-1))
            path = rr.new_entity_path(["slip", cable, f"{end}_end"])
            look = rr.StateConfiguration(
                values=list(STATES), labels=list(STATES), colors=colors
            )
            rec.log(path, look, static=True)
            rec.send_columns(
                path,
                [rr.TimeColumn(TIMELINE, duration=log["time_s"][changed])],
                [*rr.StateChange.columns(state=names[state[changed]].tolist())],
            )


def _log_scene(
    rec: Branch,
    log: EpisodeLog,
    model: mujoco.MjModel,
    frames: NDArray[np.intp],
    highest: float,
) -> None:
    time, qpos = log["time_s"][frames], log["qpos"][frames]
    log_static(rec, model)
    log_motion(rec, model, time, qpos)
    tensions = {c: log[f"tension_{c}_nodes_n"][frames] for c in log.cables}
    cables = engine.from_mjcf(model)
    drawn = [cable for cable in tensions if cable in cables and cables[cable].route]
    routes = {cable: engine.route_tendon(model, cable) for cable in drawn}
    log_tendons(rec, model, time, qpos, routes.values())
    for cable, tendon in routes.items():
        tension = tensions[cable]
        shares = conduit_shares(model, cable)
        points = conduit_points(model, cable, qpos, shares)
        radius = float(model.tendon_width[tendon])
        log_conduit(rec, cable, time, points, tension, highest, radius)


def _log_nodes(rec: Branch, log: EpisodeLog, frames: NDArray[np.intp]) -> None:
    """Log tension and slip along each cable as data: one list per frame."""
    index = [rr.TimeColumn(TIMELINE, duration=log["time_s"][frames])]
    for cable in log.cables:
        for kind, column in (
            ("tension", f"tension_{cable}_nodes_n"),
            ("slip", f"slip_{cable}_direction"),
        ):
            values = log[column][frames].astype(np.float64)
            rows = rr.Scalars.columns(scalars=values.reshape(-1))
            lists = rows.partition([values.shape[1]] * len(values))
            rec.send_columns(
                rr.new_entity_path(["nodes", cable, kind]), index, [*lists]
            )


def _about(log: EpisodeLog, metrics: Iterable[Metric]) -> rr.TextDocument:
    """Describe the episode in Markdown, without the model's XML."""
    facts = []
    for key, value in log.metadata.items():
        if key == MODEL_XML:
            continue
        if isinstance(value, dict):
            value = ", ".join(f"{name} {entry}" for name, entry in value.items())
        facts.append((key, str(value)))
    results = []
    for metric in metrics:
        number = f"{metric.value:.4g}" if math.isfinite(metric.value) else "-"
        results.append((metric.name, number, metric.unit, metric.meaning))
    parts = (
        "# Episode",
        markdown.table(("", ""), facts),
        "# Results",
        markdown.table(("", "", "", ""), results, numbers=[1]),
        "Conduits are coloured by tension, grey where the cable is slack.",
    )
    return rr.TextDocument("\n\n".join(parts), media_type=rr.MediaType.MARKDOWN)


def scene_view(
    log: EpisodeLog, model: mujoco.MjModel, root: str = "", name: str = ""
) -> rrb.Spatial3DView:
    """A view of the scene of an episode.

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


def _blueprint(log: EpisodeLog, model: mujoco.MjModel) -> rrb.Blueprint:
    scene = scene_view(log, model)
    about = rrb.TextDocumentView(origin="/about", name="About")

    def plot(origin: str, name: str) -> rrb.TimeSeriesView:
        lines = [values for path, values, _ in series(log) if path[0] == origin]
        return rrb.TimeSeriesView(
            origin=f"/{origin}", name=name, axis_y=axis(log["time_s"], lines)
        )

    plots = rrb.Vertical(
        plot("torque", "Torque [N m]"),
        plot("angle", "Angle [deg]"),
        plot("tension", "Tension at the ends [N]"),
        rrb.TimeSeriesView(origin="/moving", name="Part of the cable that slips"),
        rrb.StateTimelineView(origin="/slip", name="Stick, slip, slack"),
        row_shares=[3, 3, 3, 2, 2],
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(scene, about), plots, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing"),
        collapse_panels=True,
    )


@contextmanager
def strict() -> Iterator[None]:
    """Make Rerun raise on misuse instead of warning and dropping data."""
    before = strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)
