"""Learning of policies: return against steps, every seed of each training.

    python scripts/figures/learning_curves.py runs/ppo runs/fixed --out curves.png

Draws the curves that `scripts/train_policy.py` left in these folders, and prints what
is reached at the end: mean over seeds, least and most.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cc_mujoco.report import COLORS, figure, save, style


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    with style():
        drawing = figure(7.0, 3.6)
        axes = drawing.add_subplot()
        for folder, color in zip(options.folders, COLORS, strict=False):
            paths, ends = sorted(folder.glob("*.csv")), []
            if not paths:
                parser.error(f"{folder} has no learning curve (*.csv).")
            for path in paths:
                steps, _, returns = np.loadtxt(path, delimiter=",", skiprows=1).T
                label = folder.name if path == paths[0] else None
                axes.plot(1e-3 * steps, returns, color=color, lw=1.2, label=label)
                ends.append(float(returns[-1]))
            print(
                f"{folder.name}: {len(ends)} seeds, {np.mean(ends):.3f} "
                f"({min(ends):.3f} to {max(ends):.3f}) per second"
            )
        axes.set(xlabel="steps of 5 ms [thousand]", ylabel="return per second")
        axes.legend(loc="lower right")
        save(options.out, drawing)


if __name__ == "__main__":
    main()
