"""A simpler way to name a missing effect, to compare `cc-mujoco diagnose` with.

`bic` (Schwarz, Annals of Statistics 6, 1978): full refits of the likeliest effects to
all data, from the same tuned baseline. BIC = n ln(S/n) + k ln n with the sum of squares
S of n samples and k parameters, as if neighbouring samples were independent and the
model exact. No data is held out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from cc_mujoco.diagnosis import EFFECTS, BaselineFit, Problem, fit, screen
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.report import table

EVALUATIONS = 12
"""Simulations with new parameters per refit; screening has found a start."""
REFITTED = 6  # effects that are refitted: those that would explain most to first order

Record = dict[str, Any]


class Guess(NamedTuple):
    """The name that is given to what is missing."""

    named: str | None  # id of the effect, or None where nothing is found missing
    ranking: tuple[str, ...]  # ids, the likeliest first; named or not
    share: float  # of the squared residual that the first of the ranking explains


def bic(
    baseline_fit: BaselineFit,
    evaluations: int = EVALUATIONS,
    ids: Sequence[str] = tuple(EFFECTS),
) -> Guess:
    """Return the effect with the lowest BIC, named if that is below the baseline's."""
    problem, x = baseline_fit.problem, baseline_fit.whole.x
    counts = [record.counts for record in problem.plant.records]
    before, baseline = _scored(problem, x)
    scores, squares = {}, {}
    for signature in screen(problem, x, counts, ids)[:REFITTED]:
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
    """Return a table in Markdown; both ways on the same cases, judged by one word."""
    both = [record for record in records if "bic" in record]
    guessed = []
    for record in both:
        named = [record["bic"]["named"]] if record["bic"]["named"] else []
        verdict = "named" if named else "none"
        guessed.append({**record, "verdict": verdict, "named": named, "ties": []})
    rows = []
    for method, cases in (("diagnose", both), ("lowest BIC", guessed)):
        shares = [
            _share([judge(r) for r in cases if r["kind"] == kind], word)
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


def _share(words: Sequence[str], word: str) -> str:
    return f"{words.count(word) / len(words):.0%} of {len(words)}" if words else "-"
