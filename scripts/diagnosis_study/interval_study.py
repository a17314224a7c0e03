"""Coverage of a rig's values by the 95 % intervals of what every scene has.

    python scripts/diagnosis_study/interval_study.py --make guides --rigs 20

Every rig is diagnosed as the command does it. A line is a rig: the verdict, and how far
each value is from the truth, in half widths of its interval: beyond 1 it is missed, and
values that lie on one side are biased. With a strength of 0 nothing is hidden, else
effects take turns.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from diagnose_benchmark import said, truth_of
from diagnose_table import exact
from kept_cases import Lines

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import infer
from rig.dataset import make_dataset
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.strength import calibrate

FIRST = 700  # seed of the first rig; no study has these
_STEP = 7  # effects from one rig to the next, so that a few rigs have different kinds


def found_on(make: str, seed: int, strength: float) -> dict[str, Any]:
    """Return the findings of a diagnosis on a rig, with the truth."""
    rig = make_rig(seed, make=make)
    trials = MAKES[make].trials(rig)
    names = MAKES[make].named
    hidden = [names[(_STEP * (seed - FIRST) + 3) % len(names)]] if strength else []
    amounts = {name: calibrate(rig, name, strength, trials, seed) for name in hidden}
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        write_data(
            data, make_dataset(rig, amounts, trials, seed), facts_of(trials, seed)
        )
        result, _ = infer(Bench.of(scene_path("bench")), [data])
    truth = truth_of(rig)
    return {
        "make": make, "seed": seed, "strength": strength, "hidden": hidden,
        **said(result.diagnosis),
        "intervals": {
            name: [value.value, *value.ci95, truth[name]]
            for name, value in result.diagnosis.baseline.parameters.items()
            if name in truth
        },
    }  # fmt: skip


def off(value: float, low: float, high: float, truth: float) -> float:
    """Return the distance from the truth over half the width of the interval."""
    return (value - truth) / (value - low if truth < value else high - value)


def told(record: dict[str, Any]) -> str:
    """Return a rig in a line."""
    distances = ", ".join(
        f"{name} {off(*interval):+.2f}"
        for name, interval in sorted(record["intervals"].items())
    )
    hidden = ", ".join(record["hidden"]) or "none"
    named = ", ".join(record["named"])
    return (
        f"{record['make']:9} {record['seed']:5} R {record['strength']:g} {hidden}: "
        f"{record['verdict']} {named}; {distances}"
    )


def covered(records: Sequence[dict[str, Any]]) -> str:
    """Return how many intervals cover, by make and parameter, with exact intervals."""
    lines = []
    makes = sorted({record["make"] for record in records})
    together = [makes] if len(makes) > 1 else []
    for some in [[make] for make in makes] + together:
        chosen = [r["intervals"] for r in records if r["make"] in some]
        for name in sorted({name for each in chosen for name in each}):
            distances = np.array([off(*each[name]) for each in chosen if name in each])
            hits = int(np.sum(np.abs(distances) <= 1.0))
            lines.append(
                f"{' and '.join(some)}, {name}: {hits} of {distances.size} "
                f"({exact(hits, distances.size)} %); mean distance "
                f"{distances.mean():+.2f}, RMS {np.sqrt(np.mean(distances**2)):.2f} "
                "half widths"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--make", nargs="+", choices=MAKES, default=list(MAKES))
    parser.add_argument("--rigs", type=int, default=10, help="of every make")
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first")
    parser.add_argument(
        "--strength", type=float, nargs="+", default=[0.0, 4.0], help="R, in turns"
    )
    parser.add_argument(
        "--out", type=Path, help="JSON lines to append to; rigs in them are not redone"
    )
    options = parser.parse_args()
    lines = Lines(options.out)
    done = lines.done("make", "seed", "strength")
    for place in range(options.rigs):
        strength = options.strength[place % len(options.strength)]
        for make in options.make:
            seed = options.first + place
            if (make, seed, strength) in done:
                continue
            record = found_on(make, seed, strength)
            lines.add(record)
            print(told(record), flush=True)
    print(covered(lines.records))


if __name__ == "__main__":
    main()
