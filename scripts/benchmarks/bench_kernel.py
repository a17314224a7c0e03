"""Worst step of the cable kernel, and the cost of its terms.

    python scripts/benchmarks/bench_kernel.py [--segments 50]

Prints the worst single step over random motions with reversals, opposed ends and slack,
and what a step with each of some terms costs over one without, over the same motions.
`python scripts/thesis/reproduce.py solver` times the kernel against general solvers.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cc_mujoco.cable import Cable, packed_parameters, replay, rest_state
from cc_mujoco.cable import _kernel as K
from cc_mujoco.native import FloatArray
from thesis._experiments.solver import CABLE, DT

TERMS: tuple[dict[str, float], ...] = (
    {"static_friction": 0.25},
    {"end_compliance": 1e-4},
    {"bedding_strain": 2e-3},
    {"clearance": 5e-4},
    {"end_compliance": 1e-4, "end_hardening": 0.02, "end_loss": 0.3},
    {"bristle_length": 2e-4},
    {"friction_drift": 0.01},
    {"clamp_creep_distal": 1e-5},
    {"friction_drift": 0.01, "bedding_strain": 2e-3},
    {"grease_drag": 5.0},
)


def motions() -> list[FloatArray]:
    """Return random displacements of both ends, (6000,) [m] each."""
    rng = np.random.default_rng(0)
    knots = np.cumsum(rng.normal(0.0, 0.01, (2, 60)), axis=1)
    at = np.linspace(0.0, 59.0, 6000)
    return [np.interp(at, np.arange(60.0), row) for row in knots]


def replayed(cable: Cable) -> float:
    """Return the mean time of a step [s], the least of three runs."""
    proximal, distal = motions()
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        replay(cable, DT, u_proximal=proximal, u_distal=distal)
        times.append(time.perf_counter() - begin)
    return min(times) / len(proximal)


def worst_step(cable: Cable) -> tuple[float, float]:
    """Return the worst and the median time of a single step [s].

    Each step is timed alone and repeated; the least of its times counts, so that an
    interruption by another process does not. The time of the call itself is deducted.
    """
    proximal, distal = motions()
    n = cable.segments
    prm, state = packed_parameters(cable), rest_state(cable)
    work, new = np.empty(K.work_size(n)), state.copy()

    def cost(u_proximal: float, u_distal: float) -> float:
        begin = time.perf_counter()
        K.advance(prm, n, state, u_proximal, u_distal, DT, new, work)
        return time.perf_counter() - begin

    call = min(cost(0.0, 0.0) for _ in range(2000))
    costs = []
    for u_proximal, u_distal in zip(proximal, distal, strict=True):
        costs.append(min(cost(u_proximal, u_distal) for _ in range(5)) - call)
        state[:] = new
    return max(costs), float(np.median(costs))


def main(segments: int = 50) -> None:
    n = segments
    worst, median = worst_step(CABLE.replace(segments=n))
    print(
        "random motions, one step: "
        f"median {median * 1e6:.1f} us, worst {worst * 1e6:.1f} us"
    )
    plain = replayed(CABLE.replace(segments=n))
    for terms in TERMS:
        ratio = replayed(CABLE.replace(segments=n, **terms)) / plain
        print(f"  with {', '.join(terms):32s} {ratio:6.1f} x")


if __name__ == "__main__":
    tyro.cli(main)
