"""Report of a finished study: ranking, effects and figures as files."""

from __future__ import annotations

import itertools
import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cc_mujoco._utils import provenance
from cc_mujoco._utils.atomic_io import MANIFEST, replacing
from cc_mujoco.design import _report_text as report_text
from cc_mujoco.design._follow_up import Around
from cc_mujoco.design._pareto import column
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._protocol import known_metric, metric_of
from cc_mujoco.design._report_text import RankedStudy
from cc_mujoco.design._results_store import CONTROLLER_COLUMN
from cc_mujoco.design._scenarios import WORST_CASE_SUFFIX
from cc_mujoco.design._sensitivity import Sensitivity, Surface
from cc_mujoco.device._variables import describe
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report import _figures as figures
from cc_mujoco.report import _html as html
from cc_mujoco.report._markdown import table as table_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REPORT_FILE, RANKING_FILE = "report.html", "ranking.md"
SLOPES_FILE, PARETO_FILE, SOBOL_FILE, EFFECTS_FILE = TABLE_FILES = (
    "around.parquet", "pareto.parquet", "sobol.parquet", "effects.parquet",
)  # fmt: skip
CAPTIONS = {
    "answer.png": "All designs; the star is the best, squares are best in one "
    "objective.",
    "effects.png": "Mean over the other variables; above each, the share of variance "
    "it explains alone.",
    "effects_all.png": "The same of every metric.",
    "heatmaps.png": "Every metric over these two variables.",
    "pareto.png": "All designs, and those that nothing beats.",
}
REPORT_FILES = (REPORT_FILE, RANKING_FILE, *TABLE_FILES, *CAPTIONS)
PAGE_WIDTH = 4.8  # of a figure that can be read where the page is 390 px wide [inch]


def write_report(
    folder: Path, found: RankedStudy, command: str = ""
) -> tuple[Path, ...]:
    """Write the report of a study into its folder; return the files.

    `command` is that of the command line which made the study.
    """
    (folder / MANIFEST).unlink(missing_ok=True)  # until all is written
    tables = {
        SOBOL_FILE: sobol_table(found.sensitivities),
        EFFECTS_FILE: _effects_table(found.sensitivities),
    }
    if found.nearby is not None:
        tables[SLOPES_FILE] = _slopes_table(found.nearby)
    if found.front.any():
        tables[PARETO_FILE] = found.table.filter(pa.array(found.front))
    for name, table in tables.items():
        with replacing(folder / name) as partial:
            pq.write_table(table.combine_chunks(), partial, compression="zstd")
    with figures.style():
        drawings = dict(_drawings(found))
        for name, drawing in drawings.items():
            figures.save(folder / name, drawing)
    pages = {
        REPORT_FILE: _page(found, folder, drawings, command),
        RANKING_FILE: markdown(found),
    }
    for name, text in pages.items():
        with replacing(folder / name) as partial:
            partial.write_text(text, encoding="utf-8")
    files = (*pages, *tables, *drawings)
    for name in REPORT_FILES:  # of an earlier look at the table, by other objectives
        if name not in files:
            (folder / name).unlink(missing_ok=True)
    provenance.write_manifest(folder, REPORT_FILES)
    return tuple(folder / name for name in files)


def _drawings(found: RankedStudy) -> Iterator[tuple[str, Figure]]:
    """Yield name (a key of `CAPTIONS`) and figure of each plot of a study."""
    goals = [goal.name for goal in found.goals]
    if found.best is not None and found.varied:
        first, *others = goals
        if not others:
            shares = {one.metric: one.total for one in found.sensitivities}
            own = shares.get(first, {})
            others = [max(found.varied, key=lambda name: own.get(name, 0.0))]
        yield "answer.png", answer_plot(found, others[0])
    if len(goals) > 2 and found.front.any():
        yield "pareto.png", pareto_plot(found)
    if not found.sensitivities:
        return
    if shown := [one for one in found.sensitivities if one.metric in goals]:
        # Variables whose effects on the objectives are drawn unfolded
        yield "effects.png", effects_plot(shown, 3)
    yield "effects_all.png", effects_plot(found.sensitivities)
    if (maps := heat_maps(found)) is not None:
        yield "heatmaps.png", maps


SECTION_TITLES = {
    "best": "The best designs",
    "sure": "How sure that is",
    "controllers": "What the controller makes of it",
    "trade": "What one objective costs in another",
    "matters": "What matters",
    "limits": "What the limits leave over",
    "nearby": "What variables and limits are worth there",
    "failures": "Designs without numbers",
    "fixed": "What was held fixed",
    "words": "What the names mean",
    "made": "How this was made",
}


def _page(found: RankedStudy, folder: Path, drawn: Container[str], command: str) -> str:
    def shown(name: str) -> html.Html:
        if name not in drawn:
            return html.Html()
        return html.embed_picture(folder / name, CAPTIONS[name])

    def more(title: str, name: str) -> html.Html:
        picture = shown(name)
        if name != "pareto.png":
            picture = html.scrolled(picture)
        return html.folded(title, picture) if name in drawn else html.Html()

    versions = ", ".join(map(" ".join, provenance.versions().items()))
    note = f"The table of all designs lies beside this page. {versions}."
    made = [html.paragraph(html.element("code", command))] if command else []
    pairs = more("Every pair of objectives", "pareto.png")
    unfolded = more("All metrics and variables", "effects_all.png")
    maps = more("Maps over the two variables that matter most", "heatmaps.png")
    parts = {
        "best": report_text.best_designs(found),
        "sure": report_text.confidence(found),
        "controllers": report_text.controllers(found),
        "trade": html.illustrated(report_text.trade_offs(found), pairs),
        "matters": html.illustrated(
            report_text.deciding_variables(found), shown("effects.png"), unfolded, maps
        ),
        "limits": report_text.limit_slack(found),
        "nearby": report_text.local_values(found.nearby),
        "failures": report_text.failures(found),
        "fixed": html.folded("All values", report_text.common_values(found)),
        "words": html.folded("All names", report_text.variable_meanings(found)),
        "made": html.join_pieces([*made, html.paragraph(note)]),
    }
    there = {key: part for key, part in parts.items() if part is not None}
    if found.best is None:  # what stands in the way comes first
        first = ("limits", "failures")
        there = {key: there[key] for key in sorted(there, key=lambda k: k not in first)}
    return html.page(
        f"What if: {found.protocol.scene}",
        "named" if found.best is not None else "fix-data",
        report_text.header(found, shown("answer.png"), folder),
        html.sections(SECTION_TITLES, there),
    )


def markdown(found: RankedStudy) -> str:
    """Return the ranking as Markdown, followed by main effects and Sobol indices."""
    protocol, rows, limits = found.protocol, found.rows, found.limits
    failed = [str(row["failed"]) for row in rows if row["failed"]]
    parts = [
        f"# What if: {protocol.scene}, {len(rows)} designs",
        "Trajectory {}, task {}, ".format(*protocol.sources)
        + f"{report_text.describe_controllers(protocol.controllers)}, "
        f"{protocol.duration:g} s, seed {protocol.seed}, time step "
        f"{1e3 * protocol.timestep:g} ms.",
    ]
    if protocol.axes:
        parts.append(report_text.axes_sentence(protocol.axes))
    if protocol.across.several:
        parts.append(report_text.cases_sentence(found.plan))
    if failed:
        parts.append(
            f"Designs that failed in simulation: {len(failed)}; the first: {failed[0]}."
        )
    parts += report_text.controllers_out(found)
    for goal in found.goals:
        without = sum(row[goal.name] is None for row in rows)
        if lacking := without - len(failed):
            parts.append(f"Designs without {goal.name}: {lacking}.")
    if limits:
        kept = f"{int(found.kept.sum())} of {len(rows)}"
        parts.append(
            f"Limits: {', '.join(limit.text for limit in limits)}; {kept} keep them."
        )
    given = "Objectives" if found.chosen else "No objectives were given; usual ones"
    names = ", ".join(goal.text for goal in found.goals)
    count = 20  # designs in the ranking
    parts += [
        f"{given}: {names}. Pareto set: {int(found.front.sum())}.",
        "## Ranking",
        f"The best {min(count, len(rows))}: the Pareto set (marked *) first, "
        "each part by mean rank in the objectives."
        if found.front.any()
        else "By mean rank in the objectives; none keeps the limits.",
        _ranking(found, count),
    ]
    if found.half is not None:
        parts.append(report_text.timestep_sentence(found.half))
    if found.nearby is not None:
        parts += [f"## Around design {found.nearby.design}", report_text.SLOPES_NOTE]
        parts.append(table_of(*report_text.slope_table(found.nearby)))
        if found.nearby.prices:
            parts.append(report_text.PRICES_NOTE)
            parts.append(table_of(*report_text.price_table(found.nearby)))
    parts.append("## What each metric depends on")
    parts += map(_sensitivity, found.sensitivities)
    known = {one.metric for one in found.sensitivities}
    if unknown := [name for name in protocol.metrics if name not in known]:
        why = report_text.UNKNOWN_REASON
        parts.append(f"No shares are known of {', '.join(unknown)}: {why}.")
    meanings = [(m.name, m.unit, m.meaning) for m in map(metric_of, protocol.metrics)]
    parts += ["## Metrics", table_of(("metric", "unit", "meaning"), meanings)]
    return "\n\n".join(parts) + "\n"


def _slopes_table(found: Around) -> pa.Table:
    rows = []
    for one in found.slopes:
        ends = {k: report_text.format_cell(getattr(one, k)) for k in ("low", "high")}
        rows.append({**vars(one), "design": found.design, **ends})
    return _table(rows, design=pa.int64(), metric=_TEXT, variable=_TEXT, low=_TEXT,
                  high=_TEXT, change=_NUMBER, error=_NUMBER)  # fmt: skip


def sobol_table(found: Iterable[Sensitivity]) -> pa.Table:
    """Return the Sobol indices of all metrics, one per row; `error` is 0 if exact."""
    rows = []
    for one in found:
        about = {"metric": one.metric, "how": one.how}
        first, total, pairs = one.errors
        for name in one.first:
            kinds = ("first", one.first, first), ("total", one.total, total)
            for kind, shares, errors in kinds:
                index = {"share": shares[name], "error": errors.get(name, 0.0)}
                rows.append({**about, "kind": kind, "variable": name, **index})
        for (name, other), share in one.pairs.items():
            index = {"share": share, "error": pairs.get((name, other), 0.0)}
            which = {"kind": "pair", "variable": name, "other": other}
            rows.append({**about, **which, **index})
    return _table(rows, metric=_TEXT, kind=_TEXT, variable=_TEXT, other=_TEXT,
                  share=_NUMBER, error=_NUMBER, how=_TEXT)  # fmt: skip


def _effects_table(found: Iterable[Sensitivity]) -> pa.Table:
    rows = []
    for one in found:
        for name, (_, means) in one.effects.items():
            texts = one.value_texts(name, "{:.12g}".format)
            rows += [
                {"metric": one.metric, "variable": name, "value": text, "mean": mean}
                for text, mean in zip(texts, means.tolist(), strict=True)
            ]
    return _table(rows, metric=_TEXT, variable=_TEXT, value=_TEXT, mean=_NUMBER)


_TEXT, _NUMBER = pa.string(), pa.float64()


def _table(rows: Sequence[Mapping[str, object]], **kinds: pa.DataType) -> pa.Table:
    return pa.Table.from_pylist(rows, pa.schema(kinds))


def _ranking(found: RankedStudy, count: int) -> str:
    protocol, goals = found.protocol, [goal.name for goal in found.goals]
    columns = ["design", *found.varied, *dict.fromkeys((*goals, *protocol.metrics))]
    if len(protocol.controllers) > 1:
        columns.append(CONTROLLER_COLUMN)
    if protocol.across.several:
        columns += [f"{name}@{WORST_CASE_SUFFIX}" for name in goals]
    rows = []
    for place in found.order[:count]:
        cells = [report_text.format_cell(found.rows[place][name]) for name in columns]
        cells[0] += "*" if found.front[place] else ""
        rows.append(cells)
    return table_of(list(map(report_text.column_title, columns)), rows)


def _sensitivity(one: Sensitivity) -> str:
    rows = []
    for name in one.ranked:
        first = report_text.index_text(one.first[name], one.errors[0].get(name))
        total = report_text.index_text(one.total[name], one.errors[1].get(name))
        rows.append((name, first, total, *one.extremes(name, "{:.4g}".format)))
    unit = metric_of(one.metric).unit
    head = ("variable", "first order", "total", f"least mean [{unit}]",
            f"greatest mean [{unit}]")  # fmt: skip
    parts = [f"### {one.metric}", f"Sobol's indices: {one.how}.", table_of(head, rows)]
    large = sorted(one.pairs.items(), key=lambda item: -item[1])[:5]
    texts = ((p, s, report_text.index_text(s, one.errors[2].get(p))) for p, s in large)
    if pairs := [f"{a} with {b} {text}" for (a, b), s, text in texts if s >= 0.005]:
        parts.append(f"Together only: {'; '.join(pairs)}.")
    return "\n\n".join(parts)


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
            across[row], y[row], "s" if place else "*", markersize=9 if place else 14,
            color=figures.BLUE, fillstyle="none",
            label=("best", "best in an objective", None)[min(place, 2)],
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
    """Plot the mean of each metric (row) over the `most` important variables."""
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
    across, up = sorted(one.ranked[:2], key=study.varied.index)
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
