"""Time the cable kernel against general solvers of the same equations.

    python scripts/benchmarks/bench_kernel.py [--segments 50]

Prints, from one run, the cost of a step and ratios: the kernel against (a)
`scipy.optimize.fsolve` on equations 2.13 of the thesis, warm-started from the step
before, and (b) the dense sign enumeration of its section 2.3 in NumPy, last pattern
first. All three step the same mass motion, in which every segment slips. Then the
kernel's worst single step over random motions with reversals, opposed ends and slack,
and what a step with each of some terms costs over one without, over the same motions.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

# Dense systems of this size are slower on several threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cc_mujoco.cable import Cable, packed_parameters, replay, rest_state
from cc_mujoco.cable import _kernel as K
from cc_mujoco.native import FloatArray
from thesis._experiments.solver import CABLE, DT, costs

TERMS: tuple[dict[str, float], ...] = (
    {"static_friction": 0.25},
    {"end_compliance": 1e-4},
    {"bedding_strain": 2e-3},
    {"bristle_length": 2e-4},
    {"friction_drift": 0.01},
    {"clamp_creep_distal": 1e-5},
    {"friction_drift": 0.01, "bedding_strain": 2e-3},
    {"grease_drag": 5.0},
)


def motions() -> list[FloatArray]:
    """Return random motions of both ends (6000,) [m]."""
    rng = np.random.default_rng(0)
    knots = np.cumsum(rng.normal(0.0, 0.01, (2, 60)), axis=1)
    at = np.linspace(0.0, 59.0, 6000)
    return [np.interp(at, np.arange(60.0), row) for row in knots]


def replayed(cable: Cable) -> float:
    """Return the least mean cost of a step of three runs [s]."""
    proximal, distal = motions()
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        replay(cable, DT, u_proximal=proximal, u_distal=distal)
        times.append(time.perf_counter() - begin)
    return min(times) / len(proximal)


def worst_step(cable: Cable) -> tuple[float, float]:
    """Return the worst and median cost of a single step [s].

    Each step is timed alone and repeated; the least of its times counts, so that an
    interruption by another process does not, and the cost of the call is deducted.
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
    """Run and print."""
    n = segments
    costs(2, steps=5, general_steps=2)  # compiles
    found = costs(n, steps=300, general_steps=15)
    worst, median = worst_step(CABLE.replace(segments=n))
    print(f"{n} segments, every segment slipping")
    print(f"  kernel            {found.kernel * 1e6:10.2f} us/step")
    print(
        f"  fsolve, warm      {found.fsolve * 1e6:10.2f} us/step   "
        f"{found.fsolve / found.kernel:6.0f} x   "
        f"({found.failed:.0%} of the steps not converged)"
    )
    print(
        f"  sign enumeration  {found.enumeration * 1e6:10.2f} us/step   "
        f"{found.enumeration / found.kernel:6.0f} x   "
        f"(end tensions differ by {found.apart:.0e})"
    )
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
