r"""Rules by which an effect is accepted, and by which two effects are tied.

Two models are compared by the difference D of their held-out squared errors. Its
standard deviation has two parts: s by noise, from blocks of a second, and a model
discrepancy f, which all seconds share and no noise shows:

    z = D / sqrt(s^2 + f^2),    f = min(c E, L)

E is the error before the round, L the error that the better model leaves, and c is
`FORM_ERROR_SHARE`: a right effect leaves as much on rigs of other forms. The odds of
the better model are Phi(z) to Phi(-z). An effect is accepted from z = 2, odds 98:2; so
it lowers the error by at least 2 c = 10 %, however long the recording.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit.folds import CrossValidation, block_sum_deviation, blocks
from cc_mujoco.diagnosis._fit.plausibility import amplitude_indices, implausibility
from cc_mujoco.diagnosis._phrases import format_number
from cc_mujoco.diagnosis._search.screening import Signature, signature_cosine
from cc_mujoco.diagnosis._thresholds import (
    FORM_ERROR_SHARE,
    MAX_EXPLAINED_ERROR,
    Limit,
    Thresholds,
)
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.native import FloatArray


class Candidate(NamedTuple):
    """An effect refitted on top of the model so far.

    Attributes:
        id: of the effect.
        crossed: the wider model.
        reduction: of the held-out squared error, relative.
        z: of the comparison with the model so far.
        reason: why it may not be named, or empty.
    """

    id: str
    crossed: CrossValidation
    reduction: float
    z: float
    reason: str


class Round(NamedTuple):
    """One step of the search.

    Attributes:
        candidates: refitted, the best first.
        added: the one that was added, or None.
        rivals: ids that do as well as the one added, itself first.
        confidence: share of bootstraps that the added one wins.
        before: the model without it.
        parted: rivals that still helped when it had been added.
    """

    candidates: tuple[Candidate, ...]
    added: str | None
    rivals: tuple[str, ...]
    confidence: float
    before: CrossValidation
    parted: tuple[str, ...] = ()

    def tied(self, effects: Sequence[str], added: Sequence[str]) -> tuple[str, ...]:
        """Return tied ids, that of the model first; empty without it.

        A rival that still helped was added, too, and is not tied; but of two that were
        added and one of which was removed again, either may be the one that stayed.
        """
        both = [name for name in added if name in (self.added, *self.parted)]
        kept = [name for name in both if name in effects]
        gone = [name for name in both if name not in effects]
        return (kept[0], *gone, *self.rivals[1:]) if kept else ()


def comparison_z(
    better: FloatArray, worse: FloatArray, before: float, share: float | None = None
) -> float:
    """Return z of the difference of two models, by squared errors in blocks (blocks,).

    `better` has the smaller sum; `before` is the squared error of the model without
    either. The discrepancy is `share` over `before`; by default c, at most the rest of
    the better.
    """
    difference = worse - better
    noise = block_sum_deviation(difference)
    left = float(np.sum(better))
    form = min(FORM_ERROR_SHARE * before, left) if share is None else share * before
    z = float(np.sum(difference)) / max(math.hypot(noise, form), 1e-300)
    return min(max(z, -Limit.max_z), Limit.max_z)


def are_confusable(one: Signature, other: Signature) -> bool:
    """Return whether an effect is easily confused with another."""
    return (
        signature_cosine(one, other) > Limit.lookalike_cosine
        or other.id in EFFECTS[one.id].confounded_with
    )


def rejection_reason(
    crossed: CrossValidation,
    name: str,
    reduction: float,
    z: float,
    thresholds: Thresholds,
) -> str:
    """Return why an effect may not be named, or ""."""
    if z < thresholds.z:
        taken = round(reduction, 2) + 0.0  # no minus before a zero
        return (
            f"takes {taken:.0%} of the error, {format_number(z, 1.0)} standard errors "
            f"of noise and model form; {thresholds.z:g} are needed"
        )
    effect = crossed.problem.plant.library.effects[name]
    parameters = {parameter.name: parameter for parameter in effect.parameters}
    spread, mean = amplitude_statistics(crossed, name)
    # Where more than a size is fitted, one parameter may stand in for another.
    alone = sum(not parameter.beside for parameter in parameters.values()) == 1
    if alone and spread > thresholds.agreement * mean:
        return "its size differs between the halves of the data"
    for tuned, x in zip(crossed.problem.tuned, crossed.fits[0].x, strict=True):
        if tuned.name in parameters and parameters[tuned.name].linear:
            if x >= tuned.high * 0.999:
                return f"{tuned.name} runs to its bound"
    return implausibility(
        crossed.problem, np.mean([fit.x for fit in crossed.fits], axis=0)
    )


def amplitude_statistics(crossed: CrossValidation, name: str) -> tuple[float, float]:
    """Return spread over folds and mean of an effect's amplitude, in scales."""
    index = amplitude_indices(crossed.problem, [name])
    found = np.array([fit.x[index] for fit in crossed.fits])
    if found.shape[0] < 2:
        return 0.0, float(np.linalg.norm(found[0]))
    spread = float(np.linalg.norm(found[0] - found[1]))
    return spread, float(np.linalg.norm(found.mean(axis=0)))


def decide(
    now: CrossValidation,
    candidates: list[Candidate],
    signatures: Sequence[Signature],
    thresholds: Thresholds,
) -> Round:
    candidates.sort(key=lambda candidate: -candidate.reduction)
    able = [candidate for candidate in candidates if not candidate.reason]
    if not able:
        return Round(tuple(candidates), None, (), 0.0, now)
    sums = {c.id: blocks(c.crossed).sum(axis=1) for c in able}
    best = able[0]
    rivals, lookalikes = [best], []
    sign = {signature.id: signature for signature in signatures}
    for other in able[1:]:
        confused = are_confusable(sign[best.id], sign[other.id])
        pair = best.id, other.id
        why = tie_reason(now, best.crossed, other.crossed, pair, confused, thresholds)
        if why == "noise":
            rivals.append(other)
        elif why == "form":
            lookalikes.append(other)
    # Where the data do not decide, the one with fewer parameters comes first; a form
    # error is no reason to have the worse one in the model.
    rivals.sort(key=lambda rival: len(EFFECTS[rival.id].parameters))
    rivals += lookalikes
    leader = rivals[0].id
    tied = {rival.id for rival in rivals}
    wider = {c.id for c in rivals[1:] if tied.intersection(EFFECTS[c.id].generalises)}
    rivals = [rival for rival in rivals if rival.id not in wider]
    sums = {name: own for name, own in sums.items() if name not in wider}
    names = tuple(rival.id for rival in rivals)
    sure = confidence(sums, leader)
    return Round(tuple(candidates), leader, names, sure, now)


def tie_reason(
    now: CrossValidation,
    best: CrossValidation,
    other: CrossValidation,
    names: tuple[str, str],
    confused: bool,
    thresholds: Thresholds,
) -> Literal["", "noise", "form"]:
    """Return why two effects are tied; "" if the data distinguish them.

    The data do where one effect explains them and the other does not, even if few
    moments show it, say those of little tension; but not of effects whose forms meet.
    """
    one, two = (EFFECTS[name] for name in names)
    explained = best.misfit <= thresholds.misfit
    if explained and other.misfit > MAX_EXPLAINED_ERROR and not one.forms_meet(two):
        return ""
    difference = blocks(other).sum(axis=1) - blocks(best).sum(axis=1)
    error = block_sum_deviation(difference)
    if difference.sum() < thresholds.rival * error:
        return "noise"
    return "form" if confused and parted_by_form(now, best, other) else ""


def parted_by_form(
    now: CrossValidation, best: CrossValidation, other: CrossValidation
) -> bool:
    """Decide whether two effects differ by no more than forms do, in every trial.

    Such a difference may be significant, as it is not noise; but a spring may soften,
    and a rubber band pulls like a weight.
    """
    sums: dict[str, FloatArray] = {}
    for place, record in enumerate(now.problem.plant.records):
        left = [float(np.nansum(c.errors[place] ** 2)) for c in (now, best, other)]
        sums[record.group] = sums.get(record.group, np.zeros(3)) + left
    table = np.array(list(sums.values()))
    taken, difference = table[:, 0] - table[:, 1], table[:, 2] - table[:, 1]
    # A trial in which the effects hardly show tolerates next to no difference.
    usual = FORM_ERROR_SHARE * np.maximum(taken, taken.mean())
    return bool(np.all(difference <= usual))


def confidence(sums: dict[str, FloatArray], name: str, seed: int = 0) -> float:
    """Return the share of block bootstraps in which this candidate is the best."""
    random = np.random.default_rng(seed)
    table = np.array(list(sums.values()))
    place = list(sums).index(name)
    draws = random.integers(0, table.shape[1], (Limit.bootstrap_draws, table.shape[1]))
    totals = table[:, draws].sum(axis=2)
    return float(np.mean(np.argmin(totals, axis=0) == place))
