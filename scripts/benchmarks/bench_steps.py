"""Steps per second with cables against the same scenes without what they cost.

    python scripts/benchmarks/bench_steps.py

Each pair of scenes takes turns in one process. Prints, for every pair, the median and
the middle half of the ratios of processor time in the same round.
"""

from __future__ import annotations

from collections.abc import Callable

import bench_engine
import bench_open
import bench_route
import mujoco
import numpy as np
import tyro

from cc_mujoco.assets import scene_path

Turn = Callable[[], float]


def main(steps: int = 1000, rounds: int = 101) -> None:
    """Print the ratios.

    Args:
        steps: steps per turn.
        rounds: turns of each scene.
    """
    pairs: dict[str, tuple[Turn, Turn]] = {
        "finger: open cable / ideal tendon": (
            bench_open.player(bench_open.scene("open", 20), steps),
            bench_open.player(bench_open.scene("ideal", 20), steps),
        ),
        "ankle: moving route / fixed bends": (
            bench_route.walker(bench_route.scene("route", {"segments": 30}), steps),
            bench_route.walker(bench_route.scene("fixed", {"segments": 30}), steps),
        ),
        "wrist: two cables / ideal gear": (
            bench_engine.single(
                mujoco.MjModel.from_xml_path(str(scene_path("wrist"))), steps
            ),
            bench_engine.single(bench_engine.ideal(False), steps),
        ),
    }
    found: dict[str, list[float]] = {name: [] for name in pairs}
    for _ in range(rounds + 1):
        for name, (ours, theirs) in pairs.items():
            cost = ours()
            found[name].append(theirs() / cost)
    for name, ratios in found.items():
        low, middle, high = np.quantile(ratios[1:], (0.25, 0.5, 0.75))
        print(f"{name:36} {middle:.3f}  ({low:.3f} to {high:.3f})")


if __name__ == "__main__":
    tyro.cli(main)
