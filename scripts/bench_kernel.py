"""Time the cable kernel against general solvers of the same equations.

    python scripts/bench_kernel.py [--segments 50] [--steps 300]

Prints, from one run, the cost of a step and ratios: the kernel against (a)
`scipy.optimize.fsolve` on equations 2.13 of the thesis, warm-started from the step
before, and (b) the dense sign enumeration of its section 2.3 in NumPy, last pattern
first. All three step the same mass motion, in which every segment slips. Then the
kernel's worst single step over random motions with reversals, opposed ends and slack.
"""

from __future__ import annotations

import argparse
import os
import time

# Dense systems of this size are slower on several threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import fsolve

from cc_mujoco.transmission import Cable, Section
from cc_mujoco.transmission import kernel as K
from cc_mujoco.transmission.conduit import packed, rest_state

Array = NDArray[np.float64]
CABLE = Cable(friction=0.21, pretension=10.0, conduit=(Section(2.0, 0.28),))
DT = 1e-3


def stretch_factor(signed_angle: Array) -> Array:
    """Mean tension of a segment over that of its first node, (exp(a) - 1)/a (2.12)."""
    factor = np.ones_like(signed_angle)
    slips = signed_angle != 0.0
    factor[slips] = np.expm1(signed_angle[slips]) / signed_angle[slips]
    return factor


def residual(x: Array, near: float, far: float, before: Array, cable: Cable) -> Array:
    """Equations 2.13 with both end displacements prescribed (2.14).

    x: inner displacements (n-1,) and node tensions (n+1,).
    """
    n = cable.segments
    u = np.concatenate([[near], x[: n - 1], [far]])
    tension = x[n - 1 :]
    moved = u - before
    signed = np.sign(moved[1:] + moved[:-1]) * cable.friction * cable.wrap / n
    stretch = tension[:-1] * stretch_factor(signed) * cable.length / n
    return np.concatenate(
        [
            tension[:-1] * np.exp(signed) - tension[1:],
            (u[1:] - u[:-1]) * cable.axial_stiffness - stretch,
        ]
    )


def sign_patterns(n: int) -> list[Array]:
    """The admissible directions of the segments, Listing 2.2."""
    patterns = []
    for way in (1.0, -1.0):
        patterns.append(np.full(n, way))
        for k in range(1, n):
            pattern = np.full(n, -way)
            pattern[:k] = way
            patterns.append(pattern)
            if k < n - 1:
                still = pattern.copy()
                still[k] = 0.0
                patterns.append(still)
    return patterns


def by_enumeration(
    near: float, far: float, before: Array, patterns: list[Array], cable: Cable
) -> tuple[Array, Array]:
    """Solve the linear system of each pattern until one is consistent (2.3.2).

    The pattern found moves to the front. Returns tensions and displacements (n+1,).
    """
    n = cable.segments
    i = np.arange(n)
    for place, pattern in enumerate(patterns):
        signed = pattern * cable.friction * cable.wrap / n
        stretch = stretch_factor(signed) * cable.length / n / cable.axial_stiffness
        matrix = np.zeros((2 * n + 2, 2 * n + 2))
        matrix[i, i] = np.exp(signed)
        matrix[i, i + 1] = -1.0
        matrix[n + i, i] = stretch
        matrix[n + i, n + 1 + i] = 1.0
        matrix[n + i, n + 2 + i] = -1.0
        matrix[2 * n, n + 1] = matrix[2 * n + 1, 2 * n + 1] = 1.0
        right = np.zeros(2 * n + 2)
        right[2 * n :] = near, far
        solution = np.linalg.solve(matrix, right)
        moved = solution[n + 1 :] - before
        found = np.sign(moved[1:] + moved[:-1])
        if np.all((found == pattern) | (pattern == 0.0)):
            patterns.insert(0, patterns.pop(place))
            return solution[: n + 1], solution[n + 1 :]
    raise RuntimeError("no sign pattern is consistent")


@njit(nogil=True)
def play(
    prm: Array, n: int, state: Array, near: Array, far: Array, new: Array, work: Array
) -> None:
    """Step the kernel through a motion; `state` ends at its last sample."""
    for row in range(near.size):
        K.advance(prm, n, state, near[row], far[row], DT, new, work)
        state[:] = new


def worst_step(cable: Cable) -> tuple[float, float]:
    """Worst and median cost of a single step [s].

    Each step is timed alone and repeated; the least of its times counts, so that an
    interruption by another process does not, and the cost of the call is deducted.
    """
    rng = np.random.default_rng(0)
    knots = np.cumsum(rng.normal(0.0, 0.01, (2, 60)), axis=1)
    at = np.linspace(0.0, 59.0, 6000)
    near, far = (np.interp(at, np.arange(60.0), row) for row in knots)
    n = cable.segments
    prm, work, state = packed(cable), np.empty(K.work_size(n)), rest_state(cable)
    new = state.copy()

    def cost(u_near: float, u_far: float) -> float:
        begin = time.perf_counter()
        K.advance(prm, n, state, u_near, u_far, DT, new, work)
        return time.perf_counter() - begin

    call = min(cost(0.0, 0.0) for _ in range(2000))
    costs = []
    for u_near, u_far in zip(near, far, strict=True):
        costs.append(min(cost(u_near, u_far) for _ in range(5)) - call)
        state[:] = new
    return max(costs), float(np.median(costs))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--segments", type=int, default=50)
    parser.add_argument("--steps", type=int, default=300)
    options = parser.parse_args()
    steps = options.steps
    cable = CABLE.replace(segments=options.segments)
    n = cable.segments
    prm, work, state = packed(cable), np.empty(K.work_size(n)), rest_state(cable)
    new = state.copy()

    # Tighten and drag the cable until it moves as a whole; the clock starts there.
    drag = np.linspace(0.0, 0.2, 500)
    play(prm, n, state, drag, drag + np.minimum(drag, 0.03), new, work)
    at = np.arange(1, steps + 1) * DT
    near = state[0] + 0.05 * at
    far = state[1] + 0.05 * at + 0.002 * np.sin(6.0 * at)
    ours = []
    for _ in range(5):
        run = state.copy()
        begin = time.perf_counter()
        play(prm, n, run, near, far, new, work)
        ours.append((time.perf_counter() - begin) / steps)
    ends = run[[K.STATE_HEADER, K.STATE_HEADER + n]]

    # The general solvers count u from the unstrained cable: start on their own stretch.
    signed = np.full(n, cable.friction * cable.wrap / n)
    first = state[K.STATE_HEADER]
    tension = first * np.exp(np.concatenate([[0.0], np.cumsum(signed)]))
    stretch = tension[:-1] * stretch_factor(signed) * cable.length / n
    rest = np.concatenate([[0.0], np.cumsum(stretch / cable.axial_stiffness)])
    near_u, far_u = near - state[0], far - state[1] + rest[-1]

    before, guess = rest, np.concatenate([rest[1:-1], tension])
    failed, count = 0, max(3, steps // 20)
    begin = time.perf_counter()
    for row in range(count):
        arguments = (near_u[row], far_u[row], before, cable)
        guess, _, status, _ = fsolve(residual, guess, arguments, full_output=True)
        failed += status != 1
        before = np.concatenate([[near_u[row]], guess[: n - 1], [far_u[row]]])
    with_fsolve = (time.perf_counter() - begin) / count

    before, patterns = rest, sign_patterns(n)
    begin = time.perf_counter()
    for row in range(steps):
        dense, before = by_enumeration(near_u[row], far_u[row], before, patterns, cable)
    with_signs = (time.perf_counter() - begin) / steps

    kernel = min(ours)
    worst, median = worst_step(cable)
    difference = np.max(np.abs(dense[[0, -1]] - ends)) / np.max(ends)
    print(f"{n} segments, every segment slipping, {steps} steps")
    print(f"  kernel            {kernel * 1e6:10.2f} us/step")
    print(
        f"  fsolve, warm      {with_fsolve * 1e6:10.2f} us/step   "
        f"{with_fsolve / kernel:6.0f} x   ({failed} of {count} steps not converged)"
    )
    print(
        f"  sign enumeration  {with_signs * 1e6:10.2f} us/step   "
        f"{with_signs / kernel:6.0f} x   (end tensions differ by {difference:.0e})"
    )
    print(
        "random motions, one step: "
        f"median {median * 1e6:.1f} us, worst {worst * 1e6:.1f} us"
    )


if __name__ == "__main__":
    main()
