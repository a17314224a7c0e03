"""Tightness of the cables: pretension against transparency and slack.

    cd cc_mujoco/design
    python ../../scripts/figures/whatif_pretension.py --out whatif_pretension.png

The wrist handle renders a spring while the wearer swings it. Pretension keeps cables
from going slack, and makes everything rub harder. Draws both and prints the result.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from whatif_study import grid, studied

from cc_mujoco.report import COLORS, DASH_PATTERN, GREY, figure, save, set_ticks, style

FRICTION = (0.015, 0.05, 0.1)
PRETENSION = np.geomspace(1.0, 60.0, 14)
SHAPE = len(FRICTION), PRETENSION.size
RESERVE = 1.0  # least tension that is wanted anywhere [N]


def main() -> None:
    table, out = studied(
        __doc__,
        "whatif_pretension",
        len(FRICTION) * PRETENSION.size,
        scene="wrist",
        vary={
            "friction": FRICTION,
            "pretension": PRETENSION,
            "static_friction": 0.0,
            "loops": 1,
        },
        trajectory="sine",
        task="spring",
        duration=6.0,
        metrics=["reflected_torque", "slack_margin"],
    )
    reflected, margin = (
        grid(table, n, *SHAPE) for n in ("reflected_torque", "slack_margin")
    )
    least = [_least(row) for row in margin]
    draw(reflected, margin, least, out)
    print(conclusion(reflected, least))


def draw(
    reflected: np.ndarray, margin: np.ndarray, least: list[float], out: Path
) -> None:
    """Draw torque [N m] and tension [N], (friction, pretension)."""
    with style():
        drawing = figure(11.5, 4.0)
        feel, slack, both = drawing.subplots(1, 3)
        for k, color in enumerate(COLORS[: len(FRICTION)]):
            label = f"friction {FRICTION[k]:g}"
            feel.loglog(PRETENSION, reflected[k], "o-", color=color, markersize=3,
                        label=label)  # fmt: skip
            slack.semilogx(PRETENSION, margin[k], "o-", color=color, markersize=3)
            both.semilogx(reflected[k], margin[k], "o-", color=color, markersize=3)
            both.plot(_at(least[k], reflected[k]), RESERVE, "s", color=color)
        for axes in (slack, both):
            axes.axhline(RESERVE, color=GREY, dashes=DASH_PATTERN, linewidth=0.8)
            axes.set_yscale("symlog", linthresh=0.1)
            axes.set_ylim(-0.02, 80.0)
            axes.set_yticks([0, 0.1, 1, 10], ["slack", "0.1", "1", "10"])
        feel.set(title="Unpowered, it resists", xlabel="pretension [N]",
                 ylabel="reflected torque, RMS [N m]")  # fmt: skip
        feel.legend()
        slack.set(title="Powered, it goes slack", xlabel="pretension [N]",
                  ylabel="least tension anywhere [N]")  # fmt: skip
        both.set(title="The price of a reserve", xlabel="reflected torque, RMS [N m]",
                 ylabel="least tension anywhere [N]")  # fmt: skip
        both.text(
            0.98, RESERVE * 1.15, f"reserve of {RESERVE:g} N", color=GREY, fontsize=8,
            ha="right", transform=both.get_yaxis_transform(),
        )  # fmt: skip
        for axis in (feel.yaxis, both.xaxis):
            set_ticks(axis, (0.03, 0.1, 0.3, 1, 3))
        for axis in (feel.xaxis, slack.xaxis):
            set_ticks(axis, (1, 2, 5, 10, 20, 50))
        save(out, drawing)


def conclusion(reflected: np.ndarray, least: list[float]) -> str:
    """Return three sentences, with numbers from the study."""
    slope = [
        float(np.polyfit(np.log(PRETENSION[5:]), np.log(row[5:]), 1)[0])
        for row in reflected
    ]
    needed = ", ".join(
        f"{n:.1f} N at friction {f:g}" for n, f in zip(least, FRICTION, strict=True)
    )
    price = [_at(n, row) for n, row in zip(least, reflected, strict=True)]
    return (
        f"A reserve of {RESERVE:g} N everywhere needs a pretension of {needed}. "
        f"The torque that the wearer feels grows with pretension to the power "
        f"{min(slope):.2f} to {max(slope):.2f}, so every newton beyond that is paid "
        f"for. At the least pretension that will do, the device resists with "
        f"{price[0]:.2f} N m at friction {FRICTION[0]:g} and {price[-1]:.2f} N m at "
        f"{FRICTION[-1]:g}: a better liner buys transparency twice, by rubbing less "
        "and by needing less tension."
    )


def _least(margin: np.ndarray) -> float:
    """Return the interpolated least pretension with the reserve [N]."""
    above = int(np.argmax(margin >= RESERVE))
    if above == 0:
        return float(PRETENSION[0])
    part = slice(above - 1, above + 1)
    return float(np.interp(RESERVE, margin[part], PRETENSION[part]))


def _at(pretension: float, row: np.ndarray) -> float:
    return float(np.interp(pretension, PRETENSION, row))


if __name__ == "__main__":
    main()
