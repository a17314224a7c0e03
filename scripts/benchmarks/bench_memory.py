"""Memory of a what-if over the number of designs that it has finished.

    python scripts/benchmarks/bench_memory.py

Runs one study of many short episodes into a folder and prints, by the number of
designs that are finished, what the process holds (resident, from the system). Ends with
how much more that is at the end than after the first thousand designs.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import psutil

from cc_mujoco.design import Execution, carry_out, make_plan

LEAST = 1000
"""Designs after which memory must not grow."""
STEP = 500
"""Designs in a row of the table: what comes and goes in a batch is no growth."""


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="wrist")
    parser.add_argument("--designs", type=int, default=8000)
    parser.add_argument("--duration", type=float, default=0.2)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--controllers", nargs="+", default=["model"])
    parser.add_argument("--metrics", nargs="+", default=["rms_torque_error"])
    arguments = parser.parse_args()
    plan = make_plan(
        arguments.scene,
        {"friction": "0.05:0.2", "pretension": "5:40"},
        sampling="lhs",
        samples=arguments.designs,
        controllers=arguments.controllers,
        duration=arguments.duration,
        metrics=arguments.metrics,
    )
    process, found = psutil.Process(), []

    def progress(done: float) -> None:
        found.append((done, process.memory_info().rss / 2**20))

    with tempfile.TemporaryDirectory() as folder:
        execution = Execution(arguments.threads)
        carry_out(plan, Path(folder) / "out", execution, progress)
    done, held = np.array(found).T
    for start in range(0, arguments.designs, STEP):
        inside = held[(done >= start) & (done < start + STEP)]
        if inside.size:
            print(
                f"{start:6d} to {start + STEP:6d} designs: median "
                f"{np.median(inside):6.1f} MiB, at most {inside.max():6.1f} MiB"
            )
    first = held[(done >= LEAST) & (done < LEAST + STEP)]
    if first.size:
        growth = np.median(held[done >= done.max() - STEP]) / np.median(first) - 1.0
        print(f"growth since {LEAST} designs: {growth:+.1%}")


if __name__ == "__main__":
    main()
