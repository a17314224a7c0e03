"""Figures of a study: heat maps, Pareto plots, main effects."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.design._pareto import column
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._protocol import known_metric, metric_of
from cc_mujoco.design._sensitivity import Sensitivity, Surface
from cc_mujoco.device._variables import describe
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import _figures as figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cc_mujoco.design._report_text import RankedStudy

PAGE_WIDTH = 4.8
"""Width of a figure whose text can be read where the page is 390 px wide [inch]."""


def answer_plot(study: RankedStudy, x: str) -> Figure:
    """Return a plot of the first objective over the column `x`, metric or variable."""
    table, objective = study.table, study.goals[0]
    drawing = figures.figure(0.88 * PAGE_WIDTH, 3.1)  # in the header
    axes = drawing.add_subplot()
    y = column(table, objective.name)
    levels: list[object] = []
    places = table[x].to_pylist()
    if any(isinstance(value, str) for value in places):
        levels = list(dict.fromkeys(places))
        across = np.array([levels.index(place) for place in places], dtype=float)
    else:
        across = column(table, x)
    _scatter(axes, across, y, study.front)
    for place, row in enumerate(study.marked):
        axes.plot(
            across[row], y[row], "s" if place else "*", markersize=7 if place else 12,
            color=figures.BLUE, label=None if place else "best",
        )  # fmt: skip
        axes.annotate(
            str(table["design"][row].as_py()), (across[row], y[row]),
            xytext=(6, 6), textcoords="offset points", fontsize=9, fontweight="bold",
        )  # fmt: skip
    known = known_metric(x)
    axes.set_xlabel(_label(x, known.high) if known is not None else _variable(x))
    axes.set_ylabel(_label(objective.name, objective.high))
    if levels:
        axes.set_xticks(range(len(levels)), [str(level) for level in levels])
    else:
        _log_where_wide(axes, across, y)
    axes.legend(loc="best")
    return drawing


def pareto_plot(study: RankedStudy) -> Figure:
    """Return scatter plots of each pair of objectives, with the Pareto set marked."""
    best, pairs = study.front, list(itertools.combinations(study.goals, 2))
    drawing = figures.figure(PAGE_WIDTH, 3.2 * len(pairs))
    panels = drawing.subplots(len(pairs), squeeze=False)[:, 0]
    for axes, (one, other) in zip(panels, pairs, strict=True):
        x, y = (column(study.table, o.name) for o in (one, other))
        _scatter(axes, x, y, best)
        axes.set_xlabel(_label(one.name, one.high))
        axes.set_ylabel(_label(other.name, other.high))
        _log_where_wide(axes, x, y)
    panels[0].legend(loc="best")
    panels[0].set_title(f"Pareto set: {int(best.sum())} of {len(best)} designs")
    return drawing


def _scatter(axes: Axes, x: Array, y: Array, best: NDArray[np.bool_]) -> None:
    axes.plot(x[~best], y[~best], ".", color=figures.GREY, alpha=0.45, markersize=4,
              label="designs")  # fmt: skip
    axes.plot(x[best], y[best], "o", color=figures.ORANGE, markersize=4.5,
              label="Pareto set")  # fmt: skip


def effects_plot(found: Sequence[Sensitivity], most: int | None = None) -> Figure:
    """Return plots of the mean of each metric (a row) over each variable (a column).

    Only the `most` variables with the largest shares of variance are drawn; None is
    all.
    """
    largest = {n: max(one.total[n] for one in found) for n in found[0].effects}
    names = sorted(largest, key=lambda name: -largest[name])[:most]
    width = 1.2 + 2.1 * len(names) if most is None else PAGE_WIDTH
    drawing = figures.figure(width, 0.9 + 1.35 * len(found))
    panels = drawing.subplots(len(found), len(names), squeeze=False, sharey="row")
    for row, one in zip(panels, found, strict=True):
        for axes, name in zip(row, names, strict=True):
            x, y = one.effects[name]
            axes.plot(x, y, "o-", color=figures.BLUE, markersize=2.5)
            axes.set_title(
                f"{max(one.first[name], 0.0):.0%}", loc="right", y=1.0, pad=2,
                fontsize=8, fontweight="normal", color=figures.GREY,
            )  # fmt: skip
            axes.locator_params(axis="x", nbins=3)
            if name in one.levels:
                axes.set_xticks(x, one.levels[name], fontsize=6)
        metric = metric_of(one.metric)
        name = metric.name.replace("_", "\n")
        row[0].set_ylabel(f"{name}\n[{metric.unit}]", fontsize=8)
        # `align_ylabels` measures every label against all others: quadratic.
        # So labels get a place, in panel widths from the left side.
        row[0].yaxis.set_label_coords(-0.38 if most is None else -0.5, 0.5)
    for axes, name in zip(panels[-1], names, strict=True):
        axes.set_xlabel(_variable(name))
    for axes in panels[:-1].ravel():
        axes.tick_params(labelbottom=False)
    return drawing


def heat_maps(study: RankedStudy) -> Figure | None:
    """Return a heat map of each metric over the two variables that affect it most."""
    found = study.sensitivities
    if len(study.varied) < 2:
        return None
    columns = min(len(found), 3 if len(found) <= 6 else 4)
    rows = math.ceil(len(found) / columns)
    drawing = figures.figure(4.0 * columns, 3.3 * rows)
    panels = drawing.subplots(rows, columns, squeeze=False).ravel()
    for axes, one in zip(panels, found, strict=False):
        _heat_map(axes, study, one)
    for axes in panels[len(found) :]:
        axes.set_axis_off()
    return drawing


def _heat_map(axes: Axes, study: RankedStudy, one: Sensitivity) -> None:
    across, up = one.ranked[:2]
    ticks: Mapping[str, Sequence[object]]
    if one.surface is None:
        values = _means(study.plan, column(study.table, one.metric), across, up)
        ticks = {n: study.plan.ranges[n].levels for n in (across, up)}
    else:
        values, ticks = _surface_grid(study, one, one.surface, across, up)
    image = axes.imshow(
        values, origin="lower", aspect="auto", cmap=figures.TENSION_COLORS,
        interpolation="nearest",
    )  # fmt: skip
    axes.grid(False)
    for axis, name in ((axes.xaxis, across), (axes.yaxis, up)):
        count = len(ticks[name])
        shown = np.unique(np.linspace(0, count - 1, min(count, 5)).round().astype(int))
        values_shown = (ticks[name][i] for i in shown)
        texts = [f"{t:.3g}" if isinstance(t, float) else str(t) for t in values_shown]
        axis.set_ticks(list(shown), texts)
    axes.set(xlabel=_variable(across), ylabel=_variable(up))
    metric = metric_of(one.metric)
    axes.set_title(metric.name.replace("_", " "), y=1.0)
    bar = axes.figure.colorbar(image, ax=axes, pad=0.02)
    bar.set_label(f"[{metric.unit}]", fontsize=8)


def _means(plan: Plan, y: Array, across: str, up: str) -> Array:
    """Return the mean of `y` over a full grid's other variables, (up, across)."""
    names = list(plan.ranges)
    cube = y.reshape([len(plan.ranges[name].levels) for name in names])
    i, j = names.index(up), names.index(across)
    others = tuple(k for k in range(len(names)) if k not in (i, j))
    mean = cube.mean(axis=others)
    return np.asarray(mean if i < j else mean.T)


def _surface_grid(
    study: RankedStudy, one: Sensitivity, surface: Surface, across: str, up: str
) -> tuple[Array, dict[str, Sequence[object]]]:
    """Return a surface (up, across), NaN outside the designs' hull, and its ticks."""
    names, axes = study.varied, study.plan.ranges
    # Cells along each side of the heat map of a surface
    shares = {name: axes[name].shares(41) for name in (across, up)}
    x, y = np.meshgrid(shares[across], shares[up])
    columns = []
    for name in names:
        flat = {across: x, up: y}.get(name, np.full_like(x, 0.5)).ravel()
        columns.append(axes[name].code(axes[name].at(flat)))
    values = surface(np.stack(columns, axis=-1)).reshape(x.shape)
    good = np.flatnonzero(np.isfinite(column(study.table, one.metric)))
    designs = [study.plan.designs[place] for place in good]
    places = [axes[n].code([d[n] for d in designs]) for n in shares]
    shown = np.stack([columns[names.index(n)] for n in shares], axis=-1)
    outside = outside_hull(np.stack(places, axis=-1), shown)
    values[outside.reshape(x.shape)] = np.nan
    return values, {name: axes[name].at(share) for name, share in shares.items()}


def outside_hull(places: Array, points: Array) -> NDArray[np.bool_]:
    """Mark `points` outside the hull of `places`, both (n, 2) scaled to 0...1."""
    from scipy.spatial import Delaunay, QhullError

    # A little is allowed, for a hypercube does not reach the ends of its ranges.
    grown = places.mean(axis=0) + 1.05 * (places - places.mean(axis=0))
    try:
        return np.asarray(Delaunay(grown).find_simplex(points) < 0)
    except QhullError:  # places on a line
        return np.zeros(len(points), dtype=np.bool_)


def _label(name: str, high: bool) -> str:
    better = "more is better" if high else "less is better"
    return f"{name.replace('_', ' ')} [{metric_of(name).unit}], {better}"


def _variable(name: str) -> str:
    unit = describe(name).unit
    plain = name.replace("_", " ")
    return plain if unit == "1" else f"{plain} [{unit}]"


def _log_where_wide(axes: Axes, x: Array, y: Array) -> None:
    """Set a logarithmic scale if all values are positive and span a factor above 30."""
    pair = (axes.xaxis, x, axes.set_xscale), (axes.yaxis, y, axes.set_yscale)
    for axis, values, scale in pair:
        found = values[np.isfinite(values)]
        if found.size and found.min() > 0.0 and found.max() > 30.0 * found.min():
            scale("log")
            low, high = math.log10(found.min()), math.log10(found.max())
            decades = [10.0**k for k in range(math.ceil(low), math.floor(high) + 1)]
            if len(decades) >= 2:
                figures.set_ticks(axis, decades)
