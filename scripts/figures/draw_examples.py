"""Draw a picture of every example, beside it.

python scripts/figures/draw_examples.py [NAME ...]
"""

from __future__ import annotations

import argparse
import io
import runpy
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NAMES = (
    "cable_in_mjcf",
    "tendon_friction",
    "own_exoskeleton",
    "own_environment",
    "own_controller",
    "own_task",
    "own_metric",
    "own_effect",
    "what_if",
    "search",
    "diagnose_csv",
    "play_policy",
    "train_ppo",
    "rig_in_the_loop",
)
"""The examples, in the order of their page."""


def draw(curves: tuple[str, str, dict[str, Any]]) -> Image.Image:
    """Return a picture of what an example gives: names of both axes, and curves.

    A name that begins with `o` or `x` and a space has marks instead of a line.
    """
    across, up, lines = curves
    figure = Figure(figsize=(4.8, 2.7), dpi=100, layout="constrained")
    axes = figure.subplots()
    for name, (x, y) in lines.items():
        mark, _, rest = name.partition(" ")
        points = mark if rest and mark in ("o", "x") else ""
        axes.plot(x, y, points or "-", label=rest if points else name)
    axes.set(xlabel=across, ylabel=up)
    axes.legend(fontsize="small", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return Image.open(file).convert("RGB")


def curves_of(name: str, **given: Any) -> tuple[str, str, dict[str, Any]]:
    """Run an example and return what is drawn of it."""
    found = runpy.run_path(str(EXAMPLES / f"{name}.py"))["run"](**given)
    return found if len(found) == 3 else found[1]


def main() -> None:
    """Draw all, or those that are named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help=", ".join(NAMES))
    for name in parser.parse_args().names or NAMES:
        path = EXAMPLES / f"{name}.webp"
        draw(curves_of(name)).save(path, quality=80, method=6)
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
