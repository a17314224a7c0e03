"""Course of the conduit: routes of the ankle's cable against what arrives.

    python scripts/figures/whatif_route.py --out cc_mujoco/design/whatif_route.png

The ankle exoskeleton helps a walking wearer with its motor on a stand, on the back or
on the thigh, and with the conduit led in wide or tight bends. Draws what each route
costs and prints the result.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from whatif_study import grid, studied

from cc_mujoco.report import BLUE, GREY, ORANGE, figure, save, style


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
FRICTION = (0.05, 0.1, 0.15)
SHAPE = len(ROUTES), len(FRICTION)
PANELS = {
    "efficiency": "Efficiency [1]",
    "peak_motor_power": "Peak motor power [W]",
    "rms_torque_error": "Torque error, RMS [N m]",
    "reflected_torque": "Felt unpowered, RMS [N m]",
}


def main() -> None:
    designs = [
        {"conduit": f"{r.length!r}:{r.length / r.wrap!r}", "friction": friction}
        for r in ROUTES
        for friction in FRICTION
    ]
    table, out = studied(
        __doc__, "whatif_route", len(designs), scene="ankle", designs=designs,
        duration=5.0, metrics=tuple(PANELS),
    )  # fmt: skip
    draw(table, out)
    print(conclusion(table))


def draw(table: pa.Table, out: Path) -> None:
    """Draw a bar per route at the middle friction, and a line to the others."""
    with style():
        drawing = figure(13.0, 3.6)
        panels = drawing.subplots(1, len(PANELS), sharey=True)
        places = np.arange(len(ROUTES))
        for axes, (name, title) in zip(panels, PANELS.items(), strict=True):
            low, middle, high = grid(table, name, *SHAPE).T
            axes.barh(places, middle, color=BLUE, height=0.6)
            axes.hlines(places, low, high, color=GREY, linewidth=1.2)
            axes.plot(low, places, "|", color=ORANGE, markersize=9,
                      label=f"friction {FRICTION[0]:g}")  # fmt: skip
            axes.plot(high, places, "x", color=ORANGE, markersize=6,
                      label=f"friction {FRICTION[2]:g}")  # fmt: skip
            axes.set(title=title, xlim=(0.0, None))
            axes.grid(False, axis="y")
        labels = [f"{r.name}\n{r.length:.2g} m, {r.wrap:.2g} rad" for r in ROUTES]
        panels[0].set_yticks(places, labels, fontsize=8)
        panels[0].invert_yaxis()
        handles = panels[0].get_legend_handles_labels()
        drawing.legend(*handles, loc="outside upper right", ncols=2, fontsize=8)
        drawing.suptitle(f"Bars: friction {FRICTION[1]:g}", x=0.012, ha="left")
        save(out, drawing)


def conclusion(table: pa.Table) -> str:
    """Return three sentences, with numbers from the study."""
    share, power, error, felt = (grid(table, name, *SHAPE) for name in PANELS)
    tight, thigh = 1, len(ROUTES) - 1
    return (
        f"With the motor on the thigh instead of a stand the conduit wraps "
        f"{ROUTES[thigh].wrap:.1f} instead of {ROUTES[0].wrap:.1f} rad: at friction "
        f"{FRICTION[1]:g} efficiency rises from {share[0, 1]:.0%} to "
        f"{share[thigh, 1]:.0%}, peak motor power goes from {power[0, 1]:.0f} to "
        f"{power[thigh, 1]:.0f} W and the torque error from {error[0, 1]:.1f} to "
        f"{error[thigh, 1]:.1f} N m. Tight bends on the way from the stand bring "
        f"efficiency down to {share[tight, 1]:.0%}, and a liner of friction "
        f"{FRICTION[2]:g} instead of {FRICTION[0]:g} from {share[0, 0]:.0%} to "
        f"{share[0, 2]:.0%}, but on the thigh only from {share[thigh, 0]:.0%} to "
        f"{share[thigh, 2]:.0%}. What is felt unpowered says little of the route, "
        f"{felt[:, 1].min():.2f} to {felt[:, 1].max():.2f} N m at friction "
        f"{FRICTION[1]:g}, for a shorter cable rubs less and is stiffer."
    )


if __name__ == "__main__":
    main()
