r"""Odds that a verdict is right: comparisons of models, scaled by rates on study rigs.

Each comparison of two models has odds Phi(z) to Phi(-z), see `acceptance`; effects
whose forms meet have the discrepancy f = m E. The odds of a verdict follow from those
against each alternative and from how often such verdicts are right on sealed rigs
(`RELIABILITY`, `validation.md`), which counts what no comparison shows: effects that
the library does not have.

    belief = belief_in_verdict(found, "named", missing, ties, left)
    belief.probability, belief.statement
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist

from cc_mujoco.diagnosis._fit.folds import CrossValidation, blocks
from cc_mujoco.diagnosis._fit.plausibility import IMPLAUSIBLE_PREFIX
from cc_mujoco.diagnosis._phrases import format_number, format_odds, format_share
from cc_mujoco.diagnosis._search.acceptance import (
    MAX_EXPLAINED_ERROR,
    Round,
    comparison_z,
)
from cc_mujoco.diagnosis._search.search import Search
from cc_mujoco.diagnosis._verdict import Alternative, Verdict, VerdictOdds
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.report._html import list_words

MEETING_FORM_SHARE = 0.25
"""Discrepancy of effects whose forms meet, a weight and a spring, over the error before
the round (m)."""
RELIABILITY: Mapping[Verdict, float] = {
    "named": 0.95,
    "tie": 0.89,
    "none": 0.94,
    "unknown": 0.91,
}
"""Share of right verdicts on the 247 rigs of the fourteenth sealed set.

`scripts/diagnosis_study/diagnose_benchmark.py` prints it by verdict. On new rigs with
the standard trials verdicts were right at least as often (`validation.md`).
"""
FAR_OFF_RIGHT, FAR_OFF_NAMES = 4, 4
"""Names on study rigs that left more than `MAX_EXPLAINED_ERROR`, those that were right
and all of them, see `validation.md`. So few count by the rule of succession, (k + 1) /
(n + 2)."""
_MIN_SHOWN = 0.02
"""Least probability of an alternative that is listed."""
_MAX_SHOWN = 3


def probabilities(z: Mapping[str, float]) -> dict[str, float]:
    """Return the probability of a model, "", and of each alternative to it by id.

    Args:
        z: of the model against each alternative.
    """
    normal = NormalDist()
    weights = {name: normal.cdf(-each) / normal.cdf(each) for name, each in z.items()}
    weights[""] = 1.0
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


def belief_in_verdict(
    found: Search,
    kind: Verdict,
    missing: Sequence[str],
    ties: Sequence[Sequence[str]],
    left: float,
) -> VerdictOdds:
    """Return the probability that a verdict is right, with what else may be true.

    A name is right if its effect is the one that acts, a tie if one of its effects is.

    Args:
        found: the search.
        kind: the verdict.
        missing: ids of the effects that are called missing.
        ties: groups of ids that are tied, the one in the model first.
        left: error of the model over the noise.
    """
    reliable = RELIABILITY[kind]
    if kind == "none":
        return _rate(kind, reliable, [Alternative("small", 1.0 - reliable)])
    if kind == "unknown":
        rest = 1.0 - reliable
        others = [Alternative(name, rest / len(missing)) for name in missing]
        return _rate(kind, reliable, others)
    if left > MAX_EXPLAINED_ERROR:
        reliable = (FAR_OFF_RIGHT + 1) / (FAR_OFF_NAMES + 2)
    groups = {group[0]: set(group) for group in ties}
    whole, others = reliable, [Alternative("outside", 1.0 - reliable)]
    for step in found.rounds:
        leader = next((n for n in missing if n in (step.added, *step.parted)), None)
        if leader is None or (leader != step.added and step.added in missing):
            continue
        group = groups.get(leader, set()) | {leader}
        shares = probabilities(_alternatives(found, step, leader, group))
        whole *= shares.pop("")
        others += [Alternative(name, reliable * each) for name, each in shares.items()]
    return _worded(kind, whole, others, left)


def _alternatives(
    found: Search, step: Round, leader: str, group: set[str]
) -> dict[str, float]:
    """Return z of an effect against all that may stand in its place, by id."""
    beside = {*found.after.problem.effects, *group}
    models: dict[str, CrossValidation] = {
        c.id: c.crossed for c in step.candidates if c.crossed is not step.before
    }
    best = blocks(models[leader]).sum(axis=1)
    start = blocks(step.before).sum(axis=1)
    before = float(start.sum())
    found_z = {"nothing": comparison_z(best, start, before)}
    for c in step.candidates:
        if c.id in beside or c.id not in models:
            continue
        if c.reason.startswith(IMPLAUSIBLE_PREFIX):
            continue
        meet = EFFECTS[leader].forms_meet(EFFECTS[c.id])
        errors = blocks(models[c.id]).sum(axis=1)
        share = MEETING_FORM_SHARE if meet else None
        found_z[c.id] = comparison_z(best, errors, before, share)
    return found_z


def _rate(
    kind: Verdict, probability: float, others: Sequence[Alternative]
) -> VerdictOdds:
    """Return the belief in a verdict that compares no models: a rate."""
    meaning = {
        "none": "nothing was missing",
        "unknown": "something acted that the library does not have",
    }[kind]
    statement = (
        f"On study rigs {format_share(probability)} of such verdicts were right: "
        f"{meaning}."
    )
    return VerdictOdds(probability, statement, tuple(others))


def _worded(
    kind: Verdict, probability: float, others: Sequence[Alternative], left: float
) -> VerdictOdds:
    """Return the belief in a name or a tie with its sentence."""
    shown = sorted(
        (each for each in others if each.probability >= _MIN_SHOWN),
        key=lambda each: -each.probability,
    )[:_MAX_SHOWN]
    words = {"nothing": "nothing is missing", "outside": "something else acts"}

    def name(other: Alternative) -> str:
        return words.get(other.id) or EFFECTS[other.id].title

    rest = [f"{name(each)} (odds {format_odds(each.probability)})" for each in shown]
    complete = not left > MAX_EXPLAINED_ERROR
    subject = {
        "named": f"this {'and nothing else ' * complete}is missing",
        "tie": "one of the tied effects acts",
    }[kind]
    statement = f"The odds are {format_odds(probability)} that {subject}"
    if len(shown) == 1 and math.isclose(
        shown[0].probability, 1.0 - probability, abs_tol=_MIN_SHOWN
    ):
        rest = [name(shown[0])]
    if rest:
        statement += f"; otherwise {list_words(rest, 'or')}"
    if not complete:
        statement += (
            f". They are lower as {format_number(left)} noise floors are left: on "
            f"study rigs only {FAR_OFF_NAMES} names left more than "
            f"{MAX_EXPLAINED_ERROR:g}, of which {FAR_OFF_RIGHT} were right"
        )
    return VerdictOdds(probability, f"{statement}.", tuple(shown))
