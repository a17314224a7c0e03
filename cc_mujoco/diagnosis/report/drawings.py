"""The figures of the report.

    with style():
        for stem, drawing in draw(diagnosis, evidence, names).items():
            save(folder / f"{stem}.png", drawing)

What there is nothing to draw of has no figure.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.evidence import Evidence, Map
from cc_mujoco.diagnosis.report.excerpt import Excerpt, changed, ordinary, worst
from cc_mujoco.diagnosis.report.isolability import draw_isolability
from cc_mujoco.diagnosis.verdict import Diagnosis, Gap
from cc_mujoco.diagnosis.wording import (
    TORQUE_UNIT,
    Names,
    capital,
    channel,
    number,
    plain,
    share,
)
from cc_mujoco.figures import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEMS = ("gap", "maps", "traces", "traces_ordinary", "isolability")
"""File names of all figures that there can be, without `.png`."""

WIDTH = 7.2
"""Of every figure [inch], so that all have letters of one size on a page."""

MOST_MAPS = 8


def draw(diagnosis: Diagnosis, evidence: Evidence, names: Names) -> dict[str, Figure]:
    """File stem to figure; those for which there is nothing to draw are left out."""
    both = changed(evidence)
    found: dict[str, Figure | None] = {
        "gap": draw_gap(diagnosis.gap) if diagnosis.gap else None,
        "maps": draw_maps(shown_maps(evidence), both) if evidence.maps else None,
        "isolability": draw_isolability(evidence.isolability, names, WIDTH),
    }
    most, usual = worst(evidence), ordinary(evidence)
    if most is not None:
        found["traces"] = draw_excerpt(most, both)
    if most is not None and usual is not None and most != usual:
        found["traces_ordinary"] = draw_excerpt(usual, both)
    return {stem: drawn for stem in STEMS if (drawn := found.get(stem)) is not None}


def shown_maps(evidence: Evidence) -> list[Map]:
    """Maps that are drawn, by share: those beyond chance, or the best two without."""
    ranked = sorted(evidence.maps, key=lambda each: -np.nan_to_num(each.share))
    real = [each for each in ranked if each.share > each.chance]
    return real[:MOST_MAPS] or ranked[:2]


def draw_gap(gaps: Mapping[str, Gap]) -> Figure:
    """Bars of noise floor, error before and error after, a panel for each channel."""
    drawing = figure(WIDTH, 0.5 + 1.25 * len(gaps))
    panels = drawing.subplots(len(gaps), squeeze=False)[:, 0]
    for axes, (name, gap) in zip(panels, gaps.items(), strict=True):
        bars = [
            ("noise floor", gap.noise_floor, GREY),
            ("before", gap.rmse_before, ORANGE),
            ("after", gap.rmse_after, BLUE),
        ]
        if gap.rmse_after == gap.rmse_before:
            bars[1:] = [("simulation", gap.rmse_before, ORANGE)]
        words, values, colors = zip(*bars, strict=True)
        drawn = axes.barh(words, np.nan_to_num(values), color=colors, height=0.7)
        texts = [number(value, gap.noise_floor) for value in values]
        axes.bar_label(drawn, texts, padding=4, fontsize=9)
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        axes.margins(x=0.12)
        axes.set(title=capital(channel(name)))
    panels[-1].set_xlabel(f"weighted RMS error on held-out data [{TORQUE_UNIT}]")
    return drawing


def draw_maps(maps: list[Map], both: bool) -> Figure:
    """Mean error over the quantities along which it lies.

    Args:
        maps: to draw, one panel each.
        both: whether there is a model of `after` that differs.
    """
    columns = min(2, len(maps))
    rows = -(-len(maps) // columns)
    drawing = figure(WIDTH, 0.4 + 2.5 * rows)
    panels = drawing.subplots(rows, columns, squeeze=False).flat
    for axes, each in zip(panels, maps, strict=False):
        _draw_map(axes, each, both)
    for axes in list(panels)[len(maps) :]:
        axes.set_axis_off()
    handles, labels = drawing.axes[0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside upper center", ncols=3)
    return drawing


def draw_excerpt(excerpt: Excerpt, both: bool) -> Figure:
    """Torques of a stretch of a trial, what is left of them, and the motion.

    Args:
        excerpt: what to draw.
        both: whether there is a model of `after` that differs.
    """
    trace, part = excerpt.trace, excerpt.part
    time = trace.time[part]
    heights = [1.6, 1.0] * len(trace.measured) + [1.1]
    drawing = figure(WIDTH, 1.35 * sum(heights))
    panels = drawing.subplots(
        len(heights), squeeze=False, sharex=True, height_ratios=heights
    )[:, 0]
    for row, (name, measured) in enumerate(trace.measured.items()):
        whole, rest = panels[2 * row : 2 * row + 2]
        whole.plot(*_broken(time, measured[part]), color=BLACK, label="measured")
        before = "before" if both else "simulation"
        models = [(before, trace.before, trace.error(name), ORANGE)]
        if both:
            models.append(("after", trace.after, trace.error(name, "after"), BLUE))
        for label, played, error, color in models:
            whole.plot(*_broken(time, played[name][part]), color=color, label=label)
            rest.plot(*_broken(time, error[part]), color=color, linewidth=1.0)
        title = capital(channel(name))
        whole.set(title=title, ylabel=f"torque [{TORQUE_UNIT}]")
        rest.set(ylabel=f"error [{TORQUE_UNIT}]")
        rest.axhline(0.0, color=GREY, linewidth=0.8)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    for label, angle, color in (
        ("motor", trace.motor_angle, GREEN),
        ("joint", trace.joint_angle, PINK),
    ):
        panels[-1].plot(*_broken(time, angle[part]), color=color, label=label)
    panels[-1].set(title="Motion", ylabel="angle [rad]", xlabel="time [s]")
    panels[-1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    drawing.align_ylabels()
    return drawing


def _draw_map(axes: Axes, each: Map, both: bool) -> None:
    axes.fill_between(
        each.centre,
        -each.band,
        each.band,
        color=GREY,
        alpha=0.25,
        linewidth=0,
        label="chance (95 %)",
    )
    lines = [("before" if both else "simulation", each.before, ORANGE, "o")]
    if both:
        lines.append(("after", each.after, BLUE, "s"))
    for label, values, color, marker in lines:
        axes.plot(
            each.centre, values, color=color, marker=marker, markersize=3.5, label=label
        )
    if _geometric(each.centre):
        axes.set_xscale("log")
    axes.set(
        title=f"{capital(channel(each.channel))}: {share(each.share)} of its error",
        xlabel=f"{_text(each.axis)} [{each.unit or '1'}]",
        ylabel=f"mean error [{TORQUE_UNIT}]",
    )


def _geometric(centre: FloatArray) -> bool:
    """Return whether bins have equal ratios rather than equal differences."""
    if len(centre) < 3 or not np.all(centre > 0):
        return False
    even, ratio = np.diff(centre), np.diff(np.log(centre))
    return bool(np.std(ratio) * abs(even.mean()) < np.std(even) * abs(ratio.mean()))


def _broken(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the same, broken where samples are missing, so that no line crosses."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > 3.0 * np.median(steps)) + 1
    return np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan)


def _text(name: str) -> str:
    """Text that Matplotlib shows as it is."""
    return plain(name).replace("$", r"\$")
