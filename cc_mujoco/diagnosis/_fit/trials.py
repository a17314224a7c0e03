"""Error of every trial, and a test for one recorded on another rig.

A cable that was tightened or laid anew between trials is no effect of the library: the
trials then contradict each other, and no added effect explains them all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.fitting import Problem, fit, huber_residual
from cc_mujoco.diagnosis._phrases import format_number
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import TrialError
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

TRIAL_CONSTANTS = ("pretension", "friction", "tilt")
"""Parameters that one trial may have of its own."""
MAX_LOG_CHANGE = math.log(8.0)
"""Logarithm of the largest such change."""


def trial_errors(
    problem: Problem,
    before: Sequence[FloatArray],
    after: Sequence[FloatArray],
    final: tuple[Problem, FloatArray] | None = None,
) -> tuple[TrialError, ...]:
    """Return the errors of every trial of which samples count, in order.

    `before` and `after` are (2, samples) torques of the baseline and of the extended
    model for every record [N m]; `final` is that model and its parameters, for the
    shares of slack.
    """
    found = []
    for name, places in _record_indices(problem).items():
        measured = [problem.plant.records[k].measured for k in places]
        off, left = (
            [m - torque[k] for k, m in zip(places, measured, strict=True)]
            for torque in (before, after)
        )
        found.append(
            TrialError(
                name,
                _rms(problem, places, off),
                _rms(problem, places, left),
                _rms(problem, places, [problem.noise[k] for k in places]),
                _misfit(problem, places, off),
                _misfit(problem, places, left),
                0.0 if final is None else _slack_share(*final, places),
            )
        )
    return tuple(found)


def _slack_share(problem: Problem, x: FloatArray, places: Sequence[int]) -> float:
    values, records = problem.values(x), problem.plant.records
    sizes = [records[k].time.size for k in places]
    shares = [problem.plant.slack_share(values, problem.effects, k) for k in places]
    return float(np.average(shares, weights=sizes))


class Odd(NamedTuple):
    """Trial that the rest does not predict, or all that are declared turned.

    Attributes:
        trials: names.
        misfit: RMS error over the noise floor, by parameters fitted to the others.
        rest: the same of the others.
        tilt: declared tilt, where all trials of that tilt are meant [rad].
        own: required value of a constant of its own, in words.
        extreme: declared condition of which the trial is the only extreme one, or "".
    """

    trials: tuple[str, ...]
    misfit: float
    rest: float
    tilt: float = 0.0
    own: str = ""
    extreme: str = ""

    @property
    def question(self) -> str:
        """Question to whoever recorded it."""
        several = len(self.trials) > 1
        off = (
            f"Trial{'s' * several} {list_words(self.trials)} "
            f"{'are' if several else 'is'} off by {format_number(self.misfit)} times "
            "the noise floor, the others, fitted without, by "
            f"{format_number(self.rest)}: "
        )
        if self.tilt:
            return (
                f"{off}was the rig turned by {format_number(self.tilt)} rad, positive "
                f"as the joint is? It looks as if {self.own}. Correct sign and size of "
                "`tilt` in dataset.toml."
            )
        return (
            f"{off}was its pretension, its route or the way the rig stands changed?"
            f" It looks as if {self.own}. If so, declare it in dataset.toml "
            f"([trials.{self.trials[0]!r}] pretension, tilt)"
            + (
                f"; keep the trial, as no other has such a {self.extreme}."
                if self.extreme
                else ", or leave the trial out."
            )
        )


def exchanged_torques(problem: Problem, x: FloatArray) -> str:
    """Return in a sentence which trials have exchanged torque columns, or "".

    The others predict such a trial once its torques are exchanged.
    """
    records = problem.plant.records
    places = {
        name: own
        for name, own in _record_indices(problem).items()
        if len(records[own[0]].measured) == 2
        and not (records[own[0]].unhooked or records[own[0]].load_cell)
    }

    def by_exchange(at: FloatArray, name: str) -> tuple[float, float]:
        own = places[name]
        plant = problem.plant
        shown = plant.simulate(problem.values(at), problem.effects, own)
        found = []
        for order in (slice(None), slice(None, None, -1)):
            pairs = zip(own, shown, strict=True)
            errors = [records[k].measured[order] - torque for k, torque in pairs]
            found.append(_misfit(problem, own, errors))
        return found[0], found[1]

    def suspicious(at: FloatArray, least: float, share: float) -> tuple[str, ...]:
        sizes = {name: by_exchange(at, name) for name in places}
        return tuple(
            name
            for name, (off, exchanged) in sizes.items()
            if off > least and exchanged < share * off
        )

    names = suspicious(x, Limit.outlier_floor_ratio, 0.5)
    if not names or 2 * len(names) > len(places):
        return ""
    suspect, there = _leave_out(problem, x, names, _record_indices(problem))
    least = max(Limit.outlier_floor_ratio, Limit.outlier_ratio * suspect.rest)
    names = suspicious(there, least, Limit.max_exchanged_share)
    if not names:
        return ""
    several = len(names) > 1
    return (
        f"The torque columns of trial{'s' * several} {list_words(names)} are swapped: "
        f"{'they are' if several else 'it is'} {format_number(suspect.misfit)} times "
        "the noise floor off by what the other trials determine, and fit"
        f"{'' if several else 's'} once motor_torque_nm and joint_torque_nm are "
        "exchanged; exchange them, or declare `swapped = true` if the sensors were."
    )


def find_outlier_trial(
    problem: Problem, x: FloatArray, tuned: Mapping[str, float] | None = None
) -> Odd | None:
    """Return the trial that contradicts the others, if there is one.

    A constant of its own brings it to the level of the others. A trial with the widest
    motion suffers most from whatever the model lacks. `tuned` has the error of every
    trial by the tuned scene over the floor, see `misfits`; None if that is the model.
    """
    places = _record_indices(problem)
    if len(places) < Limit.min_outlier_trials:
        return None
    off = misfits(problem, x)
    before = tuned or off
    worst = sorted(off, key=lambda name: -off[name])[: Limit.max_suspects]
    suspects: list[tuple[str, ...]] = [
        (name,) for name in worst if off[name] > Limit.outlier_floor_ratio / 2.0
    ]
    tilts = {name: problem.plant.records[own[0]].tilt for name, own in places.items()}
    suspects += [
        names
        for tilt in sorted(set(tilts.values()) - {0.0})
        for names in [tuple(name for name, own in tilts.items() if own == tilt)]
        if 2 * len(names) <= len(places)
        and max(off[n] for n in names) > Limit.outlier_floor_ratio / 2.0
    ]
    found = [_leave_out(problem, x, names, places) for names in dict.fromkeys(suspects)]
    odd = min(found, key=lambda each: each[0].rest, default=None)
    if odd is None or odd[0].misfit < max(
        Limit.outlier_floor_ratio, Limit.outlier_ratio * odd[0].rest
    ):
        return None
    suspect, there = odd
    if suspect.misfit < Limit.min_remaining_share * max(
        before[name] for name in suspect.trials
    ):
        return None
    tilt = tilts[suspect.trials[0]]
    turned = tilt and sum(each == tilt for each in tilts.values()) == len(
        suspect.trials
    )
    own = [k for name in suspect.trials for k in places[name]]
    left, words = _best_own_constant(
        problem, there, own, ("tilt",) if turned else TRIAL_CONSTANTS
    )
    if left > Limit.max_remaining_ratio * max(suspect.rest, 1.0):
        return None
    return suspect._replace(
        tilt=tilt if turned else 0.0,
        own=words,
        extreme=_extreme_condition(problem, suspect.trials),
    )


def _extreme_condition(problem: Problem, names: Sequence[str]) -> str:
    records = problem.plant.records

    def lie_beyond(values: Callable[[Record], float | None]) -> bool:
        own, others = (
            [v for r in records if (r.trial in names) == inside and (v := values(r))]
            for inside in (True, False)
        )
        if not own or not others:
            return bool(own)
        return min(own) > 1.05 * max(others) or max(own) < 0.95 * min(others)

    if lie_beyond(lambda record: record.pretension):
        return "pretension"
    if lie_beyond(lambda record: abs(record.tilt)):
        return "tilt"
    return "load" if lie_beyond(lambda r: max(map(abs, r.known_torques))) else ""


def misfits(problem: Problem, x: FloatArray) -> dict[str, float]:
    """Return the RMS error of every trial over the noise floor, by name."""
    errors = _errors(problem, x)
    return {
        name: _misfit(problem, own, [errors[k] for k in own])
        for name, own in _record_indices(problem).items()
    }


def _leave_out(
    problem: Problem,
    x: FloatArray,
    names: tuple[str, ...],
    places: dict[str, list[int]],
) -> tuple[Odd, FloatArray]:
    own = [k for name in names for k in places[name]]
    masks = [
        record.free & (k not in own) for k, record in enumerate(problem.plant.records)
    ]
    there = fit(problem, x, masks).x
    errors = _errors(problem, there)
    rest = [k for other, theirs in places.items() if other not in names for k in theirs]
    return Odd(
        names,
        _misfit(problem, own, [errors[k] for k in own]),
        _misfit(problem, rest, [errors[k] for k in rest]),
    ), there


def _best_own_constant(
    problem: Problem, x: FloatArray, places: list[int], names: Sequence[str]
) -> tuple[float, str]:
    """Find the constant that explains trials best if it is their own.

    Return their RMS error over the floor with it, and its value in words.
    """
    values = problem.values(x)
    records = problem.plant.records
    start = problem.plant.bench.cables[0].pretension

    def misfit(name: str, change: float) -> float:
        errors = []
        for k in places:
            record, changed = records[k], {**values}
            if name == "pretension":
                usual = start if record.pretension is None else record.pretension
                record = replace(record, pretension=math.exp(change) * usual)
            elif name == "tilt":
                record = replace(record, tilt=change)
            else:
                changed[name] = math.exp(change) * values[name]
            plant = problem.plant.limited([record])
            (torque,) = plant.simulate(changed, problem.effects)
            errors.append(record.measured - torque)
        return _misfit(problem, places, errors)

    known = set(names) if "joint_gravity" in problem.effects else {*names} - {"tilt"}
    if any(records[k].unhooked for k in places):
        known &= {"tilt"}
    tried = {name: _minimise_misfit(name, misfit) for name in names if name in known}
    if not tried:
        return math.inf, ""
    name = min(tried, key=lambda each: tried[each][0])
    left, change = tried[name]
    if name == "friction":
        description = (
            f"friction times wrap were {format_number(math.exp(change))} times that of "
        )
        return left, f"{description}the others"
    if name == "tilt":
        return left, f"the rig had been turned by {format_number(change)} rad"
    own = records[places[0]].pretension
    tension = values.get("pretension", start)
    if own is not None and start > 0.0:
        tension *= own / start
    return left, (
        f"its pretension were {format_number(math.exp(change) * tension)} N, not "
        f"{format_number(tension)} N"
    )


def _minimise_misfit(
    name: str, misfit: Callable[[str, float], float]
) -> tuple[float, float]:
    """Return the least misfit by a constant, and its change there."""
    from scipy.optimize import minimize_scalar

    low, high = -MAX_LOG_CHANGE, MAX_LOG_CHANGE
    if name == "tilt":
        turns = np.linspace(-math.pi, math.pi, Limit.tilt_grid_points, endpoint=False)
        about = float(min(turns, key=lambda turn: misfit(name, float(turn))))
        low, high = (
            about - math.tau / Limit.tilt_grid_points,
            about + math.tau / Limit.tilt_grid_points,
        )
    best = minimize_scalar(
        lambda change: misfit(name, float(change)),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 0.01, "maxiter": 25},
    )
    return float(best.fun), float(best.x)


def _record_indices(problem: Problem) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for k, record in enumerate(problem.plant.records):
        if record.counts.any():
            found.setdefault(record.trial, []).append(k)
    return found


def _errors(problem: Problem, x: FloatArray) -> list[FloatArray]:
    """Return the errors, measured minus simulated (2, samples) of each record [N m]."""
    played = problem.plant.simulate(problem.values(x), problem.effects)
    return [
        record.measured - torque
        for torque, record in zip(played, problem.plant.records, strict=True)
    ]


def _rms(
    problem: Problem, places: Sequence[int], errors: Sequence[FloatArray]
) -> dict[str, float]:
    """Return each channel's RMS error, weighted by 1 / floor^2 [N m]."""
    weights = [
        _counted_samples(problem, k) / np.square(problem.floor[k]) for k in places
    ]
    squares = [
        (w * error**2).sum(axis=1) for w, error in zip(weights, errors, strict=True)
    ]
    total = np.sum([w.sum(axis=1) for w in weights], axis=0)
    found = np.sqrt(np.sum(squares, axis=0) / total)
    return dict(zip(problem.plant.instruments.channels, found.tolist(), strict=True))


def _misfit(
    problem: Problem, places: Sequence[int], errors: Sequence[FloatArray]
) -> float:
    """Return the RMS error, by Huber as in fits, over that of noise alone."""

    def mean_square(parts: Sequence[FloatArray]) -> float:
        kept = [
            part[:, _counted_samples(problem, k)].ravel()
            for k, part in zip(places, parts, strict=True)
        ]
        return float(np.mean(np.concatenate(kept) ** 2))

    floor = [problem.floor[k] for k in places]
    off = [huber_residual(e / f) for e, f in zip(errors, floor, strict=True)]
    sensed = problem.sensed
    noise = [sensed[k] / f for k, f in zip(places, floor, strict=True)]
    return math.sqrt(mean_square(off) / mean_square(noise))


def _counted_samples(problem: Problem, place: int) -> NDArray[np.bool_]:
    return problem.plant.records[place].counts
