"""Differences between trials: errors, constants that change, odd trials, occasions.

A cable that was tightened or laid anew between trials is no effect of the library: the
trials then contradict each other, and no added effect explains them all.

Around a fitted model one parameter gets a value of its own in every trial, while all
others are fitted to all trials. The derivatives of the fit serve for that, so it costs
a few replays. A trend of these values is tested by weighted regression, in which trials
may scatter beyond their own uncertainty (DerSimonian and Laird 1986), with Student's t
(Hartung and Knapp 2001).

An effect that is part of the mechanism has one size on all occasions; an error of form
that it stands in for changes with load, pose and pretension. So the size of every
accepted effect is fitted to each occasion by itself while all other parameters are
shared. An occasion could show the effect if the standard error there is below a third
of the shared size, and shows it if 95 % of its size is on the same side of 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit.intervals import amplitude_indices
from cc_mujoco.diagnosis._fit.problem import (
    Problem,
    fit,
    huber_residual,
    independence_weight,
    residual_changes,
    residual_slopes,
)
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    format_fitted,
    format_number,
    format_share,
    plain_name,
)
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._rig.simulation import (
    base_name,
    change_name,
    is_change,
    occasions_of,
)
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import (
    OccasionChange,
    Occasions,
    OccasionSize,
    TrialError,
    Where,
)
from cc_mujoco.estimation._least_squares import Estimate, Tuned
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
        slack = 0.0
        if final is not None:
            model, x = final
            values, plant = model.values(x), model.plant
            shares = [plant.slack_share(values, model.effects, k) for k in places]
            sizes = [plant.records[k].time.size for k in places]
            slack = float(np.average(shares, weights=sizes))
        found.append(
            TrialError(
                name,
                _rms(problem, places, off),
                _rms(problem, places, left),
                _rms(problem, places, [problem.noise[k] for k in places]),
                _misfit(problem, places, off),
                _misfit(problem, places, left),
                slack,
            )
        )
    return tuple(found)


class Odd(NamedTuple):
    """Trial that the rest does not predict, or all that are declared turned."""

    trials: tuple[str, ...]  # names
    misfit: float  # RMS error over the noise floor, by parameters fitted to the others
    rest: float  # the same of the others
    tilt: float = 0.0  # declared tilt, where all trials of that tilt are meant [rad]
    own: str = ""  # required value of a constant of its own, in words
    # Declared condition of which the trial is the only extreme one, or ""
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

    def suspicious(at: FloatArray, least: float, share: float) -> tuple[str, ...]:
        found = []
        for name, own in places.items():
            shown = problem.torques(at, own)
            pairs = [(records[k].measured, t) for k, t in zip(own, shown, strict=True)]
            off = _misfit(problem, own, [read - torque for read, torque in pairs])
            swapped = [read[::-1] - torque for read, torque in pairs]
            if off > least and _misfit(problem, own, swapped) < share * off:
                found.append(name)
        return tuple(found)

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
    return [
        record.measured - torque
        for torque, record in zip(
            problem.torques(x), problem.plant.records, strict=True
        )
    ]


def _rms(
    problem: Problem, places: Sequence[int], errors: Sequence[FloatArray]
) -> dict[str, float]:
    """Return each channel's RMS error, weighted by 1 / floor^2 [N m]."""
    records = problem.plant.records
    weights = [records[k].counts / np.square(problem.floor[k]) for k in places]
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
            part[:, problem.plant.records[k].counts].ravel()
            for k, part in zip(places, parts, strict=True)
        ]
        return float(np.mean(np.concatenate(kept) ** 2))

    floor = [problem.floor[k] for k in places]
    off = [huber_residual(e / f) for e, f in zip(errors, floor, strict=True)]
    sensed = problem.sensed
    noise = [sensed[k] / f for k, f in zip(places, floor, strict=True)]
    return math.sqrt(mean_square(off) / mean_square(noise))


VARIED_PARAMETERS = (
    "friction",
    "pretension",
    "axial_stiffness",
    "friction_balance",
    "motor_torque_offset",
    "joint_torque_offset",
    "joint_angle_offset",
)
"""Parameters that a rig may change between trials."""
_MAX_LOG_STEP = math.log(2.0)
SEQUENCE_ORDINATES = ("order of the trials", "time of the trials")


class TrialConstants(NamedTuple):
    """One parameter with a value of its own in every trial."""

    parameter: Tuned  # of the fit
    trials: tuple[str, ...]  # names, in the order of the data
    # (trials,) from their mean: of the logarithm where `Tuned.factor`, else in its unit
    change: FloatArray
    error: FloatArray  # (trials,) standard errors of `change`
    # Share of the squared error beyond the floor that these values explain
    share: float
    # (trials,) in the unit of the parameter, if it is no logarithm; NaN where the fit
    # by trial fails
    value: FloatArray = np.zeros(0)
    value_error: FloatArray = np.zeros(0)  # (trials,) standard errors of `value`


class Trend(NamedTuple):
    """Regression of trial constants."""

    ordinate: str  # name of the regressor
    slope: float  # change per unit of it
    t: float  # slope over its standard error
    freedom: int  # degrees of freedom
    chance: float  # probability of such a t, in either direction, without a trend


def trial_constants(problem: Problem, x: FloatArray) -> tuple[TrialConstants, ...]:
    """Return parameters whose values by trial explain most of the error, best first."""
    fit = _ByTrial(problem, x, unhooked=False)
    if len(fit.trials) < Limit.min_trend_trials:
        return ()
    able = [
        index
        for index, parameter in enumerate(problem.tuned)
        if parameter.name in VARIED_PARAMETERS and fit.affects_every_trial(index)
    ]
    first = sorted(able, key=lambda index: -fit.foreseen(index))[: Limit.max_fitted]
    found = [fit.fitted(index) for index in first]
    return tuple(sorted(found, key=lambda each: -each.share))


def constants_by_occasion(
    problem: Problem, x: FloatArray, indices: Sequence[int]
) -> tuple[TrialConstants, ...]:
    """Return parameters with a value of their own on every occasion.

    The model was fitted to all trials at `x`. A parameter that an occasion does not
    inform is left out.
    """
    fit = _ByTrial(problem, x, lambda record: record.occasion)
    return tuple(fit.fitted(k) for k in indices if fit.affects_every_trial(k))


def trial_trends(
    found: TrialConstants, ordinates: Mapping[str, FloatArray]
) -> tuple[Trend, ...]:
    """Return regressions of trial constants, the least probable first.

    `ordinates` are (trials,) by name; those without variation are left out.
    """
    tried = []
    for name, values in ordinates.items():
        good = np.isfinite(values) & np.isfinite(found.change)
        if good.sum() < Limit.min_trend_trials or np.ptp(values[good]) == 0.0:
            continue
        tried.append(_trend(name, values[good], found.change[good], found.error[good]))
    return tuple(sorted(tried, key=lambda each: each.chance))


def _trend(name: str, at: FloatArray, change: FloatArray, error: FloatArray) -> Trend:
    from scipy.stats import t as student

    design = np.stack([np.ones(at.size), at - at.mean()], axis=1)
    freedom = at.size - 2
    least = 1e-3 * float(np.median(error)) + 1e-12
    sure = 1.0 / np.maximum(error, least) ** 2

    def regress(weights: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        square = design.T @ (design * weights[:, None])
        inverse: FloatArray = np.linalg.inv(square).astype(np.float64)
        size = inverse @ (design.T @ (weights * change))
        left = change - design @ size
        return size, inverse, float(weights @ left**2)

    _, inverse, beyond = regress(sure)
    # Mean residual of a regression with these weights at a scatter of 1.
    lost = np.trace(inverse @ (design.T @ (design * sure[:, None] ** 2)))
    scatter = max(0.0, (beyond - freedom) / max(float(sure.sum() - lost), 1e-300))
    size, inverse, beyond = regress(1.0 / (1.0 / sure + scatter))
    spread = math.sqrt(max(beyond / freedom, 1e-300) * inverse[1, 1])
    t = float(size[1] / spread)
    return Trend(
        name, float(size[1]), t, freedom, float(2.0 * student.sf(abs(t), freedom))
    )


class _ByTrial:
    """Gauss-Newton with one parameter by trial, by the derivatives of the whole fit.

    `group` names what counts as a trial, for example the occasion of a record; those
    with the cables off are left out unless `unhooked`.
    """

    def __init__(
        self,
        problem: Problem,
        x: FloatArray,
        group: Callable[[Record], str] = lambda record: record.trial,
        unhooked: bool = True,
    ) -> None:
        records = problem.plant.records
        self._problem, self._x = problem, x
        self._masks = [
            record.counts & (unhooked or not record.unhooked) for record in records
        ]
        self._seen = [k for k, mask in enumerate(self._masks) if mask.any()]
        groups = [group(records[k]) for k in self._seen]
        self.trials = tuple(dict.fromkeys(groups))
        self._place = [self.trials.index(each) for each in groups]
        self._torques = problem.torques(x, self._seen)
        self._slopes = problem.slopes.of(problem, x, self._seen, self._torques)
        self._rows = np.concatenate(
            [
                np.full(len(torque) * int(self._masks[k].sum()), place)
                for k, place, torque in zip(
                    self._seen, self._place, self._torques, strict=True
                )
            ]
        )
        self._error = self._weighted(self._torques)
        self._jacobian = self._derivatives(self._torques)
        self._prior = np.array([1.0 / p.prior for p in problem.tuned])
        floor = problem.weight**2 * sum(
            float(np.sum((noise / by)[:, mask] ** 2))
            for noise, by, mask in zip(
                problem.sensed, problem.floor, self._masks, strict=True
            )
        )
        self._beyond = float(self._error @ self._error) - floor
        self._noise = floor

    def affects_every_trial(self, index: int) -> bool:
        square = np.bincount(
            self._rows, self._jacobian[:, index] ** 2, len(self.trials)
        )
        return bool(np.all(square > 1e-4))

    def foreseen(self, index: int) -> float:
        """Return the share of the error that it explains by trial, to first order."""
        design = self._design(self._jacobian, index)
        step = self._solve(design, self._error, np.zeros(design.shape[1]), index)
        return self._share(self._error + design @ step)

    def fitted(self, index: int) -> TrialConstants:
        shared = self._x.size - 1
        place = np.zeros(shared + len(self.trials))
        torques, error, slopes = self._torques, self._error, self._jacobian
        best = self._cost(error, place, index)
        proposed = self._solve(self._design(slopes, index), error, place, index)
        for _ in range(4):
            design = self._design(slopes, index)
            for damping in Limit.dampings:
                step = self._solve(design, error, place, index, damping)
                step = self._limited(step, index)
                there = self._simulated(place + step, index)
                left = self._weighted(there)
                cost = self._cost(left, place + step, index)
                if cost < best:
                    break
            else:
                break
            done = cost > (1.0 - 1e-3) * best
            place, torques, error, best = place + step, there, left, cost
            slopes = self._derivatives(torques)
            if done:
                break
        found = self._constants(index, place, torques, error, slopes)
        own = np.abs(proposed[shared:]) * self._problem.tuned[index].scale
        if not place.any() and np.any(own > Limit.missed_sigmas * found.value_error):
            found = found._replace(value=np.full(own.size, np.nan))
        return found

    def _limited(self, step: FloatArray, index: int) -> FloatArray:
        """Return a step along which no logarithm changes by more than a factor of 2."""
        tuned = self._problem.tuned
        shared = [p for k, p in enumerate(tuned) if k != index]
        own = [tuned[index]] * len(self.trials)
        scales = np.array([p.scale if p.factor else 0.0 for p in (*shared, *own)])
        longest = float(np.max(np.abs(step) * scales))
        return step * min(1.0, _MAX_LOG_STEP / max(longest, 1e-300))

    def _constants(
        self,
        index: int,
        place: FloatArray,
        torques: Sequence[FloatArray],
        error: FloatArray,
        slopes: FloatArray,
    ) -> TrialConstants:
        problem = self._problem
        parameter, count = problem.tuned[index], len(self.trials)
        design = self._design(slopes, index)
        square = design.T @ design + np.diag(self._priors(index) ** 2)
        plain = [np.zeros(mask.size)[None] for mask in self._masks]
        for k, torque in zip(self._seen, torques, strict=True):
            record = problem.plant.records[k]
            plain[k] = huber_residual((record.measured - torque) / problem.floor[k])
        # Errors of this model are weighted by the share of them that is independent.
        ratio = problem.weight / max(independence_weight(plain, self._masks), 1e-300)
        covariance = np.linalg.pinv(square, rcond=1e-10, hermitian=True) * ratio**2
        centre = np.eye(count) - 1.0 / count
        own = covariance[-count:, -count:]
        spread = centre @ own @ centre
        return TrialConstants(
            parameter,
            self.trials,
            parameter.scale * (centre @ place[-count:]),
            parameter.scale * np.sqrt(np.maximum(np.diag(spread), 0.0)),
            self._share(error),
            parameter.start + parameter.scale * (self._x[index] + place[-count:]),
            parameter.scale * np.sqrt(np.maximum(np.diag(own), 0.0)),
        )

    def _share(self, error: FloatArray) -> float:
        """Return the removed share of squared error beyond the floor, 0 without any."""
        if self._beyond <= 0.02 * self._noise:
            return 0.0
        return 1.0 - (float(error @ error) - self._noise) / self._beyond

    def _weighted(self, torques: Sequence[FloatArray]) -> FloatArray:
        """Return the residuals of the samples that count (rows,), without priors."""
        problem = self._problem
        return np.concatenate(
            [
                problem.weight
                * huber_residual(
                    (problem.plant.records[k].measured - torque) / problem.floor[k]
                )[:, self._masks[k]].ravel()
                for k, torque in zip(self._seen, torques, strict=True)
            ]
        )

    def _derivatives(self, torques: Sequence[FloatArray]) -> FloatArray:
        """Return the derivatives of the residuals (rows, parameters)."""
        steep = residual_slopes(self._problem, torques, self._masks)
        return residual_changes(steep, self._slopes).T

    def _design(self, slopes: FloatArray, index: int) -> FloatArray:
        """Return derivatives by the others, then by this one in every trial."""
        own = np.zeros((len(slopes), len(self.trials)))
        own[np.arange(len(slopes)), self._rows] = slopes[:, index]
        return np.concatenate([np.delete(slopes, index, axis=1), own], axis=1)

    def _priors(self, index: int) -> FloatArray:
        """Return the inverse deviations of the priors, without values of one trial."""
        known = np.delete(self._prior, index)
        return np.concatenate([known, np.zeros(len(self.trials))])

    def _off(self, place: FloatArray, index: int) -> FloatArray:
        """Return the residuals of the priors (unknowns,)."""
        start = np.delete(self._x, index)
        at = np.concatenate([start, np.zeros(len(self.trials))]) + place
        return -self._priors(index) * at

    def _cost(self, error: FloatArray, place: FloatArray, index: int) -> float:
        off = self._off(place, index)
        return float(error @ error + off @ off)

    def _solve(
        self,
        design: FloatArray,
        error: FloatArray,
        place: FloatArray,
        index: int,
        damping: float = 0.0,
    ) -> FloatArray:
        known = self._priors(index)
        square = design.T @ design + np.diag(known**2)
        slope = design.T @ error - known * self._off(place, index)
        size = np.sqrt(np.diag(square))
        size[size == 0.0] = 1.0
        scaled = square / np.outer(size, size)
        scaled[np.diag_indices_from(scaled)] *= 1.0 + damping
        found: FloatArray = -np.linalg.lstsq(scaled, slope / size, 1e-10)[0] / size
        return found

    def _simulated(self, place: FloatArray, index: int) -> list[FloatArray]:
        """Return the torques of the visible records, each with its trial's value."""
        shared = np.insert(place[: self._x.size - 1], index, 0.0)
        found = []
        for trial, own in enumerate(place[self._x.size - 1 :]):
            at = self._x + shared
            at[index] += own
            chosen = [
                k for k, p in zip(self._seen, self._place, strict=True) if p == trial
            ]
            found += list(zip(chosen, self._problem.torques(at, chosen), strict=True))
        return [torque for _, torque in sorted(found, key=lambda each: each[0])]


def random_constants(
    constants: Sequence[TrialConstants],
    ordinates: Mapping[str, FloatArray],
    misfit: float,
) -> str:
    """Return in words the constant that differs at random between trials, or "".

    `ordinates` (trials,) by name are those along which constants may drift; `misfit` is
    that of the tuned scene.
    """
    found = describe_trial_constants(constants, ordinates, "")
    if found is None:
        return ""
    _, where = found
    if where.axis != "trial" or where.share_of_error <= Limit.random_share:
        return ""
    return (
        "The trials contradict each other: the error of the tuned scene is "
        f"{format_number(misfit)} times the noise floor. {where.statement} Effects "
        "were not searched, as they hold for all trials: find out what was changed "
        "between them, or declare it."
    )


def trial_ordinates(
    problem: Problem, names: Sequence[str], warmth: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return the ordinates that trial constants may follow, (trials,) each by name.

    `warmth` is the mean temperature of trials by name, where it is known [degC].
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


def describe_trial_constants(
    constants: Sequence[TrialConstants], ordinates: Mapping[str, FloatArray], worst: str
) -> tuple[str, Where] | None:
    """Return constants that differ from trial to trial in words, short and in full."""
    able = [each for each in constants if each.share >= Limit.min_trend_share]
    if not able:
        return None
    best = able[0]
    name = plain_name(best.parameter.name)
    values = [
        _relative_value(best, change, error)
        for change, error in zip(best.change, best.error, strict=True)
    ]
    table = [f"{t} {value}" for t, value in zip(best.trials, values, strict=True)]
    if len(table) > 12:
        table = [*table[:3], "...", *table[-3:]]
    unit = f"{best.parameter.unit} from the mean"
    unit = "times the mean" if best.parameter.factor else unit
    rivals = [
        f"{plain_name(each.parameter.name)} by trial would take "
        f"{format_share(each.share)}"
        for each in able[1:]
        if each.share > best.share - Limit.rival_margin
    ]
    takes = (
        f"A {name} of its own for every trial takes {format_share(best.share)} of the "
        f"squared error beyond the noise ({', '.join(table)}; "
        f"{unit}){'; ' * bool(rivals)}{list_words(rivals)}."
    )
    tried = trial_trends(best, ordinates)
    level = Limit.trend_false_alarm_rate / max(len(constants) * len(tried), 1)
    clear = [each for each in tried if each.chance < level]
    if not clear:
        if best.share < Limit.unordered_share:
            return None
        test = f" It follows no trend ({_trend_statistics(tried[0])})." if tried else ""
        return (
            f"{name} differs from trial to trial without a trend",
            Where(
                worst,
                "trial",
                best.share,
                f"{capitalise(name)} differs from trial to trial. {takes}{test}",
            ),
        )
    trend = clear[0]
    along = f"with the {trend.ordinate}"
    if trend.ordinate in SEQUENCE_ORDINATES:
        along = "from trial to trial"
    first, last = (
        pick(ordinates[trend.ordinate]) for pick in (np.nanargmin, np.nanargmax)
    )
    moves = f"{'rises' if trend.slope > 0.0 else 'falls'} steadily {along}"
    sizes = f"from {values[first]} in {best.trials[first]} to {values[last]} in "
    return (
        f"{name} {moves}, {sizes}{best.trials[last]} ({unit})",
        Where(
            worst,
            trend.ordinate,
            best.share,
            f"{capitalise(name)} {moves}. {takes} Test of the trend: "
            f"{'; '.join(map(_trend_statistics, clear))}.",
        ),
    )


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


_REPORTED = ("friction", "pretension", "axial_stiffness", "friction_balance")
"""Parameters whose changes say something about the rig, in the order of reports."""


def compare_occasions(
    problem: Problem, x: FloatArray, estimated: Mapping[str, Estimate]
) -> Occasions | None:
    names = occasions_of(problem.plant.records)
    if len(names) < 2:
        return None
    changes = _changes(problem, names, estimated)
    sizes = []
    for effect in problem.effects:
        indices = [
            k
            for k in amplitude_indices(problem, [effect])
            if abs(x[k]) > Limit.absent  # others are at a bound
        ]
        for each in constants_by_occasion(problem, x, indices):
            shared = each.parameter.value(float(x[problem.tuned.index(each.parameter)]))
            sizes.append(compare_size(effect, each, shared))
    return Occasions(names, tuple(changes), tuple(sizes), _statement(changes, names))


def agreement_shares(compared: Occasions) -> dict[str, float]:
    """Return the share of the sizes of each effect on which all occasions agree."""
    by_effect: dict[str, list[bool]] = {}
    for each in compared.sizes:
        by_effect.setdefault(each.effect, []).append(each.agree)
    return {name: sum(own) / len(own) for name, own in by_effect.items()}


def _changes(
    problem: Problem, names: Sequence[str], estimated: Mapping[str, Estimate]
) -> list[OccasionChange]:
    tuned = {parameter.name: parameter for parameter in problem.tuned}
    found = []
    for since in reversed(names[:-1]):
        for base in (*_REPORTED, *(n for n in tuned if n not in _REPORTED)):
            name = change_name(base, since)
            if name in tuned and not is_change(base):
                change, words = describe_change(tuned[name], estimated[name])
                factor = tuned[name].factor
                found.append(
                    OccasionChange(base, since, names[-1], change, factor, words)
                )
    return found


def describe_change(tuned: Tuned, earlier: Estimate) -> tuple[Estimate, str]:
    """Return the change to the later occasion, and the same in words.

    `tuned` is a change, see `change_name`; its estimate is the earlier occasion over
    the later one, or less it.
    """
    low, high = earlier.ci95
    if tuned.factor:
        change = Estimate(
            1.0 / earlier.value - 1.0, "1", (1.0 / high - 1.0, 1.0 / low - 1.0)
        )
    else:
        change = Estimate(-earlier.value, earlier.unit, (-high, -low))
    words = _percent(change) if tuned.factor else _difference(change)
    return change, f"{plain_name(base_name(tuned.name))} {words}"


def _percent(change: Estimate) -> str:
    low, high = change.ci95
    if high - low > Limit.max_relative_width:
        return "not determined"
    scaled = Estimate(100.0 * change.value, "%", (100.0 * low, 100.0 * high))
    return _difference(scaled)


def _difference(change: Estimate) -> str:
    low, high = change.ci95
    unit = f" {change.unit}".removesuffix(" 1")
    if math.isnan(low):
        return "not determined"
    if change.holds(0.0):
        most = format_number(max(abs(low), abs(high)), high - low)
        return f"unchanged within {most}{unit}"
    sign = "+" if change.value > 0.0 else ""
    return (
        f"{sign}{format_fitted(change)}{unit} (95 %: "
        f"{format_number(low, high - low)} to {format_number(high, high - low)})"
    )


def _statement(recent: Sequence[OccasionChange], names: Sequence[str]) -> str:
    own = [e for e in recent if e.since == names[-2] and e.parameter in _REPORTED]
    changed = [e.statement for e in own if not e.change.holds(0.0)]
    same = [e.statement for e in own if e.change.holds(0.0)]
    start = f"Since {names[-2]}: "
    if not changed:
        return f"{start}nothing that these data show; {list_words(same)}."
    return f"{start}{list_words(changed + same)}."


def compare_size(effect: str, found: TrialConstants, shared: float) -> OccasionSize:
    unit = found.parameter.unit
    name = plain_name(found.parameter.name)
    if not np.all(np.isfinite(found.value)):
        text = f"{name}: the fit to each occasion fails, so agreement is not known."
        return OccasionSize(effect, found.parameter.name, {}, True, text)
    sizes = {
        name: Estimate(
            value, unit, (value - Limit.sigmas * error, value + Limit.sigmas * error)
        )
        for name, value, error in zip(
            found.trials, found.value.tolist(), found.value_error.tolist(), strict=True
        )
    }
    able = [
        name
        for name, error in zip(found.trials, found.value_error.tolist(), strict=True)
        if Limit.visible_ratio * error < abs(shared)
    ]
    missing = [n for n in able if sizes[n].holds(0.0) or sizes[n].value * shared < 0.0]
    words = [f"{format_fitted(size)} on {name}" for name, size in sizes.items()]
    text = f"{name} [{unit or '1'}]: {list_words(words)}"
    if missing:
        text += f"; {list_words(missing)} could show it and does not"
    elif len(able) < len(sizes):
        blind = [name for name in sizes if name not in able]
        text += f"; {list_words(blind)} cannot show a size of {format_number(shared)}"
    return OccasionSize(effect, found.parameter.name, sizes, not missing, f"{text}.")
