"""Is a controller robust to structure that its model does not have?

    python scripts/benchmarks/check_structure.py --scenes wrist ankle finger \
        --first-seed 83000 --duration 1.6

Plays suite `v2` (or `v2-known`) and prints, for every device and condition, the RMS
error of the torque, the mean over the seeds, and that of the first controller over the
best of the others. Unlike `cc-mujoco benchmark` it plays no references and keeps
nothing. A row is printed once it is played.
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np

from cc_mujoco.benchmark import SUITES, Cell, Condition, play
from cc_mujoco.errors import look_up

BASELINES = "pi_tuned", "pi_feed_forward", "inverse", "lqg"


def row(condition: Condition, laws: list[str], seeds: tuple[int, ...]) -> list[float]:
    """Print a row of the table; return the errors of the controllers [N m]."""
    errors: list[float] = []
    cells: list[str] = []
    for law in laws:
        scores = play(Cell(condition, law, seeds)).scores
        errors.append(float(np.mean(scores["rms_torque_error"])))
        failed = int(np.sum(scores["failed"]))
        cells.append(f"{errors[-1]:.3g}" + (f" ({failed} failed)" if failed else ""))
    share = errors[0] / min(errors[1:])
    print(f"| {condition.name} | {' | '.join(cells)} | {share:.2f} |", flush=True)
    return errors


def main() -> None:
    """Print the table of every device."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--suite", choices=("v2", "v2-known"), default="v2")
    parser.add_argument("--scenes", nargs="+", default=["wrist", "ankle", "finger"])
    parser.add_argument("--conditions", nargs="+", help="all by default")
    parser.add_argument("--controllers", nargs="+", default=["predictive", *BASELINES])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=4.0)
    options = parser.parse_args()
    seeds = tuple(range(options.first_seed, options.first_seed + options.seeds))
    laws: list[str] = options.controllers
    if len(laws) < 2:
        parser.error("--controllers needs one to judge and one to compare it with")
    for scene in options.scenes:
        print(f"\n| {scene} | {' | '.join(laws)} | of the best |")
        print("|---" * (len(laws) + 2) + "|", flush=True)
        shares = []
        found = {one.name: one for one in SUITES[options.suite].conditions(scene)}
        for name in options.conditions or found:
            condition = look_up("condition", name, found)
            short = dataclasses.replace(condition, duration=options.duration)
            errors = row(short, laws, seeds)
            shares.append(errors[0] / min(errors[1:]))
        print(f"\nmedian {np.median(shares):.2f}, worst {max(shares):.2f}", flush=True)


if __name__ == "__main__":
    main()
