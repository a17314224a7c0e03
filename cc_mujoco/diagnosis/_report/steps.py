"""Next steps: the command and the things to do at the top of the report."""

from __future__ import annotations

from cc_mujoco.diagnosis._phrases import (
    DATA_PREFIX,
    NO_SCENE_PREFIX,
    NOT_IN_SCENE_PREFIX,
    Names,
    capitalise,
    continue_command,
    format_fitted,
    format_interval,
    gap_sentence,
    plain_name,
)
from cc_mujoco.diagnosis._report.unknown import isolating_trial
from cc_mujoco.diagnosis._verdict import Diagnosis, FoundEffect, next_folder
from cc_mujoco.report._html import Html, bullet_list, element, join_pieces, list_words

OPEN_RECORDING = "rerun evidence.rrd"
CONTINUE = continue_command("NEW_TRIALS", ".", "NEW_FOLDER")
RUN_AGAIN = "run the same command again"
NO_LOCATION = (
    "No quantity that was recorded explains more of the error than chance does."
)


def next_command(diagnosis: Diagnosis) -> Html:
    """Return the command to run next, in the folder of the report."""
    again = str(diagnosis.provenance.get("command", ""))
    written = not any(p.startswith(NO_SCENE_PREFIX) for p in diagnosis.problems)
    command = {
        "named": "cc-mujoco play scene.xml" if written else OPEN_RECORDING,
        "none": "cc-mujoco play scene.xml" if written else OPEN_RECORDING,
        # A diagnosis of several occasions is run again with the trial in their folders.
        "tie": again if diagnosis.occasions is not None or not written else CONTINUE,
        "unknown": OPEN_RECORDING,
        "fix-data": again,
        "fix-numerics": again,
    }[diagnosis.verdict]
    if not command:
        return Html()
    where = "" if command == again else ", in the folder of this report"
    return element(
        "p", element("strong", "Next"), f"{where}: ", element("code", command)
    )


def next_steps(diagnosis: Diagnosis, names: Names) -> Html:
    """Return at most three steps: the finding and its certainty, a change, a run."""
    steps_of_verdict = {
        "named": _steps_if_named,
        "tie": _steps_if_tied,
        "none": _steps_if_none,
        "unknown": _steps_if_unknown,
        "fix-data": _steps_to_fix,
        "fix-numerics": _steps_to_fix,
    }[diagnosis.verdict](diagnosis, names)
    return bullet_list([step for step in steps_of_verdict if step][:3], ranked=True)


def _steps_if_named(diagnosis: Diagnosis, names: Names) -> list[Html]:
    found = [_certainty_sentence(each, names) for each in diagnosis.missing]
    return [
        _step_item("What is missing", " ".join(found)),
        _model_change_step(diagnosis),
        _question_step(diagnosis),
    ]


def _steps_if_tied(diagnosis: Diagnosis, names: Names) -> list[Html]:
    return [
        _experiment_step(diagnosis, names),
        _question_step(diagnosis),
        _model_change_step(diagnosis),
    ]


def _steps_if_none(diagnosis: Diagnosis, names: Names) -> list[Html]:
    check = f"Record one more trial with another motion, and {RUN_AGAIN} with it."
    return [
        _question_step(diagnosis) or _step_item("What to check", check),
        _model_change_step(diagnosis),
    ]


def _steps_if_unknown(diagnosis: Diagnosis, names: Names) -> list[Html]:
    where = next((each.statement for each in diagnosis.where), NO_LOCATION)
    close = [each for step in diagnosis.runner_ups for each in step if each.reason]
    best = max(close, key=lambda each: each.reduction, default=None)
    hint = ""
    if best is not None and best.reduction > 0.0:
        hint = f" What comes closest: {names(best.id)}, refused: {best.reason}."
    return [
        _step_item("Where to look", f"{where}{hint}"),
        _step_item(
            "What to record",
            f"{capitalise(isolating_trial(diagnosis))}; then {RUN_AGAIN} with it.",
        ),
        _step_item(
            "What to check first",
            diagnosis.question
            or "Units, signs and clocks of "
            "the columns, and whether anything was changed between trials.",
        ),
    ]


def _steps_to_fix(diagnosis: Diagnosis, names: Names) -> list[Html]:
    wrong = capitalise(diagnosis.statement.removeprefix(f"{DATA_PREFIX}: "))
    return [
        _step_item("Put right", wrong),
        _step_item("Then", f"{capitalise(RUN_AGAIN)}."),
    ]


def _certainty_sentence(found: FoundEffect, names: Names) -> str:
    # Of several sizes those count that are not 0.
    surely = {n: e for n, e in found.parameters.items() if not e.holds(0.0)}
    sizes = [
        f"{plain_name(name)} {format_fitted(each)} {each.unit}".removesuffix(" 1")
        + f" (95 %: {format_interval(each)})"
        for name, each in (surely or found.parameters).items()
    ]
    return f"{capitalise(names(found.id))}: {list_words(sizes)}."


def _model_change_step(diagnosis: Diagnosis) -> Html:
    """Describe the change of the model."""
    if any(problem.startswith(NO_SCENE_PREFIX) for problem in diagnosis.problems):
        return Html()
    gaps = [gap_sentence(name, each) for name, each in list(diagnosis.gap.items())[:1]]
    lacks = [
        each for each in diagnosis.problems if each.startswith(NOT_IN_SCENE_PREFIX)
    ]
    added = "the added effects and " if diagnosis.effects else ""
    return join_pieces(
        [
            element("strong", "What to change: "),
            "simulate with ",
            element("code", "scene.xml"),
            f" beside this report, which contains {added}the tuned values. ",
            " ".join([*lacks, *gaps]) if diagnosis.effects else "",
        ]
    )


def _question_step(diagnosis: Diagnosis) -> Html:
    """Ask about a trial or a value that contradicts the rest; empty without one."""
    if diagnosis.question and diagnosis.verdict != "unknown":  # which asks it first
        return _step_item("What to settle", diagnosis.question)
    if diagnosis.strayed:
        return _step_item("What to settle", capitalise(diagnosis.strayed[0].statement))
    return Html()


def _experiment_step(diagnosis: Diagnosis, names: Names) -> Html:
    planned = diagnosis.next_experiment
    if planned is None:
        return _step_item(
            "What to record",
            "No trial of the catalogue that is not among these would separate them; "
            "the verdict says what to declare or to measure instead.",
        )
    either = names.list(planned.separates, "or")
    then = f"record it as {planned.trial}, then continue this diagnosis with it"
    if diagnosis.occasions is not None:
        last = diagnosis.occasions.names[-1]
        then = (
            f"record it as {planned.trial} among the trials of {last}, replace their "
            f"dataset.toml by that of the folder, then {RUN_AGAIN}"
        )
    return _step_item(
        "What to record",
        f"{capitalise(planned.description.rstrip('.'))}. It shows whether it is "
        f"{either}. Folder "
        f"{next_folder(planned)} has the motion and the lines of dataset.toml; "
        f"{then}.",
    )


def _step_item(title: str, text: str) -> Html:
    return join_pieces([element("strong", f"{title}: "), text])
