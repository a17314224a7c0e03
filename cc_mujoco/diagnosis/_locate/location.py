"""The question `locate`: in which torque, angle and trials does the error lie?

The first sentence names the torque that is off and the structure that takes most of its
error; the others give each structure by itself, with its test statistic. There is
always a first sentence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from cc_mujoco.diagnosis._fit.baseline import BaselineFit, traces
from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.folds import BOOTSTRAP_BLOCK
from cc_mujoco.diagnosis._fit.trial_constants import (
    TrialConstants,
    describe_trial_constants,
    trial_constants,
    trial_ordinates,
)
from cc_mujoco.diagnosis._fit.trials import find_outlier_trial, misfits, trial_errors
from cc_mujoco.diagnosis._judge.judge import Judged
from cc_mujoco.diagnosis._locate.periodicity import (
    PeriodicError,
    Samples,
    strongest_line,
)
from cc_mujoco.diagnosis._locate.residual_maps import error_maps, map_sentences
from cc_mujoco.diagnosis._phrases import (
    channel_name,
    format_number,
    format_share,
    format_signed,
)
from cc_mujoco.diagnosis._search.screening import Signature, signature_cosine
from cc_mujoco.diagnosis._search.search import Found
from cc_mujoco.diagnosis._thresholds import MAX_EXPLAINED_ERROR, Limit
from cc_mujoco.diagnosis._verdict import (
    Evidence,
    Isolability,
    Map,
    Model,
    TrialError,
    TrialTrace,
    Where,
)
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words


@dataclass(frozen=True)
class Located:
    """Where and when the error lies.

    Attributes:
        evidence: signals and maps that the report draws.
        where: locations, the main one first.
        trials: errors of every trial.
        question: about a trial that contradicts the others, or "".
    """

    evidence: Evidence
    where: tuple[Where, ...]
    trials: tuple[TrialError, ...]
    question: str


def locate_error(
    fitted: BaselineFit, found: Found, judged: Judged, seed: int
) -> Located:
    """Locate the error of the baseline, and what is left of it."""
    baseline, model = (fitted.problem, fitted.whole.x), (found.problem, found.x)
    # What is added where nothing explains the error only stands in for it.
    unknown = judged.verdict == "unknown"
    explaining = baseline if unknown else model
    odd = find_outlier_trial(*explaining, misfits(*baseline))
    question = odd.question if odd else ""
    if found.by_trial and odd and odd.rest > MAX_EXPLAINED_ERROR:
        question = ""  # no single trial contradicts the others
    stretch = judged.stretch
    if unknown and stretch and stretch.rest <= MAX_EXPLAINED_ERROR and not odd:
        question = stretch.question
    constants = trial_constants(*explaining)
    names = constants[0].trials if constants else ()
    ordinates = trial_ordinates(found.problem, names, fitted.temperatures)
    before, after = found.held.before, found.held.after
    shown = traces(found.problem, before, after)
    drawn = error_maps(shown, seed)
    return Located(
        Evidence(shown, drawn, effect_isolability(found.search.signatures)),
        error_places(baseline, model, drawn, constants, ordinates),
        trial_errors(fitted.problem, before, after, model),
        question,
    )


def effect_isolability(signatures: Sequence[Signature]) -> Isolability:
    """Compute the similarity of the effects' signatures."""
    table = np.array([[signature_cosine(a, b) for b in signatures] for a in signatures])
    return Isolability(
        tuple(s.id for s in signatures),
        table.reshape(len(signatures), len(signatures)),
        np.array([s.visible for s in signatures]),
    )


def error_places(
    baseline: tuple[Problem, FloatArray],
    model: tuple[Problem, FloatArray],
    drawn: Sequence[Map],
    constants: Sequence[TrialConstants] = (),
    ordinates: Mapping[str, FloatArray] = MappingProxyType({}),
) -> tuple[Where, ...]:
    """Return where the error of the baseline lies, the main sentence first.

    Errors are those of fits to all data: what is predicted of trials that are held out
    is off by their parameters as well.

    Args:
        baseline: the model without any effect, and where it was fitted.
        model: the same with what was added.
        drawn: maps of the error.
        constants: by trial, best first.
        ordinates: (trials,) along which these may drift, by name.
    """
    problem = baseline[0]
    before, after = (fitted.torques(x) for fitted, x in (baseline, model))
    seen = traces(problem, before, after)
    off, left = (_noise_ratios(problem, played) for played in (before, after))
    worst = max(off, key=lambda name: off[name])
    found = [
        _describe_period(line, name)
        for name in sorted(off, key=lambda name: -off[name])
        if off[name] > Limit.min_searched_error
        and (line := strongest_line(error_samples(problem, seen, name))) is not None
    ]
    found += _describe_constants(
        {
            name: error_samples(problem, seen, name)
            for name in off
            if off[name] > Limit.min_searched_error
        }
    )
    if off[worst] > Limit.min_searched_error and (
        by_trial := describe_trial_constants(constants, ordinates, worst)
    ):
        found.append(by_trial)
    found.sort(key=lambda each: -each[1].share_of_error)
    mapped = map_sentences(drawn)
    squares = {name: size**2 for name, size in off.items()}
    first = Where(
        worst,
        "channel",
        squares[worst] / sum(squares.values()),
        _main_sentence(off, worst, found, mapped),
    )
    remaining = [
        _describe_period(line, name, " that is left with what was added")
        for name, size in left.items()
        if model[0].effects
        and size > Limit.explained_error
        and (line := strongest_line(error_samples(problem, seen, name, "after")))
        is not None
    ]
    return (first, *(where for _, where in [*found, *remaining]), *mapped)


def _noise_ratios(problem: Problem, played: Sequence[FloatArray]) -> dict[str, float]:
    """Return the weighted RMS error of each channel over that of the sensors' noise."""
    squares = np.zeros((2, len(problem.plant.instruments.channels)))
    for record, torque, sensed, floor in zip(
        problem.plant.records, played, problem.sensed, problem.floor, strict=True
    ):
        kept = record.counts
        for row, error in enumerate((record.measured - torque, sensed)):
            squares[row] += np.sum((error / floor)[:, kept] ** 2, axis=1)
    ratios = np.sqrt(squares[0] / np.maximum(squares[1], 1e-300)).tolist()
    return dict(zip(problem.plant.instruments.channels, ratios, strict=True))


def error_samples(
    problem: Problem, seen: Sequence[TrialTrace], name: str, model: Model = "before"
) -> Samples:
    """Return errors of a channel, as many as its band needs."""
    row = problem.plant.instruments.channels.index(name)
    records = problem.plant.records
    parts, first = [], 0
    for trace, record, floor in zip(seen, records, problem.floor, strict=True):
        thin = max(1, int(1.0 / (record.dt * Limit.samples_per_period * record.band)))
        kept = np.flatnonzero(trace.counts > 0.0)[::thin]
        if not kept.size:
            continue
        block = ((kept - kept[0]) * record.dt / BOOTSTRAP_BLOCK).astype(np.intp) + first
        first = int(block[-1]) + 1
        played = trace.before if model == "before" else trace.after
        parts.append(
            (
                trace.error(name, model)[kept],
                1.0 / floor[row, kept] ** 2,
                trace.motor_angle[kept],
                trace.joint_angle[kept],
                played[name][kept],
                np.gradient(trace.motor_angle, record.dt)[kept],
                block,
            )
        )
    error, weight, motor, joint, torque, speed, block = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    angles = {"motor angle": motor, "joint angle": joint}
    band = min(record.band for record in records)
    return Samples(error, weight, angles, torque, speed, block, band)


def _main_sentence(
    off: Mapping[str, float],
    worst: str,
    found: Sequence[tuple[str, Where]],
    mapped: Sequence[Where],
) -> str:
    """Return the main sentence: which torque is off, by how much, and how."""
    others = [name for name in off if name != worst]
    sizes = list_words(
        [f"{channel_name(name)} {_in_floors(size)}" for name, size in off.items()]
    )
    beside = list_words(
        [f"{channel_name(name)} {_in_floors(off[name])}" for name in others]
    )
    beyond = {name: max(size**2 - 1.0, 0.0) for name, size in off.items()}
    mostly = all(beyond[worst] > Limit.dominant_ratio * beyond[name] for name in others)
    if off[worst] <= Limit.layout_error:
        text = f"No torque is far off ({sizes} noise floors)"
    elif not others:
        size = _in_floors(off[worst])
        text = (
            f"Only the {channel_name(worst)} is compared; it is {size} noise floors off"
        )
    elif not mostly:
        text = f"The error is in both torques ({sizes} noise floors)"
    elif all(off[name] <= Limit.explained_error for name in others):
        size = _in_floors(off[worst])
        text = (
            f"The error is in the {channel_name(worst)} only "
            f"({size} noise floors; {beside})"
        )
    else:
        text = (
            f"The error is mostly in the {channel_name(worst)} ({sizes} noise floors)"
        )
    if found:
        return f"{text}: {found[0][0]}."
    if off[worst] <= Limit.layout_error:
        return f"{text}."
    if mapped:
        return (
            f"{text}: {format_share(mapped[0].share_of_error)} of the squared "
            f"{channel_name(mapped[0].channel)} error lies along {mapped[0].axis}."
        )
    return (
        f"{text}: it is not periodic in an angle, follows no constant that differs "
        "from trial to trial, and no quantity explains more of it than chance does."
    )


def _in_floors(size: float) -> str:
    """Return an error over the noise floor, to a tenth of a floor."""
    return format_number(size, 1.0 if size < 100.0 else math.nan)


def _describe_period(
    line: PeriodicError, name: str, which: str = ""
) -> tuple[str, Where]:
    """Return a period in an error in words."""
    exactly = format_number(line.order, 2.0 * line.order_error)
    order = f"{round(line.order) if line.whole_order else exactly} per turn"
    if line.by_torque is None:
        size = "constant or proportional to the torque, which these data do not show"
    elif line.by_torque:
        size = (
            "proportional to the torque "
            f"({format_number(100.0 * line.amplitude)} % of it)"
        )
    else:
        size = f"the same at every torque ({format_number(line.amplitude)} N m)"
    short = (
        f"it is periodic in the {line.angle}, {order}, with an amplitude that is {size}"
    )
    full = (
        f"{format_share(line.share)} of the squared {channel_name(name)} error{which} "
        f"is periodic in the {line.angle}, {exactly} per turn (standard error "
        f"{format_number(line.order_error)}), with an amplitude that is {size}. This "
        f"period takes {format_number(line.statistic)} times what the periods beside "
        f"it take; random errors reach {format_number(line.threshold)} in one of "
        f"{round(1 / Limit.false_alarm_rate)} data sets."
    )
    return short, Where(name, line.angle, line.share, full)


def _describe_constants(seen: Mapping[str, Samples]) -> list[tuple[str, Where]]:
    """Return errors that are the same in all stretches, in words."""
    sizes, found = {}, []
    for name, each in seen.items():
        weights = np.bincount(each.block, each.weight)
        sums = np.bincount(each.block, each.weight * each.error)
        means = sums[weights > 0.0] / weights[weights > 0.0]
        mean = float(np.average(each.error, weights=each.weight))
        square = float(np.average(each.error**2, weights=each.weight))
        takes = mean**2 / max(square, 1e-300)
        if means.size < Limit.location_min_blocks or takes < Limit.min_constant_share:
            continue
        scatter = float(np.std(means, ddof=1)) / math.sqrt(means.size)
        if abs(mean) < Limit.min_constant_sigmas * scatter:
            continue
        sizes[name] = f"{channel_name(name)} {format_signed(mean)} N m"
        text = (
            f"{format_share(takes)} of the squared {channel_name(name)} error is a "
            f"constant, measured minus simulated {format_signed(mean)} N m (standard "
            f"error {format_number(scatter)})."
        )
        found.append(Where(name, "all data", takes, text))
    short = (
        f"it is nearly constant, measured minus simulated {list_words(sizes.values())}"
    )
    return [(short, each) for each in found]
