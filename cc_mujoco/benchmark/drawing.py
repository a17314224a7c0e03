"""Figures of the benchmark: what accuracy costs, the cycle, what makes it worse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cc_mujoco.benchmark.conditions import ERRORS, TRANSMISSIONS
from cc_mujoco.benchmark.ranking import normalised
from cc_mujoco.benchmark.references import REFERENCES, SCALE
from cc_mujoco.benchmark.results import Results, rms_errors
from cc_mujoco.figures import BLACK, COLORS, GREY, figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BINS = 100
"""Of a cycle."""


def pareto(results: Results, scene: str) -> Figure:
    """Normalised error against effort and against chatter; the best are joined."""
    errors = normalised(rms_errors(results)[scene], SCALE)
    with style():
        drawing = figure(9.6, 4.2)
        panels = drawing.subplots(1, 2, sharey=True)
        for axes, cost in zip(panels, ("effort", "chatter"), strict=True):
            points = {
                law: (_mean(results, scene, law, cost), float(np.mean(values)))
                for law, values in errors.items()
                if law not in ("unplugged", "motor-off")
            }
            line = np.array(sorted(_best(list(points.values()))))
            axes.plot(line[:, 0], line[:, 1], color=GREY, lw=0.8, zorder=1)
            for law, point in points.items():
                axes.plot(*point, _marker(law), color=_color(errors, law), label=law)
            axes.set(xlabel=f"{cost}: RMS torque of the motor [Nm]", yscale="log")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
            for law in ("unplugged", "motor-off"):
                level = float(np.mean(errors[law]))
                axes.axhline(level, color=BLACK, lw=0.7, ls=_dash(law), label=law)
        panels[1].set(xscale="symlog")
        panels[1].set_xscale("symlog", linthresh=1e-3)
        panels[0].set(title=f"{scene}: error against effort", ylabel="normalised error")
        panels[1].set(title="and against chatter")
        panels[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawing


def cycle(results: Results, scene: str) -> Figure:
    """Error over the cycle of the motion in the ordinary condition, RMS over seeds."""
    errors = rms_errors(results)[scene]
    shown = {
        cell.controller: played.trace
        for cell, played in results
        if cell.condition.scene == scene and played.trace
    }
    shown.pop("unplugged", None)
    with style():
        drawing = figure(7.6, 3.8)
        axes = drawing.add_subplot()
        for law, trace in shown.items():
            counted = trace["time_s"] >= 1.0
            place = np.minimum((trace["phase"] * BINS).astype(int), BINS - 1)[counted]
            error = (trace["joint_torque_nm"] - trace["desired_torque_nm"])[counted]
            total = np.bincount(place, error**2, BINS)
            number = np.bincount(place, minlength=BINS)
            with np.errstate(invalid="ignore", divide="ignore"):
                rms = np.sqrt(total / number)
            at = (np.arange(BINS) + 0.5) / BINS
            known = np.isfinite(rms)
            color, dash = _color(errors, law), "--" if law in REFERENCES else "-"
            axes.plot(at[known], rms[known], dash, color=color, lw=1.0, label=law)
        axes.set(
            title=f"{scene}: error over the cycle, ordinary condition",
            xlabel="phase of the cycle",
            ylabel="RMS error [Nm]",
        )
        if shown:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawing


def levels(results: Results, scene: str) -> Figure:
    """Normalised error over transmissions and errors of the model, a line each."""
    rms = rms_errors(results)[scene]
    errors = normalised(rms, SCALE)
    names = list(rms[SCALE])
    kinds = [e for e in ERRORS if any(n.endswith(f"-{e}") for n in names)]
    with style():
        drawing = figure(3.1 * max(len(kinds), 1) + 1.6, 3.6)
        panels = drawing.subplots(1, max(len(kinds), 1), sharey=True, squeeze=False)[0]
        for axes, error in zip(panels, kinds, strict=False):
            _lines(axes, errors, names, error)
            axes.set(title=f"model {error}", yscale="log")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
        panels[0].set(ylabel="normalised error")
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        drawing.suptitle(
            f"{scene}: transmissions and errors of the model", x=0.01, ha="left"
        )
    return drawing


def _lines(
    axes: Axes, errors: dict[str, np.ndarray], names: list[str], error: str
) -> None:
    """A line per controller over the transmissions that were played."""
    known = [t for t in TRANSMISSIONS if f"{t}-{error}" in names]
    for law, values in errors.items():
        means = [np.mean(values[names.index(f"{t}-{error}")]) for t in known]
        dash = "--" if law in REFERENCES else "-"
        color = _color(errors, law)
        axes.plot(known, means, f"o{dash}", color=color, markersize=3, label=law)


def _mean(results: Results, scene: str, law: str, score: str) -> float:
    """Mean of a score over conditions and seeds."""
    return float(
        np.nanmean(
            np.concatenate(
                [
                    played.scores[score]
                    for cell, played in results
                    if (cell.condition.scene, cell.controller) == (scene, law)
                ]
            )
        )
    )


def _best(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    return [
        point
        for point in points
        if not any(
            other != point and other[0] <= point[0] and other[1] <= point[1]
            for other in points
        )
    ]


def _color(laws: object, law: str) -> str:
    place = list(laws).index(law)  # type: ignore[call-overload]
    return COLORS[place % len(COLORS)]


def _marker(law: str) -> str:
    return "D" if law in REFERENCES else "o"


def _dash(law: str) -> str:
    return ":" if law == "unplugged" else "--"
