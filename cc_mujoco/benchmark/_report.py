"""Tables of the benchmark: ranks, errors by condition, all scores, what was drawn."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark._conditions import plant_key
from cc_mujoco.benchmark._ranking import (
    Place,
    bootstrap_means,
    compare_resamples,
    normalise_errors,
    rank_controllers,
)
from cc_mujoco.benchmark._references import REFERENCES, SCALE_CONTROLLER
from cc_mujoco.benchmark._results import Errors, Results, rms_errors
from cc_mujoco.benchmark._scores import EVERY_SCORE, ranked_score
from cc_mujoco.device import find_device
from cc_mujoco.device._description import device_label
from cc_mujoco.report._markdown import table

Array = NDArray[np.float64]

DEFAULT_BASELINE = "pi"
"""The controller that others are compared with unless another is named."""
MAX_DEVICES = 5
"""Devices in the sentence at the top."""
OVERVIEW_HEADING = (
    "Normalised error (`none` is 1, the smaller the better), mean over conditions and "
    "seeds with its 95 % interval; and failed episodes:"
)
"""Heading of `overview_table`."""


class Interval(NamedTuple):
    """Mean and half the width of its confidence interval; NaN where there is none."""

    mean: float
    half: float
    known: int = 0
    """Values that it is of."""
    all: int = 0
    """All values, those that are not numbers too."""

    def __str__(self) -> str:
        """Return mean and half width to significant digits; values, if some lack."""
        if math.isnan(self.mean):
            return "-"
        if math.isnan(self.half) or self.half < 1e-9:
            text = f"{self.mean:.3g}"
        else:
            digits = max(0, 1 - math.floor(math.log10(self.half)))
            text = f"{self.mean:.{digits}f} ± {self.half:.{digits}f}"
        return f"{text} ({self.known} of {self.all})" if self.known < self.all else text


def format_mean_interval(values: Array) -> Interval:
    """Return the mean with its 95 % interval (Student), without NaN."""
    from scipy.stats import t as student

    count, values = values.size, values[np.isfinite(values)]
    if values.size == 0:
        return Interval(math.nan, math.nan, 0, count)
    mean = float(np.mean(values))
    if values.size == 1:
        return Interval(mean, math.nan, 1, count)
    spread = float(np.std(values, ddof=1)) / math.sqrt(values.size)
    return Interval(
        mean, float(student.ppf(0.975, values.size - 1)) * spread, values.size, count
    )


def all_tables(
    results: Results,
    baseline: str = DEFAULT_BASELINE,
    left_out: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return all tables as Markdown.

    Args:
        results: Of a run.
        baseline: Controller that the others are compared with.
        left_out: Devices that the suite has no more, and the reason.
    """
    errors = rms_errors(results)
    first = next(iter(errors))
    parts = [
        "# Benchmark of controllers",
        summary(results, baseline),
        _picture(first, "pareto"),
    ]
    parts += [f"Without {scene}: {reason}." for scene, reason in left_out.items()]
    for scene, own in errors.items():
        parts += [
            f"## {scene}",
            *([] if scene == first else [_picture(scene, "pareto")]),
            "Ranks; a controller is better than another where the interval of their "
            "difference leaves out 0, for all pairs at once:",
            ranks_table(own, baseline),
            _fold(
                "Conditions, scores and plants",
                "Normalised error by condition, mean over seeds:",
                _picture(scene, "robustness"),
                conditions_table(results, scene),
                "All scores, mean over conditions and seeds:",
                _picture(scene, "cycle"),
                scores_table(results, scene),
                "Plants sampled in the ordinary condition, in brackets the values that "
                "controllers assume:",
                plants_table(results, scene),
            ),
        ]
    times = times_table(results)
    if times:
        parts += ["## Computing time of a step of one device", times]
    parts += ["## Definitions", _fold("References and scores", definitions(results))]
    return "\n\n".join(part for part in parts if part) + "\n"


def summary(results: Results, baseline: str = DEFAULT_BASELINE) -> str:
    """Return what console and page begin with: the best, and all controllers."""
    parts = [
        best_sentence(results, baseline),
        OVERVIEW_HEADING,
        overview_table(results),
    ]
    parts += [*divergence_sentences(results), *unknown_limits(results)]
    return "\n\n".join(parts)


def best_sentence(results: Results, baseline: str = DEFAULT_BASELINE) -> str:
    """Return the best controllers of the first devices, and the next command."""
    sentences, played = [], ""
    for scene, own in rms_errors(results).items():
        places = rank_controllers(normalise_errors(own, SCALE_CONTROLLER), _plants(own))
        known = {p.name: p.score for p in places if p.name not in REFERENCES}
        best = min(known, key=lambda name: known[name])
        compared = baseline in known and baseline != best
        than = f" (`{baseline}`: {known[baseline]:.3g})" if compared else ""
        sentences.append(f"`{best}` at {scene}, {known[best]:.3g}{than}")
        played = played or f"cc-mujoco play {scene} --controller {best}"
    first = "; ".join(sentences[:MAX_DEVICES])
    return f"Least error (`none` is 1): {first}.\n\nNext: `{played}`"


def _failures(results: Results, scene: str, law: str) -> Array:
    """Return whether the episodes of a controller on a device failed."""
    return np.concatenate(
        [
            played.scores["failed"]
            for cell, played in results
            if (cell.condition.label, cell.controller) == (scene, law)
        ]
    )


def _picture(scene: str, stem: str) -> str:
    """Return a figure beside the page."""
    return f"![{scene}: {stem}]({scene}-{stem}.png)"


def _fold(title: str, *parts: str) -> str:
    """Return parts below a title that opens them."""
    return "\n\n".join([f"<details><summary>{title}</summary>", *parts, "</details>"])


def divergence_sentences(results: Results) -> list[str]:
    """Return a sentence for each controller with episodes that have no score."""
    lost: dict[str, list[Array]] = {}
    for cell, played in results:
        values = np.isnan(played.scores[ranked_score(played.scores)])
        lost.setdefault(cell.controller, []).append(values)
    episodes = {law: np.concatenate(values) for law, values in lost.items()}
    return [
        f"{_controller_label(law)} diverged, or gave a torque that is no number, in "
        f"{int(values.sum())} of {values.size} episodes."
        for law, values in episodes.items()
        if values.any()
    ]


def unknown_limits(results: Results) -> list[str]:
    """Return a sentence for each device with joints of unknown `safe_torque`."""
    found = []
    for scene in dict.fromkeys(cell.condition.scene for cell, _ in results):
        axes = find_device(scene).description.axes
        joints = [axis.joint for axis in axes if math.isinf(axis.safe_torque)]
        if joints:
            found.append(
                f"The safe torque at {', '.join(joints)} of {device_label(scene)} is "
                "unknown (`safe_torque` in its description), so that none counts as a "
                "failure there."
            )
    return found


def reference_definitions(names: Container[str]) -> list[str]:
    """Define the references among names, a line each."""
    return [f"- *{n}*: {one.meaning}" for n, one in REFERENCES.items() if n in names]


def definitions(results: Results) -> str:
    """Define every reference and every score of results, a line each."""
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


def overview_table(results: Results) -> str:
    """Return the normalised error and failures of every controller and device."""
    errors = rms_errors(results)
    laws = dict.fromkeys(cell.controller for cell, _ in results)
    head, rows = ["controller"], {law: [_controller_label(law)] for law in laws}
    for scene, own in errors.items():
        head += [scene, f"{scene}, failed"]
        places = {
            p.name: p
            for p in rank_controllers(
                normalise_errors(own, SCALE_CONTROLLER), _plants(own)
            )
        }
        for law, row in rows.items():
            if law not in own:
                row += ["-", "-"]
                continue
            failed = _failures(results, scene, law)
            row += [_score_with_interval(places[law]), f"{np.mean(failed):.0%}"]
    return table(head, rows.values())


def ranks_table(rms: Mapping[str, Mapping[str, Array]], baseline: str) -> str:
    """Return the controllers without the references, the best first."""
    errors = normalise_errors(rms, SCALE_CONTROLLER)
    errors = {n: e for n, e in errors.items() if n not in REFERENCES}
    plants = _plants(rms)
    draws, places = bootstrap_means(errors, plants), rank_controllers(errors, plants)
    compared = baseline in errors
    head = ["rank", "controller", "error"]
    head += [f"less `{baseline}`"] if compared else []
    rows = []
    for place in places:
        rank = str(place.first)
        if place.last > place.first:
            rank += f" to {place.last}"
        row = [rank, _controller_label(place.name), _score_with_interval(place)]
        if compared and place.name != baseline:
            mean = place.score - float(np.mean(errors[baseline]))
            row.append(str(compare_resamples(draws[place.name], draws[baseline], mean)))
        elif compared:
            row.append("-")
        better = [_controller_label(n) for n in errors if n in place.better_than]
        rows.append([*row, ", ".join(better) or "-"])
    return table([*head, "better than"], rows)


def conditions_table(results: Results, scene: str) -> str:
    """Return the normalised errors, a row per condition, with the error that is 1."""
    rms = rms_errors(results)[scene]
    errors = normalise_errors(rms, SCALE_CONTROLLER)
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
    return table(
        ["condition", f"`{SCALE_CONTROLLER}`", *map(_controller_label, laws)], rows
    )


def scores_table(results: Results, scene: str) -> str:
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
        rows.append([_controller_label(law), *cells])
    heads = [
        score.name.replace("_", " ") + (f" [{score.unit}]" if score.unit != "1" else "")
        for score in shown
    ]
    return table(["controller", *heads], rows)


def plants_table(results: Results, scene: str) -> str:
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
    return table(heads, rows)


def times_table(results: Results) -> str:
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
        [_controller_label(law), *(own.get(law, "-") for own in scenes.values())]
        for law in laws
    ]
    heads = [f"{scene}: median, worst" for scene in scenes]
    return table(["controller", *heads], rows) if rows else ""


def comparison(errors: Errors, differing: list[str]) -> str:
    """Return the ranks of two files of results together, device by device."""
    parts = ["# Two results compared"]
    if differing:
        parts.append(f"What made them differs in {', '.join(differing)}.")
    for scene, own in errors.items():
        parts += [f"## {scene}", ranks_table(own, SCALE_CONTROLLER)]
    return "\n\n".join(parts) + "\n"


def _plants(rms: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """Return the names of the plants of every condition."""
    return [plant_key(condition) for condition in rms[SCALE_CONTROLLER]]


def _controller_label(law: str) -> str:
    return f"*{law}*" if law in REFERENCES else f"`{law}`"


def _score_with_interval(place: Place) -> str:
    if math.isnan(place.low):
        return f"{place.score:.3f}"
    return f"{place.score:.3f} ({place.low:.3f} to {place.high:.3f})"
