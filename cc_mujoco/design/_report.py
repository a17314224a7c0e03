"""Files of a finished study in addition to its table: ranking, effects, figures."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cc_mujoco._utils import provenance
from cc_mujoco._utils.atomic_io import MANIFEST, replacing, write_manifest
from cc_mujoco.design import _report_text as report_text
from cc_mujoco.design._charts import (
    answer_plot,
    effects_plot,
    heat_maps,
    pareto_plot,
)
from cc_mujoco.design._local_sensitivity import Around
from cc_mujoco.design._phrases import (
    PRICES_NOTE,
    SLOPES_NOTE,
    UNKNOWN_REASON,
    column_title,
    describe_controllers,
    format_cell,
    index_text,
)
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._protocol import metric_of
from cc_mujoco.design._results_store import CONTROLLER_COLUMN
from cc_mujoco.design._scenarios import WORST_CASE_SUFFIX
from cc_mujoco.design._sensitivity import Sensitivity, sensitivity
from cc_mujoco.design._timestep_check import Halved
from cc_mujoco.report._figures import save, style
from cc_mujoco.report._html import (
    Html,
    element,
    embed_picture,
    folded,
    illustrated,
    join_pieces,
    page,
    paragraph,
    scrolled,
)
from cc_mujoco.report._html import sections as page_sections
from cc_mujoco.report._markdown import table as table_of

RANKING_FILE, PARETO_FILE, SOBOL_FILE, EFFECTS_FILE = (
    "ranking.md",
    "pareto.parquet",
    "sobol.parquet",
    "effects.parquet",
)
ANSWER_FIGURE, EFFECTS_FIGURE, ALL_EFFECTS_FIGURE, HEAT_MAPS_FIGURE, PARETO_FIGURE = (
    "answer.png",
    "effects.png",
    "effects_all.png",
    "heatmaps.png",
    "pareto.png",
)
REPORT_FILE, SLOPES_FILE = "report.html", "around.parquet"
REPORT_FILES = (
    REPORT_FILE, RANKING_FILE, SLOPES_FILE, PARETO_FILE, SOBOL_FILE, EFFECTS_FILE,
    ANSWER_FIGURE, EFFECTS_FIGURE, ALL_EFFECTS_FIGURE, HEAT_MAPS_FIGURE, PARETO_FIGURE,
)  # fmt: skip
"""All files that may be written in addition to the table."""

RANKED_DESIGNS = 20


def write_report(
    folder: Path,
    plan: Plan,
    table: pa.Table,
    command: str = "",
    nearby: Around | None = None,
    half: Halved | None = None,
) -> tuple[Path, ...]:
    """Write all that is made of a table; return the files.

    Without objectives the ranking goes by usual ones. `command` made the study, for the
    reader; `nearby` has sensitivities around the best design, `half` results with half
    the time step, if requested.
    """
    found = [
        one
        for name in plan.protocol.metrics
        if (one := sensitivity(plan, table, name)) is not None
    ]
    finding = report_text.RankedStudy(plan, table)
    (folder / MANIFEST).unlink(missing_ok=True)  # until all is written
    written = [folder / SOBOL_FILE, folder / EFFECTS_FILE]
    if nearby is not None:
        _write_table(folder / SLOPES_FILE, around_table(nearby))
        written.append(folder / SLOPES_FILE)
    _write_table(folder / SOBOL_FILE, sobol_table(found))
    _write_table(folder / EFFECTS_FILE, effects_table(found))
    drawings = {}
    with style():
        if finding.front.any():
            _write_table(folder / PARETO_FILE, table.filter(pa.array(finding.front)))
            written.append(folder / PARETO_FILE)
        if finding.best is not None and finding.varied:
            drawings[ANSWER_FIGURE] = answer_plot(
                table,
                _answer_abscissa(finding, found),
                finding.goals[0],
                finding.front,
                finding.marked,
            )
        if len(finding.goals) > 2 and finding.front.any():
            drawings[PARETO_FIGURE] = pareto_plot(table, finding.goals, finding.front)
        if found:
            goals = {goal.name for goal in finding.goals}
            if shown := [one for one in found if one.metric in goals]:
                # Variables whose effects on the objectives are drawn unfolded
                drawings[EFFECTS_FIGURE] = effects_plot(shown, 3)
            drawings[ALL_EFFECTS_FIGURE] = effects_plot(found)
            if (maps := heat_maps(plan, table, found)) is not None:
                drawings[HEAT_MAPS_FIGURE] = maps
        for name, drawing in drawings.items():
            save(folder / name, drawing)
            written.append(folder / name)
    text = markdown(finding, found, nearby, half)
    with replacing(folder / RANKING_FILE) as partial:
        partial.write_text(text, encoding="utf-8")
    text = _page(finding, found, folder, tuple(drawings), command, nearby, half)
    with replacing(folder / REPORT_FILE) as partial:
        partial.write_text(text, encoding="utf-8")
    files = (folder / REPORT_FILE, folder / RANKING_FILE, *written)
    for name in REPORT_FILES:  # of an earlier look at the table, by other objectives
        if folder / name not in files:
            (folder / name).unlink(missing_ok=True)
    write_manifest(folder, REPORT_FILES)
    return files


def _answer_abscissa(
    finding: report_text.RankedStudy, found: Sequence[Sensitivity]
) -> str:
    """Return what the first objective is drawn over: the second, or a variable."""
    if len(finding.goals) > 1:
        return finding.goals[1].name
    shares = {one.metric: one.total for one in found}.get(finding.goals[0].name, {})
    return max(finding.varied, key=lambda name: shares.get(name, 0.0))


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


def _page(
    finding: report_text.RankedStudy,
    found: Sequence[Sensitivity],
    folder: Path,
    drawn: Sequence[str],
    command: str,
    nearby: Around | None,
    half: Halved | None,
) -> str:
    def shown(name: str, words: str) -> Html:
        return embed_picture(folder / name, words) if name in drawn else Html()

    answer = shown(
        ANSWER_FIGURE,
        "All designs; the star is the best, squares are best in one objective.",
    )
    front = _more(
        "Every pair of objectives",
        shown(PARETO_FIGURE, "All designs, and those that nothing beats."),
    )
    effects = shown(
        EFFECTS_FIGURE,
        "Mean over the other variables; above each, the share of variance it explains "
        "alone.",
    )
    every = _more(
        "All metrics and variables",
        scrolled(shown(ALL_EFFECTS_FIGURE, "The same of every metric.")),
    )
    maps = _more(
        "Maps over the two variables that matter most",
        scrolled(shown(HEAT_MAPS_FIGURE, "Every metric over these two variables.")),
    )
    versions = ", ".join(
        f"{name} {text}" for name, text in provenance.versions().items()
    )
    made = join_pieces(
        [
            *([paragraph(element("code", command))] if command else ()),
            paragraph(f"The table of all designs lies beside this page. {versions}."),
        ]
    )
    parts = {
        "best": report_text.best_designs(finding),
        "sure": report_text.confidence(finding, nearby, half),
        "controllers": report_text.controllers(finding),
        "trade": illustrated(report_text.trade_offs(finding), front),
        "matters": illustrated(
            report_text.deciding_variables(found, finding.goals), effects, every, maps
        ),
        "limits": report_text.limit_slack(finding),
        "nearby": report_text.local_values(nearby),
        "failures": report_text.failures(finding),
        "fixed": folded("All values", report_text.common_values(finding)),
        "words": folded("All names", report_text.variable_meanings(finding)),
        "made": made,
    }
    there = {key: part for key, part in parts.items() if part is not None}
    if finding.best is None:  # what stands in the way comes first
        first = ("limits", "failures")
        there = {key: there[key] for key in sorted(there, key=lambda k: k not in first)}
    return page(
        f"What if: {finding.plan.protocol.scene}",
        "named" if finding.best is not None else "fix-data",
        report_text.header(finding, answer, folder),
        page_sections(SECTION_TITLES, there),
    )


def _more(title: str, picture: Html) -> Html:
    """Return a picture folded below a title; nothing where there is none."""
    return folded(title, picture) if "<img" in picture else Html()


def markdown(
    finding: report_text.RankedStudy,
    found: Sequence[Sensitivity],
    nearby: Around | None = None,
    half: Halved | None = None,
) -> str:
    """Return the ranking as Markdown, with effects and indices below."""
    plan, rows, limits = finding.plan, finding.rows, finding.limits
    protocol = plan.protocol
    failed = [str(row["failed"]) for row in rows if row["failed"]]
    parts = [
        f"# What if: {protocol.scene}, {len(rows)} designs",
        "Trajectory {}, task {}, ".format(*protocol.sources)
        + f"{describe_controllers(protocol.controllers)}, {protocol.duration:g} s, "
        f"seed {protocol.seed}, time step {1e3 * protocol.timestep:g} ms.",
    ]
    if protocol.axes:
        parts.append(report_text.axes_sentence(protocol.axes))
    if protocol.across.several:
        parts.append(f"{report_text.cases_sentence(plan)}")
    if failed:
        parts.append(
            f"Designs that failed in simulation: {len(failed)}; the first: {failed[0]}."
        )
    parts += report_text.controllers_out(plan, rows)
    names = ", ".join(goal.text for goal in finding.goals)
    for goal in finding.goals:
        without = sum(row[goal.name] is None for row in rows)
        if lacking := without - len(failed):
            parts.append(f"Designs without {goal.name}: {lacking}.")
    if limits:
        kept = f"{int(finding.kept.sum())} of {len(rows)}"
        parts.append(
            f"Limits: {', '.join(limit.text for limit in limits)}; {kept} keep them."
        )
    given = "Objectives" if finding.chosen else "No objectives were given; usual ones"
    parts.append(f"{given}: {names}. Pareto set: {int(finding.front.sum())}.")
    parts.append("## Ranking")
    parts.append(
        f"The best {min(RANKED_DESIGNS, len(rows))}: the Pareto set (marked *) first, "
        "each part by mean rank in the objectives."
        if finding.front.any()
        else "By mean rank in the objectives; none keeps the limits."
    )
    parts.append(_ranking(finding))
    if half is not None:
        parts.append(report_text.timestep_sentence(half))
    if nearby is not None:
        parts += [f"## Around design {nearby.design}", SLOPES_NOTE]
        parts.append(table_of(*report_text.slope_table(nearby)))
        if nearby.prices:
            parts += [PRICES_NOTE, table_of(*report_text.price_table(nearby))]
    parts.append("## What each metric depends on")
    parts += [_sensitivity(one) for one in found]
    known = {one.metric for one in found}
    if unknown := [name for name in protocol.metrics if name not in known]:
        parts.append(f"No shares are known of {', '.join(unknown)}: {UNKNOWN_REASON}.")
    parts.append("## Metrics")
    parts.append(
        table_of(
            ("metric", "unit", "meaning"),
            ((m.name, m.unit, m.meaning) for m in map(metric_of, protocol.metrics)),
        )
    )
    return "\n\n".join(parts) + "\n"


def around_table(found: Around) -> pa.Table:
    """Return the slopes at the best design, a row per metric and variable, as text."""
    rows = [
        (
            found.design,
            one.metric,
            one.variable,
            format_cell(one.low),
            format_cell(one.high),
            one.change,
            one.error,
        )
        for one in found.slopes
    ]
    kinds = [("design", pa.int64()), ("metric", pa.string()), ("variable", pa.string()),
             ("low", pa.string()), ("high", pa.string()), ("change", pa.float64()),
             ("error", pa.float64())]  # fmt: skip
    return _table(kinds, rows)


def sobol_table(found: Iterable[Sensitivity]) -> pa.Table:
    """Return the indices of all metrics, one per row; `other` is null except for pairs.

    `error` is 0 where they are exact; a share below it is 0.
    """
    rows: list[tuple[object, ...]] = []
    for one in found:
        first, total, pairs = one.errors
        for name in one.first:
            for kind, shares, errors in (
                ("first", one.first, first),
                ("total", one.total, total),
            ):
                index = shares[name], errors.get(name, 0.0)
                rows.append((one.metric, kind, name, None, *index, one.how))
        for (name, other), share in one.pairs.items():
            index = share, pairs.get((name, other), 0.0)
            rows.append((one.metric, "pair", name, other, *index, one.how))
    kinds = [("metric", pa.string()), ("kind", pa.string()), ("variable", pa.string()),
             ("other", pa.string()), ("share", pa.float64()),
             ("error", pa.float64()), ("how", pa.string())]  # fmt: skip
    return _table(kinds, rows)


def effects_table(found: Iterable[Sensitivity]) -> pa.Table:
    """Return the main effects of all metrics as text, a row per value of a variable."""
    rows = []
    for one in found:
        for name, (values, means) in one.effects.items():
            texts = one.levels.get(name) or [f"{value:.12g}" for value in values]
            rows += [
                (one.metric, name, text, float(mean))
                for text, mean in zip(texts, means, strict=True)
            ]
    kinds = [("metric", pa.string()), ("variable", pa.string()),
             ("value", pa.string()), ("mean", pa.float64())]  # fmt: skip
    return _table(kinds, rows)


def _ranking(finding: report_text.RankedStudy) -> str:
    plan, goals = finding.plan, finding.goals
    metrics = [goal.name for goal in goals]
    metrics += [name for name in plan.protocol.metrics if name not in metrics]
    several = len(plan.protocol.controllers) > 1
    columns = [
        "design",
        *plan.varied,
        *metrics,
        *([CONTROLLER_COLUMN] if several else []),
    ]
    if plan.protocol.across.several:
        columns += [f"{goal.name}@{WORST_CASE_SUFFIX}" for goal in goals]
    head = [column_title(name) for name in columns]
    rows = []
    for place in finding.order[:RANKED_DESIGNS]:
        cells = [format_cell(finding.rows[place][name]) for name in columns]
        cells[0] += "*" if finding.front[place] else ""
        rows.append(cells)
    return table_of(head, rows)


def _sensitivity(one: Sensitivity) -> str:
    rows = []
    for name in sorted(one.total, key=lambda n: one.total[n], reverse=True):
        values, means = one.effects[name]
        low, high = int(np.argmin(means)), int(np.argmax(means))
        text = one.levels.get(name) or [f"{value:.4g}" for value in values]
        rows.append(
            (
                name,
                index_text(one.first[name], one.errors[0].get(name)),
                index_text(one.total[name], one.errors[1].get(name)),
                f"{means[low]:.4g} at {text[low]}",
                f"{means[high]:.4g} at {text[high]}",
            )
        )
    unit = metric_of(one.metric).unit
    head = ("variable", "first order", "total", f"least mean [{unit}]",
            f"greatest mean [{unit}]")  # fmt: skip
    parts = [f"### {one.metric}", f"Sobol's indices: {one.how}.", table_of(head, rows)]
    large = sorted(one.pairs.items(), key=lambda item: -item[1])[:5]
    pairs = [
        f"{a} with {b} {index_text(share, one.errors[2].get((a, b)))}"
        for (a, b), share in large
        if share >= 0.005
    ]
    if pairs:
        parts.append(f"Together only: {'; '.join(pairs)}.")
    return "\n\n".join(parts)


def _table(
    kinds: Sequence[tuple[str, pa.DataType]], rows: Sequence[tuple[object, ...]]
) -> pa.Table:
    columns = list(itertools.zip_longest(*rows)) if rows else [()] * len(kinds)
    arrays = [pa.array(c, k) for c, (_, k) in zip(columns, kinds, strict=True)]
    return pa.Table.from_arrays(arrays, schema=pa.schema(kinds))


def _write_table(path: Path, table: pa.Table) -> None:
    with replacing(path) as partial:
        pq.write_table(table.combine_chunks(), partial, compression="zstd")
