"""Full refits of the likeliest effects to all data; the lowest BIC names.

BIC = n ln(S/n) + k ln n with the sum of squares S of n samples and k parameters, as if
neighbouring samples were independent and the model exact.

Schwarz, Annals of Statistics 6, 1978.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from baselines.guess import Guess
from cc_mujoco.diagnosis import EFFECTS, BaselineFit, Problem, fit, screen
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

EVALUATIONS = 12
"""Simulations with new parameters per refit; screening has found a start."""


REFITTED = 6  # effects that are refitted: those that would explain most to first order


def bic(
    baseline_fit: BaselineFit,
    evaluations: int = EVALUATIONS,
    ids: Sequence[str] = tuple(EFFECTS),
) -> Guess:
    """Return the effect with the lowest BIC, named if that is below the baseline's.

    Args:
        evaluations: most of each refit.
    """
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
