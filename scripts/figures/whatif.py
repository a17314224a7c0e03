"""Design charts of what-if studies: what a conduit, a pretension, a drum, a route cost.

    python scripts/figures/whatif.py loops --out cc_mujoco/design/whatif_loops.png
    python scripts/figures/whatif.py pretension
    python scripts/figures/whatif.py ratio
    python scripts/figures/whatif.py route

`loops` is Experiment 1b of the thesis as a design chart: the wrist handle's conduits
laid in up to three loops, with liners from slippery to dry. In `pretension` the wrist
handle renders a spring while the wearer swings it: pretension keeps cables from going
slack, and makes everything rub harder. In `ratio` the ankle exoskeleton helps a walking
wearer with drums and levers of many sizes, in `route` with its motor on a stand, on the
back or on the thigh, and with the conduit led in wide or tight bends. The controller
knows the cables of each design. Each draws a chart and prints its numbers.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from scipy.stats import spearmanr
from tqdm import tqdm

from cc_mujoco import report
from cc_mujoco._utils.command_options import progress_options
from cc_mujoco.design import StudySpec, episodes, make_plan, study
from cc_mujoco.device import Plant, load_device
from cc_mujoco.simulation import attended
from cc_mujoco.simulation._rollout import play

Array = np.ndarray
Study = Callable[..., pa.Table]


def grid(table: pa.Table, name: str, *shape: int) -> Array:
    """Return a metric of a study as an array over its variables."""
    return np.array(table[name].to_numpy(zero_copy_only=False)).reshape(shape)


LINERS = np.array([0.015, 0.03, 0.05, 0.075, 0.1, 0.125, 0.15])
LOOPS = np.linspace(0.25, 3.0, 12)


def loops(studied: Study, out: Path) -> str:
    """Draw backlash against number of loops and friction; return the numbers."""
    table = studied(
        scene="wrist",
        vary={"friction": LINERS, "loops": LOOPS, "static_friction": 0.0},
        metrics=["held_backlash"],
    )
    backlash = np.degrees(grid(table, "held_backlash", LINERS.size, LOOPS.size))
    drawing = report.figure(10.5, 4.2)
    curves, chart = drawing.subplots(1, 2)
    for k, color in zip((0, 2, 4, 6), report.COLORS, strict=False):
        curves.plot(LOOPS, backlash[k], "o-", color=color, markersize=3,
                    label=f"friction {LINERS[k]:g}")  # fmt: skip
    curves.set(
        title="Every loop costs backlash",
        xlabel="loops of the conduit",
        ylabel="backlash at the wrist [deg]",
        ylim=(0.0, None),
    )
    curves.legend()
    image = chart.pcolormesh(
        LOOPS, LINERS, backlash, shading="gouraud", cmap=report.TENSION_COLORS
    )
    lines = chart.contour(LOOPS, LINERS, backlash, (1, 2, 3, 5), colors="white")
    chart.clabel(lines, fmt=lambda value: f"{value:g} deg", fontsize=8)
    chart.plot(1.0, LINERS[0], "o", color=report.BLACK, markersize=5, clip_on=False)
    chart.annotate("Experiment 1b,\none loop", (1.0, 0.015), (1.08, 0.021),
                   color="white", fontsize=8)  # fmt: skip
    chart.grid(False)
    chart.set(
        title="Design chart: lines of equal backlash (white: too little torque)",
        xlabel="loops of the conduit",
        ylabel="friction of the liner",
    )
    drawing.colorbar(image, ax=chart, label="backlash [deg]")
    report.save(out, drawing)
    one, three = (int(np.argmin(np.abs(LOOPS - n))) for n in (1.0, 3.0))
    high = int(np.flatnonzero(np.isfinite(backlash[:, three]))[-1])
    growth = backlash[:, three] / backlash[:, one]
    level = (backlash > 1.0) & (backlash < 3.0)
    share = backlash[level] / np.outer(LINERS, LOOPS)[level]
    allowed = {
        f"{mu:g}": round(float(np.interp(2.0, row[seen], LOOPS[seen])), 1)
        for mu, row in zip(LINERS, backlash, strict=True)
        if (seen := np.isfinite(row)).any()
    }
    return (
        f"backlash of three loops over that of one: {growth[0]:.1f} at friction "
        f"{LINERS[0]:g}, {growth[high]:.1f} at {LINERS[high]:g}\n"
        f"loops with 2 deg of backlash, by friction: {allowed}\n"
        "between 1 and 3 deg backlash goes with friction times loops within "
        f"{np.std(share) / np.mean(share):.0%}"
    )


FRICTION = (0.015, 0.05, 0.1)
PRETENSION = np.geomspace(1.0, 60.0, 14)
RESERVE = 1.0  # least tension that is wanted anywhere [N]


def pretension(studied: Study, out: Path) -> str:
    """Draw transparency and slack against pretension; return the numbers."""
    table = studied(
        scene="wrist",
        vary={
            "friction": FRICTION, "pretension": PRETENSION, "static_friction": 0.0,
            "loops": 1,
        },
        trajectory="sine", task="spring", duration=6.0,
        metrics=["reflected_torque", "slack_margin"],
    )  # fmt: skip
    reflected, margin = (
        grid(table, name, len(FRICTION), PRETENSION.size)
        for name in ("reflected_torque", "slack_margin")
    )
    least = []
    for row in margin:
        above = max(int(np.argmax(row >= RESERVE)), 1)
        part = slice(above - 1, above + 1)
        least.append(float(np.interp(RESERVE, row[part], PRETENSION[part])))
    price = [
        float(np.interp(n, PRETENSION, row))
        for n, row in zip(least, reflected, strict=True)
    ]
    drawing = report.figure(11.5, 4.0)
    unpowered, slack, both = drawing.subplots(1, 3)
    for k, color in enumerate(report.COLORS[: len(FRICTION)]):
        looks = {"color": color, "markersize": 3}
        label = f"friction {FRICTION[k]:g}"
        unpowered.loglog(PRETENSION, reflected[k], "o-", label=label, **looks)
        slack.semilogx(PRETENSION, margin[k], "o-", **looks)
        both.semilogx(reflected[k], margin[k], "o-", **looks)
        both.plot(price[k], RESERVE, "s", color=color)
    for axes in (slack, both):
        axes.axhline(
            RESERVE, color=report.GREY, dashes=report.DASH_PATTERN, linewidth=0.8
        )
        axes.set_yscale("symlog", linthresh=0.1)
        axes.set_ylim(-0.02, 80.0)
        axes.set_yticks([0, 0.1, 1, 10], ["slack", "0.1", "1", "10"])
        axes.set_ylabel("least tension anywhere [N]")
    torque = "reflected torque, RMS [N m]"
    unpowered.set(title="Unpowered, it resists", xlabel="pretension [N]", ylabel=torque)
    unpowered.legend()
    slack.set(title="Powered, it goes slack", xlabel="pretension [N]")
    both.set(title=f"The price of a reserve of {RESERVE:g} N", xlabel=torque)
    for axis in (unpowered.yaxis, both.xaxis):
        report.set_ticks(axis, (0.03, 0.1, 0.3, 1, 3))
    for axis in (unpowered.xaxis, slack.xaxis):
        report.set_ticks(axis, (1, 2, 5, 10, 20, 50))
    report.save(out, drawing)
    slopes = [
        np.polyfit(np.log(PRETENSION[5:]), np.log(row[5:]), 1)[0] for row in reflected
    ]
    needed = ", ".join(
        f"{n:.1f} N at friction {mu:g} ({torque:.2f} N m felt)"
        for n, mu, torque in zip(least, FRICTION, price, strict=True)
    )
    return (
        f"pretension for a reserve of {RESERVE:g} N: {needed}\nthe torque felt goes "
        f"with pretension to the power {min(slopes):.2f} to {max(slopes):.2f}"
    )


DRUM = np.linspace(0.01, 0.05, 9)
LEVER = np.linspace(0.06, 0.18, 7)
RATIO_PANELS = {
    "peak_motor_torque": "Motor torque [N m]",
    "peak_motor_power": "Motor power [W]",
    "peak_tension": "Cable tension [N]",
    "rms_torque_error": "Torque error, RMS [N m]",
}
WALK: dict[str, Any] = {"duration": 5.0, "metrics": tuple(RATIO_PANELS)}


def ratio(studied: Study, out: Path) -> str:
    """Draw motor torque and power against drum and lever radius; return the numbers."""
    vary = {"joint_radius": LEVER, "motor_radius": DRUM}
    table = studied(scene="ankle", vary=vary, **WALK)
    found = [grid(table, name, LEVER.size, DRUM.size) for name in RATIO_PANELS]
    drawing = report.figure(10.0, 7.4)
    panels = drawing.subplots(2, 2).ravel()
    for axes, values, title in zip(panels, found, RATIO_PANELS.values(), strict=True):
        image = axes.pcolormesh(
            1e3 * DRUM,
            1e3 * LEVER,
            values,
            shading="nearest",
            cmap=report.TENSION_COLORS,
        )
        for gear in (2, 3, 5, 10):
            x = np.array([9.0, 53.0])
            axes.plot(x, gear * x, color="white", linewidth=0.7)
            at = min(50.0, 184.0 / gear)
            axes.text(at, gear * at, f"{gear}", color="white", fontsize=8,
                      ha="right", va="bottom")  # fmt: skip
        axes.plot(25.0, 120.0, "o", color=report.BLACK, markersize=4)
        axes.grid(False)
        axes.set(title=title, xlabel="radius of the drum [mm]",
                 ylabel="lever at the heel [mm]", xlim=(7.5, 52.5),
                 ylim=(50.0, 190.0))  # fmt: skip
        drawing.colorbar(image, ax=axes)
    drawing.suptitle(
        "Ankle assistance: lines of equal ratio; the dot is the scene", x=0.012,
        ha="left", fontsize=11,
    )  # fmt: skip
    report.save(out, drawing)
    torque, power, tension, error = found
    gear = LEVER[:, None] / DRUM
    steep = np.polyfit(np.log(gear).ravel(), np.log(torque).ravel(), 1)[0]
    lever = np.polyfit(np.log(LEVER), np.log(tension.mean(axis=1)), 1)[0]
    alike = spearmanr(gear.ravel(), power.ravel()).statistic
    most = np.unravel_index(np.argmax(power), power.shape)
    exact = np.unravel_index(np.argmin(error), error.shape)
    races = racing(LEVER[most[0]], DRUM[most[1]])

    def sizes(place: Any) -> str:
        drum, arm = 1e3 * DRUM[place[1]], 1e3 * LEVER[place[0]]
        return f"drum {drum:.0f} mm, lever {arm:.0f} mm"

    return (
        f"peak motor torque goes with the ratio to the power {steep:.2f}, tension with "
        f"the lever to the power {lever:.2f}\nrank correlation of peak motor power and "
        f"ratio {alike:.2f}; most {power[most]:.0f} W ({sizes(most)}), where the drum "
        f"takes up slack in {races:.0%} of the time above half of it\n"
        f"least torque error {error[exact]:.2f} N m ({sizes(exact)})"
    )


def racing(lever: float, drum: float) -> float:
    """Return the share of time above half the peak power with a slack cable."""
    design = {"joint_radius": float(lever), "motor_radius": float(drum)}
    plan = make_plan(StudySpec("ankle", designs=[design], **WALK))
    device = load_device("ankle")
    ((_, _, episode),) = episodes(plan.protocol)
    columns = play(episode, [attended(Plant(device, design))]).columns
    power = columns["motor_torque_nm"][0] * columns["motor_velocity_rad_s"][0]
    slack = columns["least_tension_n"][0, 0] <= 0.0
    return float(np.mean(slack[power > 0.5 * power.max()]))


class Route(NamedTuple):
    """A conduit from the motor to the shank."""

    name: str
    length: float  # length of the conduit [m]
    wrap: float  # wrap of the conduit [rad]


ROUTES = (
    Route("stand, as in the scene", 2.233, 4.10),
    Route("stand, tight bends", 2.233, 6.0),
    Route("back, past hip and knee", 0.95, 2.0),
    Route("back, around the waist", 1.3, math.pi + 1.0),
    Route("thigh, past the knee", 0.5, 0.8),
)
"""Lengths and wraps but the first are assumed, for a wearer of 1.75 m."""
ROUTE_FRICTION = (0.05, 0.1, 0.15)
ROUTE_PANELS = {
    "efficiency": "Efficiency [1]",
    "peak_motor_power": "Peak motor power [W]",
    "rms_torque_error": "Torque error, RMS [N m]",
    "reflected_torque": "Felt unpowered, RMS [N m]",
}


def route(studied: Study, out: Path) -> str:
    """Draw a bar per route at the middle friction, and a line to the others."""
    designs = [
        {"conduit": f"{r.length!r}:{r.length / r.wrap!r}", "friction": friction}
        for r in ROUTES
        for friction in ROUTE_FRICTION
    ]
    table = studied(
        scene="ankle", designs=designs, duration=5.0, metrics=tuple(ROUTE_PANELS)
    )
    shape = len(ROUTES), len(ROUTE_FRICTION)
    found = {name: grid(table, name, *shape) for name in ROUTE_PANELS}
    drawing = report.figure(13.0, 3.6)
    panels = drawing.subplots(1, len(found), sharey=True)
    places = np.arange(len(ROUTES))
    least, usual, most = (f"friction {friction:g}" for friction in ROUTE_FRICTION)
    for axes, values, title in zip(
        panels, found.values(), ROUTE_PANELS.values(), strict=True
    ):
        low, middle, high = values.T
        axes.barh(places, middle, color=report.BLUE, height=0.6)
        axes.hlines(places, low, high, color=report.GREY, linewidth=1.2)
        axes.plot(low, places, "|", color=report.ORANGE, markersize=9, label=least)
        axes.plot(high, places, "x", color=report.ORANGE, markersize=6, label=most)
        axes.set(title=title, xlim=(0.0, None))
        axes.grid(False, axis="y")
    labels = [f"{r.name}\n{r.length:.2g} m, {r.wrap:.2g} rad" for r in ROUTES]
    panels[0].set_yticks(places, labels, fontsize=8)
    panels[0].invert_yaxis()
    handles = panels[0].get_legend_handles_labels()
    drawing.legend(*handles, loc="outside upper right", ncols=2, fontsize=8)
    drawing.suptitle(f"Bars: {usual}", x=0.012, ha="left")
    report.save(out, drawing)
    return "\n".join(
        f"{r.name}, friction {friction:g}: "
        + ", ".join(f"{name} {values[row, k]:.3g}" for name, values in found.items())
        for row, r in enumerate(ROUTES)
        for k, friction in enumerate(ROUTE_FRICTION)
    )


CHARTS = {"loops": loops, "pretension": pretension, "ratio": ratio, "route": route}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("chart", choices=CHARTS)
    parser.add_argument("--out", type=report.figure_path, help="runs/whatif_CHART.png")
    parser.add_argument("--threads", type=int, default=0)
    given = parser.parse_args()
    out = given.out or Path("runs", f"whatif_{given.chart}.png")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tqdm(unit="design", **progress_options()) as bar, report.style():

        def studied(**how: Any) -> pa.Table:
            return study(
                controllers=["model"],
                **how,
                threads=given.threads,
                progress=lambda done: bar.update(done - bar.n),
            )

        numbers = CHARTS[given.chart](studied, out)
    print(numbers)


if __name__ == "__main__":
    main()
