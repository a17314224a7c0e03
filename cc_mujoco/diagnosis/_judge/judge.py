r"""Verdict on the search, its reasons, and its probability.

Each comparison of two models has odds Phi(z) to Phi(-z), see `acceptance`; effects
whose forms meet have the discrepancy f = m E. The odds of a verdict follow from those
against each alternative and from how often such verdicts are right on sealed rigs
(`RELIABILITY`, `validation.md`), which counts what no comparison shows: effects that
the library does not have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

from cc_mujoco.diagnosis._fit.baseline import floor_ratios, overall_share
from cc_mujoco.diagnosis._fit.folds import CrossValidation, blocks, excess
from cc_mujoco.diagnosis._fit.plausibility import IMPLAUSIBLE_PREFIX
from cc_mujoco.diagnosis._fit.trials import misfits
from cc_mujoco.diagnosis._judge.identifiability import (
    confounded_effects,
    detectability,
    deviating_parameters,
    untestable_effects,
)
from cc_mujoco.diagnosis._judge.stretches import Stretch, worst_stretch
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    format_number,
    format_odds,
    format_share,
)
from cc_mujoco.diagnosis._search.acceptance import Round, comparison_z
from cc_mujoco.diagnosis._search.rounds import Search
from cc_mujoco.diagnosis._search.search import Found
from cc_mujoco.diagnosis._thresholds import MAX_EXPLAINED_ERROR, Limit, Thresholds
from cc_mujoco.diagnosis._verdict import (
    Alternative,
    Confounded,
    Deviating,
    FoundEffect,
    Gap,
    NotTestable,
    Verdict,
    VerdictOdds,
)
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.report._html import list_words

_HINT_CAVEAT = " The layout of a rig alone can cause as much: this is a hint only."


DECLARATIONS = {
    "joint_gravity": "balanced",
    "joint_stiffness": "joint_spring",
    "torque_sensor_gain": "gain_uncertainty",
    "torque_sensor_offset": "zeroed",
}
"""Facts of `[rig]` that remove or bound an effect, by its id."""


class Judgement(NamedTuple):
    """Findings once all data have been fitted.

    Attributes:
        effects: effects in the model.
        ties: groups of ids that the data do not distinguish.
        gap: by channel.
        deviating: parameters tuned far beyond their priors.
        stretch: stretch of a trial beyond its own limit, or None.
        unhooked: error of the worst trial with the cables off, over the noise.
        by_trial: sentence on what constants by trial explain, or "".
    """

    effects: tuple[FoundEffect, ...]
    ties: tuple[tuple[str, ...], ...]
    gap: Mapping[str, Gap]
    deviating: tuple[Deviating, ...]
    stretch: Stretch | None = None
    by_trial: str = ""
    unhooked: float = 0.0


@dataclass(frozen=True)
class Judged:
    """Verdict with its reasons.

    Attributes:
        verdict: in one word.
        statement: in a few sentences.
        belief: probability that it is right; None where the search was interrupted, or
            where something happened once.
        stretch: stretch of a trial beyond its own limit, or None.
        deviating: parameters tuned far beyond their priors.
        confounded: effects that tuning would hide.
        not_testable: effects that these data cannot show.
    """

    verdict: Verdict
    statement: str
    belief: VerdictOdds | None
    stretch: Stretch | None
    deviating: tuple[Deviating, ...]
    confounded: tuple[Confounded, ...]
    not_testable: tuple[NotTestable, ...]


def judge(found: Found, limits: Thresholds) -> Judged:
    """Judge the result of the search, and list effects that these data cannot show."""
    problem, x, search = found.problem, found.x, found.search
    tied = {rival for effect in found.effects for rival in effect.rivals}
    beside = {*problem.effects, *tied}
    others = [sign.id for sign in search.signatures if sign.id not in beside]
    shown_by = detectability(problem, x, others, search.changes)
    hidden = confounded_effects(shown_by)
    beyond = deviating_parameters(problem, x, found.estimated, hidden)
    stretch = worst_stretch(problem, x, found.held.after)
    off = misfits(problem, x)
    unhooked = {r.trial for r in problem.plant.records if r.unhooked} & set(off)
    outcome = Judgement(
        found.effects,
        found.ties,
        found.held.gap,
        beyond,
        stretch,
        found.by_trial,
        max((off[name] for name in unhooked), default=0.0),
    )
    kind, statement = verdict_of(search, outcome, limits)
    statement += declared_sentence(problem.plant.library.declared)
    belief = None
    if search.interrupted:
        if not found.effects:
            kind = "unknown"
            statement = (
                "the error of the tuned scene is "
                f"{format_number(search.before.misfit)} times the noise floor, and no "
                "effect had been added."
            )
        statement = f"Stopped before all effects were tried: {statement}"
    elif not (kind == "unknown" and one_time(outcome, limits)):
        left = floor_ratios(found.held.gap)[1]
        belief = belief_in_verdict(search, kind, found.missing, found.ties, left)
    untestable = untestable_effects(shown_by, hidden)
    return Judged(kind, statement, belief, stretch, beyond, hidden, untestable)


def one_time(outcome: Judgement, limits: Thresholds) -> bool:
    """Return whether something happened once, as it did on no study rig."""
    stretch = outcome.stretch
    alone = stretch is not None and stretch.rest <= limits.misfit
    return alone or bool(outcome.by_trial)


def verdict_of(
    found: Search, outcome: Judgement, limits: Thresholds
) -> tuple[Verdict, str]:
    """Return the verdict as one word and as a few sentences."""
    kind, statement = _verdict(found, outcome, limits)
    also = " ".join(capitalise(each.statement) for each in outcome.deviating)
    return kind, f"{statement} {also}".strip()


def declared_sentence(declared: Mapping[str, str]) -> str:
    """Return in a sentence the facts of `[rig]` that remove or bound effects, or ""."""
    facts = [f"{EFFECTS[name].title} ({fact})" for name, fact in declared.items()]
    return f" Limited by what [rig] declares: {list_words(facts)}." if facts else ""


def undecidable_sentence(tie: Sequence[str]) -> str:
    """Return what decides a tie that no trial of the catalogue separates."""
    facts = [DECLARATIONS[name] for name in tie if name in DECLARATIONS]
    decide = "on such motions either gives the same torques"
    if facts:
        decide = f"declare what is known of them ([rig] {list_words(facts, 'or')})"
    return (
        " No trial of the catalogue that is not among these would separate them: "
        f"{decide}."
    )


def _verdict(
    found: Search, outcome: Judgement, limits: Thresholds
) -> tuple[Verdict, str]:
    misfit, left = found.before.misfit, found.after.misfit
    if not outcome.effects:
        return _no_effect_verdict(found.before, found, outcome, limits)
    ordinary = [each.id for each in outcome.effects if each.ordinary]
    refining = [e for e in outcome.effects if e.refinement and not e.ordinary]
    disputed = [
        e for e in outcome.effects if e.disputed and not (e.refinement or e.ordinary)
    ]
    missing = [each.id for each in outcome.effects if each.missing]
    before, after = floor_ratios(outcome.gap)
    statement = (
        f"On held-out data the error of the repaired model is {after:.1f} times the "
        f"noise floor, that of the tuned scene {before:.1f} times. The weighted RMS "
        f"error of {_describe_gap(outcome.gap)}."
    )
    stretch = outcome.stretch
    if stretch is not None and stretch.size > Limit.stretch_limit:
        statement += f" One stretch is left: {stretch.statement}"
    if refining:
        either = list_words(list_words(_tied_titles(each), "or") for each in refining)
        statement += (
            f" {capitalise(either)} refines the model, but explains too little to be "
            "called missing."
        )
    if ordinary:
        statement += (
            f" {capitalise(_titles(ordinary))} is in the model, but no larger than "
            "uneven bends and loose ends of any conduit make."
        )
    if disputed:
        statement += " " + capitalise(
            list_words(
                f"{EFFECTS[each.id].title} is supported by "
                f"{format_share(each.agreement)} of the parts of the data only"
                for each in disputed
            )
        )
        statement += ", so it may stand in for something else."
    if not (missing or disputed):
        kind, nothing = _no_effect_verdict(found.after, found, outcome, limits)
        return kind, f"{nothing} {statement}"
    if not missing:
        return "unknown", (
            "Something is missing, and parts of these data name different effects for "
            f"it{_describe_implausible(found)}. {closest_sentence(found)} {statement}"
        )
    explained = 1.0 - (left - 1.0) / (misfit - 1.0) if misfit > 1.0 else 1.0
    # A model that stays far off is wrong in form, and large errors show that.
    little = explained < Limit.min_explained_share or left > MAX_EXPLAINED_ERROR
    little = little and overall_share(outcome.gap) < Limit.min_gap_closed
    if left > limits.misfit and little:
        return "unknown", (
            f"Something is missing{_describe_implausible(found)}. What comes closest "
            f"is {_titles(missing)}: it takes {format_share(explained)} of the RMS "
            f"error above the noise and leaves {format_number(left)} times the noise "
            f"floor, so "
            f"it does not reach the noise. {statement}"
        )
    if outcome.unhooked > Limit.trial_limit and all(
        EFFECTS[name].where == "conduit" for name in missing
    ):
        return "unknown", (
            "Something is missing at motor, joint or sensors: with the cables off the "
            f"error is {format_number(outcome.unhooked)} times the noise floor, which "
            f"no cable causes. {capitalise(_titles(missing))} takes "
            f"{format_share(explained)} of the RMS error above the noise. {statement}"
        )
    if misfit < Limit.hint_error:
        statement += (
            f" The error of the tuned scene is only {format_number(misfit)} times the "
            f"noise floor.{_HINT_CAVEAT}"
        )
    tied = {name for tie in outcome.ties for name in tie}
    if tied:
        sure = [name for name in missing if name not in tied]
        groups = [_titles(sure)] if sure else []
        groups += [
            list_words([EFFECTS[name].title for name in tie], "or")
            for tie in outcome.ties
        ]
        every = ", and ".join(groups)
        return "tie", f"Missing: {every}. These data do not show which. {statement}"
    verb = "is" if len(missing) == 1 else "are"
    return "named", f"{capitalise(_titles(missing))} {verb} missing. {statement}"


def _no_effect_verdict(
    model: CrossValidation, found: Search, outcome: Judgement, limits: Thresholds
) -> tuple[Verdict, str]:
    misfit = model.misfit
    if outcome.stretch is not None and outcome.stretch.rest <= limits.misfit:
        return "unknown", (
            "The data disagree with the simulation in one stretch: "
            f"{outcome.stretch.statement}"
        )
    if outcome.by_trial:
        return "unknown", outcome.by_trial
    scene = "tuned scene" if model is found.before else "model"
    off = f"on held-out data the error of the {scene} is {format_number(misfit)} times "
    off += "the noise floor"
    usual = f"rigs without any hidden effect reach up to {limits.misfit:g} times"
    beyond = outcome.stretch is not None
    most = f" The largest error: {outcome.stretch.statement}" if outcome.stretch else ""
    if misfit <= limits.misfit and not beyond:
        return "none", f"Nothing is missing: {off}; {usual}."
    if excess(model) < limits.z and not beyond:
        return "none", (
            f"Nothing is missing that these data could show: {off}. "
            f"{capitalise(usual)}, but here a few moments make that error, which is "
            "no evidence."
        )
    return "unknown", (
        f"Something is missing (error {format_number(misfit)} times the noise floor). "
        f"{closest_sentence(found)} See where the error lies."
        f"{_HINT_CAVEAT if misfit < Limit.hint_error else ''}" + most
    )


def closest_sentence(found: Search) -> str:
    """Return the closest rejected effect in words: share of the error, rest, reason."""
    tried = [
        (candidate, step.before)
        for step in found.rounds
        for candidate in step.candidates
        if candidate.reason and candidate.crossed is not step.before
    ]
    if not tried:
        return "To first order no effect of the library takes enough of it."
    candidate, before = max(tried, key=lambda each: each[0].reduction)
    left = candidate.crossed.misfit_by(before.problem.inflation)
    share = 1.0 - (left - 1.0) / max(before.misfit - 1.0, 1e-9)
    if share < 0.01:
        return "No effect of the library that was refitted takes 1 % of it."
    return (
        f"What comes closest is {EFFECTS[candidate.id].title}: it takes "
        f"{format_share(share)} of the RMS error above the noise and leaves "
        f"{format_number(left)} times the noise floor, but is refused: "
        f"{candidate.reason}."
    )


def _describe_implausible(found: Search) -> str:
    """Name the effects that would explain the error if they could be so large."""
    statements = [
        f"{EFFECTS[candidate.id].title} {candidate.reason}"
        for step in found.rounds[-1:]
        for candidate in step.candidates
        if candidate.reason.startswith(IMPLAUSIBLE_PREFIX)
    ]
    return f"; {list_words(statements)}" if statements else ""


def _tied_titles(found: FoundEffect) -> list[str]:
    return [EFFECTS[name].title for name in (found.id, *found.rivals)]


def _titles(names: list[str]) -> str:
    return list_words([EFFECTS[name].title for name in names])


def _describe_gap(found: Mapping[str, Gap]) -> str:
    return list_words(
        [
            f"the {channel_name(name)} "
            f"{'falls' if g.rmse_after <= g.rmse_before else 'rises'} from "
            f"{format_number(g.rmse_before)} to {format_number(g.rmse_after)} N m "
            f"(noise floor {format_number(g.noise_floor)})"
            for name, g in found.items()
        ]
    )


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

STUDIED_ERROR: Mapping[Verdict, float] = {
    "named": 19.4,
    "tie": 19.4,
    "none": 1.7,
    "unknown": 39.3,
}
"""Largest error over the noise floor that such verdicts left on study rigs.

Beyond it no rate is known. See `validation.md`.
"""


def probabilities(z: Mapping[str, float]) -> dict[str, float]:
    """Return the probability of a model, "", and of each alternative to it by id."""
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
    """Return the probability that a verdict is right, and its alternatives.

    A name is right if its effect is the one that acts, a tie if one of its effects is.
    The probability is NaN where no study rig left as much. `ties` has the effect in the
    model first; `left` is the error of the model over the noise.
    """
    reliable, most = RELIABILITY[kind], STUDIED_ERROR[kind]
    if left > most:
        return VerdictOdds(
            math.nan,
            f"How often such a verdict is right is not known: it leaves "
            f"{format_number(left)} times the noise floor, and such verdicts on study "
            f"rigs left at most {most:g} times.",
            (),
        )
    if kind == "none":
        return _rate(kind, reliable, [Alternative("small", 1.0 - reliable)])
    if kind == "unknown":
        rest = 1.0 - reliable
        others = [Alternative(name, rest / len(missing)) for name in missing]
        return _rate(kind, reliable, others)
    if left > MAX_EXPLAINED_ERROR:
        reliable = (Limit.far_off_right + 1) / (Limit.far_off_names + 2)
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
        if group.intersection(EFFECTS[c.id].generalises):  # it contains the finding
            continue
        meet = EFFECTS[leader].forms_meet(EFFECTS[c.id])
        errors = blocks(models[c.id]).sum(axis=1)
        share = Limit.meeting_form_share if meet else None
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
    shown = sorted(
        (each for each in others if each.probability >= Limit.min_shown),
        key=lambda each: -each.probability,
    )[:3]
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
        shown[0].probability, 1.0 - probability, abs_tol=Limit.min_shown
    ):
        rest = [name(shown[0])]
    if rest:
        statement += f"; otherwise {list_words(rest, 'or')}"
    if not complete:
        statement += (
            f". They are lower as {format_number(left)} times the noise floor is left: "
            f"on study rigs only {Limit.far_off_names} names left more than "
            f"{MAX_EXPLAINED_ERROR:g} times, of which {Limit.far_off_right} were right"
        )
    return VerdictOdds(probability, f"{statement}.", tuple(shown))
