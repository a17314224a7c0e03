"""Tables of the benchmark as rows of text: ranks, errors by condition, all scores.

Cells are Markdown: controllers are code, references are emphasised.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark import _ranking as ranking
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER, plant_key
from cc_mujoco.benchmark._ranking import Place
from cc_mujoco.benchmark._results import DeviceResults, Results, by_device
from cc_mujoco.benchmark._scores import EVERY_SCORE, ranked_score

Array = NDArray[np.float64]
Cells = tuple[list[str], list[list[str]]]
"""Titles of the columns of a table, and its rows."""


def overview_table(results: Results) -> Cells:
    """Return error, chatter, motor peak, any failures, of controllers and devices."""
    laws = dict.fromkeys(cell.controller for cell, _ in results)
    head, rows = ["controller"], {law: [controller_label(law)] for law in laws}
    for own in by_device(results):
        failed = {law: own.mean_score(law, "failed") for law in own.rms}
        some = any(failed.values())
        head += [own.label, f"{own.label}, failed"] if some else [own.label]
        ranked = ranking.rank_controllers(own.errors, plant_names(own.rms))
        places = {place.name: place for place in ranked}
        for law, row in rows.items():
            known = law in own.rms
            row.append(_with_price(own, places[law]) if known else "-")
            if some:
                row.append(f"{failed[law]:.0%}" if known else "-")
    return head, list(rows.values())


def entry_errors(rms: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return the normalised errors of the controllers without the references."""
    errors = ranking.normalise_errors(rms)
    return {name: own for name, own in errors.items() if name not in REFERENCES}


def rank_entries(rms: Mapping[str, Mapping[str, Array]]) -> list[Place]:
    """Return the places of the controllers without the references, the best first."""
    return ranking.rank_controllers(entry_errors(rms), plant_names(rms))


def ranks_table(rms: Mapping[str, Mapping[str, Array]], baseline: str) -> Cells:
    """Return the controllers without the references, the best first."""
    errors = entry_errors(rms)
    draws = ranking.bootstrap_means(errors, plant_names(rms))
    compared = baseline in errors
    head = ["rank", "controller", "error"]
    head += [f"less `{baseline}`"] if compared else []
    rows = []
    for place in rank_entries(rms):
        rank = str(place.first)
        if place.last > place.first:
            rank += f" to {place.last}"
        row = [rank, controller_label(place.name), _score_with_interval(place)]
        if compared and place.name != baseline:
            one, other = draws[place.name], draws[baseline]
            mean = place.score - float(np.mean(errors[baseline]))
            row.append(str(ranking.compare_resamples(one, other, mean)))
        elif compared:
            row.append("-")
        better = [controller_label(n) for n in errors if n in place.better_than]
        rows.append([*row, ", ".join(better) or "-"])
    return [*head, "better than"], rows


def conditions_table(own: DeviceResults) -> Cells:
    """Return the normalised errors, a row per condition, with the error that is 1."""
    laws = [law for law in own.errors if law != SCALE_CONTROLLER]
    score = ranked_score(own.played[0][1].scores)
    measure = next(one.unit for one in EVERY_SCORE if one.name == score)
    rows = []
    for place, (condition, unit) in enumerate(own.rms[SCALE_CONTROLLER].items()):
        means = [f"{np.mean(own.errors[law][place]):.2f}" for law in laws]
        units = ", ".join(f"{each:.3g}" for each in np.nanmean(unit, axis=0))
        rows.append([condition, f"{units} {measure}", *means])
    return ["condition", f"`{SCALE_CONTROLLER}`", *map(controller_label, laws)], rows


def scores_table(own: DeviceResults) -> Cells:
    """Return every score, a row per controller."""
    had = own.played[0][1].scores
    found = {
        score: {law: own.finite_scores(law, score.name) for law in own.rms}
        for score in EVERY_SCORE
        if score.name in had
    }
    found = {s: each for s, each in found.items() if any(map(np.size, each.values()))}
    rows = []
    for law in own.rms:
        cells = [controller_label(law)]
        for score, each in found.items():
            form = ".1%" if score.unit == "1" else ".3g"
            cells.append(f"{np.mean(each[law]):{form}}" if each[law].size else "-")
        rows.append(cells)
    heads = [
        score.name.replace("_", " ") + (f" [{score.unit}]" if score.unit != "1" else "")
        for score in found
    ]
    return ["controller", *heads], rows


def plants_table(own: DeviceResults) -> Cells:
    """Return the plants of the ordinary condition, or of the first, a row per seed."""
    chosen = [(c, r) for c, r in own.played if c.condition.usual] or own.played
    cell, played = next((c, r) for c, r in chosen if c.controller == SCALE_CONTROLLER)
    drawn = played.plants
    heads = ["seed", "friction", "EA [kN]", "pretension [N]", "wrap [rad]"]
    heads += ["wearer [N m/rad]", "delay [steps]", "bias of torque [N m]"]

    def both(name: str, row: int, scale: float = 1.0) -> str:
        actual, known = drawn[f"plant_{name}"][row], drawn[f"believed_{name}"][row]
        pairs = zip(actual, known, strict=True)
        return ", ".join(f"{scale * p:.3g} ({scale * b:.3g})" for p, b in pairs)

    def each(name: str, row: int, form: str = ".3g") -> str:
        return ", ".join(f"{value:{form}}" for value in drawn[f"plant_{name}"][row])

    rows = [
        [
            str(seed),
            both("friction", row),
            both("axial_stiffness", row, 1e-3),
            both("pretension", row),
            each("wrap", row),
            each("wearer", row) or "-",
            str(drawn["plant_delay"][row]),
            each("bias", row, ".2g"),
        ]
        for row, seed in enumerate(cell.seeds)
    ]
    return heads, rows


def times_table(results: Results) -> Cells:
    """Return the median and worst time of a step, measured during the runs."""
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


def _with_price(own: DeviceResults, place: Place) -> str:
    """Return an error with its price: chatter [mN m] and motor peak [N m]."""
    chatter = own.mean_score(place.name, "chatter")
    peak = own.mean_score(place.name, "peak_motor_torque")
    error = _score_with_interval(place)
    if math.isnan(chatter) or math.isnan(peak):  # it gave no torque in any episode
        return f"{error}, -, -"
    return f"{error}, {1e3 * chatter:.3g}, {peak:.2g}"


def plant_names(rms: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """Return the names of the plants of every condition."""
    return [plant_key(condition) for condition in rms[SCALE_CONTROLLER]]


def controller_label(law: str) -> str:
    return f"*{law}*" if law in REFERENCES else f"`{law}`"


def _score_with_interval(place: Place) -> str:
    if math.isnan(place.low):
        return f"{place.score:.3f}"
    return f"{place.score:.3f} ({place.low:.3f} to {place.high:.3f})"
