"""Number of loops of the conduit: backlash against loops and friction.

    python scripts/figures/whatif_loops.py --out cc_mujoco/design/whatif_loops.png

Experiment 1b of the thesis as a design chart: the wrist handle's conduits laid in up to
three loops, with liners from slippery to dry. Draws the chart and prints its result.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from whatif_study import grid, studied

from cc_mujoco.report import BLACK, COLORS, TENSION_COLORS, figure, save, style

FRICTION = np.array([0.015, 0.03, 0.05, 0.075, 0.1, 0.125, 0.15])
LOOPS = np.linspace(0.25, 3.0, 12)
SHOWN = (0, 2, 4, 6)
LINES = (1.0, 2.0, 3.0, 5.0)  # contour lines of equal backlash [deg]


def main() -> None:
    table, out = studied(
        __doc__,
        "whatif_loops",
        FRICTION.size * LOOPS.size,
        scene="wrist",
        vary={"friction": FRICTION, "loops": LOOPS, "static_friction": 0.0},
        metrics=["held_backlash"],
    )
    width = grid(table, "held_backlash", FRICTION.size, LOOPS.size)
    backlash = np.degrees(width)
    draw(backlash, out)
    print(conclusion(backlash))


def draw(backlash: np.ndarray, out: Path) -> None:
    """Draw backlash [deg], (friction, loops)."""
    with style():
        drawing = figure(10.5, 4.2)
        curves, chart = drawing.subplots(1, 2)
        for k, color in zip(SHOWN, COLORS, strict=False):
            curves.plot(LOOPS, backlash[k], "o-", color=color, markersize=3,
                        label=f"friction {FRICTION[k]:g}")  # fmt: skip
        curves.set(
            title="Every loop costs backlash",
            xlabel="loops of the conduit",
            ylabel="backlash at the wrist [deg]",
            ylim=(0.0, None),
        )
        curves.legend()
        image = chart.pcolormesh(
            LOOPS, FRICTION, backlash, shading="gouraud", cmap=TENSION_COLORS
        )
        lines = chart.contour(LOOPS, FRICTION, backlash, LINES, colors="white")
        chart.clabel(lines, fmt=lambda value: f"{value:g} deg", fontsize=8)
        chart.plot(1.0, FRICTION[0], "o", color=BLACK, markersize=5, clip_on=False)
        chart.annotate("Experiment 1b,\none loop", (1.0, 0.015), (1.08, 0.021),
                       color="white", fontsize=8)  # fmt: skip
        if np.isnan(backlash[-1, -1]):
            chart.text(
                0.985, 0.975, "too little\ntorque arrives\nto tell", fontsize=7.5,
                ha="right", va="top", transform=chart.transAxes,
            )  # fmt: skip
        chart.grid(False)
        chart.set(
            title="Design chart: lines of equal backlash",
            xlabel="loops of the conduit",
            ylabel="friction of the liner",
        )
        drawing.colorbar(image, ax=chart, label="backlash [deg]")
        save(out, drawing)


def conclusion(backlash: np.ndarray) -> str:
    """Return three sentences, with numbers from the study."""
    one, three = (int(np.argmin(np.abs(LOOPS - n))) for n in (1.0, 3.0))
    low, high = 0, int(np.flatnonzero(np.isfinite(backlash[:, three]))[-1])
    allowed = [
        float(np.interp(2.0, row[np.isfinite(row)], LOOPS[np.isfinite(row)]))
        for row in backlash
    ]
    product = np.outer(FRICTION, LOOPS)
    level = (backlash > 1.0) & (backlash < 3.0)
    spread = np.std(backlash[level] / product[level]) / np.mean(
        backlash[level] / product[level]
    )
    return (
        f"Going from one loop to three multiplies backlash by "
        f"{backlash[low, three] / backlash[low, one]:.1f} at friction "
        f"{FRICTION[low]:g} and by {backlash[high, three] / backlash[high, one]:.1f} "
        f"at {FRICTION[high]:g}. For at most 2 deg the conduit may make "
        f"{allowed[2]:.1f} loops at friction {FRICTION[2]:g} and "
        f"{allowed[4]:.1f} at {FRICTION[4]:g}. "
        f"Between 1 and 3 deg backlash goes with friction times loops to within "
        f"{spread:.0%}, so a liner that halves friction buys twice the loops."
    )


if __name__ == "__main__":
    main()
