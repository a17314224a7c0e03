"""Files of an episode: all that is made of a log."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

from cc_mujoco import files
from cc_mujoco.metrics import METRICS, Metric, measure, of_cables
from cc_mujoco.recording.log import EpisodeLog
from cc_mujoco.recording.summary import write_summary

if TYPE_CHECKING:
    pass

LOG = "log.parquet"
FILES = ("recording.rrd", LOG, "metrics.json", "summary.png", files.WRITTEN)
"""Files that `write_episode` leaves in its folder."""
_CHANGED = ("recording.rrd", "metrics.json", "summary.png")
MEASURED = (
    "rms_torque_error",
    "torque_lag",
    "peak_joint_torque",
    "rms_joint_torque",
    "rms_angle_error",
    "twist_backlash",
    "efficiency",
    "efficiency_motor_drives",
    "efficiency_wearer_drives",
    "motor_share",
    "slack_time_{cable}",
    "dissipated_energy_{cable}",
)
"""Metrics of an episode that is played."""
VIDEO, PAGE = "video.mp4", "episode.html"
"""Files that it also leaves there on request."""


def require_ours(folder: str | os.PathLike[str]) -> None:
    """Find out, before an episode is played, whether its files may be written there.

    Raises:
        CableError: If not; see `files.require_ours` and `files.require_signed`.
    """
    names = (*FILES, VIDEO, PAGE)
    files.require_ours(folder, names, lambda place: files.is_marked(place / LOG))
    files.require_signed(folder, (*_CHANGED, VIDEO, PAGE))


def write_episode(
    folder: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    *,
    metrics: Iterable[Metric] = (),
    video: bool = False,
    html: bool = False,
    progress: Callable[[float], object] | None = None,
    say: Callable[[str], object] = lambda sentence: None,
) -> dict[Metric, float]:
    """Write recording, log, metrics and figure, and on request video and page.

    They are made beside the folder and moved into it when all are whole; other files in
    the folder are left alone. Video and page of an earlier episode go with its log.

    Args:
        folder: Where `FILES` shall lie; made if need be.
        log: The episode.
        model: The model that the episode was played on.
        metrics: Measured besides `MEASURED`.
        video: Whether to write `VIDEO`, too.
        html: Whether to write `PAGE`, too.
        progress: Called with the simulated time [s] that the video has reached.
        say: Called with a sentence where a video or page of an earlier episode goes.

    Returns:
        The value of every metric that was written.

    Raises:
        CableError: If the folder has files by these names that are not an episode's, or
            cannot be written; if a video cannot be made, see `video.require_video`; if
            a page cannot, see `web_page.require_page`.
    """
    from cc_mujoco.recording.rerun_file import write_recording

    require_ours(folder)
    chosen = dict.fromkeys((*(METRICS[name] for name in MEASURED), *metrics))
    found = measure(log, of_cables(chosen, log.cables))
    with files.replacing_folder(folder) as partial:
        log.write(partial / LOG)
        write_metrics(partial / "metrics.json", found)
        write_summary(partial / "summary.png", log)
        write_recording(partial / "recording.rrd", log, model, found)
        if video:
            from cc_mujoco.recording.video import write_video

            write_video(partial / VIDEO, log, model, progress)
        if html:
            from cc_mujoco.recording.web_page import write_page

            write_page(partial / PAGE, log, model, found)
        files.sign(partial, [path.name for path in partial.iterdir()])
    for name, written in ((VIDEO, video), (PAGE, html)):
        old = Path(folder, name)
        if not written and old.exists():
            old.unlink()
            say(f"{old} is deleted, as it showed an earlier episode.")
    return found


def write_metrics(path: str | os.PathLike[str], found: Mapping[Metric, float]) -> None:
    """Write values with unit and meaning as JSON; NaN becomes `null`."""
    content = {
        metric.name: {
            "value": value if math.isfinite(value) else None,
            "unit": metric.unit,
            "meaning": metric.meaning,
        }
        for metric, value in found.items()
    }
    with files.replacing(path) as partial:
        partial.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
