"""Results of the benchmark in Markdown: the best in a sentence, and tables.

Tables are rows of text with Markdown in their cells: controllers are set as code,
references emphasised.
"""

import math
import shlex
from collections.abc import Container, Mapping

import numpy as np

from cc_mujoco.benchmark import _ranking as ranking
from cc_mujoco.benchmark._cell import CUT_SHARE, EVERY_SCORE, FAILURE, ranked_score
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER, plant_key
from cc_mujoco.benchmark._ranking import Place
from cc_mujoco.benchmark._results import (
    DeviceResults,
    Errors,
    Results,
    by_device,
    rms_errors,
)
from cc_mujoco.benchmark._training import KEY as TRAINED_ON
from cc_mujoco.benchmark._training import NOT_STATED
from cc_mujoco.device import find_device
from cc_mujoco.device._description import device_label
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.report._html import list_words
from cc_mujoco.report._markdown import table

Cells = tuple[list[str], list[list[str]]]  # titles of columns, and rows

DEFAULT_BASELINE = "pi"
OVERVIEW_HEADING = (
    "Normalised error (`none` is 1, the smaller the better), mean over conditions and "
    "seeds with its 95 % interval, chatter [mN m] and motor peak [N m]; and failed "
    "episodes, if any:"
)
TIMES_TITLE = "Computing time of a step of one device"


def device_tables(own: DeviceResults, baseline: str) -> list[tuple[str, Cells]]:
    """Return (heading, table) pairs of a device: ranks, conditions, scores."""
    return [
        (
            "Ranks; a controller is better than another where the interval of their "
            "difference leaves out 0, for all pairs at once:",
            ranks_table(own.rms, baseline),
        ),
        ("Normalised error by condition, mean over seeds:", conditions_table(own)),
        ("All scores, mean over conditions and seeds:", scores_table(own)),
    ]


def summary(results: Results, baseline: str = DEFAULT_BASELINE) -> str:
    """Return the best controller of each device and an overview, as Markdown."""
    parts = [
        best_sentence(results, baseline),
        f"Next: `{next_command(results)}`",
        OVERVIEW_HEADING,
        table(*overview_table(results)),
        *divergence_sentences(results),
        *cut_sentences(results),
        *assumed_limits(results),
    ]
    return "\n\n".join(parts)


def best_sentence(results: Results, baseline: str = DEFAULT_BASELINE) -> str:
    errors = rms_errors(results)
    parts = [_best_at(scene, own, baseline) for scene, own in errors.items()]
    shown = parts[:5]
    if parts[5:]:
        shown.append(f"{len(parts) - 5} more devices")
    seeds = len(results[0][0].seeds)
    scale = f"{SCALE_CONTROLLER}` is 1; {seeds} seed{'s' if seeds > 1 else ''}"
    return f"{'; '.join(shown)} (error of `{scale})."


def _best_at(scene: str, rms: Mapping[str, Mapping[str, Array]], baseline: str) -> str:
    best, *others = rank_entries(rms)
    known = {place.name: f"{place.score:.3g}" for place in others}
    equal = [f"`{n}` ({known[n]})" for n in known if n not in best.better_than]
    text = f"`{best.name}` has the least error at {scene}, {best.score:.3g}"
    if others and not equal:
        text = f"`{best.name}` wins at {scene} with an error of {best.score:.3g}"
    elif equal and not math.isnan(best.low):
        if len(equal) > 3:  # too many names for a sentence
            equal = [f"{len(equal)} others"]
        return f"{text}, not significantly below {list_words(equal, 'or')}"
    return f"{text} (`{baseline}`: {known[baseline]})" if baseline in known else text


def next_command(results: Results) -> str:
    first = by_device(results)[0]
    scene, best = first.played[0][0].condition.scene, rank_entries(first.rms)[0]
    return shlex.join(["cc-mujoco", "play", scene, "--controller", best.name])


def divergence_sentences(results: Results) -> list[str]:
    """Return a sentence per controller on episodes that ended early, and the reason."""
    found: dict[str, list[str]] = {}
    for cell, played in results:
        at = f"{cell.condition.label} {cell.condition.name}, seed"
        each = zip(cell.seeds, played.plants[FAILURE], strict=True)
        own = found.setdefault(cell.controller, [])
        own += [why and f"{at} {seed}: {why}" for seed, why in each]
    return [
        f"{controller_label(law)} ended {len(reasons) - reasons.count('')} of "
        f"{len(reasons)} episodes early; the first: {next(filter(None, reasons))}."
        for law, reasons in found.items()
        if any(reasons)
    ]


def cut_sentences(results: Results) -> list[str]:
    """Return a sentence per entry cut to the motor's limit: in how many steps."""
    found: dict[str, list[float]] = {}
    for cell, played in results:
        found.setdefault(cell.controller, []).extend(played.plants.get(CUT_SHARE, ()))
    return [
        f"{controller_label(law)} commanded more than the motor gives in "
        f"{100.0 * np.mean(shares):.3g} % of its steps, and was cut to that."
        for law, shares in found.items()
        if any(shares)
    ]


def assumed_limits(results: Results) -> list[str]:
    """Return a sentence per device whose description gives no `safe_torque`."""
    found = []
    for scene in dict.fromkeys(cell.condition.scene for cell, _ in results):
        axes = [a for a in find_device(scene).description.axes if a.safe_is_assumed]
        if limits := [f"{a.safe_torque:g} N m at joint {a.joint}" for a in axes]:
            found.append(
                f"The safe torque of device {device_label(scene)} is assumed: "
                f"{', '.join(limits)}, or twice what the task demands, if that is "
                "more; `safe_torque` in its description gives another."
            )
    return found


def reference_definitions(names: Container[str]) -> list[str]:
    return [f"- *{n}*: {one.meaning}" for n, one in REFERENCES.items() if n in names]


def definitions(results: Results) -> str:
    laws = {cell.controller for cell, _ in results}
    scores = results[0][1].scores
    lines = reference_definitions(laws)
    lines.append(
        f"- `error` [1]: `{ranked_score(scores)}` over the mean of that of `none` in "
        "the same condition, at most 10, which an episode that diverged has"
    )
    lines += [
        f"- `{s.name}` [{s.unit}]: {s.meaning}" for s in EVERY_SCORE if s.name in scores
    ]
    return "\n".join(lines)


def comparison(errors: Errors, differing: list[str]) -> str:
    parts = ["# Two results compared"]
    if differing:
        parts.append(f"What made them differs in {', '.join(differing)}.")
    for scene, own in errors.items():
        parts += [f"## {scene}", table(*ranks_table(own, SCALE_CONTROLLER))]
    return "\n\n".join(parts) + "\n"


def training(results: Results) -> dict[str, list[str]]:
    """Return the effects in the training of each policy; empty without policies."""
    found = {c.controller: r.plants.get(TRAINED_ON) for c, r in results}
    return {law: each[0].split(", ") for law, each in found.items() if each}


def _unseen(own: DeviceResults, trained: Container[str]) -> list[bool]:
    """Return whether the effect of each condition is in no training, () of ordinary."""
    if NOT_STATED in trained:
        return [False] * len(own.rms[SCALE_CONTROLLER])
    effects = {c.condition.name: c.condition.structure for c, _ in own.played}
    return [bool(e) and e not in trained for e in effects.values()]


def overview_table(results: Results) -> Cells:
    """Return error, chatter, motor peak and failures, by controller and device.

    If policies play, columns state what they were trained on, and the mean error over
    conditions whose effect none of them was trained on.
    """
    laws = dict.fromkeys(cell.controller for cell, _ in results)
    head, rows = ["controller"], {law: [controller_label(law)] for law in laws}
    taught = training(results)
    if taught:
        head.append("trained on")
        for law, row in rows.items():
            effects = taught.get(law, ["-"])
            many = f"{len(effects)} effects"
            row.append(", ".join(effects) if len(effects) < 4 else many)
    for own in by_device(results):
        failed = {law: own.mean_score(law, "failed") for law in own.rms}
        some = any(failed.values())
        head += [own.label, f"{own.label}, failed"] if some else [own.label]
        ranked = ranking.rank_controllers(own.errors, plant_names(own.rms))
        places = {place.name: place for place in ranked}
        for law, row in rows.items():
            known, text = law in own.rms, "-"
            if known:  # the error with its price: chatter [mN m] and motor peak [N m]
                costs = "chatter", "peak_motor_torque"
                chatter, peak = (own.mean_score(law, cost) for cost in costs)
                is_driven = not (math.isnan(chatter) or math.isnan(peak))
                price = f"{1e3 * chatter:.3g}, {peak:.2g}" if is_driven else "-, -"
                text = f"{places[law]}, {price}"
            row.append(text)
            if some:
                row.append(f"{failed[law]:.0%}" if known else "-")
        if taught:
            unseen = _unseen(own, set().union(*taught.values()))
            head.append(f"{own.label}, unseen effects")
            for law, row in rows.items():
                shown = any(unseen) and law in own.errors
                row.append(f"{np.mean(own.errors[law][unseen]):.3f}" if shown else "-")
    return head, list(rows.values())


def entry_errors(rms: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    errors = ranking.normalise_errors(rms)
    return {name: own for name, own in errors.items() if name not in REFERENCES}


def rank_entries(rms: Mapping[str, Mapping[str, Array]]) -> list[Place]:
    return ranking.rank_controllers(entry_errors(rms), plant_names(rms))


def ranks_table(rms: Mapping[str, Mapping[str, Array]], baseline: str) -> Cells:
    """Return a table of all controllers but references by rank, the best first."""
    errors = entry_errors(rms)
    plants = plant_names(rms)
    compared = baseline in errors
    head = ["rank", "controller", "error"]
    head += [f"less `{baseline}`"] if compared else []
    rows = []
    for place in rank_entries(rms):
        rank = str(place.first)
        if place.last > place.first:
            rank += f" to {place.last}"
        row = [rank, controller_label(place.name), str(place)]
        if compared and place.name != baseline:
            less = errors[place.name] - errors[baseline]
            row.append(str(ranking.mean_interval(less, plants)))
        elif compared:
            row.append("-")
        better = [controller_label(n) for n in errors if n in place.better_than]
        rows.append([*row, ", ".join(better) or "-"])
    return [*head, "better than"], rows


def conditions_table(own: DeviceResults) -> Cells:
    """Return normalised errors, a row per condition, with the RMS error of `none`.

    Those of a policy that was trained on the effect are marked as seen.
    """
    laws = [law for law in own.errors if law != SCALE_CONTROLLER]
    score = ranked_score(own.played[0][1].scores)
    taught = training(own.played)
    unseen = {law: _unseen(own, effects) for law, effects in taught.items()}
    measure = next(one.unit for one in EVERY_SCORE if one.name == score)
    rows = []
    for place, (condition, unit) in enumerate(own.rms[SCALE_CONTROLLER].items()):
        means = [
            f"{np.mean(own.errors[law][place]):.2f}"
            + ("" if law not in taught or unseen[law][place] else " (seen)")
            for law in laws
        ]
        units = ", ".join(f"{each:.3g}" for each in np.nanmean(unit, axis=0))
        rows.append([condition, f"{units} {measure}", *means])
    return ["condition", f"`{SCALE_CONTROLLER}`", *map(controller_label, laws)], rows


def scores_table(own: DeviceResults) -> Cells:
    had = [score for score in EVERY_SCORE if score.name in own.played[0][1].scores]
    found = {s: {law: own.finite_scores(law, s.name) for law in own.rms} for s in had}
    found = {s: each for s, each in found.items() if any(map(np.size, each.values()))}
    rows = []
    for law in own.rms:
        cells = [controller_label(law)]
        for score, each in found.items():
            form = ".1%" if score.unit == "1" else ".3g"
            cells.append(f"{np.mean(each[law]):{form}}" if each[law].size else "-")
        rows.append(cells)
    units = {score: f" [{score.unit}]" if score.unit != "1" else "" for score in found}
    heads = [score.name.replace("_", " ") + unit for score, unit in units.items()]
    return ["controller", *heads], rows


def times_table(results: Results) -> Cells:
    """Return the median and worst computing time of each controller's step."""
    scenes: dict[str, dict[str, str]] = {}
    for cell, played in results:
        median = played.plants.get("step_median_s", [None])[0]
        worst = played.plants.get("step_worst_s", [None])[0]
        if median is not None and worst is not None:
            times = f"{1e6 * median:.0f} µs, {1e6 * worst:.0f} µs"
            scenes.setdefault(cell.condition.label, {})[cell.controller] = times
    laws = dict.fromkeys(law for own in scenes.values() for law in own)
    rows = [
        [controller_label(law), *(own.get(law, "-") for own in scenes.values())]
        for law in laws
    ]
    heads = [f"{scene}: median, worst" for scene in scenes]
    return ["controller", *heads], rows


def plant_names(rms: Mapping[str, Mapping[str, Array]]) -> list[str]:
    return [plant_key(condition) for condition in rms[SCALE_CONTROLLER]]


def controller_label(law: str) -> str:
    return f"*{law}*" if law in REFERENCES else f"`{law}`"
