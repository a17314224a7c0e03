"""Figures of the report; those without data are left out.

save_figures(folder, diagnosis, evidence)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis import _phrases as words
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import (
    Diagnosis,
    Evidence,
    Gap,
    Isolability,
    LearnedTable,
    Map,
    TrialTrace,
)
from cc_mujoco.native import FloatArray
from cc_mujoco.report._figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PINK,
    figure,
    save,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Excerpt(NamedTuple):
    """Stretch of one trial to draw."""

    trace: TrialTrace  # of the trial
    part: slice  # its samples that are shown
    error: float  # RMS error of the baseline in it, over that of all trials [1]


def excerpts(evidence: Evidence) -> tuple[Excerpt, Excerpt] | None:
    """Return the stretch where the baseline errs most, and an ordinary one; or None."""
    windows = _windows(evidence)
    if not windows:
        return None
    most = max(windows, key=lambda excerpt: excerpt.error)
    ranked = sorted(windows, key=lambda excerpt: excerpt.error)
    return most, ranked[len(ranked) // 2]


def model_changed(evidence: Evidence) -> bool:
    """Return whether the torques of `after` and `before` differ in any trial."""
    pairs = [(t.before[c], t.after[c]) for t in evidence.traces for c in t.measured]
    return not all(np.array_equal(*pair, equal_nan=True) for pair in pairs)


def _windows(evidence: Evidence) -> list[Excerpt]:
    """Return windows of every trial, each overlapping the next by three quarters."""
    squares = [  # errors of the baseline by channel, 0 without valid data
        {c: np.nan_to_num(t.error(c) * (t.counts > 0)) ** 2 for c in t.measured}
        for t in evidence.traces
    ]
    power = {}
    for channel in dict.fromkeys(name for each in squares for name in each):
        pairs = zip(evidence.traces, squares, strict=True)
        valid = [own[channel][t.counts > 0] for t, own in pairs if channel in own]
        whole = np.concatenate(valid)
        if len(whole) and (mean := float(whole.mean())) > 0.0:
            power[channel] = mean
    found: list[Excerpt] = []
    for trace, own in zip(evidence.traces, squares, strict=True):
        time, counts = trace.time, trace.counts > 0
        if not counts.any():
            continue
        error = np.zeros(len(time))
        for channel, scale in power.items():
            if channel in own:
                error += own[channel] / scale
        start, end = time[counts][0], time[counts][-1]
        length = min(Limit.max_excerpt, end - start)
        total = np.concatenate([[0.0], np.cumsum(error)])
        many = np.concatenate([[0], np.cumsum(counts)])
        steps = 1 + int(np.ceil(4.0 * (end - start - length) / max(length, 1e-9)))
        for begin in np.linspace(start, end - length, steps):
            # Times read from text differ in the last digits.
            edges = (begin - 1e-9, begin + length + 1e-9)
            first, last = np.searchsorted(time, edges)
            number = many[last] - many[first]
            if number > 1:
                mean = (total[last] - total[first]) / (number * max(1, len(power)))
                found.append(Excerpt(trace, slice(first, last), float(np.sqrt(mean))))
    return found


def confounded_pairs(isolability: Isolability) -> list[tuple[str, str, float]]:
    """Return (id, id, cosine) of similar signatures, the most similar first."""
    ids, cosines = isolability.ids, isolability.cosines
    places = [(r, c) for r, c in np.ndindex(cosines.shape) if c < r]
    able = [(r, c) for r, c in places if cosines[r, c] > Limit.confused_cosine]
    pairs = [(ids[r], ids[c], float(cosines[r, c])) for r, c in able]
    return sorted(pairs, key=lambda pair: -pair[2])


def invisible_effects(isolability: Isolability) -> list[str]:
    pairs = zip(isolability.ids, isolability.visible, strict=True)
    return [name for name, visible in pairs if not visible >= Limit.min_visible_size]


def draw_isolability(isolability: Isolability, width: float) -> Figure:
    """Draw cosines between effects, and each one's visibility."""
    from matplotlib.colors import LinearSegmentedColormap

    count = len(isolability.ids)
    order = _cluster_order(isolability.cosines)
    cosines = isolability.cosines[np.ix_(order, order)]
    names = [words.effect_name(isolability.ids[k]).replace("$", r"\$") for k in order]
    drawing = figure(width, 1.5 + 0.24 * count)
    heat, bars = drawing.subplots(1, 2, sharey=True, width_ratios=[3.2, 1])
    shades = LinearSegmentedColormap.from_list("likeness", ["white", BLUE])
    picture = heat.imshow(cosines, cmap=shades, vmin=0.0, vmax=1.0, aspect="auto")
    for row, column in np.argwhere(np.nan_to_num(cosines) >= 0.7):
        if row != column:  # cells off the diagonal that matter
            text = f"{cosines[row, column]:.2f}".lstrip("0")
            heat.text(column, row, text, ha="center", va="center", size=6, color="w")
    heat.set_xticks(range(count), [str(place + 1) for place in range(count)])
    heat.tick_params(axis="x", labelsize=7)
    heat.set_yticks(range(count), [f"{n}  {k + 1}" for k, n in enumerate(names)])
    heat.grid(False)
    heat.set(title="Likeness of two effects")
    drawing.colorbar(
        picture, ax=heat, label="cosine of signatures [1]", location="bottom", aspect=40
    )
    _draw_bars(bars, np.nan_to_num(isolability.visible[order]))
    return drawing


def _cluster_order(cosines: NDArray[np.float64]) -> list[int]:
    """Return an order with similar effects side by side (average linkage)."""
    # SciPy's hierarchical clustering takes half a second to import.
    similar = np.clip(np.nan_to_num(cosines), 0.0, 1.0)
    groups = [[place] for place in range(len(similar))]
    while len(groups) > 1:
        pairs = combinations(groups, 2)
        one, two = max(pairs, key=lambda pair: similar[np.ix_(*pair)].mean())
        sides = product((one, one[::-1]), (two, two[::-1]))
        left, right = max(sides, key=lambda side: similar[side[0][-1], side[1][0]])
        rest = [group for group in groups if group is not one and group is not two]
        groups = [*rest, left + right]
    return groups[0]


def _draw_bars(axes: Axes, visible: NDArray[np.float64]) -> None:
    colors = [BLUE if value >= Limit.min_visible_size else GREY for value in visible]
    least = 0.01
    axes.barh(range(len(visible)), np.maximum(visible, least), color=colors, height=0.7)
    axes.axvline(Limit.min_visible_size, color=BLACK, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xlim(least, max(10.0, 2.0 * float(visible.max())))
    axes.tick_params(left=False)
    axes.grid(False, axis="y")
    axes.set_title("Visibility")
    axes.set_xlabel("size over noise [1]", fontsize=8, loc="right")


FIGURE_STEMS = ("gap", "maps", "traces", "traces_ordinary", "learned", "isolability")
"""File names of all possible figures, without `.png`."""


def figures(
    diagnosis: Diagnosis, evidence: Evidence
) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the figures with data, by file name without `.png`."""
    both = model_changed(evidence)
    made: dict[str, Callable[[], Figure]] = {}
    if diagnosis.gap:
        made["gap"] = partial(draw_gap, diagnosis.gap)
    if evidence.maps:
        made["maps"] = partial(draw_maps, shown_maps(evidence), both)
    if shown := excerpts(evidence):
        most, usual = shown
        made["traces"] = partial(draw_excerpt, most, both)
        if most != usual:
            made["traces_ordinary"] = partial(draw_excerpt, usual, both)
    if diagnosis.learned and diagnosis.learned.curves:
        made["learned"] = partial(draw_curves, diagnosis.learned.curves)
    if evidence.isolability.ids:
        made["isolability"] = partial(draw_isolability, evidence.isolability, 7.2)
    return made


def save_figures(folder: Path, diagnosis: Diagnosis, evidence: Evidence) -> set[str]:
    """Write the figures that the folder lacks, and return the names of all."""
    made = figures(diagnosis, evidence).items()
    paths = {folder / f"{stem}.png": draw for stem, draw in made}
    if rest := [path for path in paths if not path.exists()]:
        with style():
            for path in rest:
                save(path, paths[path]())
    return {path.name for path in paths}


def ranked_maps(evidence: Evidence) -> list[Map]:
    return sorted(evidence.maps, key=lambda each: -np.nan_to_num(each.share))


def shown_maps(evidence: Evidence) -> list[Map]:
    """Return the best four maps beyond chance, or else the best two."""
    ranked = ranked_maps(evidence)
    real = [each for each in ranked if each.share > each.chance]
    return real[:4] or ranked[:2]


def draw_gap(gaps: Mapping[str, Gap]) -> Figure:
    drawing = figure(0.88 * Limit.figure_width, 0.5 + 1.25 * len(gaps))  # in the header
    panels = drawing.subplots(len(gaps), squeeze=False)[:, 0]
    for axes, (name, gap) in zip(panels, gaps.items(), strict=True):
        floor, before = gap.noise_floor, gap.rmse_before
        bars = [("noise floor", floor, GREY), ("before", before, ORANGE)]
        bars.append(("after", gap.rmse_after, BLUE))
        if gap.rmse_after == gap.rmse_before:
            bars[1:] = [("simulation", gap.rmse_before, ORANGE)]
        titles, values, colors = zip(*bars, strict=True)
        drawn = axes.barh(titles, np.nan_to_num(values), color=colors, height=0.7)
        texts = [words.format_number(value, gap.noise_floor) for value in values]
        axes.bar_label(drawn, texts, padding=4, fontsize=9)
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        axes.margins(x=0.16)
        axes.locator_params(axis="x", nbins=5)
        axes.set(title=words.capitalise(words.channel_name(name)))
    panels[-1].set_xlabel(f"weighted RMS error on held-out data [{words.TORQUE_UNIT}]")
    return drawing


def draw_maps(maps: list[Map], both: bool) -> Figure:
    """Draw the mean error along each map's axis, a panel each; `both` models or one."""
    drawing = figure(Limit.figure_width, 0.4 + 2.2 * len(maps))
    panels = drawing.subplots(len(maps), squeeze=False)[:, 0]
    for axes, each in zip(panels, maps, strict=True):
        _draw_map(axes, each, both)
    handles, labels = drawing.axes[0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside upper center", ncols=3)
    return drawing


def draw_curves(curves: Sequence[LearnedTable]) -> Figure:
    """Draw learned curves, a panel each."""
    drawing = figure(Limit.figure_width, 0.4 + 2.2 * len(curves))
    panels = drawing.subplots(len(curves), squeeze=False)[:, 0]
    for axes, each in zip(panels, curves, strict=True):
        for (channel, table), color in zip(
            each.torque.items(), (BLUE, ORANGE), strict=False
        ):
            label = words.channel_name(channel)
            axes.plot(each.at, table, color=color, marker="o", ms=3.0, label=label)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        factor = f" per {each.times}" if each.times else ""
        again = " within a period" if each.period else ""
        added = f"torque{factor} [{each.torque_unit}]"
        axes.set(xlabel=f"{each.over}{again} [{each.unit}]", ylabel=added)
        axes.legend()
    return drawing


def draw_excerpt(excerpt: Excerpt, both: bool) -> Figure:
    """Draw a stretch's torques, residuals and motion, of one or `both` models."""
    trace, part = excerpt.trace, excerpt.part
    time = trace.time[part]
    heights = [1.6, 1.0] * len(trace.measured) + [1.1]
    drawing = figure(Limit.figure_width, 1.35 * sum(heights))
    how: Any = {"squeeze": False, "sharex": True, "height_ratios": heights}
    panels = drawing.subplots(len(heights), **how)[:, 0]
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
        title = words.capitalise(words.channel_name(name))
        whole.set(title=title, ylabel=f"torque [{words.TORQUE_UNIT}]")
        rest.set(ylabel=f"error [{words.TORQUE_UNIT}]")
        rest.axhline(0.0, color=GREY, linewidth=0.8)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    angles = ("motor", trace.motor_angle, GREEN), ("joint", trace.joint_angle, PINK)
    for label, angle, color in angles:
        panels[-1].plot(*_broken(time, angle[part]), color=color, label=label)
    panels[-1].set(title="Motion", ylabel="angle [rad]", xlabel="time [s]")
    panels[-1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    for axes in panels:
        axes.yaxis.set_label_coords(-0.13, 0.5)
    return drawing


def _draw_map(axes: Axes, each: Map, both: bool) -> None:
    look: Any = {"color": GREY, "alpha": 0.25, "linewidth": 0, "label": "chance (95 %)"}
    axes.fill_between(each.centre, -each.band, each.band, **look)
    lines = [("before" if both else "simulation", each.before, ORANGE, "o")]
    if both:
        lines.append(("after", each.after, BLUE, "s"))
    for label, values, color, marker in lines:
        axes.plot(each.centre, values, color=color, marker=marker, ms=3.5, label=label)
    if _has_equal_ratios(each.centre):
        axes.set_xscale("log")
    axis = words.plain_name(each.axis).replace("$", r"\$")
    channel = words.capitalise(words.channel_name(each.channel))
    share = words.format_share(each.share)
    axes.set(
        title=f"{channel}: {share} of its error",
        xlabel=f"{axis} [{each.unit or '1'}]",
        ylabel=f"mean error [{words.TORQUE_UNIT}]",
    )


def _has_equal_ratios(centre: FloatArray) -> bool:
    """Return whether the bins `centre` have equal ratios, not equal differences."""
    if len(centre) < 3 or not np.all(centre > 0):
        return False
    even, ratio = np.diff(centre), np.diff(np.log(centre))
    return bool(np.std(ratio) * abs(even.mean()) < np.std(even) * abs(ratio.mean()))


def _broken(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve with NaN where samples are missing, so that no line crosses."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > 3.0 * np.median(steps)) + 1
    return np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan)
