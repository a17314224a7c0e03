"""Video of an episode: the scene with cables coloured by tension, and the plots.

    write_video("episode.mp4", log, env.unwrapped.model)

30 frames for every simulated second, in H.264, which every player and page shows. No
display is needed, but OpenGL and PyAV (`pip install 'cc_mujoco[video]'`) are.
"""

import os
import textwrap
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.errors import CableError, import_extra
from cc_mujoco.report._figures import GREY, TENSION_COLORS, style
from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz import _film_plots as panels
from cc_mujoco.viz import _offscreen_renderer as offscreen
from cc_mujoco.viz._film_plots import FRAME_RATE, draw_lines, highest_tension
from cc_mujoco.viz._plot_axes import axis_limits
from cc_mujoco.viz._summary import episode_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Picture = NDArray[np.uint8]


class _Layout(NamedTuple):
    """Positions of scene and plots in a frame [pixels]."""

    size: tuple[int, int] = (720, 1280)  # height and width
    scene: tuple[int, int, int, int] = (44, 632, 0, 760)  # top, height, left, width
    plots: tuple[int, int] = (836, 1256)  # first and last column
    cursor: int = 2  # width of the line at the moment shown


LAYOUT = _Layout()
CODEC, PIXEL_FORMAT = "libx264", "yuv420p"
"""Codec, and format that every player knows. The size stays, so that nothing is lost
where colours are taken from every other pixel without a filter, in two thirds of the
time."""


class Strips:
    """Frames of a video without the scene: plots, faded to the right of a time."""

    def __init__(self, log: EpisodeLog, highest: float) -> None:
        self._start, self._end = float(log["time_s"][0]), float(log["time_s"][-1])
        self._whole, self.rows = _draw_surroundings(log, highest, 1.0)
        self._faded_frame, _ = _draw_surroundings(log, highest, 0.25)
        self._frame, self._column = self._faded_frame.copy(), LAYOUT.scene[3]

    def column(self, time: float) -> int:
        """Return the pixel column at which the plots show the time [s]."""
        share = (time - self._start) / max(self._end - self._start, 1e-9)
        return round(LAYOUT.plots[0] + share * (LAYOUT.plots[1] - LAYOUT.plots[0]))

    def frame(self, scene: Picture, time: float) -> Picture:
        """Return the frame (720, 1280, 3) at `time` [s]; the next call overwrites it.

        `scene` is the picture of the scene, of the size in `LAYOUT.scene`.
        """
        frame, column = self._frame, self.column(time)
        low, high = sorted((self._column, column))
        low, high = low - LAYOUT.cursor, high + LAYOUT.cursor
        frame[:, low:column] = self._whole[:, low:column]
        frame[:, column:high] = self._faded_frame[:, column:high]
        self._column = column
        half = LAYOUT.cursor // 2
        for top, bottom in self.rows:
            frame[top:bottom, column - half : column + half] = 0
        top, height, left, width = LAYOUT.scene
        frame[top : top + height, left : left + width] = scene
        return frame


def _draw_surroundings(
    log: EpisodeLog, highest: float, opacity: float
) -> tuple[Picture, list[tuple[int, int]]]:
    """Draw a frame without its scene; return it, and each plot's (top, bottom) row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = LAYOUT.size
    with style():
        figure = Figure(figsize=(width / 100, height / 100), dpi=100)
        canvas = FigureCanvasAgg(figure)
        title = textwrap.wrap(episode_title(log), 105)  # characters above the scene
        place, size = (
            (14 / width, 1 - 22 / height),
            min(11.0, 24.0 / max(len(title), 1)),
        )
        figure.text(*place, "\n".join(title), fontsize=size, va="center")
        _draw_scale(figure, highest)
        plots = _draw_plots(figure, log, opacity)
        canvas.draw()  # type: ignore[no-untyped-call]
        pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
        picture = np.array(pixels)[..., :3]
    boxes = [axes.get_window_extent() for axes in plots]
    return picture, [(height - round(b.y1), height - round(b.y0)) for b in boxes]


def _draw_scale(figure: "Figure", highest: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    height, width = LAYOUT.size
    axes = figure.add_axes((120 / width, 22 / height, 400 / width, 10 / height))
    colors = ScalarMappable(Normalize(0.0, highest), TENSION_COLORS)
    figure.colorbar(colors, cax=axes, orientation="horizontal")
    axes.tick_params(length=2, pad=1, labelsize=8)
    middle = 27 / height
    figure.text(14 / width, middle, "tension [N]", fontsize=9, va="center")
    figure.text(540 / width, middle, "grey: slack", fontsize=9, va="center")


def _draw_plots(figure: "Figure", log: EpisodeLog, opacity: float) -> "list[Axes]":
    height, width = LAYOUT.size
    shown = panels.torques(log) + panels.tensions(log)
    if len(shown) > 7:  # more than fit: of several axes, the torques at the joints
        shown = panels.torques(log)[::2][:7]
    top, bottom, between = 44, 52, 34
    each = (height - top - bottom - between * (len(shown) - 1)) / len(shown)
    time, plots = log["time_s"], []
    for number, (name, unit, lines) in enumerate(shown):
        low = height - top - each - number * (each + between)
        left, right = (column / width for column in LAYOUT.plots)
        axes = figure.add_axes((left, low / height, right - left, each / height))
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        draw_lines(axes, time, lines, alpha=opacity)
        axes.set(title=f"{name} [{unit}]")
        axes.set_xlim(time[0], max(time[-1], time[0] + 1e-9))
        reach = axis_limits(time, [line.values for line in lines])
        if reach is not None:
            axes.set_ylim(*reach)
        axes.locator_params(axis="y", nbins=5)
        if len(lines) > 1:
            place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.97)}
            legend = axes.legend(ncols=2, borderpad=0.2, **place)
            for handle in legend.get_lines():
                handle.set_alpha(1.0)
        axes.tick_params(labelbottom=number == len(shown) - 1)
        plots.append(axes)
    plots[-1].set_xlabel("time [s]")
    return plots


def require_video() -> None:
    """Raise `CableError` if PyAV or OpenGL, which a video needs, is missing."""
    _av()
    offscreen.require_opengl()


def write_video(
    path: str | os.PathLike[str],
    log: EpisodeLog,
    model: mujoco.MjModel,
    progress: Callable[[float], object] | None = None,
) -> None:
    """Write the video of an episode as MP4, which replaces an older one when complete.

    `progress` is called with the simulated time [s] that is encoded, first with 0.
    """
    av = _av()
    progress = progress or (lambda time: None)
    progress(0.0)
    samples = panels.frame_samples(log["time_s"])
    highest = highest_tension(log)
    strips = Strips(log.thinned(panels.MAX_SAMPLES), highest)
    _, height, _, width = LAYOUT.scene
    poses = log.rows("qpos", np.linspace(0, len(log) - 1, 40).astype(int))
    look = highest, poses, (height, width)
    # The index in front, so that a page can show it while it arrives.
    how: dict[str, Any] = {"format": "mp4", "options": {"movflags": "+faststart"}}
    with (
        replacing(path) as partial,
        offscreen.OffscreenRenderer(model, log.cables, *look) as stage,
        av.open(os.fspath(partial), "w", **how) as film,
        ThreadPoolExecutor(1) as other,  # finishes a frame while the next is drawn
    ):
        # Fast, with sharp lines and letters, in parallel to rendering
        own = {"preset": "veryfast", "crf": "20", "threads": "1"}
        stream = film.add_stream(CODEC, rate=FRAME_RATE, options=own)
        stream.height, stream.width = LAYOUT.size
        stream.pix_fmt = PIXEL_FORMAT

        def encode(number: int, exposure: offscreen.Exposure, time: float) -> None:
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
    """Yield time [s], `qpos` (nq,) and node tensions by cable (n,) [N] at `samples`."""
    for part in panels.frame_slices(len(samples), 600):
        some = samples[part]
        time, qpos = log.rows("time_s", some), log.rows("qpos", some)
        nodes = {c: log.rows(f"tension_{c}_nodes_n", some) for c in log.cables}
        for row in range(len(some)):
            tensions = {cable: values[row] for cable, values in nodes.items()}
            yield float(time[row]), qpos[row], tensions


def _av() -> Any:
    av = import_extra("av", "a video needs PyAV", "video")
    if CODEC not in av.codecs_available:
        raise CableError(f"a video needs PyAV with {CODEC}, which this one lacks.")
    return av
