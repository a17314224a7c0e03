"""Files of a benchmark: results, tables, figures."""

from __future__ import annotations

import os
from pathlib import Path

from cc_mujoco.benchmark import drawing, entry
from cc_mujoco.benchmark.report import BASELINE, markdown
from cc_mujoco.benchmark.results import Results, write_results
from cc_mujoco.benchmark.runner import FIGURES, RESULTS, TABLE, BenchmarkPlan
from cc_mujoco.figures import save, style
from cc_mujoco.files import WRITTEN, replacing, sign


def write(
    out: str | os.PathLike[str],
    plan: BenchmarkPlan,
    results: Results,
    baseline: str = BASELINE,
) -> str:
    """Write `results.parquet`, `table.md` and the figures of every device.

    Returns:
        The tables, as Markdown.
    """
    out = Path(out)
    makers = entry.makers(*plan.controllers)
    write_results(out / RESULTS, results, plan.suite, makers)
    text = markdown(results, baseline)
    (out / WRITTEN).unlink(missing_ok=True)  # until all is written
    with replacing(out / TABLE) as partial:
        partial.write_text(text, encoding="utf-8")
    for scene in dict.fromkeys(cell.condition.scene for cell, _ in results):
        for stem in FIGURES:
            with style():
                draw = getattr(drawing, stem)
                save(out / f"{scene}-{stem}.png", draw(results, scene))
    sign(out, [TABLE])
    return text
