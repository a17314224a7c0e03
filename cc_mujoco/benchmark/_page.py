"""Files of a benchmark: results, figures, tables and a page on the best controllers."""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco._utils.atomic_io import MANIFEST, replacing, write_manifest
from cc_mujoco._utils.provenance import versions
from cc_mujoco.benchmark import _figures as figures
from cc_mujoco.benchmark import _report as text
from cc_mujoco.benchmark import _results as stored
from cc_mujoco.benchmark import _runner as runner
from cc_mujoco.benchmark._runner import BenchmarkPlan
from cc_mujoco.report import _html as html
from cc_mujoco.report._figures import save, style
from cc_mujoco.report._html import Html

CAPTIONS = {
    "pareto": "Normalised error against effort and chatter, mean over conditions and "
    "seeds; the line joins the controllers that no other beats in both.",
    "robustness": "Normalised error of every controller in every condition; blue is "
    "better than none, red is worse.",
    "cycle": "Error over the cycle in the ordinary condition.",
}
"""Captions of the figures of a device."""


def write(
    out: str | os.PathLike[str],
    plan: BenchmarkPlan,
    results: stored.Results,
    baseline: str = text.DEFAULT_BASELINE,
) -> str:
    """Write `results.parquet`, figures, `table.md`, `report.html`; return a summary."""
    out = Path(out)
    makers = plan.made_by()
    stored.write_results(out / runner.RESULTS_FILE, results, plan.suite, makers)
    (out / MANIFEST).unlink(missing_ok=True)  # until all is written
    for own in stored.by_device(results):
        for stem in CAPTIONS:
            with style():
                save(out / f"{own.label}-{stem}.png", getattr(figures, stem)(own))
    pages = {
        runner.TABLES_FILE: text.all_tables(results, baseline, plan.left_out()),
        runner.REPORT_FILE: _report_page(out, plan, results, baseline),
    }
    for name, content in pages.items():
        with replacing(out / name) as partial:
            partial.write_text(content, encoding="utf-8")
    write_manifest(out, runner.TEXT_FILES)
    return text.summary(results, baseline)


def _report_page(
    folder: Path, plan: BenchmarkPlan, results: stored.Results, baseline: str
) -> str:
    """Return the page of a benchmark, whose figures are in `folder`."""
    devices = {f"device{n}": own for n, own in enumerate(stored.by_device(results))}
    titles = {
        k: f"{own.label[:1].upper()}{own.label[1:]}" for k, own in devices.items()
    }
    parts: dict[str, Html] = {}
    for key, own in devices.items():
        parts[key] = _device(folder, own, baseline, key == "device0")
    titles |= {"all": "All controllers and references", "words": "What the names mean"}
    titles |= {"times": text.TIMES_TITLE, "made": "How this was made"}
    notes = (*text.divergence_sentences(results), *text.assumed_limits(results))
    notes += tuple(text.left_out_sentences(plan.left_out()))
    parts["all"] = _folded_table(text.OVERVIEW_HEADING, text.overview_table(results))
    times = text.times_table(results)
    if times[1]:
        parts["times"] = html.short_table(*_marked(times))
    lines = [line.removeprefix("- ") for line in text.definitions(results).splitlines()]
    words = html.bullet_list(map(html.inline_markdown, lines))
    parts["words"] = html.folded("References and scores", words)
    parts["made"] = _provenance()
    best = html.inline_markdown(text.best_sentence(results, baseline))
    command = html.element("code", text.next_command(results))
    header = html.element(
        "header",
        html.element("h1", f"Benchmark of controllers, suite {plan.suite}"),
        html.paragraph(best, kind="lead"),
        _figure(folder, devices["device0"], "pareto"),
        html.paragraph(html.element("b", "Next: "), command),
        *(html.paragraph(html.inline_markdown(n), kind="small") for n in notes),
    )
    title = f"Benchmark of controllers: suite {plan.suite}"
    return html.page(title, "named", header, html.sections(titles, parts))


def _device(
    folder: Path, own: stored.DeviceResults, baseline: str, first: bool
) -> Html:
    ranks = text.ranks_table(own.rms, baseline)
    return html.join_pieces(
        [
            html.paragraph(text.RANKS_HEADING),
            html.short_table(*_marked(ranks)),
            *([] if first else [_figure(folder, own, "pareto")]),
            _figure(folder, own, "robustness"),
            _folded_table(text.CONDITIONS_HEADING, text.conditions_table(own)),
            _folded_table(text.SCORES_HEADING, text.scores_table(own)),
            html.folded("Error over the cycle", _figure(folder, own, "cycle")),
            _folded_table(text.PLANTS_HEADING, text.plants_table(own)),
        ]
    )


def _figure(folder: Path, own: stored.DeviceResults, stem: str) -> Html:
    return html.embed_picture(folder / f"{own.label}-{stem}.png", CAPTIONS[stem])


def _folded_table(heading: str, cells: text.Cells) -> Html:
    title = html.inline_markdown(heading.rstrip(":"))
    return html.folded(title, html.table(*_marked(cells)))


def _marked(cells: text.Cells) -> tuple[list[Html], list[list[Html]]]:
    """Return a table whose code and emphasis are elements."""
    head, *rows = ([*map(html.inline_markdown, r)] for r in (cells[0], *cells[1]))
    return head, rows


def _provenance() -> Html:
    listed = ", ".join(f"{name} {number}" for name, number in versions().items())
    machine = stored.describe_machine()
    return html.paragraph(
        html.element("code", runner.RESULTS_FILE),
        f" beside this page has a row per episode. {listed}. "
        f"{machine['processors']} processors ({machine['processor']}), "
        f"{machine['system']}.",
    )
