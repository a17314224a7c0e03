"""Location of the error: in which torque, periodic in which angle, in which trials.

The first sentence names the torque that is off and the structure that takes most of its
error; the others give each structure by itself, with its test statistic. There is
always a first sentence.

    places = locate_error(baseline, model, maps, Trials(constants, along))
    places[0].statement
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit.fitting import Problem
from cc_mujoco.diagnosis._fit.folds import BOOTSTRAP_BLOCK
from cc_mujoco.diagnosis._fit.heldout_error import traces
from cc_mujoco.diagnosis._locate.periodicity import (
    FALSE_ALARM_RATE as PERIODIC_BY_CHANCE,
)
from cc_mujoco.diagnosis._locate.periodicity import (
    PeriodicError,
    Samples,
    strongest_line,
)
from cc_mujoco.diagnosis._locate.residual_maps import map_sentences
from cc_mujoco.diagnosis._locate.trial_trends import (
    MIN_TREND_SHARE,
    Trend,
    TrialConstants,
    trial_trends,
)
from cc_mujoco.diagnosis._locate.trial_trends import (
    TREND_FALSE_ALARM_RATE as TREND_BY_CHANCE,
)
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    channel_name,
    format_number,
    format_share,
    format_signed,
    plain_name,
)
from cc_mujoco.diagnosis._report_data import Map, Model, TrialTrace
from cc_mujoco.diagnosis._verdict import Where
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

EXPLAINED_ERROR = 1.5
"""Error over the noise floor up to which a torque counts as explained; that of rigs
from which nothing is missing."""
LAYOUT_ERROR = 1.8
"""Error over the noise floor that the layout of a rig can make, see `HINT_ERROR`."""
MIN_SEARCHED_ERROR = 1.15
"""Error over the noise floor from which on a structure is looked for."""
DOMINANT_RATIO = 3.0
"""Squared error beyond the floor of one torque over that of the other, from which on it
is mostly in that torque."""
RIVAL_MARGIN = 0.02
"""Share of the squared error by which another constant may do worse and is given."""
UNORDERED_SHARE = 0.5
"""Least share of the squared error beyond the floor of reported constants per trial
without a trend: other effects show more in some trials, too."""
MIN_CONSTANT_SHARE = 0.5
"""Least share of the squared error of a constant that is reported."""
MIN_CONSTANT_SIGMAS = 5.0
"""Least size of such a constant over its standard error."""
MIN_BLOCKS = 4
"""Stretches of about a second from which on a constant is looked for."""
SEQUENCE_ORDINATES = ("order of the trials", "time of the trials")
_SAMPLES_PER_PERIOD = 2.5
"""Samples per period of the highest frequency of the errors."""
_MAX_SHOWN = 12


class Trials(NamedTuple):
    """Quantities by which trials are compared.

    Attributes:
        constants: parameters with a value of their own in every trial, best first.
        ordinates: (trials,) along which these may drift, by name.
    """

    constants: Sequence[TrialConstants] = ()
    ordinates: Mapping[str, FloatArray] = {}


RANDOM_SHARE = 0.9
"""Share of the squared error beyond the floor from which on constants by trial without
a trend are the verdict; of single effects that are hidden in rigs they take 4 %."""


class Fitted(NamedTuple):
    """A model and where it was fitted to all data."""

    problem: Problem
    x: FloatArray


class _Structure(NamedTuple):
    """A structure of the error.

    Attributes:
        short: clause for the first sentence.
        where: the same in full.
    """

    short: str
    where: Where


def locate_error(
    baseline: Fitted,
    model: Fitted,
    drawn: Sequence[Map],
    trials: Trials | None = None,
) -> tuple[Where, ...]:
    """Return where the error of the baseline lies, the main sentence first.

    Errors are those of fits to all data: what is predicted of trials that are held out
    is off by their parameters as well.

    Args:
        baseline: the model without any effect.
        model: the same with what was added.
        drawn: maps of the error.
        trials: constants by trial, see `trial_ordinates`; None where they are not
            known.
    """
    problem = baseline.problem
    before, after = (each.problem.torques(each.x) for each in (baseline, model))
    seen = traces(problem, before, after)
    off, left = (_noise_ratios(problem, played) for played in (before, after))
    worst = max(off, key=lambda name: off[name])
    found = [
        _describe_period(line, name)
        for name in sorted(off, key=lambda name: -off[name])
        if off[name] > MIN_SEARCHED_ERROR
        and (line := strongest_line(error_samples(problem, seen, name))) is not None
    ]
    found += _describe_constants(
        {
            name: error_samples(problem, seen, name)
            for name in off
            if off[name] > MIN_SEARCHED_ERROR
        }
    )
    if trials is not None and off[worst] > MIN_SEARCHED_ERROR:
        found += _describe_trial_constants(trials, worst)
    found.sort(key=lambda each: -each.where.share_of_error)
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
        if model.problem.effects
        and size > EXPLAINED_ERROR
        and (line := strongest_line(error_samples(problem, seen, name, "after")))
        is not None
    ]
    return (first, *(each.where for each in [*found, *remaining]), *mapped)


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


def random_constants(trials: Trials, misfit: float) -> str:
    """Return the constant that differs at random between trials, in words, or "".

    Args:
        trials: constants by trial of the tuned scene.
        misfit: of it.
    """
    for each in _describe_trial_constants(trials, ""):
        if each.where.axis == "trial" and each.where.share_of_error > RANDOM_SHARE:
            return (
                f"The trials contradict each other: the error of the tuned scene is "
                f"{format_number(misfit)} times the noise floor. "
                f"{each.where.statement} Effects were not searched, as they hold for "
                "all trials: find out what was changed between them, or declare it."
            )
    return ""


def error_samples(
    problem: Problem, seen: Sequence[TrialTrace], name: str, model: Model = "before"
) -> Samples:
    """Return errors of a channel, as many as its band needs.

    Args:
        problem: with the records and the floor.
        seen: traces of the same records.
        name: of the channel.
        model: whose errors.
    """
    row = problem.plant.instruments.channels.index(name)
    records = problem.plant.records
    parts, first = [], 0
    for trace, record, floor in zip(seen, records, problem.floor, strict=True):
        thin = max(1, int(1.0 / (record.dt * _SAMPLES_PER_PERIOD * record.band)))
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


def trial_ordinates(
    problem: Problem, names: Sequence[str], warmth: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return the ordinates that trial constants may follow, (trials,) each by name.

    Args:
        problem: with the records.
        names: of the trials, in the order of the data.
        warmth: mean temperature of trials by name, where it is known [degC].
    """
    own = {
        name: [r for r in problem.plant.records if r.trial == name] for name in names
    }

    def speed(name: str) -> float:
        square = [np.mean(np.gradient(r.motor_angle, r.dt) ** 2) for r in own[name]]
        return math.sqrt(float(np.mean(square)))

    spans = [(own[n][0].time[0], own[n][-1].time[-1]) for n in names]
    ordered = all(last < first for (_, last), (first, _) in pairwise(spans))
    when = {SEQUENCE_ORDINATES[0]: np.arange(float(len(names)))}
    if ordered:  # one clock for all of them
        when = {SEQUENCE_ORDINATES[1]: np.array([first for first, _ in spans])}
    pulled = [own[name][0].pretension for name in names]
    return {
        **when,
        "temperature": np.array([warmth.get(name, math.nan) for name in names]),
        "speed of the trial": np.array([speed(name) for name in names]),
        "declared pretension": np.array(
            [math.nan if each is None else each for each in pulled], dtype=float
        ),
    }


def _main_sentence(
    off: Mapping[str, float],
    worst: str,
    found: Sequence[_Structure],
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
    mostly = all(beyond[worst] > DOMINANT_RATIO * beyond[name] for name in others)
    if off[worst] <= LAYOUT_ERROR:
        text = f"No torque is far off ({sizes} noise floors)"
    elif not others:
        size = _in_floors(off[worst])
        text = (
            f"Only the {channel_name(worst)} is compared; it is {size} noise floors off"
        )
    elif not mostly:
        text = f"The error is in both torques ({sizes} noise floors)"
    elif all(off[name] <= EXPLAINED_ERROR for name in others):
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
        return f"{text}: {found[0].short}."
    if off[worst] <= LAYOUT_ERROR:
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


def _describe_period(line: PeriodicError, name: str, which: str = "") -> _Structure:
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
        f"{round(1 / PERIODIC_BY_CHANCE)} data sets."
    )
    return _Structure(short, Where(name, line.angle, line.share, full))


def _describe_constants(seen: Mapping[str, Samples]) -> list[_Structure]:
    """Return errors that are the same in all stretches, in words.

    Args:
        seen: errors by channel.
    """
    sizes, found = {}, []
    for name, each in seen.items():
        weights = np.bincount(each.block, each.weight)
        sums = np.bincount(each.block, each.weight * each.error)
        means = sums[weights > 0.0] / weights[weights > 0.0]
        mean = float(np.average(each.error, weights=each.weight))
        square = float(np.average(each.error**2, weights=each.weight))
        takes = mean**2 / max(square, 1e-300)
        if means.size < MIN_BLOCKS or takes < MIN_CONSTANT_SHARE:
            continue
        scatter = float(np.std(means, ddof=1)) / math.sqrt(means.size)
        if abs(mean) < MIN_CONSTANT_SIGMAS * scatter:
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
    return [_Structure(short, each) for each in found]


def _describe_trial_constants(trials: Trials, worst: str) -> list[_Structure]:
    """Return constants that differ from trial to trial in words."""
    able = [each for each in trials.constants if each.share >= MIN_TREND_SHARE]
    if not able:
        return []
    best = able[0]
    name = plain_name(best.parameter.name)
    values = [
        _relative_value(best, change, error)
        for change, error in zip(best.change, best.error, strict=True)
    ]
    table = [
        f"{trial} {value}" for trial, value in zip(best.trials, values, strict=True)
    ]
    if len(table) > _MAX_SHOWN:
        table = [*table[:3], "...", *table[-3:]]
    unit = f"{best.parameter.unit} from the mean"
    unit = "times the mean" if best.parameter.factor else unit
    rivals = [
        f"{plain_name(each.parameter.name)} by trial would take "
        f"{format_share(each.share)}"
        for each in able[1:]
        if each.share > best.share - RIVAL_MARGIN
    ]
    takes = (
        f"A {name} of its own for every trial takes {format_share(best.share)} of the "
        f"squared error beyond the noise ({', '.join(table)}; "
        f"{unit}){'; ' * bool(rivals)}{list_words(rivals)}."
    )
    tried = trial_trends(best, trials.ordinates)
    level = TREND_BY_CHANCE / max(len(trials.constants) * len(tried), 1)
    clear = [each for each in tried if each.chance < level]
    if not clear:
        if best.share < UNORDERED_SHARE:
            return []
        test = f" It follows no trend ({_trend_statistics(tried[0])})." if tried else ""
        return [
            _Structure(
                f"{name} differs from trial to trial without a trend",
                Where(
                    worst,
                    "trial",
                    best.share,
                    f"{capitalise(name)} differs from trial to trial. {takes}{test}",
                ),
            )
        ]
    trend = clear[0]
    along = f"with the {trend.ordinate}"
    if trend.ordinate in SEQUENCE_ORDINATES:
        along = "from trial to trial"
    first, last = (
        pick(trials.ordinates[trend.ordinate]) for pick in (np.nanargmin, np.nanargmax)
    )
    moves = f"{'rises' if trend.slope > 0.0 else 'falls'} steadily {along}"
    sizes = f"from {values[first]} in {best.trials[first]} to {values[last]} in "
    return [
        _Structure(
            f"{name} {moves}, {sizes}{best.trials[last]} ({unit})",
            Where(
                worst,
                trend.ordinate,
                best.share,
                f"{capitalise(name)} {moves}. {takes} Test of the trend: "
                f"{'; '.join(map(_trend_statistics, clear))}.",
            ),
        )
    ]


def _trend_statistics(trend: Trend) -> str:
    return (
        f"along the {trend.ordinate} t = {format_number(trend.t)} with {trend.freedom} "
        f"degrees of freedom, p = {format_number(trend.chance)}"
    )


def _relative_value(found: TrialConstants, change: float, error: float) -> str:
    """Return a trial's value relative to the mean of all, with its standard error."""
    if found.parameter.factor:
        change = math.exp(change)
        error = change * error
    return (
        f"{format_number(change, 10.0 * error)} ± {format_number(error, 10.0 * error)}"
    )
