"""Files of a benchmark: results, figures, tables and a page."""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco._utils.atomic_io import MANIFEST, replacing, write_manifest
from cc_mujoco.benchmark import _figures as drawing
from cc_mujoco.benchmark._page import report_page
from cc_mujoco.benchmark._report import DEFAULT_BASELINE, all_tables, summary
from cc_mujoco.benchmark._results import Results, write_results
from cc_mujoco.benchmark._runner import (
    FIGURE_STEMS,
    REPORT_FILE,
    RESULTS_FILE,
    TABLES_FILE,
    TEXT_FILES,
    BenchmarkPlan,
)
from cc_mujoco.report._figures import save, style


def write(
    out: str | os.PathLike[str],
    plan: BenchmarkPlan,
    results: Results,
    baseline: str = DEFAULT_BASELINE,
) -> str:
    """Write `results.parquet`, figures, `table.md`, `report.html`; return a summary."""
    out = Path(out)
    makers = plan.made_by()
    write_results(out / RESULTS_FILE, results, plan.suite, makers)
    (out / MANIFEST).unlink(missing_ok=True)  # until all is written
    for scene in dict.fromkeys(cell.condition.label for cell, _ in results):
        for stem in FIGURE_STEMS:
            with style():
                draw = getattr(drawing, stem)
                save(out / f"{scene}-{stem}.png", draw(results, scene))
    texts = {
        TABLES_FILE: all_tables(results, baseline, plan.left_out()),
        REPORT_FILE: report_page(out, plan, results, baseline),
    }
    for name, text in texts.items():
        with replacing(out / name) as partial:
            partial.write_text(text, encoding="utf-8")
    write_manifest(out, TEXT_FILES)
    return summary(results, baseline)
