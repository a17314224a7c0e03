"""Files of a benchmark: results, figures, and a page on the best controllers.

Figures show error against effort, and by condition.
"""

import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cc_mujoco._utils.atomic_io import MANIFEST, replacing
from cc_mujoco._utils.provenance import versions, write_manifest
from cc_mujoco.benchmark import _report as text
from cc_mujoco.benchmark import _results as stored
from cc_mujoco.benchmark import _runner as runner
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER
from cc_mujoco.benchmark._results import DeviceResults, Results
from cc_mujoco.benchmark._runner import BenchmarkPlan
from cc_mujoco.report import _html as html
from cc_mujoco.report._figures import BLACK, COLORS, GREY, figure, save, style
from cc_mujoco.report._html import Html

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CAPTIONS = {
    "pareto": "Normalised error against effort and chatter, mean over conditions and "
    "seeds; the line joins the controllers that no other beats in both.",
    "robustness": "Normalised error of every controller in every condition; blue is "
    "better than none, red is worse.",
}


def write(
    out: str | os.PathLike[str],
    plan: BenchmarkPlan,
    results: Results,
    baseline: str = text.DEFAULT_BASELINE,
) -> str:
    """Write `results.parquet`, figures and `report.html`; return a summary."""
    out = Path(out)
    makers = plan.made_by()
    stored.write_results(out / runner.RESULTS_FILE, results, plan.suite, makers)
    (out / MANIFEST).unlink(missing_ok=True)  # until all is written
    drawings = {"pareto": pareto, "robustness": robustness}
    for own in stored.by_device(results):
        for stem, draw in drawings.items():
            with style():
                save(out / f"{own.label}-{stem}.png", draw(own))
    page = _report_page(out, plan, results, baseline)
    with replacing(out / runner.REPORT_FILE) as partial:
        partial.write_text(page, encoding="utf-8")
    write_manifest(out, [runner.REPORT_FILE])
    return text.summary(results, baseline)


def _report_page(
    folder: Path, plan: BenchmarkPlan, results: Results, baseline: str
) -> str:
    devices = {f"device{n}": own for n, own in enumerate(stored.by_device(results))}
    titles, parts = {}, {}
    for key, own in devices.items():
        titles[key] = f"{own.label[:1].upper()}{own.label[1:]}"
        parts[key] = _device(folder, own, baseline, key == "device0")
    titles |= {"all": "All controllers and references", "words": "What the names mean"}
    titles |= {"times": text.TIMES_TITLE, "made": "How this was made"}
    notes = (*text.divergence_sentences(results), *text.cut_sentences(results))
    notes += tuple(text.assumed_limits(results))
    parts["all"] = _folded_table(text.OVERVIEW_HEADING, text.overview_table(results))
    times = text.times_table(results)
    if times[1]:
        parts["times"] = html.short_table(*_marked(times))
    lines = [line.removeprefix("- ") for line in text.definitions(results).splitlines()]
    words = html.bullet_list(map(html.inline_markdown, lines))
    parts["words"] = html.folded("References and scores", words)
    listed = ", ".join(f"{name} {number}" for name, number in versions().items())
    machine = stored.describe_machine()
    parts["made"] = html.paragraph(
        html.element("code", runner.RESULTS_FILE),
        f" beside this page has a row per episode. {listed}. "
        f"{machine['processors']} processors ({machine['processor']}), "
        f"{machine['system']}.",
    )
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


def _device(folder: Path, own: DeviceResults, baseline: str, first: bool) -> Html:
    (heading, ranks), *others = text.device_tables(own, baseline)
    conditions, scores = (_folded_table(*other) for other in others)
    return html.join_pieces(
        [
            html.paragraph(heading),
            html.short_table(*_marked(ranks)),
            *([] if first else [_figure(folder, own, "pareto")]),
            _figure(folder, own, "robustness"),
            conditions,
            scores,
        ]
    )


def _figure(folder: Path, own: DeviceResults, stem: str) -> Html:
    return html.embed_picture(folder / f"{own.label}-{stem}.png", CAPTIONS[stem])


def _folded_table(heading: str, cells: text.Cells) -> Html:
    title = html.inline_markdown(heading.rstrip(":"))
    return html.folded(title, html.table(*_marked(cells)))


def _marked(cells: text.Cells) -> tuple[list[Html], list[list[Html]]]:
    """Return head and rows of a Markdown table with cells in HTML."""
    head, *rows = ([*map(html.inline_markdown, r)] for r in (cells[0], *cells[1]))
    return head, rows


def pareto(own: DeviceResults) -> "Figure":
    errors, looks = own.errors, _line_styles(own.errors)
    costs = {
        "rms_motor_torque": "effort: RMS torque of the motor [N m]",
        "chatter": "chatter: RMS of the same less its mean over 50 ms [N m]",
    }
    passive = [law for law in errors if law in ("unplugged", "motor-off")]
    drawing = _figure_for_phone(6.6)
    panels = drawing.subplots(2, 1)
    for axes, (cost, label) in zip(panels, costs.items(), strict=True):
        points = {
            law: (own.mean_score(law, cost), float(np.mean(values)))
            for law, values in errors.items()
            if law not in passive
        }
        points = {law: p for law, p in points.items() if math.isfinite(p[0])}
        entries = [point for law, point in points.items() if law not in REFERENCES]
        front = [
            one
            for one in entries
            if not any(p != one and p[0] <= one[0] and p[1] <= one[1] for p in entries)
        ]
        line = np.array(sorted(front))
        axes.plot(line[:, 0], line[:, 1], color=GREY, lw=0.8, zorder=1)
        for law, point in points.items():
            about = looks[law] | {"linestyle": "", "markersize": 6}
            axes.plot(*point, label=law, clip_on=False, **about)
        for law in passive:  # whose motor does nothing
            about = looks[law] | {"marker": "", "lw": 0.9}
            axes.axhline(float(np.mean(errors[law])), label=law, **about)
        axes.set(xlabel=label, ylabel="normalised error", ylim=(0.0, None))
    panels[0].set(title=f"{own.label}: error against effort")
    panels[1].set(title="and against chatter")
    labels = panels[0].get_legend_handles_labels()
    drawing.legend(*labels, loc="outside lower center", ncols=3)
    return drawing


def robustness(own: DeviceResults) -> "Figure":
    """Draw the normalised error by condition (rows) and controller (columns).

    Colours are logarithmic around 1, the error of `none`.
    """
    shown = [law for law in own.errors if law not in (*REFERENCES, SCALE_CONTROLLER)]
    shown = shown or [SCALE_CONTROLLER]
    conditions = list(own.rms[SCALE_CONTROLLER])
    means = np.array([own.errors[law].mean(axis=1) for law in shown]).T
    drawing = _figure_for_phone(0.21 * len(conditions) + 1.7)
    axes = drawing.add_subplot()
    logarithms, decades = np.log10(np.maximum(means, 1e-9)), 1.5  # either side of 1
    ends = -decades, decades
    picture = axes.imshow(logarithms, cmap="RdBu_r", clim=ends, aspect="auto")
    axes.grid(visible=False)
    axes.set_xticks(range(len(shown)), shown, rotation=60, ha="right")
    axes.set_yticks(range(len(conditions)), conditions)
    axes.set_title(f"{own.label}: error over that of none", loc="left")
    size = 8 if len(shown) <= 6 else 48 / len(shown)
    for (row, column), mean in np.ndenumerate(means):
        pale = abs(math.log10(max(mean, 1e-9))) < 0.6 * decades
        text = f"{mean:.2f}" if mean < 9.995 else f"{mean:.0f}"
        shown_text = text if mean >= 1.0 else text.removeprefix("0")
        drawn = axes.text(column, row, shown_text, ha="center", va="center")
        drawn.set(size=max(size, 5.0), color=BLACK if pale else "white")
    bar = drawing.colorbar(picture, location="bottom", aspect=40, pad=0.02)
    ticks = [-1.0, -0.5, 0.0, 0.5, 1.0]
    bar.set_ticks(ticks, labels=[f"{10.0**tick:.2g}" for tick in ticks])
    bar.outline.set_visible(False)
    return drawing


def _figure_for_phone(height: float) -> "Figure":
    return figure(4.9, height)  # wide [inch]: legible at 390 pixels


def _line_styles(laws: Iterable[str]) -> dict[str, dict[str, Any]]:
    laws = list(laws)
    dashes, markers = (":", "--", "-.", (0, (5, 1))), ("v", "^", "D", "s")
    found: dict[str, dict[str, Any]] = {}
    for place, law in enumerate(name for name in laws if name in REFERENCES):
        look = {"linestyle": dashes[place % 4], "marker": markers[place % 4]}
        found[law] = look | {"color": GREY}
    for place, law in enumerate(name for name in laws if name not in REFERENCES):
        # Seven colours; the next seven have squares in place of circles.
        color, marker = COLORS[place % 7], "s" if place // 7 % 2 else "o"
        found[law] = {"linestyle": "-", "marker": marker, "color": color}
    return found
