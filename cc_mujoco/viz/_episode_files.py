"""Files of an episode: log, metrics, figure, Rerun recording, video and web page."""

import dataclasses
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import mujoco

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.provenance import write_manifest
from cc_mujoco.metrics import METRICS, Metric, expand_cable_metrics, measure_axes
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz._summary import write_summary

LOG_FILE = "log.parquet"
_REWRITTEN_FILES = ("recording.rrd", "metrics.json", "summary.png")
EPISODE_FILES = (*_REWRITTEN_FILES, LOG_FILE, atomic_io.MANIFEST)
EPISODE_METRICS = (
    "rms_torque_error", "torque_lag", "peak_joint_torque", "rms_joint_torque",
    "rms_angle_error", "twist_backlash", "efficiency", "efficiency_motor_drives",
    "efficiency_wearer_drives", "motor_share", "slack_time_{cable}",
    "dissipated_energy_{cable}",
)  # fmt: skip
VIDEO_FILE, PAGE_FILE = "video.mp4", "episode.html"  # on request


def require_ours(
    folder: str | os.PathLike[str], video: bool = False, html: bool = False
) -> None:
    """Raise `CableError` unless a later `write_episode` can write to the folder."""
    atomic_io.require_ours(folder, lambda place: atomic_io.is_marked(place / LOG_FILE))
    atomic_io.require_unmodified(folder, (*_REWRITTEN_FILES, VIDEO_FILE, PAGE_FILE))
    if video:
        from cc_mujoco.viz._video import require_video

        require_video()
    if html:
        from cc_mujoco.viz._web_page import require_page

        require_page()


def write_episode(
    folder: str | os.PathLike[str],
    log: EpisodeLog | Callable[[Path], EpisodeLog],
    model: mujoco.MjModel,
    *,
    metrics: Iterable[Metric] = (),
    video: bool = False,
    html: bool = False,
    progress: Callable[[float], object] | None = None,
    say: Callable[[str], object] = lambda sentence: None,
) -> dict[Metric, float]:
    """Write recording, log, metrics and figure, and on request video and page.

    They are written next to the folder and moved into it when all are complete; other
    files in the folder are not changed. Video and page of an earlier episode are
    removed with its log.

    Args:
        folder: Folder of the `EPISODE_FILES`; made if needed.
        log: The episode, or a function that plays it: it is called with the file to
            which it writes the log while the episode runs, and returns the log.
        model: The model that the episode was played on.
        metrics: Measured besides `EPISODE_METRICS`.
        video: Whether to write `VIDEO_FILE` as well.
        html: Whether to write `PAGE_FILE` as well.
        progress: Called with the simulated time [s] that the video has reached.
        say: Called with a sentence if a video or page of an earlier episode is
            removed, or if a cable is drawn along a route that it does not name.

    Returns:
        The value of every metric that was written.
    """
    from cc_mujoco.viz._cable_lines import line_notes
    from cc_mujoco.viz._rerun_file import write_recording

    require_ours(folder)
    chosen = dict.fromkeys((*(METRICS[name] for name in EPISODE_METRICS), *metrics))
    with atomic_io.replacing_folder(folder) as partial:
        if isinstance(log, EpisodeLog):
            log.write(partial / LOG_FILE)
        else:
            log = log(partial / LOG_FILE)
        every = expand_cable_metrics(chosen, log.cables)
        measured = measure_axes(log, every)
        found = {}
        for axis, metric, value in measured:
            if axis:
                name, meaning = f"{axis}.{metric.name}", f"{metric.meaning}, of {axis}"
                metric = dataclasses.replace(metric, name=name, meaning=meaning)
            found[metric] = value
        write_metrics(partial / "metrics.json", found)
        write_summary(partial / "summary.png", log)
        write_recording(partial / "recording.rrd", log, model, found)
        if video:
            from cc_mujoco.viz._video import write_video

            write_video(partial / VIDEO_FILE, log, model, progress)
        if html:
            from cc_mujoco.viz._web_page import write_page

            write_page(partial / PAGE_FILE, log, model, found)
        for note in line_notes(model, log.cables):
            say(note)
        write_manifest(partial, [path.name for path in partial.iterdir()])
    for name, written in ((VIDEO_FILE, video), (PAGE_FILE, html)):
        old = Path(folder, name)
        if not written and old.exists():
            old.unlink()
            say(f"{old} is deleted, as it showed an earlier episode.")
    return found


def write_metrics(path: str | os.PathLike[str], found: Mapping[Metric, float]) -> None:
    """Write values with unit and meaning as JSON; NaN becomes `null`."""
    content = {}
    for metric, value in found.items():
        number = value if math.isfinite(value) else None
        about = {"unit": metric.unit, "meaning": metric.meaning}
        content[metric.name] = {"value": number} | about
    with atomic_io.replacing(path) as partial:
        partial.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
