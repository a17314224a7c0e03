"""Learned curves on rigs that hide what no library knows: the held-out gap closed.

    python scripts/diagnosis_study/learned_curves.py --out runs/learned_curves

Every `unknown_...` effect of every make (`rig/effects.toml`) is hidden in a rig of its
own, and each rig is diagnosed. Curves are learned where the verdict is `unknown`, or
where a named model stays far off. The table has errors over the noise floor of the
tuned scene and of the model with what was added, on held-out trials, and the share of
what was left that curves take. Cases that are done are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from kept_cases import complete

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Options, load, run_inference
from cc_mujoco.diagnosis._fit.problem import floor_ratios
from cc_mujoco.diagnosis._learn.residual import described
from cc_mujoco.report import table
from rig.generate import generate
from rig.makes import MAKES


def diagnosed(
    make: str, effect: str, strength: float, seed: int, effects: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Diagnose a rig; return the verdict and what curves take of the error left.

    The search considers `effects` only, if any are given.
    """
    with TemporaryDirectory() as folder:
        place = Path(folder, "rig")
        hidden = [] if effect == "none" else [effect]
        generate(place, hidden, strength, "rich", seed, make)
        bench = Bench.of(scene_path("bench"))
        dataset, _ = load([place / "data"], None, bench)
        found = run_inference(dataset, bench, Options(effects)).diagnosis
    learned = found.learned
    curves = [described(curve) for curve in learned.curves] if learned else []
    formulas = [curve.formula for curve in learned.curves] if learned else []
    given = learned.gap if learned and curves else found.gap
    before, after = floor_ratios(found.gap)[0], floor_ratios(given)[1]
    case = {"make": make, "effect": effect, "strength": strength, "seed": seed}
    return case | {
        "verdict": found.verdict,
        "named": [each.id for each in found.missing],
        "before": before,
        "after": after,
        "curves": curves,
        "formulas": formulas,
        "closed": learned.gap_closed if learned and curves else 0.0,
        "interval": list(learned.ci95) if learned and curves else [0.0, 0.0],
    }


def summary(records: Sequence[Mapping[str, Any]]) -> str:
    """Return a Markdown table, a row per rig, and the median of what is closed."""
    rows = [
        (
            f"{each['effect'].removeprefix('unknown_')} ({each['make']})",
            f"`{each['verdict']}`",
            f"{each['before']:.1f}",
            f"{each['after']:.1f}",
            f"{each['closed']:.2f}" if each["curves"] else "-",
            "; ".join(text.removeprefix("a curve of the ") for text in each["curves"]),
            "; ".join(filter(None, each["formulas"])),
        )
        for each in records
    ]
    unknown = [each for each in records if each["verdict"] == "unknown"]
    found = [each for each in unknown if each["curves"]]
    shares = [1.0 - (e["after"] - 1.0) / (e["before"] - 1.0) for e in unknown]
    medians = [
        float(np.median(values)) if values else 0.0
        for values in ([each["closed"] for each in found], shares)
    ]
    head = "hidden", "verdict", "scene", "model", "by curves", "curve", "formula"
    return (
        f"{table(head, rows)}\n\nOf {len(unknown)} `unknown` rigs {len(found)} have "
        f"curves, which close {medians[0]:.2f} (median) of what is left; model and "
        f"curves close {medians[1]:.2f} (median of all of them)."
    )


def main(
    makes: tuple[str, ...] = tuple(MAKES),
    strength: float = 6.0,
    first: int = 27000,
    none: int = 0,
    effects: tuple[str, ...] = (),
    out: Path = Path("runs", "learned_curves"),
) -> None:
    """Diagnose every unknown effect of these makes, and `none` rigs that hide nothing.

    Args:
        makes: makes of rigs.
        strength: R of each effect.
        first: seed of the first rig.
        none: rigs of each make that hide nothing.
        effects: effects that are searched, all by default.
        out: folder of the records and the table.
    """
    hidden = [(make, name) for make in makes for name in MAKES[make].unknown]
    hidden += [(make, "none") for make in makes for _ in range(none)]
    pairs = enumerate(hidden, start=first)
    cases = [(make, name, strength, seed) for seed, (make, name) in pairs]
    keys = "make", "effect", "strength", "seed"
    complete(out, keys, cases, partial(diagnosed, effects=effects), summary)


if __name__ == "__main__":
    tyro.cli(main)
