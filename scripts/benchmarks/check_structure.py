"""Is a controller robust to structure that its model does not have?

    python scripts/benchmarks/check_structure.py --scenes wrist ankle finger \
        --first-seed 83000 --duration 1.6 --out cc_mujoco/benchmark/v2-conditions.csv

Plays suite `v2` (or `v2-known`, `v3`) and prints, for every device and condition, the
RMS error of the torque, the mean over the seeds, and that of the first controller over
the best of the others. Unlike `cc-mujoco benchmark` it plays no references. A device is
printed once it is played. `--out` keeps errors, chatter and motor peak, of which
`fill_readme.py structure` makes the tables of the pages.
"""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from cc_mujoco.benchmark import SUITES, Cell, Condition, batch_groups
from cc_mujoco.benchmark._cell import play_group

BASELINES = "pi_tuned", "pi_feed_forward", "inverse", "lqg"
SCORES = "rms_torque_error", "chatter", "peak_motor_torque"
"""Scores that are kept [N m], means over the seeds."""


def played(
    conditions: list[Condition], laws: tuple[str, ...], seeds: tuple[int, ...]
) -> dict[str, dict[str, list[float]]]:
    """Return `SCORES` and failed episodes by controller and condition."""
    found: dict[str, dict[str, list[float]]] = {one.name: {} for one in conditions}
    for law in laws:
        for group in batch_groups(Cell(one, law, seeds) for one in conditions):
            for cell, result in zip(group, play_group(group), strict=True):
                means = [float(np.mean(result.scores[name])) for name in SCORES]
                failed = int(np.sum(result.scores["failed"]))
                found[cell.condition.name][law] = [*means, failed]
    return found


def main(
    suite: Literal["v2", "v2-known", "v3"] = "v2",
    scenes: tuple[str, ...] = ("wrist", "ankle", "finger"),
    controllers: tuple[str, ...] = ("predictive", *BASELINES),
    seeds: int = 5,
    first_seed: int = 0,
    duration: float = 4.0,
    out: Path | None = None,
) -> None:
    """Print a table for each device.

    Args:
        out: CSV file, written after every device.
    """
    if len(controllers) < 2:
        raise SystemExit("--controllers needs one to judge and one to compare it with")
    numbers = tuple(range(first_seed, first_seed + seeds))
    kept: list[tuple[str | float, ...]] = []
    for scene in scenes:
        print(f"\n| {scene} | {' | '.join(controllers)} | of the best |")
        print("|---" * (len(controllers) + 2) + "|", flush=True)
        shares = []
        wanted = [
            dataclasses.replace(one, duration=duration)
            for one in SUITES[suite].conditions(scene)
        ]
        for name, found in played(wanted, controllers, numbers).items():
            errors = [scores[0] for scores in found.values()]
            shares.append(errors[0] / min(errors[1:]))
            cells = [
                f"{error:.3g}" + (f" ({failed} failed)" if failed else "")
                for error, *_, failed in found.values()
            ]
            print(f"| {name} | {' | '.join(cells)} | {shares[-1]:.2f} |", flush=True)
            for law, scores in found.items():
                kept.append((scene, name, law, *(f"{one:.4g}" for one in scores)))
        if out is not None:
            with out.open("w", newline="", encoding="utf-8") as file:
                to = csv.writer(file, lineterminator="\n")
                to.writerow(["scene", "condition", "controller", *SCORES, "failed"])
                to.writerows(kept)
        print(f"\nmedian {np.median(shares):.2f}, worst {max(shares):.2f}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
