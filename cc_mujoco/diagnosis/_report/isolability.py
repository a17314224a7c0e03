"""Heat map of which effects are confounded in these data, and which are visible."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._phrases import Names
from cc_mujoco.diagnosis._report_data import Isolability
from cc_mujoco.report._figures import BLACK, BLUE, GREY, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CONFUSED_COSINE = 0.9
"""Cosine above which two effects are called confounded."""

MIN_VISIBLE_SIZE = 1.0
"""Size over noise below which an effect is called too small to be seen."""


def confounded_pairs(isolability: Isolability) -> list[tuple[str, str, float]]:
    """Return the pairs of ids with similar signatures, by falling cosine."""
    ids, cosines = isolability.ids, isolability.cosines
    pairs = [
        (ids[row], ids[column], float(cosines[row, column]))
        for row in range(len(ids))
        for column in range(row)
        if cosines[row, column] > CONFUSED_COSINE
    ]
    return sorted(pairs, key=lambda pair: -pair[2])


def invisible_effects(isolability: Isolability) -> list[str]:
    """Return the ids of effects that would drown in the noise."""
    pairs = zip(isolability.ids, isolability.visible, strict=True)
    return [effect for effect, visible in pairs if not visible >= MIN_VISIBLE_SIZE]


def draw_isolability(
    isolability: Isolability, names: Names, width: float
) -> Figure | None:
    """Draw a heat map of cosines and bars of visibility; None without effects.

    Similar effects are adjacent.
    """
    from matplotlib.colors import LinearSegmentedColormap

    count = len(isolability.ids)
    if not count:
        return None
    order = _cluster_order(isolability.cosines)
    cosines = isolability.cosines[np.ix_(order, order)]
    labels = [names(isolability.ids[index]).replace("$", r"\$") for index in order]
    drawing = figure(width, 1.5 + 0.24 * count)
    heat, bars = drawing.subplots(1, 2, sharey=True, width_ratios=[3.2, 1])
    shades = LinearSegmentedColormap.from_list("likeness", ["white", BLUE])
    picture = heat.imshow(cosines, cmap=shades, vmin=0.0, vmax=1.0, aspect="auto")
    _write_numbers(heat, cosines)
    places = range(count)
    heat.set_xticks(places, [str(place + 1) for place in places])
    heat.tick_params(axis="x", labelsize=7)
    heat.set_yticks(places, [f"{name}  {row + 1}" for row, name in enumerate(labels)])
    heat.grid(False)
    heat.set(title="Likeness of two effects")
    drawing.colorbar(
        picture, ax=heat, label="cosine of signatures [1]", location="bottom", aspect=40
    )
    _draw_bars(bars, np.nan_to_num(isolability.visible[order]))
    return drawing


def _cluster_order(cosines: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the order in which similar effects are adjacent."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    if len(cosines) < 3:
        return np.arange(len(cosines))
    distance = 1.0 - np.clip(np.nan_to_num(cosines), 0.0, 1.0)
    distance = 0.5 * (distance + distance.T)
    np.fill_diagonal(distance, 0.0)
    tree = linkage(squareform(distance), "average", optimal_ordering=True)
    return np.asarray(leaves_list(tree), dtype=np.intp)


def _write_numbers(axes: Axes, cosines: NDArray[np.float64]) -> None:
    """Write the likeness into cells off the diagonal that matter."""
    for row, column in np.argwhere(np.nan_to_num(cosines) >= 0.7):
        if row != column:
            axes.text(
                column,
                row,
                f"{cosines[row, column]:.2f}".lstrip("0"),
                ha="center",
                va="center",
                fontsize=6,
                color="white",
            )


def _draw_bars(axes: Axes, visible: NDArray[np.float64]) -> None:
    """Draw bars of the size of each effect over the noise."""
    colors = [BLUE if value >= MIN_VISIBLE_SIZE else GREY for value in visible]
    least = 0.01
    axes.barh(range(len(visible)), np.maximum(visible, least), color=colors, height=0.7)
    axes.axvline(MIN_VISIBLE_SIZE, color=BLACK, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xlim(least, max(10.0, 2.0 * float(visible.max())))
    axes.tick_params(left=False)
    axes.grid(False, axis="y")
    axes.set_title("Visibility")
    axes.set_xlabel("size over noise [1]", fontsize=8, loc="right")
