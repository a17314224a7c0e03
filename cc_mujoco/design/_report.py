"""Report of a finished study: ranking, effects and figures as files."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.parquet as pq

from cc_mujoco._utils import provenance
from cc_mujoco._utils.atomic_io import MANIFEST, replacing, write_manifest
from cc_mujoco.design import _charts as charts
from cc_mujoco.design import _report_text as report_text
from cc_mujoco.design._follow_up import Around
from cc_mujoco.design._protocol import metric_of
from cc_mujoco.design._report_text import RankedStudy
from cc_mujoco.design._results_store import CONTROLLER_COLUMN
from cc_mujoco.design._scenarios import WORST_CASE_SUFFIX
from cc_mujoco.design._sensitivity import Sensitivity
from cc_mujoco.report import _html as html
from cc_mujoco.report._figures import save, style
from cc_mujoco.report._markdown import table as table_of

if TYPE_CHECKING:
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
"""Figures and what they show."""
REPORT_FILES = (REPORT_FILE, RANKING_FILE, *TABLE_FILES, *CAPTIONS)
"""All files that may be written in addition to the table."""


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
    with style():
        drawings = dict(_drawings(found))
        for name, drawing in drawings.items():
            save(folder / name, drawing)
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
    write_manifest(folder, REPORT_FILES)
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
        yield "answer.png", charts.answer_plot(found, others[0])
    if len(goals) > 2 and found.front.any():
        yield "pareto.png", charts.pareto_plot(found)
    if not found.sensitivities:
        return
    if shown := [one for one in found.sensitivities if one.metric in goals]:
        # Variables whose effects on the objectives are drawn unfolded
        yield "effects.png", charts.effects_plot(shown, 3)
    yield "effects_all.png", charts.effects_plot(found.sensitivities)
    if (maps := charts.heat_maps(found)) is not None:
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
"""Sections of the page in their order."""


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
    """Return the Sobol indices of all metrics, one per row.

    `other` is null except for pairs; `error` is 0 for exact indices. Indices below
    their error are 0.
    """
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
