"""Share of a fine grid's Pareto front that a search finds with few designs.

    python scripts/benchmarks/bench_optimise.py

The wrist handle: which pulleys and which pretension give the least torque error with
the smallest motor, while no cable goes slack? A grid of 10,648 designs, then searches
and Latin hypercubes of a twentieth of that. Prints the hypervolume of each front over
that of the grid's; both refer to the grid's worst of the front, a tenth further out. A
search may find more than the grid has.
"""

from __future__ import annotations

import time

import numpy as np
import pyarrow as pa
import tyro
from tqdm import tqdm

from cc_mujoco._utils.command_options import progress_options
from cc_mujoco.design import (
    objective_costs,
    optimise,
    pareto_rows,
    read_limits,
    read_objectives,
    study,
)
from cc_mujoco.native import FloatArray as Array

ENDS = {"motor_radius": "0.01:0.05", "joint_radius": "0.05:0.2", "pretension": "2:40"}
GOALS, LIMITS = ["rms_torque_error", "peak_motor_torque"], ["slack_margin>=1"]


def front(table: pa.Table) -> Array:
    """Return the costs (designs, 2) of the Pareto-optimal designs within the limits."""
    cost = objective_costs(table, read_objectives(GOALS), read_limits(LIMITS))
    return cost[pareto_rows(cost)]


def hypervolume(cost: Array, reference: Array) -> float:
    """Return the area that costs (designs, 2) dominate below the `reference`."""
    inside = cost[(cost < reference).all(axis=1)]
    inside = inside[np.argsort(inside[:, 0])]
    floor = np.minimum.accumulate(np.append(reference[1], inside[:, 1]))
    return float(np.sum((reference[0] - inside[:, 0]) * -np.diff(floor)))


def main(
    levels: int = 22,
    duration: float = 2.0,
    seeds: int = 3,
    controllers: tuple[str, ...] = ("none",),
) -> None:
    """Print the table.

    Args:
        levels: of every variable.
        duration: of an episode [s].
        seeds: of searches and hypercubes.
        controllers: that every design is simulated with.
    """
    count = levels ** len(ENDS)
    few = count // 20
    how = {"duration": duration, "controllers": list(controllers)}
    measured = [*GOALS, "slack_margin"]
    with tqdm(total=count, unit="design", **progress_options()) as bar:
        begin = time.perf_counter()
        grid = study(
            "wrist",
            {name: f"{ends}:{levels}" for name, ends in ENDS.items()},
            metrics=measured,
            progress=lambda done: bar.update(done - bar.n),
            **how,
        )
        spent = time.perf_counter() - begin
    whole = front(grid)
    reference = whole.max(axis=0) + 0.1 * np.ptp(whole, axis=0)
    area = hypervolume(whole, reference)
    print(f"grid: {count} designs, {len(whole)} in the front, {spent:.0f} s")
    print("designs   seed   search   its time   Latin hypercube")
    for seed in range(seeds):
        begin = time.perf_counter()
        searched = optimise("wrist", ENDS, GOALS, LIMITS, evaluations=few, seed=seed,
                            **how)  # fmt: skip
        took = time.perf_counter() - begin
        random = study("wrist", ENDS, sampling="lhs", samples=few, seed=seed,
                       metrics=measured, **how)  # fmt: skip
        shares = [hypervolume(front(t), reference) / area for t in (searched, random)]
        print(f"{few:7}   {seed:4}   {shares[0]:6.3f}   {took / spent:7.1%}"
              f"   {shares[1]:15.3f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    tyro.cli(main)
