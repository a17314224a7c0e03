"""Style of every figure of this package: Matplotlib's objects on the Agg canvas.

    with style():
        drawing = figure(8.0, 4.0)
        axes = drawing.add_subplot()
        axes.plot(time, torque, color=BLUE)
        axes.set(title="Torque", xlabel="time [s]", ylabel="torque [N m]")

No display is needed and no global state is changed. Axes read the style when they are
made, lines when they are drawn, so that both belong inside `style`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cc_mujoco._utils.atomic_io import replacing

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

# Okabe and Ito's colours, distinguishable for every kind of colour vision.
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#6E6E6E"
PINK, YELLOW, SKY, BLACK = "#CC79A7", "#E69F00", "#56B4E9", "#000000"
COLORS = (BLUE, ORANGE, GREEN, PINK, YELLOW, SKY, BLACK, GREY)
DASH_PATTERN = (4, 2)
TENSION_COLORS = "viridis"

SOFTWARE_TAG = "cc_mujoco"
"""Software that the metadata of this package's figures name."""


def style() -> AbstractContextManager[None]:
    """Return a context in which Matplotlib makes and draws axes in this style."""
    from matplotlib.style import context

    return context(Path(__file__).with_name("figures.mplstyle"))


def figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size [inch] with constrained layout."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(drawing)
    return drawing


def set_ticks(axis: Axis, values: Iterable[float]) -> None:
    """Set the ticks of an axis to `values`, as plain numbers on log scales too."""
    values = list(values)
    axis.set_ticks(values, [f"{value:g}" for value in values])
    axis.set_ticks([], minor=True)


def save(path: str | os.PathLike[str], drawing: Figure, *, dpi: float = 130.0) -> None:
    """Write a figure to a PNG file, atomically."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.image import imsave

    # `savefig` draws all of it twice, once for the layout, with the same bits.
    canvas: Any = FigureCanvasAgg(drawing)
    drawing.set_dpi(dpi)
    # Lines are drawn in pieces: a long one to and fro needs much memory.
    with matplotlib.rc_context({"agg.path.chunksize": 10_000}):
        canvas.draw()
    about = {"Software": SOFTWARE_TAG}
    with replacing(path) as partial:
        imsave(partial, canvas.buffer_rgba(), format="png", dpi=dpi, metadata=about)


def is_ours(path: Path) -> bool:
    """Return whether `save` wrote this file, by the software named in the PNG."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.info.get("Software") == SOFTWARE_TAG
    except OSError:
        return False
