"""Benchmark of `cc-mujoco diagnose`, on rigs in which an effect is hidden.

    python scripts/diagnosis_study/diagnose_benchmark.py --strength 2 4 --out runs/b

Rigs, motions and sensors come from `rig`, which shares no code with the package;
`--make guides` and `--make elements` are rigs by other equations.
Every case is generated, written to files, diagnosed from these as the command does, and
only then compared with its label. Studies draw from disjoint seeds: `development` and
`calibration` were used to set thresholds, `final` only to measure, once; what followed
from it was measured on `second`, and so on: changes are measured on rigs that had not
led to them. Cases that are done are kept; the table is written anew after each.

With `--bic` every case is also named in the simpler way of `lowest_bic.py`, from the
same tuned baseline. A case that was done without keeps its record.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro
from diagnose_table import LAST, STUDIES, summary
from kept_cases import Lines
from tqdm import tqdm

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.command_options import progress_options

if TYPE_CHECKING:
    from cc_mujoco.diagnosis import Diagnosis, DiagnosisResult
    from rig.nominal import Rig

PAIRS = (
    ("viscous_friction", "backlash"),
    ("viscous_friction", "joint_gravity"),
    ("load_independent_friction", "motor_inertia"),
    ("stribeck_friction", "viscous_friction"),
    ("asymmetric_friction", "joint_stiffness"),
    ("pulley_eccentricity", "viscous_friction"),
)
NEWER = ("joint_friction",)
"""Effects that come last, so that those of earlier studies keep their seeds."""


def cases(
    study: str,
    seeds: int,
    strengths: Sequence[float],
    kinds: Sequence[str],
    make: str = "bristles",
) -> Iterator[dict[str, Any]]:
    """Yield the cases of a study: hidden effects, strengths and seeds."""
    from rig.makes import MAKES

    first = STUDIES[study]
    hidden: list[tuple[str, tuple[str, ...]]] = []
    hidden += [("named", (name,)) for name in MAKES[make].named]
    hidden += [("unknown", (name,)) for name in MAKES[make].unknown]
    hidden += [("none", ())] * 10
    hidden += [("pair", pair) for pair in PAIRS]
    hidden.sort(key=lambda each: each[1] == NEWER)
    for turn, strength in enumerate(list(strengths) * seeds):
        for place, (kind, names) in enumerate(hidden):
            if kind in kinds:
                seed = first + 100 * turn + place
                yield {
                    "kind": kind, "hidden": names, "seed": seed, "strength": strength,
                    "make": make,
                }  # fmt: skip


def run(case: dict[str, Any], with_bic: bool = False) -> dict[str, Any]:
    """Generate, diagnose and record one case, and name it by BIC, too, if wanted."""
    from lowest_bic import bic
    from proposal_loop import loop

    from cc_mujoco.diagnosis import overall_share
    from rig.makes import MAKES
    from rig.nominal import make_rig
    from rig.strength import calibrate, measure

    seed = case["seed"]
    rig = make_rig(seed, make=case["make"])
    trials = MAKES[rig.make].trials(rig)
    recorded = f"{trials}_standard" if case.get("standard") else trials
    amounts = {
        name: calibrate(rig, name, case["strength"], trials, seed)
        for name in case["hidden"]
    }
    with tempfile.TemporaryDirectory() as folder:
        first, *more = loop(rig, amounts, recorded, seed, Path(folder))
    result, found, truth = first.result, first.diagnosis, truth_of(rig)
    record = {
        **case,
        "amounts": amounts,
        "reached": measure(rig, amounts, trials, seed).refit if amounts else 0.0,
        "trials": recorded,
        "misfit": misfit(result),
        **judgement(found),
        "said": found.statement,
        "closed": overall_share(found.gap) if found.gap else float("nan"),
        "intervals": {
            name: [value.value, *value.ci95, truth[name]]
            for name, value in found.baseline.parameters.items()
            if name in truth
        },
        # Once the experiments that ties propose have been done, too.
        "settled": judgement(more[-1].diagnosis) if more else None,
        "seconds": first.seconds,
    }
    if with_bic and result.baseline_fit is not None:
        record["bic"] = bic(result.baseline_fit)._asdict()
    return record


def truth_of(rig: Rig) -> dict[str, float]:
    """Return the baseline's parameters of a rig, as a lumped scene means them."""
    from rig.makes import MAKES
    from rig.nominal import NOMINAL

    # A shaft that twists is soft in series with both cables.
    shaft = getattr(MAKES[rig.make].plant_of(rig), "shaft", 0.0)
    pair = 2.0 * rig.motor_radius**2 * rig.axial_stiffness / rig.length
    return {
        "axial_stiffness": rig.axial_stiffness / (1.0 + shaft * pair),
        "pretension": rig.pretension,
        # The scene's wrap is taken for granted, so friction is scaled by the rest.
        "friction": 0.5
        * (rig.friction_a + rig.friction_b)
        * rig.wrap
        / NOMINAL["wrap_angle_rad"],
    }


def judgement(diagnosis: Diagnosis) -> dict[str, Any]:
    return {
        "verdict": diagnosis.verdict,
        "named": [effect.id for effect in diagnosis.missing],
        "shares": {effect.id: effect.share for effect in diagnosis.effects},
        "deviating": {each.parameter: each.deviations for each in diagnosis.deviating},
        "ties": [list(tie) for tie in diagnosis.ties],
    }


def misfit(result: DiagnosisResult) -> float:
    """Return the baseline's RMS held-out error over the floor, NaN without one."""
    baseline_fit = result.baseline_fit
    return baseline_fit.crossed.misfit if baseline_fit else float("nan")


def main(
    study: Literal[tuple(STUDIES)] = LAST,
    seeds: int = 1,
    strength: tuple[float, ...] = (2.0,),
    kinds: tuple[str, ...] = ("named", "none", "unknown", "pair"),
    only: tuple[str, ...] = (),
    make: Literal["bristles", "guides", "elements"] = "bristles",
    standard: bool = False,
    bic: bool = False,
    jobs: int = 2,
    out: Path = Path("runs", "diagnose_benchmark"),
) -> None:
    """Diagnose the cases that are not done; write and print the table.

    Args:
        seeds: rounds over all that can be hidden.
        strength: R of every effect.
        only: ids.
        make: of the rigs.
        standard: record the rig turned, and without its cables, too.
        bic: name by BIC, too; a quarter longer.
        jobs: processes.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines, page = Lines(out / f"{study}.jsonl"), out / f"{study}.md"
    done = lines.done("seed", "strength", "make")
    wanted = [
        {**case, "standard": standard}
        for case in cases(study, seeds, strength, kinds, make)
        if (case["seed"], case["strength"], case["make"]) not in done
        and (not only or set(case["hidden"]) & set(only))
    ]
    with (
        ProcessPoolExecutor(jobs, get_context("spawn")) as pool,
        tqdm(total=len(wanted), unit="case", **progress_options()) as bar,
    ):
        for one in as_completed(pool.submit(run, case, bic) for case in wanted):
            lines.add(one.result())
            with replacing(page) as partial:
                partial.write_text(summary(lines.records), encoding="utf-8")
            bar.update()
    print(summary(lines.records))


if __name__ == "__main__":
    tyro.cli(main)
