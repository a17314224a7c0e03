"""Text of each section of the report, without its figures.

A section is None where the diagnosis has nothing for it. `_report.output` sets titles
and order.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from cc_mujoco.diagnosis._phrases import (
    DATA_PREFIX,
    NO_SCENE_PREFIX,
    NOT_IN_SCENE_PREFIX,
    SIGN_NOTE,
    VERDICT_MEANINGS,
    capitalise,
    channel_name,
    class_statement,
    continue_command,
    effect_name,
    effect_names,
    format_fitted,
    format_interval,
    format_number,
    format_share,
    gap_sentence,
    headline,
    plain_name,
    tried_sentence,
)
from cc_mujoco.diagnosis._report import drawings
from cc_mujoco.diagnosis._report.drawings import Excerpt
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Diagnosis, Event, Evidence, RunnerUp
from cc_mujoco.estimation._least_squares import Estimate
from cc_mujoco.report._html import (
    Html,
    bullet_list,
    element,
    folded,
    join_pieces,
    list_words,
    paragraph,
    share_bar,
    short_table,
    table,
)

MOTOR_ONLY = (
    "one trial with the cables off (`unhooked = true`): what is left then is the motor "
    "and its sensor"
)
JOINT_ONLY = (
    "one trial with the cables off and the joint moved by hand (`unhooked = true`): "
    "what is left then is the joint and its sensor"
)
CABLE_ALONE = (
    'one trial with the joint held fast (`locked = "joint"`) at the same tensions: if '
    "the error stays, it is in the cables or the motor, else at the joint"
)
BY_AXIS = {
    "acceleration": "strokes of one top speed, short and sudden, long and gentle",
    "travel": "strokes of 1, 10 and 50 % of the range around one angle",
    "direction": "slow strokes both ways with the same load in each",
    "speed": "the same motion at half and at twice the speed, both with little tension",
    "torque": "the same motion with no load and with twice the load",
    "tension": "the same motion at half and at twice the pretension",
    "pretension": "the same motion at half and at twice the pretension",
    "angle": "slow strokes over a tenth of the range, around two different angles",
    "order": "the first trial again, now and after an hour",
    "time": "one trial of several minutes at one speed, and the first trial again",
    "temperature": "the first trial again, cold and warm, with `temperature_c`",
    "rest": "one motion with rests of 1, 10 and 60 s before each stroke",
}
"""Trials that isolate what grows with a quantity, by a word of its name."""


def four_answers(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    return [
        ("Which channel and end?", _which_end(diagnosis)),
        ("Which trials?", _which_trials(diagnosis)),
        ("Growing with what?", _growing_with(diagnosis)),
        ("What shows it alone?", capitalise(isolating_trial(diagnosis)) + "."),
    ]


def _floors(diagnosis: Diagnosis, after: bool = False) -> dict[str, float]:
    """Return the error over the noise floor by channel, the largest first."""
    sizes = {
        name: (gap.rmse_after if after else gap.rmse_before) / gap.noise_floor
        for name, gap in diagnosis.gap.items()
    }
    return dict(sorted(sizes.items(), key=lambda each: -each[1]))


def _which_end(diagnosis: Diagnosis) -> str:
    if not diagnosis.gap:
        return "No torque could be compared."
    sizes = _floors(diagnosis, bool(diagnosis.effects))
    (most, largest), *others = sizes.items()
    each = list_words(f"{channel_name(n)} {sizes[n]:.1f}" for n in diagnosis.gap)
    off = f"Errors over the noise floor: {each}."
    if not others or others[0][1] > 0.5 * largest:
        return f"{off} No single end has most of it."
    end = "motor" if most.startswith("motor") else "joint"
    return f"{off} It is mostly at the {end}'s end."


def _which_trials(diagnosis: Diagnosis) -> str:
    model = "misfit_after" if diagnosis.effects else "misfit_before"
    beyond = {  # squared error beyond noise
        trial.trial: max(getattr(trial, model) ** 2 - 1.0, 0.0)
        for trial in diagnosis.trials
    }
    whole = sum(beyond.values())
    if whole == 0.0 or len(beyond) < 2:
        return "There is one trial only."
    shares = {name: own / whole for name, own in beyond.items()}
    ranked = sorted(shares.items(), key=lambda each: -each[1])
    worst = ranked[: min(3, len(ranked) // 2)]
    words = list_words([f"{name} ({format_share(share)})" for name, share in worst])
    together = sum(share for _, share in worst)
    where = "Mostly" if together >= Limit.concentrated_share else "All of them; most"
    return f"{where} in {words}; in brackets the share of the squared error."


def _growing_with(diagnosis: Diagnosis) -> str:
    found: dict[str, float] = {}
    for each in diagnosis.where:
        if each.axis != "channel":
            found.setdefault(each.axis, each.share_of_error)
    if not found:
        return "With nothing that was recorded, beyond chance."
    ranked = sorted(found.items(), key=lambda each: -each[1])[:2]
    takes = [(plain_name(axis), format_share(share)) for axis, share in ranked]
    words = [f"{axis} ({share} of the squared error)" for axis, share in takes]
    return capitalise(list_words(words)) + "."


def isolating_trial(diagnosis: Diagnosis) -> str:
    axis = next((e.axis for e in diagnosis.where if e.axis != "channel"), "")
    for word, trial in BY_AXIS.items():
        if word in axis:
            return trial
    (worst, most), *others = [*_floors(diagnosis).items()] or [("", 0.0)]
    if not others or most < 2.0 * others[-1][1]:
        return CABLE_ALONE
    return MOTOR_ONLY if worst.startswith("motor") else JOINT_ONLY


OPEN_RECORDING = "rerun evidence.rrd"
RUN_AGAIN = "run the same command again"


def next_command(diagnosis: Diagnosis) -> Html:
    again = str(diagnosis.provenance.get("command", ""))
    written, command = _has_scene(diagnosis), again
    if diagnosis.verdict in ("named", "none"):
        command = "cc-mujoco play scene.xml" if written else OPEN_RECORDING
    elif diagnosis.verdict == "unknown":
        command = OPEN_RECORDING
    elif diagnosis.verdict == "tie" and diagnosis.occasions is None and written:
        # A diagnosis of several occasions is repeated with the trial in their folders.
        command = continue_command("NEW_TRIALS", ".", "NEW_FOLDER")
    if not command:
        return Html()
    where = "" if command == again else ", in the folder of this report"
    code = element("code", command)
    return element("p", element("strong", "Next"), f"{where}: ", code)


def _has_scene(diagnosis: Diagnosis) -> bool:
    return not any(p.startswith(NO_SCENE_PREFIX) for p in diagnosis.problems)


def next_steps(diagnosis: Diagnosis) -> Html:
    certain = []
    for found in diagnosis.missing:
        # Only sizes that are not 0 count.
        surely = {n: e for n, e in found.parameters.items() if not e.holds(0.0)}
        sizes = [
            f"{plain_name(name)} {format_fitted(each)} {each.unit}".removesuffix(" 1")
            + f" (95 %: {format_interval(each)})"
            for name, each in (surely or found.parameters).items()
        ]
        certain.append(f"{capitalise(effect_name(found.id))}: {list_words(sizes)}.")
    change, question = _model_change_step(diagnosis), _question_step(diagnosis)
    check = f"Record one more trial with another motion, and {RUN_AGAIN} with it."
    none = "No quantity that was recorded explains more of the error than chance does."
    where = next((each.statement for each in diagnosis.where), none)
    close = [each for step in diagnosis.runner_ups for each in step if each.reason]
    best = max(close, key=lambda each: each.reduction, default=None)
    if best is not None and best.reduction > 0.0:
        where += f" What comes closest: {effect_name(best.id)}, refused: {best.reason}."
    alone = f"{capitalise(isolating_trial(diagnosis))}; then {RUN_AGAIN} with it."
    usual = (
        "Units, signs and clocks of the columns, and whether anything was changed "
        "between trials."
    )
    wrong = capitalise(diagnosis.statement.removeprefix(f"{DATA_PREFIX}: "))
    again = _step_item("Then", f"{capitalise(RUN_AGAIN)}.")
    fix = [_step_item("Put right", wrong), again]
    steps = {
        "named": [_step_item("What is missing", " ".join(certain)), change, question],
        "tie": [_experiment_step(diagnosis), question, change],
        "none": [question or _step_item("What to check", check), change],
        "unknown": [
            _step_item("Where to look", where),
            _step_item("What to record", alone),
            _step_item("What to check first", diagnosis.question or usual),
        ],
    }.get(diagnosis.verdict, fix)
    return bullet_list([step for step in steps if step][:3], ranked=True)


def _model_change_step(diagnosis: Diagnosis) -> Html:
    if not _has_scene(diagnosis):
        return Html()
    added, notes = "", []
    if diagnosis.effects:
        added = "the added effects and "
        notes = [p for p in diagnosis.problems if p.startswith(NOT_IN_SCENE_PREFIX)]
        notes += [gap_sentence(n, gap) for n, gap in [*diagnosis.gap.items()][:1]]
    scene = element("code", "scene.xml")
    what = f" beside this report, which contains {added}the tuned values. "
    title = element("strong", "What to change: ")
    return join_pieces([title, "simulate with ", scene, what, " ".join(notes)])


def _question_step(diagnosis: Diagnosis) -> Html:
    question = diagnosis.question
    if not question or diagnosis.verdict == "unknown":  # which asks it first
        question = "".join(capitalise(e.statement) for e in diagnosis.deviating[:1])
    return _step_item("What to settle", question) if question else Html()


def _experiment_step(diagnosis: Diagnosis) -> Html:
    planned, title = diagnosis.next_experiment, "What to record"
    if planned is None:
        return _step_item(
            title,
            "The verdict says whether the trial that would separate them is still "
            "worked out, or what to declare or to measure instead.",
        )
    names = list_words(planned.trials)
    either = effect_names(planned.separates, "or")
    then = f"record {names}, then continue this diagnosis"
    if diagnosis.occasions is not None:
        last = diagnosis.occasions.names[-1]
        then = (
            f"record {names} among the trials of {last}, replace their "
            f"dataset.toml by that of the folder, then {RUN_AGAIN}"
        )
    return _step_item(
        title,
        f"{capitalise(planned.description.rstrip('.'))}. It shows whether it is "
        f"{either}. Folder {planned.folder} has the motion and the lines of "
        f"dataset.toml; {then}.",
    )


def _step_item(title: str, text: str) -> Html:
    return join_pieces([element("strong", f"{title}: "), text])


def _event(event: Event) -> Html:
    lines = element("pre", "\n".join(event.declaration))
    title = "The rest is judged without it. If so, declare it in these tables:"
    happened = paragraph(element("strong", "What happened: "), event.statement)
    return join_pieces([happened, folded(title, lines)])


def header(diagnosis: Diagnosis, picture: Html) -> Html:
    tried = tried_sentence(diagnosis) if diagnosis.verdict == "unknown" else ""
    return element(
        "header",
        paragraph("Diagnosis of a cable transmission", kind="small"),
        element("h1", headline(diagnosis)),
        picture,
        *map(_event, diagnosis.events),
        next_command(diagnosis),
        next_steps(diagnosis),
        *([paragraph(diagnosis.belief.statement)] if diagnosis.belief else []),
        folded(
            "The verdict in full",
            paragraph(diagnosis.statement),
            paragraph(f"{tried} {VERDICT_MEANINGS[diagnosis.verdict]}".strip()),
        ),
    )


def gap(diagnosis: Diagnosis) -> Html | None:
    if not diagnosis.gap:
        return None
    key = (
        "All errors are those on data that were not used for fitting. The simulation "
        "before has no new effect, but everything that can be tuned is tuned; the "
        "noise floor is what the noise of the sensors makes of it, an estimate. "
        "Samples are weighted by how well the angles determine the torque: where an "
        "end of the cable sticks, the last digit of an angle is worth newtons, and "
        "plain errors there, as in the traces, are several times larger."
    )
    lines = [gap_sentence(name, each) for name, each in diagnosis.gap.items()]
    return join_pieces([bullet_list(lines), paragraph(key, kind="small")])


def occasions(diagnosis: Diagnosis) -> Html | None:
    found = diagnosis.occasions
    if found is None:
        return None
    rows = [(f"{e.since} to {e.until}", capitalise(e.statement)) for e in found.changes]
    parts = [paragraph(found.statement), table(("between", "change"), rows)]
    for each in found.sizes:
        verb = "agrees" if each.agree else "does not agree"
        if not each.sizes:
            verb = "is not known to agree"
        title = f"{capitalise(effect_name(each.effect))} {verb} between occasions"
        parts += [element("h3", title), paragraph(each.statement)]
    key = (
        "The effects are shared by all occasions, and the size of each is also fitted "
        "to every occasion by itself. Friction, pretension, stiffness, offsets and "
        f"clocks have values of their own; those given below are of {found.names[-1]}."
    )
    return join_pieces([*parts, paragraph(key, kind="small")])


def trials(diagnosis: Diagnosis) -> Html | None:
    if len(diagnosis.trials) < 2:
        return None
    both = bool(diagnosis.effects)
    shown = "misfit_after" if both else "misfit_before"
    ranked = sorted(diagnosis.trials, key=lambda each: -getattr(each, shown))
    slack = any(each.slack > 0.0 for each in diagnosis.trials)

    def change(before: float, after: float, floor: float = float("nan")) -> str:
        sizes = (before, after) if both else (before,)
        return " to ".join(format_number(size, floor) for size in sizes)

    rows = []
    for each in ranked:
        errors = each.rmse_before, each.rmse_after, each.noise_floor
        misfit = change(each.misfit_before, each.misfit_after)
        sizes = (change(*(e[name] for e in errors)) for name in each.rmse_before)
        slack_share = [format_share(each.slack)] if slack else []
        rows.append((element("code", each.trial), misfit, *sizes, *slack_share))
    torques = [f"{channel_name(name)} [N m]" for name in ranked[0].rmse_before]
    key = (
        "Each trial is predicted by parameters fitted to the others or, where trials "
        "are few, to other parts of them. The second column has the error of all "
        "torques over the noise floor, the next columns the weighted RMS error of each"
        + ("; before and after the effects were added." if both else ".")
    )
    head = ("trial", "over the floor", *torques, *(["a cable slack"] if slack else []))
    return join_pieces([short_table(head, rows), paragraph(key, kind="small")])


def error_location(diagnosis: Diagnosis) -> Html | None:
    if not diagnosis.where:
        return None
    items = []
    for each in diagnosis.where:
        share, note = format_share(each.share_of_error), ""
        if each.axis != "channel" and share not in each.statement:
            note = f" ({channel_name(each.channel)} over {plain_name(each.axis)}: "
            note += f"{share} of its variance)"
        small = element("span", note, class_="small")
        items.append(join_pieces([each.statement, small]))
    note = (
        "Errors here are those of a fit to all data; on data held out, above, they are "
        "larger."
    )
    return join_pieces([bullet_list(items, ranked=True), paragraph(note, kind="small")])


def learned(diagnosis: Diagnosis) -> Html | None:
    found = diagnosis.learned
    if found is None:
        return None
    lines = [gap_sentence(name, each) for name, each in found.gap.items()]
    if not lines:
        return paragraph(found.statement)
    key = (
        "Each trial is predicted by curves that were chosen, and fitted together with "
        "the tuned values, without it."
    )
    parts = [paragraph(found.statement), bullet_list(lines)]
    return join_pieces([*parts, paragraph(key, kind="small")])


def unknown(diagnosis: Diagnosis) -> Html | None:
    if diagnosis.verdict != "unknown":
        return None
    return bullet_list(
        join_pieces([element("strong", question), f" {answer}"])
        for question, answer in four_answers(diagnosis)
    )


def maps(evidence: Evidence) -> Html | None:
    if not evidence.maps:
        return None
    real = [each for each in evidence.maps if each.share > each.chance]
    if not real:
        return paragraph("No map shows more than chance would; the largest are drawn.")
    text = (
        f"{SIGN_NOTE} Titles give the share of the variance of the baseline's error "
        "that a quantity explains. Chance keeps the mean error within the grey band in "
        "95 % of cases."
    )
    drawn = {id(each) for each in drawings.shown_maps(evidence)}
    groups = {
        "Beyond chance, but weaker than those drawn": [
            each for each in real if id(each) not in drawn
        ],
        "No more than chance": [e for e in evidence.maps if not e.share > e.chance],
    }
    parts = [paragraph(text)]
    for words, group in groups.items():
        listed = list_words(
            f"{channel_name(each.channel)} over {plain_name(each.axis)} "
            f"({format_share(each.share)})"
            for each in group
        )
        if group:
            parts.append(paragraph(f"{words}: {listed}.", kind="small"))
    return join_pieces(parts)


def excerpt_caption(excerpt: Excerpt, worst: bool) -> str:
    time = excerpt.trace.time[excerpt.part]
    span = f"Trial {excerpt.trace.trial}, {time[0]:.1f} s to {time[-1]:.1f} s"
    size = f"{format_number(excerpt.error)} times its RMS error over all trials"
    if worst:
        caption = f"{span}: the seconds in which the baseline errs most, {size}."
        return f"{caption} {SIGN_NOTE}"
    return f"{span}: ordinary seconds, the baseline errs by {size}."


def candidates(diagnosis: Diagnosis) -> Html | None:
    rounds = [each for each in diagnosis.runner_ups if each]
    if not rounds:
        summary = tried_sentence(diagnosis)
        return paragraph(summary) if summary else None
    parts: list[Html] = []
    for count, each in enumerate(rounds, start=1):
        if len(rounds) > 1:
            parts.append(element("h3", f"Round {count}"))
        ranked = sorted(each, key=lambda runner: -runner.reduction)
        rows = [_candidate_text(runner, diagnosis) for runner in ranked]
        head = ("effect", "held-out error removed", "outcome", "fitted values [SI]")
        parts.append(short_table(head, rows))
    key = (
        "Error removed: of the sum of squares; negative where an effect makes it worse."
    )
    return join_pieces([*parts, paragraph(key, kind="small")])


def effect_similarity(evidence: Evidence) -> Html | None:
    if not evidence.isolability.ids:
        return None
    pairs = [
        f"{effect_name(one)} and {effect_name(other)} ({cosine:.2f})"
        for one, other, cosine in drawings.confounded_pairs(evidence.isolability)
    ]
    lines = ["These data distinguish all effects."]
    if pairs:
        lines = [f"These data can hardly distinguish {list_words(pairs, 'or')}."]
    if weak := drawings.invisible_effects(evidence.isolability):
        lines.append(f"Smaller than the noise, if present: {effect_names(weak)}.")
    return bullet_list(lines)


def untested_effects(diagnosis: Diagnosis) -> Html | None:
    hidden = [(e.id, plain_name(e.parameter), e.remedy) for e in diagnosis.confounded]
    items = [(name, f"hidden by tuning {other}; {how}.") for name, other, how in hidden]
    items += [(e.id, f"{e.reason.rstrip('.')}.") for e in diagnosis.not_testable]
    parts = [paragraph(diagnosis.instruments)] if diagnosis.instruments else []
    if items:
        titled = [(element("strong", capitalise(effect_name(n))), t) for n, t in items]
        parts.append(bullet_list(join_pieces([n, f": {t}"]) for n, t in titled))
    return join_pieces(parts) if parts else None


def experiment(diagnosis: Diagnosis) -> Html | None:
    planned = diagnosis.next_experiment
    if planned is None:
        return None
    lines = (
        planned.description,
        f"It separates {effect_names(planned.separates)}.",
        f"Predicted difference: {planned.predicted_difference}",
    )
    return join_pieces(map(paragraph, lines))


def parameters(diagnosis: Diagnosis) -> Html | None:
    parts: list[Html] = []
    for found in diagnosis.effects:
        title = capitalise(effect_name(found.id))
        if found.form:
            title += f", {found.form}"
        if found.refinement:
            title += " (refines)"
        elif found.ordinary:
            title += " (no more than any rig may have)"
        takes = (
            f"Without it {format_share(found.share)} of the squared error above the "
            "noise floor opens again; it is the best candidate in "
            f"{format_share(found.confidence)} of resamplings."
        )
        note = paragraph(takes, kind="small")
        parts += [element("h3", title), _values(found.parameters), note]
    baseline = diagnosis.baseline
    if baseline.parameters:
        parts += [element("h3", "Baseline"), _values(baseline.parameters)]
        if diagnosis.verdict == "unknown":
            text = "Something is missing, so these hold for the tuned scene only."
            parts.append(paragraph(text, kind="small"))
    if baseline.not_identifiable:
        title = element("h3", "What the data do not determine")
        parts += [title, bullet_list(baseline.not_identifiable)]
    if diagnosis.classes:
        title = element("h3", "Causes with equal torques")
        parts += [title, bullet_list(map(class_statement, diagnosis.classes))]
    return join_pieces(parts) if parts else None


def problems(diagnosis: Diagnosis) -> Html:
    if not diagnosis.problems:
        return paragraph("No problem of the data or of the numerics was found.")
    return bullet_list(diagnosis.problems)


def _candidate_text(runner: RunnerUp, diagnosis: Diagnosis) -> Sequence[str | Html]:
    removed = join_pieces([format_share(runner.reduction), share_bar(runner.reduction)])
    named = any(runner.id == found.id for found in diagnosis.effects)
    tied = any(runner.id in group for group in diagnosis.ties)
    outcome = "helps" if runner.accepted else "not accepted"
    if runner.accepted and runner.reduction > Limit.sufficient_share:
        outcome = "would do by itself"
    if runner.accepted and (named or tied):
        outcome = "tied" if tied else "added"
    if runner.reason:
        outcome += f": {runner.reason}"
    values = [
        f"{plain_name(k)} {format_number(v)}" for k, v in runner.parameters.items()
    ]
    return capitalise(effect_name(runner.id)), removed, outcome, ", ".join(values)


def _values(values: Mapping[str, Estimate]) -> Html:
    rows = [
        (plain_name(name), format_fitted(each), each.unit or "1", format_interval(each))
        for name, each in values.items()
    ]
    return short_table(("parameter", "value", "unit", "95 % interval"), rows)


def nested_table(value: Any) -> Html:
    if isinstance(value, Mapping):
        rows = [(str(key), nested_table(item)) for key, item in value.items()]
        return table(("what", "value"), rows)
    if isinstance(value, list | tuple):
        return bullet_list(nested_table(item) for item in value)
    return element("code", str(value))
