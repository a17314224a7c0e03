"""Benchmark of `cc-mujoco diagnose`, on rigs in which an effect is hidden.

    python scripts/diagnosis_study/diagnose_benchmark.py --strength 2 4 --out runs/b

Rigs, motions and sensors come from `rig`, which shares no code with the package;
`--make guides` and `--make elements` are rigs by other equations.
Every case is generated, written to files, diagnosed from these as the command does, and
only then compared with its label. Studies draw from disjoint seeds: `development` and
`calibration` were used to set thresholds, `final` only to measure, once; what followed
from it was measured on `second`, and so on: changes are measured on rigs that had not
led to them. Cases that are done are kept; the table is written anew after each.

With `--bic` every case is also named in the simpler way of `bic`, from the same tuned
baseline. A case that was done without keeps its record.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import tyro
from kept_cases import Lines
from tqdm import tqdm

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.command_options import progress_options
from cc_mujoco.diagnosis import (
    EFFECTS,
    BaselineFit,
    Diagnosis,
    DiagnosisResult,
    Problem,
    fit,
    overall_share,
    screen,
)
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.report import table
from rig.makes import MAKES
from rig.nominal import NOMINAL, Rig, make_rig
from rig.strength import calibrate, measure

Record = dict[str, Any]

STUDIES = {
    "development": 1000, "calibration": 2000, "final": 3000, "second": 4000,
    "third": 5000, "fourth": 6000, "fifth": 7000, "sixth": 8000, "seventh": 9000,
    "eighth": 10000, "ninth": 11000, "tenth": 12000,
    "eleventh": 13000, "twelfth": 14000, "thirteenth": 15000,
    "fourteenth": 16000, "fifteenth": 17000,
}  # fmt: skip
"""First seed of every study, in the order in which they were run."""
LAST = "fourteenth"
"""The last that was run whole, which the page of the diagnosis shows."""
SHOWN = 1.5
"""Error over the floor that effect-free rigs stay below: beyond it, something shows."""


def judged(
    kind: str,
    hidden: Sequence[str],
    verdict: str,
    named: Sequence[str] = (),
    ties: Sequence[Sequence[str]] = (),
) -> str:
    """Return how a diagnosis went: right, tie, half, missed or wrong.

    `kind` of the hidden effects is named, pair, unknown or none; `ties` are groups of
    ids.
    """
    tied = [set(tie) for tie in ties]
    if kind == "none":
        return "right" if verdict == "none" else "wrong"
    if kind == "unknown":
        return {"unknown": "right", "none": "missed"}.get(verdict, "wrong")
    sure = set(named).difference(*tied)
    if kind == "pair":
        if set(hidden) <= sure:
            return "right"
        either = sure.union(*(tie for tie in tied if len(tie) == 2))
        if set(hidden) <= either:
            return "tie"
        return "half" if set(hidden) & either else "wrong"
    if verdict == "unknown":
        return "missed"  # whatever it added: it reports that most of the error is left
    for tie in tied:
        if hidden[0] in tie:
            return "tie" if len(tie) == 2 else "missed"
    if named and named[0] == hidden[0]:
        return "right"
    return "missed" if not named else "wrong"


def went(record: Record) -> str:
    """Return how the diagnosis of a record went, see `judged`."""
    names = ("kind", "hidden", "verdict", "named", "ties")
    return judged(**{name: record[name] for name in names})


def is_right(record: Record) -> bool:
    """Return whether a verdict is right in the sense of the odds that it states.

    Names are right if they are all that is hidden, a tie if one of its effects is.
    """
    hidden, verdict = set(record["hidden"]), record["verdict"]
    if verdict == "tie":
        return any(hidden & set(tie) for tie in record["ties"])
    if record["kind"] in ("named", "pair"):
        return verdict == "named" and hidden == set(record["named"])
    return bool(verdict == record["kind"])


def verdict_rates(records: list[Record]) -> list[list[str]]:
    """Return rows (verdict, times given, share right), for `STUDIED` of `_judge`."""
    found = []
    for verdict in ("named", "none", "tie", "unknown"):
        right = [is_right(r) for r in records if r["verdict"] == verdict]
        if right:
            share = (
                f"{_share(sum(right), len(right))} ({exact(sum(right), len(right))})"
            )
            found.append([verdict, str(len(right)), share])
    return found


def summary(records: list[Record]) -> str:
    """Return a study's results as Markdown; pages take the text above the first fold.

    Rates by kind and figures come first; rates by make and strength, and all cases, are
    folded.
    """
    columns = {
        "right": "right", "in a tie": "tie", "one of two": "half",
        "missed": "missed", "wrong": "wrong",
    }  # fmt: skip
    kinds = [
        kind
        for kind in ("named", "pair", "unknown", "none")
        if any(r["kind"] == kind for r in records)
    ]
    whole, rates = [], []
    for kind in kinds:
        by_size: dict[tuple[str, str], list[str]] = {}
        for r in sorted(records, key=lambda r: (r["make"], r["strength"])):
            if r["kind"] == kind:
                size = "-" if kind == "none" else f"{r['strength']:g}"
                by_size.setdefault((r["make"], size), []).append(went(r))
        every = [word for words in by_size.values() for word in words]
        whole.append([kind, *_shares(every, columns.values())])
        for (make, size), words in by_size.items():
            rates.append([kind, make, size, *_shares(words, columns.values())])
    head: Sequence[str] = ("cases", *columns)
    parts = [table(("hidden", *head), whole), *_figures(records)]
    if any("bic" in r for r in records):
        parts.append(comparison(records, went))
    parts += [
        "<details><summary>By verdict, rigs and strength</summary>",
        table(("verdict", "given", "right"), verdict_rates(records)),
        table(("hidden", "rigs", "R", *head), rates),
        "</details>",
    ]
    cases = []
    for r in sorted(records, key=lambda record: record["seed"]):
        hidden = ", ".join(r["hidden"]) or "none"
        ties = "; ".join(", ".join(tie) for tie in r["ties"])
        cases.append(
            (
                hidden, r["make"], f"{r['strength']:g}", f"{r['reached']:.1f}",
                _number(r.get("misfit", math.nan), 1), r["verdict"],
                ", ".join(r["named"]) or "-", ties or "-",
                _number(r.get("closed", math.nan), 2),
            )
        )  # fmt: skip
    head = (
        "hidden", "rigs", "R", "reached", "error", "verdict", "named", "ties",
        "gap closed",
    )  # fmt: skip
    parts += [
        "<details><summary>Every case: what was hidden, what was said</summary>",
        table(head, cases),
        "</details>",
    ]
    return "\n\n".join(parts) + "\n"


def _shares(words: Sequence[str], wanted: Iterable[str]) -> list[str]:
    """Return the number of cases, and of each word, the first with its interval."""
    whole = len(words)
    found = [_share(words.count(word), whole) for word in wanted]
    right = f"{found[0]} ({exact(words.count('right'), whole)})"
    return [str(whole), right, *found[1:]]


def _share(count: int, whole: int) -> str:
    return f"{count / whole:.0%}" if whole else "-"


def exact(count: int, whole: int) -> str:
    """Return an exact 95 % interval [%] (Clopper, Pearson, Biometrika 26, 1934)."""
    from scipy.stats import binomtest

    low, high = binomtest(count, whole).proportion_ci(method="exact")
    return f"{100 * low:.0f} to {100 * high:.0f}"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _figures(records: list[Record]) -> list[str]:
    """Return sentences: the gap, what intervals cover, how long it took."""
    found = _strengths(records)
    right = [r for r in records if r["kind"] == "named" and went(r) == "right"]
    if right:
        closed: dict[float, list[float]] = {}
        for r in sorted(right, key=lambda record: record["strength"]):
            closed.setdefault(r["strength"], []).append(r["closed"])
        shares = [
            f"{np.nanmedian(each):.2f} at R = {size:g} ({len(each)})"
            for size, each in closed.items()
        ]
        found.append(f"Median gap closed: {', '.join(shares)}.")
    shown = [r for r in records if r["kind"] == "named" and r.get("misfit", 0) > SHOWN]
    if shown:
        words = [went(r) for r in shown]
        found.append(
            f"Single effects at which the tuned baseline is more than {SHOWN:g} times "
            f"the floor off: {len(shown)}, of which right "
            f"{words.count('right') / len(words):.0%}, right or in a tie "
            f"{(words.count('right') + words.count('tie')) / len(words):.0%}."
        )
    tied = [r for r in records if r.get("settled")]
    if tied:
        single = [r for r in tied if r["kind"] == "named"]
        found.append(
            f"Ties: {len(tied)}; with the proposed experiment done as well, what was "
            f"hidden was named and no longer tied in {sum(map(_well, tied))}; of the "
            f"{len(single)} of single effects in {sum(map(_well, single))}."
        )
    more = [len(set(r["named"]) - set(r["hidden"])) for r in right]
    if more:
        found.append(
            "Rightly named cases in which another effect was named as well: "
            f"{sum(count > 0 for count in more)} of {len(more)}."
        )
    for make in dict.fromkeys(r["make"] for r in records):
        given = [
            r["intervals"] for r in records if r["make"] == make and r.get("intervals")
        ]
        shares = []
        for name in given[0] if given else ():
            of = [each[name] for each in given]
            held = sum(low <= true <= high for _, low, high, true in of)
            shares.append(f"{name} {_share(held, len(of))} ({exact(held, len(of))})")
        if shares:
            found.append(
                f"Intervals of 95 % that cover, of {len(given)} rigs ({make}): "
                f"{', '.join(shares)}."
            )
    return found


def _well(record: Record) -> bool:
    """Return whether the proposed experiment settled a tie."""
    last = record["settled"]
    return last["verdict"] == "named" and set(record["hidden"]) <= set(last["named"])


def _strengths(records: list[Record]) -> list[str]:
    """Return sentences: what was right by strength, effect-free rigs, times."""
    found = []
    for kind, what in (("named", "single effects"), ("pair", "pairs")):
        some = [r for r in records if r["kind"] == kind]
        sizes = sorted({r["strength"] for r in some})
        rates = []
        for size in sizes:
            words = [went(r) for r in some if r["strength"] == size]
            right = words.count("right")
            rates.append(
                f"{right} of {len(words)} at R = {size:g} ({exact(right, len(words))}%)"
            )
        if rates:
            found.append(f"Right, of {what}: {', '.join(rates)}.")
    free = [r for r in records if r["kind"] == "none"]
    if free:
        errors = [r.get("misfit", math.nan) for r in free]
        coarse = sum(r["trials"] == "restful" for r in free)
        found.append(
            f"Effect-free rigs are {min(errors):.2f} to {max(errors):.2f} floors off; "
            f"{coarse} of {len(free)} have coarse encoders and long rests."
        )
    times: dict[str, list[float]] = {}
    for r in sorted(records, key=lambda record: record["strength"]):
        size = "none hidden" if r["kind"] == "none" else f"R = {r['strength']:g}"
        times.setdefault(size, []).append(r["seconds"])
    if times:
        by_size = [f"{np.median(each):.0f} s ({size})" for size, each in times.items()]
        longest = max(records, key=lambda record: record["seconds"])
        found.append(
            f"Median time of a diagnosis: {', '.join(by_size)}; longest "
            f"{longest['seconds']:.0f} s ({', '.join(longest['hidden']) or 'none'}, "
            f"R = {longest['strength']:g})."
        )
    return found


class Guess(NamedTuple):
    """The effect that the comparison method `bic` names, and its criterion."""

    named: str | None  # id of the effect, or None where nothing is found missing
    ranking: tuple[str, ...]  # ids, the likeliest first; named or not
    share: float  # of the squared residual that the first of the ranking explains


def bic(
    baseline_fit: BaselineFit,
    evaluations: int = 12,  # with new parameters; screening has found a start
    ids: Sequence[str] = tuple(EFFECTS),
) -> Guess:
    """Return the effect with the lowest BIC, named if that is below the baseline's.

    A simpler way to name a missing effect, to compare `cc-mujoco diagnose` with
    (Schwarz, Annals of Statistics 6, 1978): full refits of the likeliest effects to all
    data, from the same tuned baseline. BIC = n ln(S/n) + k ln n with the sum of squares
    S of n samples and k parameters, as if neighbouring samples were independent and the
    model exact. No data is held out.
    """
    problem, x = baseline_fit.problem, baseline_fit.whole.x
    counts = [record.counts for record in problem.plant.records]
    before, baseline = _scored(problem, x)
    scores, squares = {}, {}
    for signature in screen(problem, x, counts, ids)[:6]:  # that explain most
        wider = problem.with_effect(signature.id, signature.start)
        start = wider.placed(x, signature.start)
        try:
            found = fit(wider, start, counts, evaluations)
        except CableError:  # cannot be simulated, so it is no candidate
            continue
        squares[signature.id], scores[signature.id] = _scored(wider, found.x)
    ranking = tuple(sorted(scores, key=lambda name: scores[name]))
    if not ranking:
        return Guess(None, (), 0.0)
    first = ranking[0]
    named = first if scores[first] < baseline else None
    return Guess(named, ranking, 1.0 - squares[first] / before)


def _scored(problem: Problem, x: FloatArray) -> tuple[float, float]:
    """Return the sum of squared errors, and BIC."""
    kept = [
        error[:, record.counts].ravel()
        for error, record in zip(problem.errors(x), problem.plant.records, strict=True)
    ]
    squares = float(sum(part @ part for part in kept))
    count = sum(part.size for part in kept)
    score = count * math.log(squares / count) + x.size * math.log(count)
    return squares, score


def comparison(records: Sequence[Record], judge: Callable[[Record], str]) -> str:
    """Return a Markdown table of both methods on the same cases, graded by `judge`."""
    both = [record for record in records if "bic" in record]
    guessed = []
    for record in both:
        named = [record["bic"]["named"]] if record["bic"]["named"] else []
        verdict = "named" if named else "none"
        guessed.append({**record, "verdict": verdict, "named": named, "ties": []})
    rows = []
    for method, cases in (("diagnose", both), ("lowest BIC", guessed)):
        shares = [
            _counted([judge(r) for r in cases if r["kind"] == kind], word)
            for kind, word in (
                *(("named", word) for word in ("right", "tie", "missed", "wrong")),
                ("none", "wrong"),
                ("unknown", "wrong"),
            )
        ]
        rows.append((method, *shares))
    head = (
        "method", "right", "in a tie of two", "missed", "wrong",
        "none: false alarms", "unknown: wrongly named",
    )  # fmt: skip
    return table(head, rows)


def _counted(words: Sequence[str], word: str) -> str:
    return f"{words.count(word) / len(words):.0%} of {len(words)}" if words else "-"


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
    """Generate, diagnose and record a case; with `with_bic` also name it by BIC."""
    from proposal_loop import loop

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
    """Return the true parameters of a rig in terms of the baseline's lumped scene."""
    # A shaft that twists is soft in series with both cables.
    shaft = MAKES[rig.make].plant_of(rig).bench.shaft
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
    """Return the baseline's RMS held-out error over the noise floor; NaN if unknown."""
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
