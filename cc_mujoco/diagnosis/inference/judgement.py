"""The verdict: what a search, the gap that it closed and what was tuned come to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.diagnosis.inference.agreement import REACHED
from cc_mujoco.diagnosis.inference.folds import CrossValidation, excess
from cc_mujoco.diagnosis.inference.gap import overall
from cc_mujoco.diagnosis.inference.plausibility import FITS_ONLY
from cc_mujoco.diagnosis.inference.search import Search, Thresholds
from cc_mujoco.diagnosis.verdict import Found, Gap, Strayed, Verdict
from cc_mujoco.diagnosis.wording import capital, channel, number, share
from cc_mujoco.page import listed

EXPLAINED = 0.6
"""Share of the error beyond the floor that named effects have to take, or else the gap.

In the search large errors count less, since few moments must not decide what is named;
an effect that shows in few moments only closes the gap without taking that share.
"""

CLOSED = 0.75
"""Share of the gap that an effect has to close which takes less than `EXPLAINED`."""

REFINES = 0.1
"""Share of the baseline's gap below which an effect only refines the others."""

HINT = 1.8
"""Error over the floor below which a name is a hint: rigs whose bends and friction are
laid out otherwise than the scene's reach that without any effect."""
_AS_MUCH = " The layout of a rig can make as much: take this for a hint."


class Outcome(NamedTuple):
    """What was found once all data have been fitted.

    Attributes:
        effects: in the model.
        ties: groups of ids that the data do not tell apart.
        gap: by channel.
        strayed: parameters tuned beyond what is known of them.
    """

    effects: tuple[Found, ...]
    ties: tuple[tuple[str, ...], ...]
    gap: Mapping[str, Gap]
    strayed: tuple[Strayed, ...]


def judged(found: Search, outcome: Outcome, limits: Thresholds) -> tuple[Verdict, str]:
    """The verdict in one word and in a few sentences."""
    kind, told = _judged(found, outcome, limits)
    also = " ".join(capital(each.statement) for each in outcome.strayed)
    return kind, f"{told} {also}".strip()


def _judged(found: Search, outcome: Outcome, limits: Thresholds) -> tuple[Verdict, str]:
    misfit, left = found.before.misfit, found.after.misfit
    if not outcome.effects:
        return _nothing(found.before, found, limits)
    ordinary = [each.id for each in outcome.effects if each.ordinary]
    refining = [e.id for e in outcome.effects if e.refinement and not e.ordinary]
    disputed = [
        e for e in outcome.effects if e.disputed and not (e.refinement or e.ordinary)
    ]
    missing = [each.id for each in outcome.effects if each.missing]
    told = f"On data held out, the weighted RMS error of {_gap(outcome.gap)}."
    if refining:
        told += (
            f" {capital(_titles(refining))} refines the model, but takes too little "
            "to be called missing."
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
    explained = 1.0 - (left**2 - 1.0) / (misfit**2 - 1.0) if misfit > 1.0 else 1.0
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
    tie = next(iter(outcome.ties), ())
    if tie:
        sure = [name for name in missing if name not in tie]
        either = listed([EFFECTS[name].title for name in tie], "or")
        both = f"{_titles(sure)}, and {either}" if sure else either
        return "tie", f"Missing is {both}; these data cannot tell which. {told}"
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
    """Which effects would do if they could be so large, in words."""
    said = [
        f"{EFFECTS[candidate.id].title} {candidate.reason}"
        for candidate in found.rounds[-1].candidates
        if candidate.reason.startswith(FITS_ONLY)
    ]
    return f"; {listed(said)}" if said else ""


def _titles(names: list[str]) -> str:
    return listed([EFFECTS[name].title for name in names])


def _gap(found: Mapping[str, Gap]) -> str:
    """Errors before and after, in words."""
    return listed(
        [
            f"the {channel(name)} "
            f"{'falls' if g.rmse_after <= g.rmse_before else 'rises'} from "
            f"{number(g.rmse_before)} to {number(g.rmse_after)} Nm (noise floor "
            f"{number(g.noise_floor)})"
            for name, g in found.items()
        ]
    )
