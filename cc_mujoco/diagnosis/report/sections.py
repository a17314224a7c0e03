"""Text of each section of the report, without its figures.

A section is None where the diagnosis has nothing for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cc_mujoco.diagnosis.evidence import Evidence, Map
from cc_mujoco.diagnosis.report.drawings import shown_maps
from cc_mujoco.diagnosis.report.excerpt import Excerpt
from cc_mujoco.diagnosis.report.isolability import confounded_pairs, invisible
from cc_mujoco.diagnosis.report.steps import steps
from cc_mujoco.diagnosis.verdict import Diagnosis, RunnerUp
from cc_mujoco.diagnosis.wording import (
    MEANING,
    SIGN,
    Names,
    capital,
    channel,
    fitted,
    gap_sentence,
    headline,
    interval,
    number,
    plain,
    share,
    tried,
)
from cc_mujoco.estimation.least_squares import Estimate
from cc_mujoco.page import (
    Html,
    bar,
    bullets,
    element,
    joined,
    listed,
    paragraph,
    table,
)


def header(diagnosis: Diagnosis, names: Names) -> Html:
    """The verdict: in one line, what to do next, its own words and what they mean."""
    return element(
        "header",
        paragraph("Diagnosis of a cable transmission", kind="small"),
        element("h1", headline(diagnosis, names)),
        steps(diagnosis, names),
        paragraph(diagnosis.statement),
        paragraph(
            " ".join(
                each
                for each in (
                    tried(diagnosis) if diagnosis.verdict == "unknown" else "",
                    MEANING[diagnosis.verdict],
                )
                if each
            )
        ),
    )


def gap(diagnosis: Diagnosis) -> Html | None:
    """Errors on held-out data in sentences."""
    if not diagnosis.gap:
        return None
    key = (
        "All errors are those on data that were not used for fitting. The simulation "
        "before has no new effect, but everything that can be tuned is tuned; the "
        "noise floor is what the noise of the sensors makes of it, an estimate. "
        "Samples are weighted by how well the angles tell the torque: where an end of "
        "the cable sticks, the last digit of an angle is worth newtons, and plain "
        "errors there, as in the traces, are several times larger."
    )
    lines = [gap_sentence(name, each) for name, each in diagnosis.gap.items()]
    return joined([bullets(lines), paragraph(key, kind="small")])


def trials(diagnosis: Diagnosis) -> Html | None:
    """Errors of every trial, the worst first."""
    if len(diagnosis.trials) < 2:
        return None
    both = bool(diagnosis.effects)
    shown = "misfit_after" if both else "misfit_before"
    ranked = sorted(diagnosis.trials, key=lambda each: -getattr(each, shown))

    def change(before: float, after: float, floor: float = float("nan")) -> str:
        sizes = (before, after) if both else (before,)
        return " to ".join(number(size, floor) for size in sizes)

    rows = [
        (
            element("code", each.trial),
            change(each.misfit_before, each.misfit_after),
            *(
                change(
                    each.rmse_before[name],
                    each.rmse_after[name],
                    each.noise_floor[name],
                )
                for name in each.rmse_before
            ),
        )
        for each in ranked
    ]
    torques = [f"{channel(name)} [N m]" for name in diagnosis.trials[0].rmse_before]
    key = (
        "Trials are predicted by parameters that were fitted to others, or where they "
        "are few to other parts of them. First all torques over the noise floor, then "
        "the weighted RMS error of each"
        + ("; before and after effects were added." if both else ".")
    )
    head = ("trial", "over the floor", *torques)
    return joined([table(head, rows), paragraph(key, kind="small")])


def where(diagnosis: Diagnosis) -> Html | None:
    """Return where the error lies, the main sentence first."""
    if not diagnosis.where:
        return None
    items = []
    for each in diagnosis.where:
        note = (
            f" ({channel(each.channel)} over {plain(each.axis)}: "
            f"{share(each.share_of_error)} of its variance)"
        )
        if each.axis == "channel":  # the main sentence, which has its numbers
            note = ""
        items.append(joined([each.statement, element("span", note, class_="small")]))
    return bullets(items, ranked=True)


def maps(evidence: Evidence) -> Html | None:
    """Words on the maps that are drawn and on those that are not."""
    if not evidence.maps:
        return None
    drawn = shown_maps(evidence)
    chance = [each for each in evidence.maps if not each.share > each.chance]
    if len(chance) == len(evidence.maps):
        return paragraph("No map shows more than chance would; the largest are drawn.")
    text = (
        f"{SIGN} Titles give the share of the variance of the baseline's error that a "
        "quantity explains. Chance keeps the mean error within the grey band in 95 % "
        "of cases."
    )
    hidden = [e for e in evidence.maps if not any(e is d for d in drawn)]
    weaker = [each for each in hidden if each.share > each.chance]
    more = [
        f"{words}: {listed(map(_map_words, group))}."
        for words, group in (
            ("Beyond chance, but weaker than those drawn", weaker),
            ("No more than chance", chance),
        )
        if group
    ]
    return joined([paragraph(text), *(paragraph(each, kind="small") for each in more)])


def excerpt_caption(excerpt: Excerpt, worst: bool) -> str:
    """Describe what an excerpt shows and why it was chosen."""
    time = excerpt.trace.time[excerpt.part]
    span = f"Trial {excerpt.trace.trial}, {time[0]:.1f} s to {time[-1]:.1f} s"
    size = f"{number(excerpt.error)} times its RMS error over all trials"
    if worst:
        told = f"{span}: the seconds in which the baseline errs most, {size}."
        return f"{told} {SIGN}"
    return f"{span}: ordinary seconds, the baseline errs by {size}."


def candidates(diagnosis: Diagnosis, names: Names) -> Html | None:
    """Every effect that was refitted, what it removed and why it was not named."""
    rounds = [each for each in diagnosis.runner_ups if each]
    if not rounds:
        told = tried(diagnosis)
        return paragraph(told) if told else None
    parts: list[Html] = []
    for count, each in enumerate(rounds, start=1):
        if len(rounds) > 1:
            parts.append(element("h3", f"Round {count}"))
        ranked = sorted(each, key=lambda runner: -runner.reduction)
        rows = [_candidate(runner, diagnosis, names) for runner in ranked]
        head = ("effect", "held-out error removed", "outcome", "fitted values [SI]")
        parts.append(table(head, rows))
    key = (
        "Error removed: of the sum of squares; negative where an effect makes it worse."
    )
    return joined([*parts, paragraph(key, kind="small")])


def likeness(evidence: Evidence, names: Names) -> Html | None:
    """Describe which effects are alike, and which would drown in the noise."""
    if not evidence.isolability.ids:
        return None
    pairs = [
        f"{names(one)} and {names(other)} ({alike:.2f})"
        for one, other, alike in confounded_pairs(evidence.isolability)
    ]
    weak = invisible(evidence.isolability)
    lines = ["These data tell all effects apart."]
    if pairs:
        lines = [f"These data can hardly tell apart {listed(pairs)}."]
    if weak:
        lines.append(f"Smaller than the noise, if present: {names.list(weak)}.")
    return bullets(lines)


def untested(diagnosis: Diagnosis, names: Names) -> Html | None:
    """Effects that the data cannot show, and why."""
    if not diagnosis.not_testable:
        return None
    return bullets(
        joined([element("strong", capital(names(each.id))), f": {each.reason}"])
        for each in diagnosis.not_testable
    )


def experiment(diagnosis: Diagnosis, names: Names) -> Html | None:
    """Describe what to record next."""
    planned = diagnosis.next_experiment
    if planned is None:
        return None
    lines = (
        planned.description,
        f"It separates {names.list(planned.separates)}.",
        f"Predicted difference: {planned.predicted_difference}",
    )
    return joined(map(paragraph, lines))


def parameters(diagnosis: Diagnosis, names: Names) -> Html | None:
    """Fitted numbers of effects and baseline with their intervals."""
    parts: list[Html] = []
    for found in diagnosis.effects:
        title = capital(names(found.id))
        if found.refinement:
            title += f" (refines; takes {share(found.share)} of the gap)"
        elif found.ordinary:
            title += " (no more than any rig may have)"
        parts += [element("h3", title), _values(found.parameters)]
    if diagnosis.baseline.parameters:
        parts += [element("h3", "Baseline"), _values(diagnosis.baseline.parameters)]
    if diagnosis.baseline.not_identifiable:
        parts.append(element("h3", "What the data do not determine"))
        parts.append(bullets(diagnosis.baseline.not_identifiable))
    return joined(parts) if parts else None


def problems(diagnosis: Diagnosis) -> Html:
    """Describe what is wrong with the data or the numerics."""
    if not diagnosis.problems:
        return paragraph("No problem of the data or of the numerics was found.")
    return bullets(diagnosis.problems)


def provenance(diagnosis: Diagnosis) -> Html | None:
    """Describe from what, by what and how this was made."""
    return _nested(diagnosis.provenance) if diagnosis.provenance else None


def _map_words(each: Map) -> str:
    return f"{channel(each.channel)} over {plain(each.axis)} ({share(each.share)})"


def _candidate(
    runner: RunnerUp, diagnosis: Diagnosis, names: Names
) -> Sequence[str | Html]:
    removed = joined([share(runner.reduction), bar(runner.reduction)])
    named = any(runner.id == found.id for found in diagnosis.effects)
    tied = any(runner.id in group for group in diagnosis.ties)
    outcome = "would do by itself" if runner.accepted else "not accepted"
    if runner.accepted and (named or tied):
        outcome = "tied" if tied else "added"
    if runner.reason:
        outcome += f": {runner.reason}"
    values = [f"{plain(k)} {number(v)}" for k, v in runner.parameters.items()]
    return capital(names(runner.id)), removed, outcome, ", ".join(values)


def _values(values: Mapping[str, Estimate]) -> Html:
    rows = [
        (plain(name), fitted(each), each.unit or "1", interval(each))
        for name, each in values.items()
    ]
    return table(("parameter", "value", "unit", "95 % interval"), rows)


def _nested(value: Any) -> Html:
    """A mapping as a table, with tables inside it."""
    if isinstance(value, Mapping):
        rows = [(str(key), _nested(item)) for key, item in value.items()]
        return table(("what", "value"), rows)
    if isinstance(value, list | tuple):
        return bullets(_nested(item) for item in value)
    return element("code", str(value))
