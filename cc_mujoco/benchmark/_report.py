"""Results of the benchmark in Markdown: the best in a sentence, then all tables."""

from __future__ import annotations

import math
import shlex
from collections.abc import Container, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.benchmark import _tables as tables
from cc_mujoco.benchmark._conditions import REFERENCES, SCALE_CONTROLLER
from cc_mujoco.benchmark._results import (
    DeviceResults,
    Errors,
    Results,
    by_device,
    rms_errors,
)
from cc_mujoco.benchmark._scores import EVERY_SCORE, ranked_score
from cc_mujoco.device import find_device
from cc_mujoco.device._description import device_label
from cc_mujoco.report._html import list_words
from cc_mujoco.report._markdown import table

Array = NDArray[np.float64]

DEFAULT_BASELINE = "pi"
"""Default controller that others are compared with."""
OVERVIEW_HEADING = (
    "Normalised error (`none` is 1, the smaller the better), mean over conditions and "
    "seeds with its 95 % interval, chatter [mN m] and motor peak [N m]; and failed "
    "episodes, if any:"
)
"""Heading of `overview_table`."""
RANKS_HEADING = (
    "Ranks; a controller is better than another where the interval of their "
    "difference leaves out 0, for all pairs at once:"
)
CONDITIONS_HEADING = "Normalised error by condition, mean over seeds:"
SCORES_HEADING = "All scores, mean over conditions and seeds:"
PLANTS_HEADING = (
    "Plants sampled in the ordinary condition, in brackets the values that "
    "controllers assume:"
)
TIMES_TITLE = "Computing time of a step of one device"


def all_tables(
    results: Results,
    baseline: str = DEFAULT_BASELINE,
    left_out: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return all tables as Markdown.

    Args:
        results: Results of a run.
        baseline: Controller that the others are compared with.
        left_out: Devices that the suite no longer has, and the reason.
    """
    first, *others = by_device(results)
    parts = [
        "# Benchmark of controllers",
        summary(results, baseline),
        _picture(first, "pareto"),
        *left_out_sentences(left_out),
    ]
    for own in (first, *others):
        parts += [
            f"## {own.label}",
            *([] if own is first else [_picture(own, "pareto")]),
            RANKS_HEADING,
            table(*tables.ranks_table(own.rms, baseline)),
            _fold(
                "Conditions, scores and plants",
                CONDITIONS_HEADING,
                _picture(own, "robustness"),
                table(*tables.conditions_table(own)),
                SCORES_HEADING,
                _picture(own, "cycle"),
                table(*tables.scores_table(own)),
                PLANTS_HEADING,
                table(*tables.plants_table(own)),
            ),
        ]
    head, rows = tables.times_table(results)
    if rows:
        parts += [f"## {TIMES_TITLE}", table(head, rows)]
    parts += ["## Definitions", _fold("References and scores", definitions(results))]
    return "\n\n".join(parts) + "\n"


def summary(results: Results, baseline: str = DEFAULT_BASELINE) -> str:
    """Return the head of console output and tables: the best, and all controllers."""
    parts = [
        best_sentence(results, baseline),
        f"Next: `{next_command(results)}`",
        OVERVIEW_HEADING,
        table(*tables.overview_table(results)),
        *divergence_sentences(results),
        *assumed_limits(results),
    ]
    return "\n\n".join(parts)


def best_sentence(results: Results, baseline: str = DEFAULT_BASELINE) -> str:
    """Name the best controllers of the first devices, and the number of seeds."""
    parts = [
        _best_at(scene, own, baseline) for scene, own in rms_errors(results).items()
    ]
    shown = parts[:5]
    if parts[5:]:
        shown.append(f"{len(parts) - 5} more devices")
    seeds = len(results[0][0].seeds)
    scale = f"{SCALE_CONTROLLER}` is 1; {seeds} seed{'s' if seeds > 1 else ''}"
    return f"{'; '.join(shown)} (error of `{scale})."


def _best_at(scene: str, rms: Mapping[str, Mapping[str, Array]], baseline: str) -> str:
    best, *others = tables.rank_entries(rms)
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
    """Return the command that plays the best controller on the first device."""
    first = by_device(results)[0]
    scene, best = first.played[0][0].condition.scene, tables.rank_entries(first.rms)[0]
    return shlex.join(["cc-mujoco", "play", scene, "--controller", best.name])


def left_out_sentences(left_out: Mapping[str, str]) -> list[str]:
    """Return a sentence for each device that a suite no longer has."""
    return [f"Without {scene}: {reason}." for scene, reason in left_out.items()]


def _picture(own: DeviceResults, stem: str) -> str:
    return f"![{own.label}: {stem}]({own.label}-{stem}.png)"


def _fold(title: str, *parts: str) -> str:
    return "\n\n".join([f"<details><summary>{title}</summary>", *parts, "</details>"])


def divergence_sentences(results: Results) -> list[str]:
    """Return a sentence for each controller with episodes without a score."""
    lost: dict[str, list[Array]] = {}
    for cell, played in results:
        values = np.isnan(played.scores[ranked_score(played.scores)])
        lost.setdefault(cell.controller, []).append(values)
    episodes = {law: np.concatenate(values) for law, values in lost.items()}
    return [
        f"{tables.controller_label(law)} diverged, or gave a torque that is no number, "
        f"in {int(values.sum())} of {values.size} episodes."
        for law, values in episodes.items()
        if values.any()
    ]


def assumed_limits(results: Results) -> list[str]:
    """Return a sentence for each device with joints of assumed `safe_torque`."""
    found = []
    for scene in dict.fromkeys(cell.condition.scene for cell, _ in results):
        axes = find_device(scene).description.axes
        limits = [
            f"{axis.safe_torque:g} N m at joint {axis.joint}"
            for axis in axes
            if axis.safe_is_assumed
        ]
        if limits:
            found.append(
                f"The safe torque of device {device_label(scene)} is assumed: "
                f"{', '.join(limits)}, or twice what the task demands, if that is "
                "more; `safe_torque` in its description gives another."
            )
    return found


def reference_definitions(names: Container[str]) -> list[str]:
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


def comparison(errors: Errors, differing: list[str]) -> str:
    """Return the ranks of two files of results together, device by device."""
    parts = ["# Two results compared"]
    if differing:
        parts.append(f"What made them differs in {', '.join(differing)}.")
    for scene, own in errors.items():
        parts += [f"## {scene}", table(*tables.ranks_table(own, SCALE_CONTROLLER))]
    return "\n\n".join(parts) + "\n"
