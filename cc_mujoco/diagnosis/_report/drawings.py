"""Figures of the report.

    with style():
        for stem, drawing in draw(diagnosis, evidence, names).items():
            save(folder / f"{stem}.png", drawing)

Figures without data are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cc_mujoco.diagnosis._phrases import (
    TORQUE_UNIT,
    Names,
    capitalise,
    channel_name,
    format_number,
    format_share,
    plain_name,
)
from cc_mujoco.diagnosis._report.excerpt import (
    Excerpt,
    model_changed,
    ordinary_excerpt,
    worst_excerpt,
)
from cc_mujoco.diagnosis._report.isolability import draw_isolability
from cc_mujoco.diagnosis._report_data import Evidence, Map
from cc_mujoco.diagnosis._verdict import Diagnosis, Gap
from cc_mujoco.native import FloatArray
from cc_mujoco.report._figures import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURE_STEMS = ("gap", "maps", "traces", "traces_ordinary", "isolability")
"""File names of all possible figures, without `.png`."""

FIGURE_WIDTH = 4.8
"""Width of every figure [inch]: text can be read where the page is 390 px wide."""
MATRIX_WIDTH = 7.2
"""Width of the folded matrix of effects, which scrolls [inch]."""
LABEL_PLACE = -0.13
"""Place of the labels of an excerpt, in widths of a panel from its left side."""

MAX_MAPS = 4
"""Maps that are drawn; others are mentioned."""


def draw_figures(
    diagnosis: Diagnosis, evidence: Evidence, names: Names
) -> dict[str, Figure]:
    """Return the figures by file stem, without empty ones."""
    both = model_changed(evidence)
    found: dict[str, Figure | None] = {
        "gap": draw_gap(diagnosis.gap) if diagnosis.gap else None,
        "maps": draw_maps(shown_maps(evidence), both) if evidence.maps else None,
        "isolability": draw_isolability(evidence.isolability, names, MATRIX_WIDTH),
    }
    most, usual = worst_excerpt(evidence), ordinary_excerpt(evidence)
    if most is not None:
        found["traces"] = draw_excerpt(most, both)
    if most is not None and usual is not None and most != usual:
        found["traces_ordinary"] = draw_excerpt(usual, both)
    return {
        stem: drawn for stem in FIGURE_STEMS if (drawn := found.get(stem)) is not None
    }


def shown_maps(evidence: Evidence) -> list[Map]:
    """Return the maps to draw, by share: those beyond chance, or else the best two."""
    ranked = sorted(evidence.maps, key=lambda each: -np.nan_to_num(each.share))
    real = [each for each in ranked if each.share > each.chance]
    return real[:MAX_MAPS] or ranked[:2]


def draw_gap(gaps: Mapping[str, Gap]) -> Figure:
    """Draw bars of the noise floor and the error before and after, per channel."""
    drawing = figure(0.88 * FIGURE_WIDTH, 0.5 + 1.25 * len(gaps))  # in the header
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
        texts = [format_number(value, gap.noise_floor) for value in values]
        axes.bar_label(drawn, texts, padding=4, fontsize=9)
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        axes.margins(x=0.16)
        axes.locator_params(axis="x", nbins=5)
        axes.set(title=capitalise(channel_name(name)))
    panels[-1].set_xlabel(f"weighted RMS error on held-out data [{TORQUE_UNIT}]")
    return drawing


def draw_maps(maps: list[Map], both: bool) -> Figure:
    """Draw the mean error over the quantities along which it varies.

    Args:
        maps: maps to draw, one panel each.
        both: True if the model of `after` differs.
    """
    drawing = figure(FIGURE_WIDTH, 0.4 + 2.2 * len(maps))
    panels = drawing.subplots(len(maps), squeeze=False)[:, 0]
    for axes, each in zip(panels, maps, strict=True):
        _draw_map(axes, each, both)
    handles, labels = drawing.axes[0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside upper center", ncols=3)
    return drawing


def draw_excerpt(excerpt: Excerpt, both: bool) -> Figure:
    """Draw torques of a stretch of a trial, their residuals, and the motion.

    Args:
        excerpt: stretch to draw.
        both: True if the model of `after` differs.
    """
    trace, part = excerpt.trace, excerpt.part
    time = trace.time[part]
    heights = [1.6, 1.0] * len(trace.measured) + [1.1]
    drawing = figure(FIGURE_WIDTH, 1.35 * sum(heights))
    panels = drawing.subplots(
        len(heights), squeeze=False, sharex=True, height_ratios=heights
    )[:, 0]
    for row, (name, measured) in enumerate(trace.measured.items()):
        whole, rest = panels[2 * row : 2 * row + 2]
        whole.plot(*_break_at_gaps(time, measured[part]), color=BLACK, label="measured")
        before = "before" if both else "simulation"
        models = [(before, trace.before, trace.error(name), ORANGE)]
        if both:
            models.append(("after", trace.after, trace.error(name, "after"), BLUE))
        for label, played, error, color in models:
            whole.plot(
                *_break_at_gaps(time, played[name][part]), color=color, label=label
            )
            rest.plot(*_break_at_gaps(time, error[part]), color=color, linewidth=1.0)
        title = capitalise(channel_name(name))
        whole.set(title=title, ylabel=f"torque [{TORQUE_UNIT}]")
        rest.set(ylabel=f"error [{TORQUE_UNIT}]")
        rest.axhline(0.0, color=GREY, linewidth=0.8)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    for label, angle, color in (
        ("motor", trace.motor_angle, GREEN),
        ("joint", trace.joint_angle, PINK),
    ):
        panels[-1].plot(*_break_at_gaps(time, angle[part]), color=color, label=label)
    panels[-1].set(title="Motion", ylabel="angle [rad]", xlabel="time [s]")
    panels[-1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    for axes in panels:
        axes.yaxis.set_label_coords(LABEL_PLACE, 0.5)
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
    if _has_equal_ratios(each.centre):
        axes.set_xscale("log")
    axes.set(
        title=f"{capitalise(channel_name(each.channel))}: "
        f"{format_share(each.share)} of its error",
        xlabel=f"{_escape_mathtext(each.axis)} [{each.unit or '1'}]",
        ylabel=f"mean error [{TORQUE_UNIT}]",
    )


def _has_equal_ratios(centre: FloatArray) -> bool:
    """Return whether bins have equal ratios rather than equal differences."""
    if len(centre) < 3 or not np.all(centre > 0):
        return False
    even, ratio = np.diff(centre), np.diff(np.log(centre))
    return bool(np.std(ratio) * abs(even.mean()) < np.std(even) * abs(ratio.mean()))


def _break_at_gaps(
    time: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the same, broken where samples are missing, so that no line crosses."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > 3.0 * np.median(steps)) + 1
    return np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan)


def _escape_mathtext(name: str) -> str:
    """Return the text that Matplotlib shows as it is."""
    return plain_name(name).replace("$", r"\$")
