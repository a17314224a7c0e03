"""Draw a picture of every example, beside it.

python scripts/figures/draw_examples.py [NAME ...]
"""

from __future__ import annotations

import argparse
import io
import os
import runpy
import tempfile
from pathlib import Path

import matplotlib
from matplotlib import pyplot, rc_context
from matplotlib.figure import Figure
from PIL import Image

matplotlib.use("agg")

STYLE = {
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "figure.dpi": 100,
    "figure.figsize": (4.8, 2.7),
    "legend.fontsize": "small",
    "legend.frameon": False,
    "savefig.dpi": "figure",
}
"""Style of the pictures."""
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NAMES = sorted({path.stem for path in EXAMPLES.glob("*.py")} - {"knee_trials"})
"""Examples that draw."""


def drawn(name: str) -> Figure:
    pyplot.close("all")
    before = Path.cwd()
    with rc_context(STYLE), tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        finally:
            os.chdir(before)
        return pyplot.gcf()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help=", ".join(NAMES))
    for name in parser.parse_args().names or NAMES:
        path, file = EXAMPLES / f"{name}.webp", io.BytesIO()
        drawn(name).savefig(file, format="png")
        Image.open(file).convert("RGB").save(path, quality=80, method=6)
        print(f"wrote {path}")


if __name__ == "__main__":
    main()
