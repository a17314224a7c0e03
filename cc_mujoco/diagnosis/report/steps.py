"""Next steps: the three things at the top of the report."""

from __future__ import annotations

from cc_mujoco.diagnosis.verdict import Diagnosis, FoundEffect
from cc_mujoco.diagnosis.wording import (
    NO_SCENE,
    NOT_IN_SCENE,
    Names,
    capital,
    fitted,
    gap_sentence,
    interval,
    plain,
    share,
)
from cc_mujoco.page import Html, bullets, element, joined, listed

AGAIN = "run the same command again"
NOWHERE = "No quantity that was recorded explains more of the error than chance does."


def steps(diagnosis: Diagnosis, names: Names) -> Html:
    """At most three: what is known and how surely, what to change, what to run."""
    told = {
        "named": _named,
        "tie": _tie,
        "none": _none,
        "unknown": _unknown,
        "fix-data": _fix,
        "fix-numerics": _fix,
    }[diagnosis.verdict](diagnosis, names)
    return bullets([step for step in told if step][:3], ranked=True)


def _named(diagnosis: Diagnosis, names: Names) -> list[Html]:
    found = [_sure(each, names) for each in diagnosis.missing]
    return [
        _step("What is missing", " ".join(found)),
        _use(diagnosis),
        _doubt(diagnosis, names),
    ]


def _tie(diagnosis: Diagnosis, names: Names) -> list[Html]:
    return [_experiment(diagnosis, names), _doubt(diagnosis, names), _use(diagnosis)]


def _none(diagnosis: Diagnosis, names: Names) -> list[Html]:
    return [_doubt(diagnosis, names), _use(diagnosis)]


def _unknown(diagnosis: Diagnosis, names: Names) -> list[Html]:
    where = next((each.statement for each in diagnosis.where), NOWHERE)
    close = [
        f"{names(each.id)} {each.reason}"
        for step in diagnosis.runner_ups[-1:]
        for each in step
        if "only with" in each.reason
    ]
    hint = f" What comes close: {listed(close)}." if close else ""
    return [
        _step("Where to look", f"{where}{hint}"),
        _step("What to check first", diagnosis.question or "Units, signs and clocks of "
              "the columns, and whether anything was changed between trials."),
        _doubt(diagnosis, names),
    ]  # fmt: skip


def _fix(diagnosis: Diagnosis, names: Names) -> list[Html]:
    first = diagnosis.problems[:2] or (diagnosis.statement,)
    return [*(_step("Put right", each) for each in first), _step("Then", _again(""))]


def _sure(found: FoundEffect, names: Names) -> str:
    # Of several sizes those count that are not 0.
    surely = {n: e for n, e in found.parameters.items() if not e.holds(0.0)}
    sizes = [
        f"{plain(name)} {fitted(each)} {each.unit}".removesuffix(" 1")
        + f" (95 %: {interval(each)})"
        for name, each in (surely or found.parameters).items()
    ]
    takes = f"It takes {share(found.share)} of the gap"
    best = f"is the best candidate in {share(found.confidence)} of resamplings"
    return f"{capital(names(found.id))}: {listed(sizes)}. {takes} and {best}."


def _use(diagnosis: Diagnosis) -> Html:
    """Describe what to change in the model."""
    if any(problem.startswith(NO_SCENE) for problem in diagnosis.problems):
        return Html()
    gaps = [gap_sentence(name, each) for name, each in list(diagnosis.gap.items())[:1]]
    lacks = [each for each in diagnosis.problems if each.startswith(NOT_IN_SCENE)]
    has = "what is missing and the tuned values" if diagnosis.effects else "what tuning"
    has += "" if diagnosis.effects else " found"
    return joined(
        [
            element("strong", "What to change: "),
            "simulate with ",
            element("code", "scene.xml"),
            f" beside this report, which has {has}. ",
            " ".join([*lacks, *gaps]) if diagnosis.effects else "",
        ]
    )


def _doubt(diagnosis: Diagnosis, names: Names) -> Html:
    """Describe what to record or to declare, in order to know more."""
    if diagnosis.question and diagnosis.verdict != "unknown":  # which asks it first
        return _step("What to settle", diagnosis.question)
    if diagnosis.strayed:
        return _step("What to settle", capital(diagnosis.strayed[0].statement))
    if diagnosis.confounded:
        each = diagnosis.confounded[0]
        return _step(
            "What these data hide",
            f"{capital(names(each.id))}, which tuning {plain(each.parameter)} would "
            f"hide: {each.remedy}; then {AGAIN}.",
        )
    weak = [names(each.id) for each in diagnosis.not_testable]
    if weak:
        return _step(
            "What these data cannot show",
            f"{capital(listed(weak))}; see below what it takes. {_again('with it')}",
        )
    return _step(
        "What to check",
        "Record one trial more, of another motion. " + _again("with it"),
    )


def _experiment(diagnosis: Diagnosis, names: Names) -> Html:
    planned = diagnosis.next_experiment
    if planned is None:
        return _step(
            "What to record",
            "No motion of the catalogue that is not among these trials would tell "
            "these apart; declare what is known of one of them, or measure it alone.",
        )
    either = names.list(planned.separates, "or")
    return _step(
        "What to record", f"{capital(planned.description)}. It tells whether it is "
        f"{either}; then {AGAIN} with it.",
    )  # fmt: skip


def _again(how: str) -> str:
    return f"{capital(AGAIN)} {how}".strip() + "."


def _step(title: str, told: str) -> Html:
    return joined([element("strong", f"{title}: "), told])
