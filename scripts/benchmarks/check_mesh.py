"""Error, end stiffness and cost of the mesh of a cable, against equal segments.

    python scripts/benchmarks/check_mesh.py [--random 200]

For kinds of cable with short, tight bends, with several coefficients of friction and
seven motions each, and for random cables: the largest RMS error of an end tension in
percent of the largest tension of its motion, against the independent solver of the
tests. Then the largest ratios of the end stiffness, of the longest stable time step it
allows (a ratio to the power -1/2), and of the time of a motion.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cable import bends
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import packed_parameters, rest_state
from cc_mujoco.native import FloatArray
from thesis._experiments.solver import step_through

SEGMENTS = (50, 100)
FIRST_SEED = 1000


def random_cases(count: int) -> Iterator[bends.Case]:
    """Yield random cables and motions, without cables that are always slack."""
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        try:
            case = bends.random_case(seed)
        except ValueError:  # the solver finds no null point
            continue
        if case is not None:
            yield case


def cost(case: bends.Case, prm: FloatArray, segments: int) -> float:
    """Return the least time of three that a motion takes [s]."""
    times = []
    for _ in range(3):
        state = rest_state(case.cable.replace(segments=segments))
        state[0], state[1] = case.ends[0][0], case.ends[1][0]
        begin = time.perf_counter()
        work = np.empty(kernel.work_size(segments))
        ends = map(np.ascontiguousarray, case.ends)
        step_through(prm, segments, state, *ends, state.copy(), work)
        times.append(time.perf_counter() - begin)
    return min(times)


def row(cases: Iterable[bends.Case]) -> list[float]:
    """Return errors with equal segments and with the mesh, stiffness, step, cost."""
    errors = np.zeros((len(SEGMENTS), 2))
    stiffer, times = 0.0, np.zeros(2)
    for case in cases:
        for which, n in enumerate(SEGMENTS):
            cable = case.cable.replace(segments=n)
            meshes = bends.equally_packed(cable), packed_parameters(cable)
            found = [bends.error(case, prm, n) for prm in meshes]
            errors[which] = np.maximum(errors[which], found)
            for distal in (False, True):
                stiffness = [kernel.end_stiffness(p, n, distal) for p in meshes]
                stiffer = max(stiffer, stiffness[1] / stiffness[0])
            if n == SEGMENTS[0]:
                times += [cost(case, prm, n) for prm in meshes]
    ratio = float(times[1] / times[0])
    return [*(100.0 * errors).ravel(), stiffer, 1.0 / math.sqrt(stiffer), ratio]


def main(random: int = 200) -> None:
    """Compute and print, also for this many random cables."""
    titles = [f"{n} {mesh}" for n in SEGMENTS for mesh in ("equal", "mesh")]
    titles += ["stiffer", "step", "time"]
    print("| largest error, % |", *(f"{title} |" for title in titles))
    print("|---|" + len(titles) * "---|")
    kinds = [(kind, bends.cases(kind)) for kind in bends.KINDS]
    for kind, cases in [*kinds, ("random cables", random_cases(random))]:
        *errors, stiffer, step, ratio = row(cases)
        shown = [f"{e:.2f}" for e in errors]
        print(f"| {kind} |", *(f"{s} |" for s in shown), end=" ")
        print(f"{stiffer:.1f} | {step:.2f} | {ratio:.2f} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
