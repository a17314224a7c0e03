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
from cc_mujoco.benchmark._results import Results, rms_errors
from cc_mujoco.benchmark._scores import EVERY_SCORE, ranked_score

Array = NDArray[np.float64]
Cells = tuple[list[str], list[list[str]]]
"""Titles of the columns of a table, and its rows."""


def overview_table(results: Results) -> Cells:
    """Return error, chatter, motor peak, any failures, of controllers and devices."""
    errors = rms_errors(results)
    laws = dict.fromkeys(cell.controller for cell, _ in results)
    head, rows = ["controller"], {law: [controller_label(law)] for law in laws}
    for scene, own in errors.items():
        failed = {law: mean_score(results, scene, law, "failed") for law in own}
        some = any(failed.values())
        head += [scene, f"{scene}, failed"] if some else [scene]
        places = {
            p.name: p
            for p in ranking.rank_controllers(
                ranking.normalise_errors(own, SCALE_CONTROLLER), plant_names(own)
            )
        }
        for law, row in rows.items():
            known = law in own
            row.append(_with_price(results, scene, places[law]) if known else "-")
            if some:
                row.append(f"{failed[law]:.0%}" if known else "-")
    return head, list(rows.values())


def entry_errors(rms: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return the normalised errors of the controllers without the references."""
    errors = ranking.normalise_errors(rms, SCALE_CONTROLLER)
    return {name: own for name, own in errors.items() if name not in REFERENCES}


def rank_entries(rms: Mapping[str, Mapping[str, Array]]) -> list[ranking.Place]:
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
            mean = place.score - float(np.mean(errors[baseline]))
            row.append(
                str(ranking.compare_resamples(draws[place.name], draws[baseline], mean))
            )
        elif compared:
            row.append("-")
        better = [controller_label(n) for n in errors if n in place.better_than]
        rows.append([*row, ", ".join(better) or "-"])
    return [*head, "better than"], rows


def conditions_table(results: Results, scene: str) -> Cells:
    """Return the normalised errors, a row per condition, with the error that is 1."""
    rms = rms_errors(results)[scene]
    errors = ranking.normalise_errors(rms, SCALE_CONTROLLER)
    laws = [law for law in errors if law != SCALE_CONTROLLER]
    score = next(
        ranked_score(r.scores) for c, r in results if c.condition.label == scene
    )
    measure = next(one.unit for one in EVERY_SCORE if one.name == score)
    rows = []
    for place, (condition, unit) in enumerate(rms[SCALE_CONTROLLER].items()):
        means = [f"{np.mean(errors[law][place]):.2f}" for law in laws]
        units = ", ".join(f"{own:.3g}" for own in np.nanmean(unit, axis=0))
        rows.append([condition, f"{units} {measure}", *means])
    return ["condition", f"`{SCALE_CONTROLLER}`", *map(controller_label, laws)], rows


def scores_table(results: Results, scene: str) -> Cells:
    """Return every score, a row per controller."""
    found: dict[str, dict[str, list[Array]]] = {}
    for cell, played in results:
        if cell.condition.label == scene:
            own = found.setdefault(cell.controller, {})
            for name, values in played.scores.items():
                own.setdefault(name, []).append(values)
    telling = {
        score.name
        for score in EVERY_SCORE
        if any(np.isfinite(own.get(score.name, [])).any() for own in found.values())
    }
    shown = [score for score in EVERY_SCORE if score.name in telling]
    rows = []
    for law, own in found.items():
        cells = []
        for score in shown:
            values = np.concatenate(own[score.name])
            known = values[np.isfinite(values)]
            form = ".1%" if score.unit == "1" else ".3g"
            cells.append(f"{np.mean(known):{form}}" if known.size else "-")
        rows.append([controller_label(law), *cells])
    heads = [
        score.name.replace("_", " ") + (f" [{score.unit}]" if score.unit != "1" else "")
        for score in shown
    ]
    return ["controller", *heads], rows


def plants_table(results: Results, scene: str) -> Cells:
    """Return the plants of the ordinary condition, or of the first, a row per seed."""
    of_scene = [(c, r) for c, r in results if c.condition.label == scene]
    chosen = [(c, r) for c, r in of_scene if c.condition.usual] or of_scene
    cell, played = next((c, r) for c, r in chosen if c.controller == SCALE_CONTROLLER)
    drawn = played.plants
    heads = ["seed", "friction", "EA [kN]", "pretension [N]", "wrap [rad]"]
    heads += ["wearer [N m/rad]", "delay [steps]", "bias of torque [N m]"]
    rows = []
    for row, seed in enumerate(cell.seeds):

        def both(name: str, scale: float = 1.0, row: int = row) -> str:
            pairs = zip(
                drawn[f"plant_{name}"][row], drawn[f"believed_{name}"][row], strict=True
            )
            return ", ".join(f"{scale * p:.3g} ({scale * b:.3g})" for p, b in pairs)

        rows.append(
            [
                str(seed),
                both("friction"),
                both("axial_stiffness", 1e-3),
                both("pretension"),
                ", ".join(f"{wrap:.3g}" for wrap in drawn["plant_wrap"][row]),
                ", ".join(f"{own:.3g}" for own in drawn["plant_wearer"][row]) or "-",
                str(drawn["plant_delay"][row]),
                ", ".join(f"{own:.2g}" for own in drawn["plant_bias"][row]),
            ]
        )
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


def mean_score(results: Results, scene: str, law: str, name: str) -> float:
    """Return the mean of a score over conditions and seeds, NaN without an episode."""
    values = [
        played.scores[name]
        for cell, played in results
        if (cell.condition.label, cell.controller) == (scene, law)
    ]
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    return float(np.mean(known)) if known.size else math.nan


def _with_price(results: Results, scene: str, place: ranking.Place) -> str:
    """Return an error with its price: chatter [mN m] and motor peak [N m]."""
    chatter, peak = (
        mean_score(results, scene, place.name, name)
        for name in ("chatter", "peak_motor_torque")
    )
    error = _score_with_interval(place)
    if math.isnan(chatter) or math.isnan(peak):  # it gave no torque in any episode
        return f"{error}, -, -"
    return f"{error}, {1e3 * chatter:.3g}, {peak:.2g}"


def plant_names(rms: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """Return the names of the plants of every condition."""
    return [plant_key(condition) for condition in rms[SCALE_CONTROLLER]]


def controller_label(law: str) -> str:
    return f"*{law}*" if law in REFERENCES else f"`{law}`"


def _score_with_interval(place: ranking.Place) -> str:
    if math.isnan(place.low):
        return f"{place.score:.3f}"
    return f"{place.score:.3f} ({place.low:.3f} to {place.high:.3f})"
