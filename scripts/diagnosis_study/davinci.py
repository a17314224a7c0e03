"""One mechanism on several occasions: a model mended on one, tested on the others.

    python scripts/diagnosis_study/davinci.py DIR --out runs/davinci.json

DIR holds trials of a da Vinci grasper as `davinci.toml` describes them. Every occasion
is diagnosed by itself. Then what was added on one, named or not, goes with its sizes
into the model of each other, whose baseline alone is tuned to it: friction, stiffness,
pretension, offsets. Errors are those of trials that no fit has seen.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import (
    DiagnosisResult,
    Problem,
    TorqueDerivatives,
    fit,
    gaps,
    infer,
    predicted,
    trial_folds,
)
from cc_mujoco.report import table

TOML = Path(__file__).with_suffix(".toml")
OCCASIONS = {
    "L_4": (r"tool4_freq[04]_load[048]\.csv|tool4_freq[04]_load[26]\.csv", "load[26]"),
    "L_2": (r"tool4_L2_.*\.csv", "load1"),
    "R_5": (r"tool4_R5_.*\.csv", "load1"),
}
"""Files of each occasion, and of its trials those that are held out."""


def toml_of(held_out: str, names: list[str]) -> str:
    """Return the rig's file, with the tables of other trials than its own."""
    head = TOML.read_text(encoding="utf-8").partition("\n[trials")[0]
    tests = [Path(name).stem for name in names if re.search(held_out, name)]
    return head + "".join(f'\n[trials."{t}"]\nsplit = "test"\n' for t in tests)


def diagnosed(occasion: str, folder: Path, work: Path) -> tuple[DiagnosisResult, float]:
    """Return the result of an occasion by itself, and seconds of processor time."""
    pattern, held_out = OCCASIONS[occasion]
    files = sorted(f for f in folder.iterdir() if re.fullmatch(pattern, f.name))
    if not files:
        raise SystemExit(f"{folder} holds no trial of {occasion} ({pattern}).")
    rig = work / f"{occasion}.toml"
    rig.parent.mkdir(parents=True, exist_ok=True)
    rig.write_text(toml_of(held_out, [f.name for f in files]), encoding="utf-8")
    begin = time.process_time()
    result, _ = infer(Bench.of(scene_path("bench")), files, dataset_toml=rig)
    return result, time.process_time() - begin


def with_sizes(problem: Problem, other: Problem, values: dict[str, float]) -> Problem:
    """Return a baseline with another model's effects, of sizes that are not tuned."""
    for name in other.effects:
        problem = problem.with_effect(name, {})
    tuned = list(problem.tuned)
    for k, parameter in enumerate(tuned):
        if parameter.name in values and k >= len(tuned) - _shapes(other):
            start = values[parameter.name]
            tuned[k] = parameter._replace(
                start=start, low=0.0, high=0.0, factor=False, scale=1.0
            )
    return replace(problem, tuned=tuple(tuned), slopes=TorqueDerivatives())


def _shapes(problem: Problem) -> int:
    effects = problem.plant.library.effects
    return sum(len(effects[name].parameters) for name in problem.effects)


def carried_over(giver: DiagnosisResult, taker: DiagnosisResult) -> dict[str, Any]:
    """Return the errors of held-out trials [N m] before and after, by channel."""
    assert giver.problem is not None and taker.baseline_fit is not None
    own = taker.baseline_fit
    model = with_sizes(own.problem, giver.problem, giver.problem.values(giver.x))
    records = own.problem.plant.records
    start = [*own.whole.x, *[0.0] * _shapes(giver.problem)]
    x = fit(model, start, [record.free for record in records]).x
    division = trial_folds(records)
    before = predicted(own.problem, own.whole.x, division)
    after = predicted(model, x, division)
    found = gaps(own.problem, before, after, division)
    return {c: [g.rmse_before, g.rmse_after, g.noise_floor] for c, g in found.items()}


def main() -> None:
    """Diagnose every occasion, carry each model over, print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/davinci.json"))
    parser.add_argument("--only", nargs="+", choices=OCCASIONS, default=[*OCCASIONS])
    given = parser.parse_args()
    results: dict[str, DiagnosisResult] = {}
    kept: dict[str, Any] = {"occasions": {}, "carried over": {}}
    for occasion in given.only:
        result, seconds = diagnosed(occasion, given.folder, given.out.parent)
        results[occasion] = result
        found = result.diagnosis
        kept["occasions"][occasion] = {
            "verdict": found.verdict,
            "statement": found.statement,
            "seconds": seconds,
            "effects": {
                e.id: {
                    "missing": e.missing,
                    "agreement": e.agreement,
                    "share": e.share,
                    "sizes": {n: [v.value, *v.ci95] for n, v in e.parameters.items()},
                }
                for e in found.effects
            },
            "gap": {
                c: [g.rmse_before, g.rmse_after, g.noise_floor]
                for c, g in found.gap.items()
            },
        }
        print(occasion, json.dumps(kept["occasions"][occasion], indent=1), flush=True)
    for giver, given_by in results.items():
        for taker, taken_by in results.items():
            if giver != taker and given_by.problem and given_by.problem.effects:
                kept["carried over"][f"{giver} to {taker}"] = carried_over(
                    given_by, taken_by
                )
    given.out.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    rows = [
        (
            name,
            *(
                " to ".join(f"{1e3 * e:.1f}" for e in errors[:2])
                for errors in each.values()
            ),
        )
        for name, each in kept["carried over"].items()
    ]
    print(table(("model of, on", "motor torque [mN m]", "joint torque [mN m]"), rows))


if __name__ == "__main__":
    main()
