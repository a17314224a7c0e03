"""Video of an episode: the scene with cables coloured by tension, and the plots.

    write_video("episode.mp4", log, env.unwrapped.model)

30 frames for every simulated second, in H.264, which every player and page shows. No
display is needed, but OpenGL and PyAV (`pip install 'cc_mujoco[video]'`) are.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.errors import CableError
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz._frame_times import FRAME_RATE, MAX_SAMPLES, frame_samples
from cc_mujoco.viz._offscreen_renderer import (
    Exposure,
    OffscreenRenderer,
    require_opengl,
)
from cc_mujoco.viz._overlays import FRAME_SIZE, SCENE_RECTANGLE, Strips
from cc_mujoco.viz._panels import highest_tension

CODEC = "libx264"
ENCODER_OPTIONS = {"preset": "veryfast", "crf": "20", "threads": "1"}
"""Encoder settings: fast, with sharp lines and letters; runs parallel to rendering."""
PIXEL_FORMAT = "yuv420p"
"""Pixel format, which every player knows. The size stays, so that nothing is lost where
colours are taken from every other pixel without a filter, in two thirds of the time."""
CONTAINER_OPTIONS = {"movflags": "+faststart"}
"""The index in front, so that a page can show it while it arrives."""
CAMERA_POSES = 40
"""Poses of the episode that the camera is aimed by."""
FRAMES_AT_ONCE = 600
"""Frames whose tensions are in memory at the same time."""


def require_video() -> None:
    """Find out, before an episode is played, whether a video can be made of it."""
    _av()
    require_opengl()


def write_video(
    path: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    progress: Callable[[float], object] | None = None,
) -> None:
    """Write the video of an episode as MP4; an older file stays until it is whole.

    `progress` is called with the simulated time [s] of what is done, first with 0.
    """
    av = _av()
    progress = progress or (lambda time: None)
    progress(0.0)
    samples = frame_samples(log["time_s"])
    highest = highest_tension(log)
    strips = Strips(log.thinned(MAX_SAMPLES), highest)
    _, height, _, width = SCENE_RECTANGLE
    poses = log.rows("qpos", np.linspace(0, len(log) - 1, CAMERA_POSES).astype(int))
    with (
        replacing(path) as partial,
        OffscreenRenderer(model, log.cables, highest, poses, (height, width)) as stage,
        av.open(
            os.fspath(partial), "w", format="mp4", options=CONTAINER_OPTIONS
        ) as film,
        ThreadPoolExecutor(1) as other,  # finishes a frame while the next is drawn
    ):
        stream = film.add_stream(CODEC, rate=FRAME_RATE, options=ENCODER_OPTIONS)
        stream.height, stream.width = FRAME_SIZE
        stream.pix_fmt = PIXEL_FORMAT

        def encode(number: int, exposure: Exposure, time: float) -> None:
            scene = stage.compose_picture(exposure)
            frame = av.VideoFrame.from_ndarray(strips.frame(scene, time), "rgb24")
            frame = frame.reformat(format=PIXEL_FORMAT, interpolation="POINT")
            frame.pts, frame.time_base = number, Fraction(1, FRAME_RATE)
            film.mux(stream.encode(frame))

        waiting = None
        for number, (time, qpos, tensions) in enumerate(_shown(log, samples)):
            exposure = stage.render_moving(qpos, tensions)
            if waiting is not None:
                waiting.result()
            waiting = other.submit(encode, number, exposure, time)
            progress((number + 1) / FRAME_RATE)
        if waiting is not None:
            waiting.result()
        film.mux(stream.encode(None))


def _shown(
    log: EpisodeLog, samples: NDArray[np.intp]
) -> Iterator[tuple[float, NDArray[np.float64], dict[str, NDArray[np.float64]]]]:
    """Yield time, pose and tensions at the nodes of the cables of some samples."""
    for start in range(0, len(samples), FRAMES_AT_ONCE):
        some = samples[start : start + FRAMES_AT_ONCE]
        time, qpos = log.rows("time_s", some), log.rows("qpos", some)
        nodes = {c: log.rows(f"tension_{c}_nodes_n", some) for c in log.cables}
        for row in range(len(some)):
            tensions = {cable: values[row] for cable, values in nodes.items()}
            yield float(time[row]), qpos[row], tensions


def _av() -> Any:
    try:
        import av
    except ImportError:
        raise CableError(
            "a video needs PyAV: pip install 'cc_mujoco[video]'."
        ) from None
    if CODEC not in av.codecs_available:
        raise CableError(f"a video needs PyAV with {CODEC}, which this one lacks.")
    return av
