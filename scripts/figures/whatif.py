"""Design charts of what-if studies: what a conduit, a pretension, a drum, a route cost.

    python scripts/figures/whatif.py loops cc_mujoco/design/whatif_loops.png

`loops` is Experiment 1b of the thesis as a design chart: the wrist handle's conduits
laid in up to three loops, with liners from slippery to dry. In `pretension` the wrist
handle renders a spring while the wearer swings it: pretension keeps cables from going
slack, and makes everything rub harder. In `ratio` the ankle exoskeleton helps a walking
wearer with drums and levers of many sizes, in `route` with its motor on a stand, on the
back or on the thigh, and with the conduit led in wide or tight bends; lengths and wraps
of routes but the first are assumed, for a wearer of 1.75 m. The controller knows the
cables of each design. Draws each metric and prints the numbers of the page.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from figure_paths import figure_path

from cc_mujoco import report
from cc_mujoco.design import study

Array = np.ndarray


class Chart(NamedTuple):
    """A study over two variables; each metric is drawn over the second one."""

    curves: str  # variable with a curve for each value
    values: Sequence[float]  # its values
    across: str  # the other one
    along: Sequence[Any]  # values of it, or names of designs
    metrics: dict[str, str]  # to titles
    study: dict[str, Any]  # other arguments of the study
    numbers: Callable[..., str]  # of the page, by a metric's values (curves, along)
    is_log: bool = False  # both axes
    mark: str = "o-"


def per_loops(backlash: Array) -> str:
    one, three = (LOOPS.index(n) for n in (1.0, 3.0))
    growth = backlash[:, three] / backlash[:, one]
    last = int(np.flatnonzero(np.isfinite(growth))[-1])
    return (
        f"backlash of three loops over that of one: {growth[0]:.1f} at friction "
        f"{LINERS[0]:g}, {growth[last]:.1f} at {LINERS[last]:g}"
    )


def per_reserve(reflected: Array, margin: Array) -> str:
    least = []
    for row in margin:
        above = max(int(np.argmax(row >= 1.0)), 1)
        part = slice(above - 1, above + 1)
        least.append(f"{np.interp(1.0, row[part], PRETENSION[part]):.1f} N")
    size = np.log(PRETENSION[5:])
    powers = np.polyfit(size, np.log(reflected[:, 5:]).T, 1)[0]
    return (
        f"pretension for a reserve of 1 N, by friction: {', '.join(least)}\nthe torque "
        f"felt goes with it to the power {min(powers):.2f} to {max(powers):.2f}"
    )


def per_ratio(torque: Array, power: Array, tension: Array, error: Array) -> str:
    gear = np.log(np.divide.outer(LEVER, DRUM))
    steep, lever = (
        np.polyfit(np.ravel(x), np.log(y).ravel(), 1)[0]
        for x, y in ((gear, torque), (np.log(LEVER), tension.mean(axis=1)))
    )
    return (
        f"peak motor torque goes with the ratio to the power {steep:.2f}, tension with "
        f"the lever to the power {lever:.2f}"
    )


def per_route(efficiency: Array, *others: Array) -> str:
    shown = zip(ROUTES, efficiency[1], strict=True)
    return "\n".join(f"efficiency {share:.0%}: {name!r}" for name, share in shown)


LOOPS = np.linspace(0.25, 3.0, 12).tolist()
LINERS = (0.015, 0.05, 0.1, 0.125)
PRETENSION = np.geomspace(1.0, 60.0, 14)
DRUM, LEVER = np.linspace(0.01, 0.05, 9), np.linspace(0.06, 0.18, 7)
ROUTES = {
    "stand,\nas in scene": (2.233, 4.10),
    "stand,\ntight bends": (2.233, 6.0),
    "back, past\nhip and knee": (0.95, 2.0),
    "back, around\nthe waist": (1.3, math.pi + 1.0),
    "thigh, past\nthe knee": (0.5, 0.8),
}
"""Lengths [m] and wraps [rad] of conduits from the motor to the shank."""
CHARTS = {
    "loops": Chart(
        "friction", LINERS, "loops", LOOPS, {"held_backlash": "Backlash [rad]"},
        {"scene": "wrist", "fixed": {"static_friction": 0.0}}, per_loops,
    ),
    "pretension": Chart(
        "friction", (0.015, 0.05, 0.1), "pretension", PRETENSION.tolist(),
        {
            "reflected_torque": "Felt unpowered, RMS [N m]",
            "slack_margin": "Least tension anywhere [N]",
        },
        {
            "scene": "wrist", "trajectory": "sine", "task": "spring", "duration": 6.0,
            "fixed": {"static_friction": 0.0, "loops": 1},
        },
        per_reserve, is_log=True,
    ),
    "ratio": Chart(
        "joint_radius", LEVER.tolist(), "motor_radius", DRUM.tolist(),
        {
            "peak_motor_torque": "Motor torque [N m]",
            "peak_motor_power": "Motor power [W]",
            "peak_tension": "Cable tension [N]",
            "rms_torque_error": "Torque error, RMS [N m]",
        },
        {"scene": "ankle", "duration": 5.0}, per_ratio,
    ),
    "route": Chart(
        "friction", (0.05, 0.1, 0.15), "conduit", list(ROUTES),
        {
            "efficiency": "Efficiency [1]",
            "peak_motor_power": "Peak motor power [W]",
            "rms_torque_error": "Torque error, RMS [N m]",
            "reflected_torque": "Felt unpowered, RMS [N m]",
        },
        {"scene": "ankle", "duration": 5.0}, per_route, mark="o",
    ),
}  # fmt: skip


LABELS = {
    "friction": "friction", "loops": "loops of the conduit", "conduit": "",
    "pretension": "pretension [N]", "joint_radius": "lever [m]",
    "motor_radius": "radius of the drum [m]",
}  # fmt: skip


def design(chart: Chart, value: float, along: Any) -> dict[str, Any]:
    if chart.across == "conduit":
        length, wrap = ROUTES[along]
        along = f"{length!r}:{length / wrap!r}"
    return {chart.curves: value, chart.across: along, **chart.study.get("fixed", {})}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("chart", choices=CHARTS)
    parser.add_argument("out", type=figure_path)
    given = parser.parse_args()
    chart = CHARTS[given.chart]
    how = {name: value for name, value in chart.study.items() if name != "fixed"}
    table = study(
        designs=[design(chart, v, a) for v in chart.values for a in chart.along],
        controllers=["model"], metrics=tuple(chart.metrics), **how,
    )  # fmt: skip
    found = [
        np.reshape(table[name].to_numpy(zero_copy_only=False), (len(chart.values), -1))
        for name in chart.metrics
    ]
    with report.style():
        rows, columns = (len(found) + 1) // 2, min(len(found), 2)
        drawing = report.figure(5.2 * columns, 3.6 * rows)
        panels = np.ravel(drawing.subplots(rows, columns))
        for axes, title, values in zip(
            panels, chart.metrics.values(), found, strict=True
        ):
            for value, row in zip(chart.values, values, strict=True):
                label = f"{LABELS[chart.curves]} {value:g}"
                axes.plot(chart.along, row, chart.mark, markersize=3, label=label)
            axes.set(title=title, xlabel=LABELS[chart.across])
            if chart.is_log:
                axes.loglog()
        panels[0].legend()
        report.save(given.out, drawing)
    print(chart.numbers(*found))


if __name__ == "__main__":
    main()
