"""Files of a benchmark: results, tables, figures."""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco._utils.atomic_io import MANIFEST, replacing, write_manifest
from cc_mujoco.benchmark import _figures as drawing
from cc_mujoco.benchmark._report import DEFAULT_BASELINE, all_tables, summary
from cc_mujoco.benchmark._results import Results, write_results
from cc_mujoco.benchmark._runner import (
    FIGURE_STEMS,
    RESULTS_FILE,
    TABLES_FILE,
    BenchmarkPlan,
)
from cc_mujoco.report._figures import save, style


def write(
    out: str | os.PathLike[str],
    plan: BenchmarkPlan,
    results: Results,
    baseline: str = DEFAULT_BASELINE,
) -> str:
    """Write `results.parquet`, `table.md` and the figures of every device.

    Returns:
        The summary at the top, as Markdown.
    """
    out = Path(out)
    makers = plan.made_by()
    write_results(out / RESULTS_FILE, results, plan.suite, makers)
    text = all_tables(results, baseline, plan.left_out())
    (out / MANIFEST).unlink(missing_ok=True)  # until all is written
    with replacing(out / TABLES_FILE) as partial:
        partial.write_text(text, encoding="utf-8")
    for scene in dict.fromkeys(cell.condition.label for cell, _ in results):
        for stem in FIGURE_STEMS:
            with style():
                draw = getattr(drawing, stem)
                save(out / f"{scene}-{stem}.png", draw(results, scene))
    write_manifest(out, [TABLES_FILE])
    return summary(results, baseline)
