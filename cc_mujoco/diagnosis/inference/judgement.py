"""The verdict: what a search, the gap that it closed and what was tuned come to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.inference.folds import CrossValidation, excess
from cc_mujoco.diagnosis.inference.gap import off, overall
from cc_mujoco.diagnosis.inference.plausibility import FITS_ONLY
from cc_mujoco.diagnosis.inference.search import REACHED, Search, Thresholds
from cc_mujoco.diagnosis.verdict import FoundEffect, Gap, Strayed, Verdict
from cc_mujoco.diagnosis.wording import capital, channel, number, share
from cc_mujoco.page import listed

EXPLAINED = 0.5
"""Share of the RMS error beyond the floor that named effects have to take, or else the
gap.

In the search large errors count less, since few moments must not decide what is named;
an effect that shows in few moments only closes the gap without taking that share.
"""

CLOSED = 2.0 / 3.0
"""Share of the gap between RMS errors that an effect has to close which takes less than
`EXPLAINED`, or stays far off."""

REFINES = 0.1
"""Share of the squared gap below which an effect may only mend the form of another."""
OWN = 5.0
"""RMS error of its own over the floor from which on it is a finding even so."""

HINT = 1.8
"""Error over the floor below which a name is a hint: rigs whose bends and friction are
laid out otherwise than the scene's reach that without any effect."""
_AS_MUCH = " The layout of a rig can make as much: take this for a hint."


class Judgement(NamedTuple):
    """Findings once all data have been fitted.

    Attributes:
        effects: in the model.
        ties: groups of ids that the data do not tell apart.
        gap: by channel.
        strayed: parameters tuned beyond what is known of them.
    """

    effects: tuple[FoundEffect, ...]
    ties: tuple[tuple[str, ...], ...]
    gap: Mapping[str, Gap]
    strayed: tuple[Strayed, ...]


def refines(
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
    if shares[name] >= min(REFINES, max(shares.values())):
        return False
    mends = any(
        shares[other] > shares[name] and EFFECTS[name].confused(EFFECTS[other])
        for other in shares
    )
    return mends or own[name] < max(OWN, left)


def judged(
    found: Search, outcome: Judgement, limits: Thresholds
) -> tuple[Verdict, str]:
    """The verdict in one word and in a few sentences."""
    kind, told = _judged(found, outcome, limits)
    also = " ".join(capital(each.statement) for each in outcome.strayed)
    return kind, f"{told} {also}".strip()


def _judged(
    found: Search, outcome: Judgement, limits: Thresholds
) -> tuple[Verdict, str]:
    misfit, left = found.before.misfit, found.after.misfit
    if not outcome.effects:
        return _nothing(found.before, found, limits)
    ordinary = [each.id for each in outcome.effects if each.ordinary]
    refining = [e for e in outcome.effects if e.refinement and not e.ordinary]
    disputed = [
        e for e in outcome.effects if e.disputed and not (e.refinement or e.ordinary)
    ]
    missing = [each.id for each in outcome.effects if each.missing]
    before, after = off(outcome.gap)
    told = (
        f"The repaired model is {after:.1f} times the noise floor off data held out, "
        f"the tuned scene {before:.1f} times; the weighted RMS error of "
        f"{_gap(outcome.gap)}."
    )
    if refining:
        either = listed(listed(_all(each), "or") for each in refining)
        told += (
            f" {capital(either)} refines the model, but takes too little to be called "
            "missing."
        )
    if ordinary:
        told += (
            f" {capital(_titles(ordinary))} is in the model, but no larger than uneven "
            "bends and loose ends of any conduit make."
        )
    if disputed:
        told += " " + capital(
            listed(
                f"{EFFECTS[each.id].title} is named by {share(each.agreement)} of the "
                "parts of the data only"
                for each in disputed
            )
        )
        told += ", so it may stand in for something else."
    if not (missing or disputed):
        kind, nothing = _nothing(found.after, found, limits)
        return kind, f"{nothing} {told}"
    if not missing:
        return "unknown", (
            "Something is missing, and parts of these data name different effects for "
            f"it{_impossible(found)}. {told}"
        )
    explained = 1.0 - (left - 1.0) / (misfit - 1.0) if misfit > 1.0 else 1.0
    # A model that stays far off is wrong in form; large errors are what that is about.
    little = explained < EXPLAINED or left > REACHED
    little = little and overall(outcome.gap) < CLOSED
    if left > limits.misfit and little:
        return "unknown", (
            f"Something is missing; {_titles(missing)} explains {share(explained)} of "
            f"it, and the rest is none of the effects in the library"
            f"{_impossible(found)}. {told}"
        )
    if misfit < HINT:
        told += (
            f" The tuned scene is only {number(misfit)} times the noise floor off."
            f"{_AS_MUCH}"
        )
    tied = {name for tie in outcome.ties for name in tie}
    if tied:
        sure = [name for name in missing if name not in tied]
        groups = [_titles(sure)] if sure else []
        groups += [
            listed([EFFECTS[name].title for name in tie], "or") for tie in outcome.ties
        ]
        every = ", and ".join(groups)
        return "tie", f"Missing is {every}; these data cannot tell which. {told}"
    return "named", f"Missing is {_titles(missing)}. {told}"


def _nothing(
    model: CrossValidation, found: Search, limits: Thresholds
) -> tuple[Verdict, str]:
    """The verdict where no effect is missing from this model."""
    misfit = model.misfit
    scene = "tuned scene" if model is found.before else "model"
    off = f"on data it has not seen the {scene} is {number(misfit)} times the noise "
    off += "floor off"
    usual = f"rigs without any hidden effect reach up to {limits.misfit:g}"
    if misfit <= limits.misfit:
        return "none", f"Nothing is missing: {off}; {usual}."
    if excess(model) < limits.certainty:
        return "none", (
            f"Nothing is missing that these data could show: {off}. "
            f"{capital(usual)}, but here a few moments make that error, which is "
            "no evidence."
        )
    return "unknown", (
        f"Something is missing (error {number(misfit)} times the noise floor) and it "
        f"is none of the effects in the library{_impossible(found)}; see where the "
        f"error lies.{_AS_MUCH if misfit < HINT else ''}"
    )


def _impossible(found: Search) -> str:
    """Name the effects that would do if they could be so large, in words."""
    said = [
        f"{EFFECTS[candidate.id].title} {candidate.reason}"
        for candidate in found.rounds[-1].candidates
        if candidate.reason.startswith(FITS_ONLY)
    ]
    return f"; {listed(said)}" if said else ""


def _all(found: FoundEffect) -> list[str]:
    """Return the titles of an effect and of what the data do not tell from it."""
    return [EFFECTS[name].title for name in (found.id, *found.rivals)]


def _titles(names: list[str]) -> str:
    return listed([EFFECTS[name].title for name in names])


def _gap(found: Mapping[str, Gap]) -> str:
    """Errors before and after, in words."""
    return listed(
        [
            f"the {channel(name)} "
            f"{'falls' if g.rmse_after <= g.rmse_before else 'rises'} from "
            f"{number(g.rmse_before)} to {number(g.rmse_after)} N m (noise floor "
            f"{number(g.noise_floor)})"
            for name, g in found.items()
        ]
    )
