"""Figures of the experiment `online`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cc_mujoco.native import FloatArray
from cc_mujoco.report._figures import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, figure
from thesis._experiments.online_runs import (
    CABLE,
    CURVATURE_PLACES,
    DRIFT_START,
    DT,
    MODEL_FRICTIONS,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cc_mujoco.estimation._tracks import EstimateTrack
    from thesis._experiments.online_estimates import Bends, Softening
    from thesis._experiments.online_laws import MassMotion, PrintedLaws
    from thesis._experiments.online_runs import Truth


def slopes(instant: MassMotion, printed: PrintedLaws) -> Figure:
    """Draw Fig. 3.9, and the laws that use it."""
    drawing = figure(11.0, 4.4)
    left, right = drawing.subplots(1, 2)
    nodes = np.arange(1, instant.reading.size + 1)
    colors = (BLUE, GREEN, PINK, ORANGE)
    for model, told, color in zip(MODEL_FRICTIONS, instant.models, colors, strict=True):
        label = f"model: {model:g} times the true friction"
        left.plot(nodes, told.T, color=color, linewidth=0.6, label=[label] + [""] * 10)
    left.plot(nodes, instant.line, color=BLACK, linewidth=2.2, label="line fitted")
    left.plot(nodes, instant.reading, "o", color=BLACK, markersize=4, label="sensors")
    left.set(
        title="Each sensor's reading, carried along the cable by models",
        xlabel="node, from the motor",
        ylabel="tension [N]",
        ylim=(0.0, 3.0 * float(np.max(instant.reading))),
    )
    left.legend()
    looks = ((GREY, "-"), (ORANGE, "-"), (PINK, "-"), (BLUE, "-"))
    for (name, track), (color, style) in zip(
        printed.tracks.items(), looks, strict=True
    ):
        label = name if name == "least squares" else f"printed law {name}"
        label = label.replace("law and", "law, signed and").replace("law as", "law, as")
        right.plot(printed.time, track, style, color=color, linewidth=1.1, label=label)
    right.axhline(CABLE.friction, color=BLACK, linewidth=1.0, label="truth")
    right.set(
        title="Friction from twice the truth, laws at their best gains",
        xlabel="time [s]",
        ylabel="friction coefficient",
        ylim=(0.0, 0.7),
    )
    right.legend(loc="upper right", ncols=2)
    return drawing


def tracking(
    truth: Truth, friction: FloatArray, one: EstimateTrack, ends: EstimateTrack
) -> Figure:
    """Draw growing friction and its estimates."""
    drawing = figure(11.0, 4.4)
    left, right = drawing.subplots(1, 2)
    seen = slice(None, None, 10)
    time = truth.time[seen]
    pairs = (
        ("slope of ln T, 11 sensors", one.value, one.deviation, BLUE),
        (
            "unscented filter, ends only",
            ends.value[:, 0],
            ends.deviation[:, 0],
            ORANGE,
        ),
    )
    left.plot(time, friction[seen], color=BLACK, linewidth=2.0, label="truth")
    for label, value, deviation, color in pairs:
        left.plot(time, value[seen], color=color, linewidth=0.9, label=label)
        error = 100.0 * (value / friction - 1.0)[seen]
        stated = 200.0 * (deviation / friction)[seen]
        right.plot(time, error, color=color, linewidth=0.8, label=label)
        right.plot(time, stated, "--", color=color, linewidth=0.8)
        right.plot(time, -stated, "--", color=color, linewidth=0.8)
    right.plot([], [], "--", color=GREY, label="two stated deviations")
    left.set(
        title="Friction that grows by half in three minutes",
        xlabel="time [s]",
        ylabel="friction coefficient",
        ylim=(0.15, 0.45),
    )
    right.set(
        title="Error, and what the estimators state",
        xlabel="time [s]",
        ylabel="error [% of the truth]",
        ylim=(-2.5, 2.5),
    )
    left.legend()
    right.legend(loc="upper right", ncols=2)
    return drawing


def bend_and_stiffness(bend: Bends, soft: Softening) -> Figure:
    """Draw mu/R along the cable, and stiffness over time."""
    drawing = figure(11.0, 4.4)
    left, right = drawing.subplots(1, 2)
    _draw_bend(left, bend)
    seen = slice(None, None, 10)
    time, found = soft.time[seen], soft.found.value[seen] / 1e3
    spread = 2.0 * soft.found.deviation[seen] / 1e3
    right.fill_between(
        time, found - spread, found + spread, color=BLUE, alpha=0.25, linewidth=0.0
    )
    right.plot(time, soft.truth[seen] / 1e3, color=BLACK, linewidth=2.0, label="truth")
    right.plot(
        time, found, color=BLUE, linewidth=1.0, label="estimate, two stated deviations"
    )
    right.set(
        title="Axial stiffness from partial motion, start at twice the truth",
        xlabel="time [s]",
        ylabel="EA [kN]",
        ylim=(2.0, 5.0),
    )
    right.legend()
    return drawing


def _draw_bend(axes: Axes, bend: Bends) -> None:
    moments = (
        (round(DRIFT_START / DT) - 1, BLUE, f"after {DRIFT_START:g} s"),
        (-1, ORANGE, "at the end, friction grown by half"),
    )
    for row, color, label in moments:
        value, spread = bend.found.value[row], 2.0 * bend.found.deviation[row]
        axes.fill_between(
            CURVATURE_PLACES,
            value - spread,
            value + spread,
            color=color,
            alpha=0.25,
            linewidth=0,
        )
        axes.plot(CURVATURE_PLACES, value, color=color, label=f"estimate {label}")
        axes.plot(CURVATURE_PLACES, bend.truth[row], "k--", linewidth=1.0)
    axes.plot([], [], "k--", linewidth=1.0, label="truth")
    axes.axhline(bend.start, color=GREY, linewidth=0.9, label="start")
    axes.set(
        title="Friction over bend radius, two stated deviations",
        xlabel="position from the motor [m]",
        ylabel="mu/R [1/m]",
        ylim=(0.0, 2.4),
    )
    axes.legend(ncols=2, loc="upper center")
