"""Where does the model stop being better? Error against what is wrong, as curves.

    python scripts/figures/study_robustness.py --out runs/robustness

Wrist handle, sine, virtual spring. One thing is made worse at a time: friction of the
model, too low and too high, up to 50 %; noise of all sensors; delay of all sensors. The
rest is as in the benchmark, without its random errors of the models. Writes a figure,
the data, and prints from where on each controller is no better than `pi`.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from tqdm import tqdm

from cc_mujoco.benchmark import Cell, interval, play
from cc_mujoco.benchmark.mismatch import Mismatch
from cc_mujoco.devices import DEVICES
from cc_mujoco.errors import CableError
from cc_mujoco.figures import COLORS, GREY, figure, is_ours, mark, save, style
from cc_mujoco.files import replacing, require_ours

TABLE, PICTURE = "robustness.csv", "robustness.png"

LAWS = ("pi", "model", "stiction", "adaptive")
SWEEPS = {
    "friction": (-0.5, -0.3, -0.15, 0.0, 0.15, 0.3, 0.5),
    "noise": (0.0, 1.0, 3.0, 10.0, 30.0),
    "delay": (0, 1, 2, 4, 8),
}
"""What is made worse: relative error, multiple of the benchmark's noise, steps."""
LABELS = {
    "friction": "error of the model's friction [%]",
    "noise": "noise, multiple of the benchmark's",
    "delay": "delay of the sensors [ms]",
}


def cell(sweep: str, value: float, law: str, seeds: int, duration: float) -> Cell:
    """The cell in which one thing is worse."""
    sensing = DEVICES["wrist"].sensing
    bias = 0.0
    if sweep == "friction":
        bias = value
    elif sweep == "noise":
        sensing = dataclasses.replace(
            sensing,
            torque_noise=value * sensing.torque_noise,
            tension_noise=value * sensing.tension_noise,
            motor_steps=sensing.motor_steps / value if value else 0.0,
            joint_steps=sensing.joint_steps / value if value else 0.0,
        )
    else:
        sensing = dataclasses.replace(sensing, delay=int(value))
    wrong = Mismatch(0.0, 0.0, 0.0, bias)
    return Cell(
        "wrist", law, "sine", "spring", tuple(range(seeds)), duration, wrong, sensing
    )


def error(one: Cell) -> np.ndarray[Any, Any]:
    """RMS errors of a cell (seeds,) [Nm]."""
    return play(one).scores["rms_error"]


def crossing(values: Sequence[float], ratio: Sequence[float]) -> float:
    """Least value, away from the best, from which on a ratio is 1 or more."""
    for (v0, r0), (v1, r1) in zip(
        zip(values, ratio, strict=True),
        zip(values[1:], ratio[1:], strict=True),
        strict=False,
    ):
        if r0 < 1.0 <= r1 or not math.isfinite(r1):
            if not math.isfinite(r1):
                return v1
            return v0 + (v1 - v0) * (1.0 - r0) / (r1 - r0)
    return math.inf


def main() -> None:
    """Play all, draw, and say where the curves cross."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=3.5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs", "robustness"))
    arguments = parser.parse_args()
    try:
        files = (TABLE, PICTURE)
        require_ours(arguments.out, files, lambda out: is_ours(out / PICTURE))
    except CableError as error:
        parser.error(str(error))
    arguments.out.mkdir(parents=True, exist_ok=True)
    keys = [(s, v, law) for s, vs in SWEEPS.items() for v in vs for law in LAWS]
    cells = [cell(*key, arguments.seeds, arguments.duration) for key in keys]
    with ProcessPoolExecutor(arguments.workers, get_context("spawn")) as pool:
        found = list(tqdm(pool.map(error, cells), total=len(cells), unit="cell"))
    errors = dict(zip(keys, found, strict=True))
    table = {
        "sweep": [k[0] for k in keys],
        "value": [float(k[1]) for k in keys],
        "controller": [k[2] for k in keys],
        "rms_error_nm": [interval(e).mean for e in found],
        "half_interval_nm": [interval(e).half for e in found],
    }
    with replacing(arguments.out / TABLE) as partial:
        pa_csv.write_csv(pa.table(table), partial)
    draw(arguments.out / PICTURE, errors)
    for sweep, values in SWEEPS.items():
        for law in LAWS[1:]:
            says(sweep, values, law, errors)


def says(sweep: str, values: Sequence[float], law: str, errors: Any) -> None:
    """Print where a controller stops being better than `pi`."""
    ratio = [
        interval(errors[sweep, v, law]).mean / interval(errors[sweep, v, "pi"]).mean
        for v in values
    ]
    sides = [(values, ratio)]
    if sweep == "friction":
        middle = values.index(0.0)
        low = (
            [-v for v in values[middle::-1]],
            ratio[middle::-1],
        )
        sides = [low, (values[middle:], ratio[middle:])]
    for side, (at, ratios) in enumerate(sides):
        sign = "-" if sweep == "friction" and side == 0 else ""
        limit = crossing(at, ratios)
        worst = f"{sign}{max(at):g}"
        if math.isfinite(limit):
            text = f"no better than pi from {sign}{limit:.3g} on"
        else:
            text = (
                f"better than pi up to {worst} (error {ratios[-1]:.2f} of pi's there)"
            )
        print(f"{sweep:9} {law:12} {text}")


def draw(path: Path, errors: Any) -> None:
    """Three panels, a curve per controller."""
    with style():
        drawing = figure(11.0, 3.9)
        panels = drawing.subplots(1, 3, sharey=True)
        for axes, (sweep, values) in zip(panels, SWEEPS.items(), strict=True):
            scale = 100.0 if sweep == "friction" else 1.0
            at = scale * np.array(values, dtype=float)
            for law, color in zip(LAWS, (GREY, *COLORS), strict=False):
                stats = [interval(errors[sweep, v, law]) for v in values]
                mean = np.array([s.mean for s in stats])
                half = np.nan_to_num([s.half for s in stats])
                axes.plot(at, mean, "o-", color=color, markersize=3, label=law)
                low = np.maximum(mean - half, 1e-3)
                axes.fill_between(at, low, mean + half, color=color, alpha=0.15, lw=0)
            axes.set(xlabel=LABELS[sweep], yscale="log")
            if sweep == "noise":
                axes.set_xscale("symlog", linthresh=1.0)
                mark(axes.xaxis, values)
        panels[0].set(ylabel="RMS error [Nm]", title="Friction of the model")
        panels[1].set(title="Noise")
        panels[2].set(title="Delay")
        panels[2].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        save(path, drawing)


if __name__ == "__main__":
    main()
