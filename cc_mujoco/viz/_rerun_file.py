"""The Rerun recording of an episode: a file that opens with a finished layout.

No display is needed to write it. `rerun recording.rrd` opens it. The recording id is a
digest of the log, so equal logs give equal recordings.
"""

import hashlib
import itertools
import json
import os
import shutil
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.error_utils import strict_mode

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.metrics import Metric
from cc_mujoco.metrics._metric import value_text
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import _markdown as markdown
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.simulation._log_columns import MODEL_XML
from cc_mujoco.viz import _film_plots as film_plots
from cc_mujoco.viz._cable_lines import CONDUIT, cable_lines, tension_colors
from cc_mujoco.viz._rerun_plots import ORANGE, PURPLE, SKY, blueprint, plotted_series
from cc_mujoco.viz._scene3d import WORLD, Branch, log_motion, log_static, log_tendons

# States of an end of a cable, and the colour of each in the timeline
END_STATES = {
    "stuck": 0x5F5F5FFF,
    "slips to joint": ORANGE,
    "slips to motor": SKY,
    "slack": 0xE0E0E0FF,
    "to and fro": PURPLE,
}


def log_lanes(rec: Branch, log: EpisodeLog) -> None:
    """Log stick, slip or slack at both ends of each cable whenever it changes."""
    time, names = log["time_s"], np.array(list(END_STATES))
    colors = np.array(list(END_STATES.values()), dtype=np.uint32)
    states = list(END_STATES)
    look = rr.StateConfiguration(values=states, labels=states, colors=colors)
    for cable in log.cables:
        pieces = log.pieces(f"slip_{cable}_direction")
        slip = np.concatenate([rows[:, [0, -1]] for rows in pieces])
        for end, place, segment in (("motor", "proximal", 0), ("joint", "distal", -1)):
            slack = log[f"tension_{cable}_{place}_n"] <= 0
            # Directions 0, 1 and -1 are positions 0, 1 and 2 in END_STATES.
            state = np.where(slack, 3, slip[:, segment] % 3)
            changed, state = state_changes(time, state)
            path = rr.new_entity_path(["slip", cable, f"{end}_end"])
            rec.log(path, look, static=True)
            changes = rr.StateChange.columns(state=names[state].tolist())
            rec.send_series(path, time[changed], [*changes])


def state_changes(
    time: NDArray[np.float64], state: NDArray[np.integer]
) -> tuple[NDArray[np.intp], NDArray[np.integer]]:
    """Return the samples at which a state begins, and that state (changes,) each.

    `time` (T,) [s] increases; `state` (T,) indexes `END_STATES`. Four or more brief
    states in a row become one state "to and fro".
    """
    begun = np.flatnonzero(np.diff(state, prepend=-1))
    lasts = np.diff(time[begun], append=time[-1])
    # A motor shaking with sensor noise makes thousands of states, of which a lane would
    # show none: four or more in a row, each shorter than 0.03 s, become one.
    brief = np.concatenate([[False], lasts < 0.03, [False]])
    edges = np.flatnonzero(np.diff(brief)).reshape(-1, 2)
    found = state[begun]
    kept = np.ones(len(begun), dtype=bool)
    for first, last in edges.tolist():
        if last - first >= 4:
            found[first] = 4  # "to and fro"
            kept[first + 1 : last] = False
    return begun[kept], found[kept]


def write_recording(
    path: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    metrics: Mapping[Metric, float] = MappingProxyType({}),
) -> None:
    """Write an episode as a `.rrd` file, which replaces an older one when complete.

    The recording's page about the episode shows the `metrics`.
    """
    opening = blueprint(log.thinned(film_plots.MAX_SAMPLES), model)
    with recording(path, recording_id(log), opening) as rec:
        rec.log("about", _about(log, metrics), static=True)
        log_episode(Branch(rec), log, model, film_plots.highest_tension(log))


def log_episode(
    rec: Branch, log: EpisodeLog, model: mujoco.MjModel, highest: float
) -> None:
    log_lanes(rec, log)
    log = log.thinned(film_plots.MAX_SAMPLES)
    time = log["time_s"]
    ticks = np.floor(time * _rate(time) + 1e-6)
    frames = np.flatnonzero(np.diff(ticks, prepend=ticks[0] - 1) > 0)
    for line in plotted_series(log):
        path = rr.new_entity_path(list(line.path))
        look = rr.SeriesLines(names=[line.name], colors=[line.color], widths=[1.5])
        rec.log(path, look, static=True)
        rec.send_series(path, time, [*rr.Scalars.columns(scalars=line.values)])
    _log_scene(rec, log, model, frames, highest)
    _log_nodes(rec, log, frames)


@contextmanager
def recording(
    path: str | os.PathLike[str], identity: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Yield a stream whose data replace the file `path` when the block succeeds.

    Rerun writes to a pipe that a thread copies to the file, so memory does not hold all
    data, and a full disk raises an error; Rerun's own writer would wait for ever.
    Windows has no such pipe: there all data stay in memory until the end.
    """
    with replacing(path) as partial, strict():
        own: Any = {"recording_id": identity, "send_properties": False}
        # By size alone: cut by time, recordings of equal data would differ.
        own["batcher_config"] = rr.ChunkBatcherConfig(flush_tick=1e6)
        rec = rr.RecordingStream("cc_mujoco", **own)
        saved = _saved_on_windows if sys.platform == "win32" else _saved
        with saved(rec, partial):
            rec.send_blueprint(blueprint, make_active=False, make_default=True)
            yield rec


@contextmanager
def _saved(rec: rr.RecordingStream, path: Path) -> Iterator[None]:
    """Write the data logged in the block to `path`; raise its errors (full disk)."""
    failures: list[OSError] = []

    def move_on(pipe: int) -> None:
        with open(pipe, "rb", buffering=0) as source:
            try:
                with path.open("wb") as file:
                    shutil.copyfileobj(source, file, 1 << 20)
            except OSError as error:
                failures.append(error)
                while source.read(1 << 20):  # else Rerun would wait for a reader
                    pass

    reading, writing = os.pipe()
    mover = threading.Thread(target=move_on, args=(reading,), daemon=True)
    mover.start()
    try:
        rec.save(f"/dev/fd/{writing}")
    finally:
        os.close(writing)
    try:
        yield
    finally:
        rec.disconnect()
        mover.join()
    if failures:
        raise failures[0]


@contextmanager
def _saved_on_windows(rec: rr.RecordingStream, path: Path) -> Iterator[None]:
    memory = rec.memory_recording()
    try:
        yield
        path.write_bytes(memory.drain_as_bytes())
    finally:
        rec.disconnect()


def recording_id(log: EpisodeLog) -> str:
    """Return a digest of the log, equal for equal logs only."""
    digest = hashlib.sha256(json.dumps(log.metadata, sort_keys=True).encode())
    for column in log.schema:
        pieces = log.pieces(column.name)
        first = next(pieces)
        shape = len(log), *first.shape[1:]
        digest.update(f"{column.name}{shape}".encode())
        for rows in itertools.chain([first], pieces):
            digest.update(rows.tobytes())
    return digest.hexdigest()[:32]


def _rate(time: Array) -> float:
    # At most 18 000 frames in space: a longer episode shows fewer than 60 per second.
    return film_plots.frame_rate(time, 60.0, 18_000)


def _log_scene(
    rec: Branch,
    log: EpisodeLog,
    model: mujoco.MjModel,
    frames: NDArray[np.intp],
    highest: float,
) -> None:
    time, qpos = log["time_s"][frames], log.rows("qpos", frames)
    log_static(rec, model)
    log_motion(rec, model, time, qpos)
    lines = cable_lines(model, log.cables)
    followed = [line.source for line in lines if isinstance(line.source, int)]
    log_tendons(rec, model, time, qpos, followed)
    for line in lines:
        place = [line.cable] if line.part == CONDUIT else [line.cable, line.part]
        path = rr.new_entity_path([WORLD, "conduit", *place])
        look = rr.LineStrips3D.from_fields(radii=[line.radius])
        rec.log(path, look, static=True)
        for some in film_plots.frame_slices(len(time)):
            nodes = log.rows(f"tension_{line.cable}_nodes_n", frames[some])
            colors = tension_colors(line.tensions(nodes), highest)
            points = line.all_points(model, qpos[some])
            _log_conduit(rec, path, time[some], points, colors)


def _log_conduit(
    rec: Branch, path: str, time: Array, ends: Array, colors: NDArray[np.uint8]
) -> None:
    """Log a coloured polyline at `path` for some frames, at `time` (t,) [s].

    `ends` (t, P, 3) [m] are the ends of its parts, `colors` (t, P-1, 4) theirs.
    """
    lengths = [ends.shape[1] - 1] * len(ends)
    own = rr.LineStrips3D.columns(colors=colors.reshape(-1, 4))
    columns = [*own.partition(lengths)]
    pairs = np.stack([ends[:, :-1], ends[:, 1:]], axis=2).astype(np.float32)
    if np.allclose(ends, ends[0], rtol=0.0, atol=1e-6):  # only its colours change
        strips = rr.LineStrips3D.columns(strips=pairs[0])
        rec.send_series(path, time[:1], [*strips.partition(lengths[:1])])
    else:
        strips = rr.LineStrips3D.columns(strips=pairs.reshape(-1, 2, 3))
        columns = [*strips.partition(lengths), *columns]
    rec.send_series(path, time, columns)


def _log_nodes(rec: Branch, log: EpisodeLog, frames: NDArray[np.intp]) -> None:
    time = log["time_s"][frames]
    for cable in log.cables:
        for kind, column in (
            ("tension", f"tension_{cable}_nodes_n"),
            ("slip", f"slip_{cable}_direction"),
        ):
            path = rr.new_entity_path(["nodes", cable, kind])
            for some in film_plots.frame_slices(len(frames)):
                values = log.rows(column, frames[some]).astype(np.float64)
                rows = rr.Scalars.columns(scalars=values.reshape(-1))
                lists = rows.partition([values.shape[1]] * len(values))
                rec.send_series(path, time[some], [*lists])


def _about(log: EpisodeLog, metrics: Mapping[Metric, float]) -> rr.TextDocument:
    facts = []
    for key, value in log.metadata.items():
        if isinstance(value, dict):
            value = ", ".join(f"{name} {entry}" for name, entry in value.items())
        if key != MODEL_XML:
            facts.append((key, str(value)))
    results = [(m.name, value_text(v), m.unit, m.meaning) for m, v in metrics.items()]
    parts = (
        "# Episode",
        markdown.table(("", ""), facts),
        "# Results",
        markdown.table(("", "", "", ""), results, numbers=[1]),
        *_thinning(log),
        "Conduits and the ropes at their ends are coloured by tension, grey where the "
        "cable is slack; other tendons have their own colour, or are brown.",
    )
    return rr.TextDocument("\n\n".join(parts), media_type=rr.MediaType.MARKDOWN)


def _thinning(log: EpisodeLog) -> list[str]:
    time = log["time_s"]
    rate, shown = _rate(time), len(log.thinned(film_plots.MAX_SAMPLES))
    if rate == 60.0 and shown == len(log):
        return []
    return [
        f"The episode is long: of its samples one in {-(-len(log) // shown)} is "
        f"plotted, and the scene has {rate:.3g} frames in every second; the log has "
        "all of them."
    ]


@contextmanager
def strict() -> Iterator[None]:
    """Make Rerun raise on misuse instead of warning and dropping data."""
    before = strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)
