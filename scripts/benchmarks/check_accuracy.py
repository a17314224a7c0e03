"""Error of the kernel against the continuum, by number of segments and by mesh.

    python scripts/benchmarks/check_accuracy.py segments [--reference FOLDER]
    python scripts/benchmarks/check_accuracy.py mesh [--random 200]

`segments` prints the RMS error of the worse end tension, in percent of the motion's
largest tension, for seven kinds of motion and several cables, against the independent
solver of the tests; or against the motions of a folder of reference files
(`parameters.json` and CSV files with end displacements and end tensions).

`mesh` compares with equal segments: for kinds of cable with short, tight bends, with
several coefficients of friction and seven motions each, and for random cables: the
largest RMS error of an end tension in percent of the largest tension of its motion,
against the same solver. Then the largest ratios of the end stiffness, of the longest
stable time step it allows (a ratio to the power -1/2), and of the time of a motion.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cable import bends
from cable import test_kernel_accuracy as accuracy
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import packed_parameters, rest_state
from cc_mujoco.native import FloatArray
from thesis._experiments.solver import step_through

SEGMENTS = (25, 50, 100, 200)


def generated(seeds: int) -> Iterator[tuple[str, Any, Any, Any]]:
    """Yield motions of every kind for every cable; the worst seed is shown."""
    for which, cable in accuracy.CABLES.items():
        for name in accuracy.MOTIONS:
            for seed in range(seeds):
                ends = accuracy.case(cable, name, seed, 4000)
                yield f"{which}: {name}", cable, ends, accuracy.continuum(cable, ends)


def segments(reference: Path | None = None, seeds: int = 3) -> None:
    cases = accuracy.references(reference) if reference else generated(seeds)
    worst: dict[str, list[float]] = {}
    for name, cable, ends, tensions in cases:
        errors = [accuracy.rms_error(cable, n, ends, tensions) for n in SEGMENTS]
        before = worst.get(name, [0.0] * len(SEGMENTS))
        worst[name] = [max(pair) for pair in zip(before, errors, strict=True)]
    print(f"{'RMS error, % of largest tension':48}", *(f"N={n:<5}" for n in SEGMENTS))
    for name, row in worst.items():
        print(f"{name:48}", *(f"{100 * e:7.4f}" for e in row))
    columns = zip(*worst.values(), strict=True)
    print(f"{'worst':48}", *(f"{100 * max(column):7.4f}" for column in columns))


TIGHT_SEGMENTS = (50, 100)
FIRST_SEED = 1000


def random_cases(count: int) -> Iterator[bends.Case]:
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        try:
            case = bends.random_case(seed)
        except ValueError:  # the solver finds no null point
            continue
        if case is not None:
            yield case


def cost(case: bends.Case, prm: FloatArray, segments: int) -> float:
    """Return the time of a motion [s], the least of three."""
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
    """Return errors of equal segments and mesh; ratios of stiffness, step and time."""
    errors = np.zeros((len(TIGHT_SEGMENTS), 2))
    stiffer, times = 0.0, np.zeros(2)
    for case in cases:
        for which, n in enumerate(TIGHT_SEGMENTS):
            cable = case.cable.replace(segments=n)
            meshes = bends.equally_packed(cable), packed_parameters(cable)
            found = [bends.error(case, prm, n) for prm in meshes]
            errors[which] = np.maximum(errors[which], found)
            for distal in (False, True):
                stiffness = [kernel.end_stiffness(p, n, distal) for p in meshes]
                stiffer = max(stiffer, stiffness[1] / stiffness[0])
            if n == TIGHT_SEGMENTS[0]:
                times += [cost(case, prm, n) for prm in meshes]
    ratio = float(times[1] / times[0])
    return [*(100.0 * errors).ravel(), stiffer, 1.0 / math.sqrt(stiffer), ratio]


def mesh(random: int = 200) -> None:
    """Print errors of the mesh, for the kinds of cable and for `random` random ones."""
    titles = [f"{n} {mesh}" for n in TIGHT_SEGMENTS for mesh in ("equal", "mesh")]
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
    tyro.extras.subcommand_cli_from_dict({"segments": segments, "mesh": mesh})
