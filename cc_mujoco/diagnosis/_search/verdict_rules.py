"""Rules for the verdict, from a search, the closed gap and the tuned parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cc_mujoco.diagnosis._fit.folds import CrossValidation, excess
from cc_mujoco.diagnosis._fit.heldout_error import floor_ratios, overall_share
from cc_mujoco.diagnosis._fit.plausibility import IMPLAUSIBLE_PREFIX
from cc_mujoco.diagnosis._fit.stretches import STRETCH_LIMIT, TRIAL_LIMIT, Stretch
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    format_number,
    format_share,
)
from cc_mujoco.diagnosis._search.acceptance import MAX_EXPLAINED_ERROR, Thresholds
from cc_mujoco.diagnosis._search.search import Search
from cc_mujoco.diagnosis._verdict import FoundEffect, Gap, Strayed, Verdict
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.report._html import list_words

MIN_EXPLAINED_SHARE = 0.5
"""Share of the RMS error beyond the floor that named effects have to take, or else the
gap.

In the search large errors count less, since few moments must not decide what is named;
an effect that shows in few moments only closes the gap without taking that share.
"""

MIN_GAP_CLOSED = 2.0 / 3.0
"""Share of the gap between RMS errors that an effect has to close which takes less than
`MIN_EXPLAINED_SHARE`, or stays far off."""

MAX_REFINEMENT_SHARE = 0.1
"""Share of the squared gap below which an effect may only mend the form of another."""
FINDING_ERROR = 5.0
"""RMS error of its own over the floor from which on it is a finding even so."""

HINT_ERROR = 1.8
"""Error over the floor below which a name is a hint: rigs whose bends and friction are
laid out otherwise than the scene's reach that without any effect."""
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
        effects: in the model.
        ties: groups of ids that the data do not distinguish.
        gap: by channel.
        strayed: parameters tuned far beyond their priors.
        stretch: stretch of a trial beyond its own limit, or None.
        unhooked: error of the worst trial with the cables off, over the noise.
        by_trial: what constants that differ from trial to trial explain, in words, or
            "".
    """

    effects: tuple[FoundEffect, ...]
    ties: tuple[tuple[str, ...], ...]
    gap: Mapping[str, Gap]
    strayed: tuple[Strayed, ...]
    stretch: Stretch | None = None
    by_trial: str = ""
    unhooked: float = 0.0


def only_refines(
    name: str, shares: Mapping[str, float], own: Mapping[str, float], left: float
) -> bool:
    """Return whether an effect of a model only refines the others.

    One that takes little of the gap is a finding nevertheless where it takes half of
    the squared error that the model would have without it, and that is clearly more
    than noise; unless a larger effect is easily confused with it, whose form it may
    mend.

    Args:
        name: of the effect.
        shares: of the squared gap that opens without each effect.
        own: RMS error over the floor that opens without each effect.
        left: RMS error of the model over the floor.
    """
    if shares[name] >= min(MAX_REFINEMENT_SHARE, max(shares.values())):
        return False
    mends = any(
        shares[other] > shares[name] and EFFECTS[name].confused(EFFECTS[other])
        for other in shares
    )
    return mends or own[name] < max(FINDING_ERROR, left)


def judge(found: Search, outcome: Judgement, limits: Thresholds) -> tuple[Verdict, str]:
    """Return the verdict as one word and as a few sentences."""
    kind, statement = _judge(found, outcome, limits)
    also = " ".join(capitalise(each.statement) for each in outcome.strayed)
    return kind, f"{statement} {also}".strip()


def declared_sentence(declared: Mapping[str, str]) -> str:
    """Return the facts of `[rig]` that remove or bound effects, as a sentence or ""."""
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


def _judge(
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
    if stretch is not None and stretch.size > STRETCH_LIMIT:
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
    # A model that stays far off is wrong in form; large errors are what that is about.
    little = explained < MIN_EXPLAINED_SHARE or left > MAX_EXPLAINED_ERROR
    little = little and overall_share(outcome.gap) < MIN_GAP_CLOSED
    if left > limits.misfit and little:
        return "unknown", (
            f"Something is missing{_describe_implausible(found)}. What comes closest "
            f"is {_titles(missing)}: it takes {format_share(explained)} of the RMS "
            f"error above the noise and leaves {format_number(left)} noise floors, so "
            f"it does not reach the noise. {statement}"
        )
    if outcome.unhooked > TRIAL_LIMIT and all(
        EFFECTS[name].where == "conduit" for name in missing
    ):
        return "unknown", (
            "Something is missing at motor, joint or sensors: with the cables off the "
            f"error is {format_number(outcome.unhooked)} times the noise floor, which "
            f"no cable causes. {capitalise(_titles(missing))} takes "
            f"{format_share(explained)} of the RMS error above the noise. {statement}"
        )
    if misfit < HINT_ERROR:
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
    """Return the verdict where no effect is missing from this model."""
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
        f"{_HINT_CAVEAT if misfit < HINT_ERROR else ''}" + most
    )


def closest_sentence(found: Search) -> str:
    """Return the refused effect that comes closest: share, rest and why, in words."""
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
    if share <= 0.0:
        return "No effect of the library that was refitted takes any of it."
    return (
        f"What comes closest is {EFFECTS[candidate.id].title}: it takes "
        f"{format_share(share)} of the RMS error above the noise and leaves "
        f"{format_number(left)} noise floors, but is refused: {candidate.reason}."
    )


def _describe_implausible(found: Search) -> str:
    """Name the effects that would do if they could be so large, in words."""
    statements = [
        f"{EFFECTS[candidate.id].title} {candidate.reason}"
        for step in found.rounds[-1:]
        for candidate in step.candidates
        if candidate.reason.startswith(IMPLAUSIBLE_PREFIX)
    ]
    return f"; {list_words(statements)}" if statements else ""


def _tied_titles(found: FoundEffect) -> list[str]:
    """Return the titles of an effect and of those in a tie with it."""
    return [EFFECTS[name].title for name in (found.id, *found.rivals)]


def _titles(names: list[str]) -> str:
    return list_words([EFFECTS[name].title for name in names])


def _describe_gap(found: Mapping[str, Gap]) -> str:
    """Return the errors before and after, in words."""
    return list_words(
        [
            f"the {channel_name(name)} "
            f"{'falls' if g.rmse_after <= g.rmse_before else 'rises'} from "
            f"{format_number(g.rmse_before)} to {format_number(g.rmse_after)} N m "
            f"(noise floor {format_number(g.noise_floor)})"
            for name, g in found.items()
        ]
    )
