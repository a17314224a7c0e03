"""Tables of the benchmark: means over seeds with intervals, differences in pairs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark.cell import Cell, CellResult
from cc_mujoco.benchmark.scores import SCORES
from cc_mujoco.markdown import table

BASELINE = "pi"
"""The controller that all others are compared with, seed by seed."""
CONFIDENCE = 0.95
OVERVIEW = (
    "RMS error [Nm], mean over trajectories, tasks and seeds, "
    "± half of the 95 % interval over seeds:"
)
"""Of `overview_table`."""

Results = Sequence[tuple[Cell, CellResult]]


class Interval(NamedTuple):
    """Mean and half the width of its confidence interval; NaN where there is none."""

    mean: float
    half: float
    known: int = 0
    """Seeds that it is of."""
    seeds: int = 0
    """All seeds."""

    def __str__(self) -> str:
        """Mean and half width to the digits that count; seeds, if some are missing."""
        if math.isnan(self.mean):
            return "-"
        if math.isnan(self.half) or self.half < 1e-9:
            text = f"{self.mean:.3g}"
        else:
            digits = max(0, 1 - math.floor(math.log10(self.half)))
            text = f"{self.mean:.{digits}f} ± {self.half:.{digits}f}"
        return (
            f"{text} ({self.known} of {self.seeds})"
            if self.known < self.seeds
            else text
        )


def interval(values: NDArray[np.float64]) -> Interval:
    """Mean over seeds with its 95 % interval (Student), without NaN."""
    from scipy.stats import t as student

    seeds, values = values.size, values[np.isfinite(values)]
    if values.size == 0:
        return Interval(math.nan, math.nan, 0, seeds)
    mean = float(np.mean(values))
    if values.size == 1:
        return Interval(mean, math.nan, 1, seeds)
    spread = float(np.std(values, ddof=1)) / math.sqrt(values.size)
    factor = float(student.ppf(0.5 + CONFIDENCE / 2.0, values.size - 1))
    return Interval(mean, factor * spread, values.size, seeds)


def over_conditions(
    results: Results, scene: str, controller: str, score: str
) -> NDArray[np.float64]:
    """A score of every seed, mean over trajectories and tasks (seeds,).

    Those in which no controller has the score do not count. In the others a seed
    without it has no mean: an episode that diverged must not make the mean better.
    """
    rows = {
        (cell.controller, cell.trajectory, cell.task): played.scores[score]
        for cell, played in results
        if cell.scene == scene
    }
    telling = {key[1:] for key, values in rows.items() if np.isfinite(values).any()}
    own = {key[1:]: values for key, values in rows.items() if key[0] == controller}
    counted = [own[play] for play in own if play in telling] or list(own.values())
    mean: NDArray[np.float64] = np.mean(counted, axis=0)
    return mean


def markdown(results: Results) -> str:
    """All tables as Markdown."""
    parts = ["# Benchmark of torque controllers", OVERVIEW, overview_table(results)]
    for scene in dict.fromkeys(cell.scene for cell, _ in results):
        parts += [
            f"## {scene}",
            "RMS error [Nm], mean over seeds ± half of the 95 % interval:",
            errors_table(results, scene),
            f"RMS error less that of `{BASELINE}` in the same seeds [Nm]:",
            errors_table(results, scene, paired=True),
            "All scores, mean over trajectories and tasks:",
            scores_table(results, scene),
        ]
    parts.append(definitions())
    return "\n\n".join(part for part in parts if part) + "\n"


def definitions() -> str:
    """What every score is, as a list."""
    return "\n".join(f"- `{s.name}` [{s.unit}]: {s.meaning}" for s in SCORES)


def overview_table(results: Results) -> str:
    """RMS error of every controller and scene, paired difference, share of failures."""
    scenes = list(dict.fromkeys(cell.scene for cell, _ in results))
    laws = dict.fromkeys(cell.controller for cell, _ in results)
    played = {(cell.scene, cell.controller) for cell, _ in results}
    head, rows = ["controller"], [[f"`{law}`"] for law in laws]
    for scene in scenes:
        head += [scene, f"{scene}, less `{BASELINE}`", f"{scene}, failed"]
        for law, row in zip(laws, rows, strict=True):
            if (scene, law) not in played:
                row += ["-", "-", "-"]
                continue
            values = over_conditions(results, scene, law, "rms_error")
            row.append(str(interval(values)))
            if law == BASELINE or (scene, BASELINE) not in played:
                row.append("-")
            else:
                base = over_conditions(results, scene, BASELINE, "rms_error")
                row.append(str(interval(values - base)))
            failed = over_conditions(results, scene, law, "failed")
            row.append(f"{np.mean(failed):.0%}")
    return table(head, rows)


def errors_table(results: Results, scene: str, *, paired: bool = False) -> str:
    """RMS errors, a row per controller and a column per trajectory and task."""
    found = {
        (cell.controller, cell.trajectory, cell.task): played.scores["rms_error"]
        for cell, played in results
        if cell.scene == scene
    }
    laws = list(dict.fromkeys(key[0] for key in found))
    plays = list(dict.fromkeys(key[1:] for key in found))
    if paired and BASELINE not in laws:
        return ""
    rows = []
    for law in laws:
        if paired and law == BASELINE:
            continue
        cells = []
        for play in plays:
            values = found[(law, *play)]
            if paired:
                values = values - found[(BASELINE, *play)]
            cells.append(str(interval(values)))
        rows.append([f"`{law}`", *cells])
    return table(["controller", *(f"{a}, {b}" for a, b in plays)], rows)


def scores_table(results: Results, scene: str) -> str:
    """Every score, a row per controller."""
    laws = dict.fromkeys(cell.controller for cell, _ in results if cell.scene == scene)
    rows = []
    for law in laws:
        cells = []
        for score in SCORES:
            values = over_conditions(results, scene, law, score.name)
            if score.name == "failed":
                cells.append(f"{np.mean(values):.0%}")
            else:
                cells.append(str(interval(values)))
        rows.append([f"`{law}`", *cells])
    heads = [
        score.name.replace("_", " ") + (f" [{score.unit}]" if score.unit != "1" else "")
        for score in SCORES
    ]
    return table(["controller", *heads], rows)
