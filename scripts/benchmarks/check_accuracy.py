"""Error of the kernel against the continuum, by number of segments.

    python scripts/benchmarks/check_accuracy.py [--reference FOLDER] [--seeds 3]

Prints the RMS error of the worse end tension, in percent of the motion's largest
tension, for seven kinds of motion and several cables, against the independent solver of
the tests; or against the motions of a folder of reference files (`parameters.json` and
CSV files with end displacements and end tensions).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from cable import test_kernel_accuracy as accuracy

SEGMENTS = (25, 50, 100, 200)


def generated(seeds: int) -> Iterator[tuple[str, Any, Any, Any]]:
    """Yield motions of every kind for every cable; the worst seed is shown."""
    for which, cable in accuracy.CABLES.items():
        for name in accuracy.MOTIONS:
            for seed in range(seeds):
                ends = accuracy.case(cable, name, seed, 4000)
                yield f"{which}: {name}", cable, ends, accuracy.continuum(cable, ends)


def main(reference: Path | None = None, seeds: int = 3) -> None:
    """Compute and print."""
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


if __name__ == "__main__":
    tyro.cli(main)
