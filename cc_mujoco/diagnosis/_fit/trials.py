"""Differences between trials: errors, varying constants, outliers, occasions.

A cable that was tightened or routed anew between trials is no effect of the library:
the trials then contradict each other, and no added effect explains them all.

To find this, one parameter of a fitted model gets a value for every trial, while all
others are fitted to all trials. The derivatives of the fit are reused, so it costs a
few replays. An effect that is part of the mechanism has one size on all occasions. An
error of form that it stands in for changes with load, pose and pretension, which the
size fitted to each occasion shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit import problem as fitting
from cc_mujoco.diagnosis._fit.intervals import amplitude_indices
from cc_mujoco.diagnosis._fit.problem import Problem
from cc_mujoco.diagnosis._phrases import (
    capitalise,
    format_estimate,
    format_fitted,
    format_number,
    format_share,
    plain_name,
)
from cc_mujoco.diagnosis._rig import simulation
from cc_mujoco.diagnosis._rig.records import Arrays, Record
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


def trial_errors(
    problem: Problem, before: Arrays, after: Arrays, final: tuple[Problem, FloatArray]
) -> tuple[TrialError, ...]:
    """Return the errors of both models in every trial with counted samples, in order.

    `before` and `after` are their torques (2, samples) of every record [N m]; `final`
    is the second model and its parameters, for the shares of slack.
    """
    found, records, (model, x) = [], problem.plant.records, final
    values, plant = model.values(x), model.plant
    for name, places in problem.plant.by_trial.items():
        sides = before, after
        off, left = ([records[k].measured - side[k] for k in places] for side in sides)
        noise = [problem.noise[k] for k in places]
        rmse = [_rms(problem, places, errors) for errors in (off, left, noise)]
        misfits = problem.misfit(places, off), problem.misfit(places, left)
        shares = [plant.slack_share(values, model.effects, k) for k in places]
        sizes = [plant.records[k].time.size for k in places]
        slack = float(np.average(shares, weights=sizes))
        found.append(TrialError(name, rmse[0], rmse[1], rmse[2], *misfits, slack))
    return tuple(found)


class Outlier(NamedTuple):
    """Trial, or all trials of one tilt, that the fit to the others misses."""

    trials: tuple[str, ...]  # names
    misfit: float  # RMS error over the noise floor, by parameters fitted to the others
    rest: float  # the same of the others
    tilt: float = 0.0  # declared tilt, where all trials of that tilt are meant [rad]
    own: str = ""  # required value of a constant of its own, in words
    extreme: str = ""  # declared condition of which it is the only extreme one, or ""

    @property
    def least(self) -> float:
        """Misfit above which the trial counts as an outlier."""
        return max(Limit.outlier_floor_ratio, Limit.outlier_ratio * self.rest)

    @property
    def question(self) -> str:
        single = len(self.trials) == 1
        off = (
            f"{'Trial' if single else 'Trials'} {list_words(self.trials)} "
            f"{'is' if single else 'are'} off by {format_number(self.misfit)} times "
            "the noise floor, the others, fitted without, by "
            f"{format_number(self.rest)}: "
        )
        if self.tilt:
            return (
                f"{off}was the rig turned by {format_number(self.tilt)} rad, positive "
                f"as the joint is? It looks as if {self.own}. Correct sign and size of "
                "`tilt` in dataset.toml."
            )
        advice = ", or leave the trial out"
        if self.extreme:
            advice = f"; keep the trial, as no other has such a {self.extreme}"
        return (
            f"{off}was its pretension, its route or the way the rig stands changed?"
            f" It looks as if {self.own}. If so, declare it in dataset.toml "
            f"([trials.{self.trials[0]!r}] pretension, tilt){advice}."
        )


def exchanged_torques(problem: Problem, x: FloatArray) -> str:
    """Return an advice if trials fit better with exchanged torque columns, or ""."""
    records, every = problem.plant.records, problem.plant.by_trial.items()
    firsts = {name: (own, records[own[0]]) for name, own in every}
    able = {n: own for n, (own, r) in firsts.items() if not (r.unhooked or r.load_cell)}
    places = {n: own for n, own in able.items() if len(records[own[0]].measured) == 2}

    def suspicious(at: FloatArray, least: float, share: float) -> tuple[str, ...]:
        found = []
        for name, own in places.items():
            torques = problem.torques(at, own)
            pairs = [
                (records[k].measured, t) for k, t in zip(own, torques, strict=True)
            ]
            off = problem.misfit(own, [read - torque for read, torque in pairs])
            swapped = [read[::-1] - torque for read, torque in pairs]
            if off > least and problem.misfit(own, swapped) < share * off:
                found.append(name)
        return tuple(found)

    names = suspicious(x, Limit.outlier_floor_ratio, 0.5)
    if not names or 2 * len(names) > len(places):
        return ""
    suspect, there = _leave_out(problem, x, names)
    names = suspicious(there, suspect.least, Limit.max_exchanged_share)
    if not names:
        return ""
    single = len(names) == 1
    return (
        f"The torque columns of {'trial' if single else 'trials'} {list_words(names)} "
        f"are swapped: {'it is' if single else 'they are'} "
        f"{format_number(suspect.misfit)} times the noise floor off by what the other "
        f"trials determine, and {'fits' if single else 'fit'} once "
        "motor_torque_nm and joint_torque_nm are exchanged; exchange them, or declare "
        "`swapped = true` if the sensors were."
    )


def find_outlier_trial(
    problem: Problem, x: FloatArray, tuned: Mapping[str, float] | None = None
) -> Outlier | None:
    """Return the trial, or trials of one tilt, that contradicts the others, or None.

    Another pretension, friction or tilt has to bring it to their level. `tuned` are the
    errors by trial of the tuned scene, see `misfits`; None if that is the model.
    """
    places = problem.plant.by_trial
    if len(places) < Limit.min_outlier_trials:
        return None
    off = misfits(problem, x)
    large = {name for name in off if off[name] > Limit.outlier_floor_ratio / 2.0}
    worst = sorted(off, key=lambda name: -off[name])[:2]
    suspects: list[tuple[str, ...]] = [(name,) for name in worst if name in large]
    tilts = {name: problem.plant.records[own[0]].tilt for name, own in places.items()}
    for tilt in sorted(set(tilts.values()) - {0.0}):
        names = tuple(name for name, own in tilts.items() if own == tilt)
        if 2 * len(names) <= len(places) and large.intersection(names):
            suspects.append(names)
    found = [_leave_out(problem, x, names) for names in dict.fromkeys(suspects)]
    if not found:
        return None
    suspect, there = min(found, key=lambda each: each[0].rest)
    kept = Limit.min_remaining_share * max((tuned or off)[n] for n in suspect.trials)
    if suspect.misfit < max(suspect.least, kept):
        return None
    tilt = tilts[suspect.trials[0]]
    turned = tilt and [*tilts.values()].count(tilt) == len(suspect.trials)
    own = [k for name in suspect.trials for k in places[name]]
    able = ("tilt",) if turned else ("pretension", "friction", "tilt")
    left, words = _best_own_constant(problem, there, own, able)
    if left > Limit.max_remaining_ratio * max(suspect.rest, 1.0):
        return None
    extreme = extreme_condition(problem, suspect.trials)
    return suspect._replace(tilt=tilt if turned else 0.0, own=words, extreme=extreme)


def extreme_condition(problem: Problem, names: Sequence[str]) -> str:
    """Return the declared condition that is extreme in these trials only, or ""."""
    records = problem.plant.records
    conditions: dict[str, list[float | None]] = {
        "pretension": [record.pretension for record in records],
        "tilt": [abs(record.tilt) for record in records],
        "load": [max(map(abs, record.known_torques)) for record in records],
    }
    for condition, sizes in conditions.items():
        every = zip(sizes, (record.trial in names for record in records), strict=True)
        pairs = [(size, there) for size, there in every if size]
        own, others = (
            [s for s, there in pairs if there == side] for side in (True, False)
        )
        if own and (
            not others or min(own) > 1.05 * max(others) or max(own) < 0.95 * min(others)
        ):
            return condition
    return ""


def misfits(problem: Problem, x: FloatArray) -> dict[str, float]:
    """Return every trial's RMS error by Huber's loss, over that of sensor noise."""
    errors = problem.deviations(x)
    places = problem.plant.by_trial.items()
    return {n: problem.misfit(own, [errors[k] for k in own]) for n, own in places}


def _leave_out(
    problem: Problem, x: FloatArray, names: tuple[str, ...]
) -> tuple[Outlier, FloatArray]:
    """Return the error of trials by a fit to the others, and the fitted parameters."""
    places = problem.plant.by_trial
    own = [k for name in names for k in places[name]]
    rest = [k for other, theirs in places.items() if other not in names for k in theirs]
    records = problem.plant.records
    masks = [r.free & (k not in own) for k, r in enumerate(records)]
    there = fitting.fit(problem, x, masks).x
    errors = problem.deviations(there)
    off, left = (problem.misfit(k, [errors[j] for j in k]) for k in (own, rest))
    return Outlier(names, off, left), there


def _best_own_constant(
    problem: Problem, x: FloatArray, places: list[int], names: Sequence[str]
) -> tuple[float, str]:
    """Return the least misfit by an own constant of `names`, and that in words."""
    from scipy.optimize import minimize_scalar

    values = problem.values(x)
    records = [problem.plant.records[k] for k in places]
    start = problem.plant.bench.cables[0].pretension

    def misfit(change: float, name: str) -> float:
        errors, changed, factor = [], {**values}, math.exp(change)
        if name == "friction":
            changed[name] = factor * values[name]
        for record in records:
            if name == "pretension":
                usual = start if record.pretension is None else record.pretension
                record = replace(record, pretension=factor * usual)
            elif name == "tilt":
                record = replace(record, tilt=change)
            plant = problem.plant.limited([record])
            (torque,) = plant.simulate(changed, problem.effects)
            errors.append(record.measured - torque)
        return problem.misfit(places, errors)

    tried = {}
    for name in names:
        if name != "tilt" and any(record.unhooked for record in records):
            continue
        about, reach = 0.0, math.log(8.0)  # the logarithm of the largest change
        if name == "tilt":
            if "joint_gravity" not in problem.effects:
                continue
            reach = math.tau / Limit.tilt_grid_points
            turns = np.arange(Limit.tilt_grid_points) * reach - math.pi
            about = float(min(turns, key=lambda turn: misfit(float(turn), name)))
        best = minimize_scalar(
            lambda change, name=name: misfit(float(change), name),
            bounds=(about - reach, about + reach),
            method="bounded",
            options={"xatol": 0.01, "maxiter": 25},
        )
        tried[name] = float(best.fun), float(best.x)
    if not tried:
        return math.inf, ""
    name = min(tried, key=lambda each: tried[each][0])
    left, change = tried[name]
    if name == "tilt":
        return left, f"the rig had been turned by {format_number(change)} rad"
    factor = math.exp(change)
    if name == "friction":
        times = format_number(factor)
        return left, f"friction times wrap were {times} times that of the others"
    own = records[0].pretension
    tension = values.get("pretension", start)
    if own is not None and start > 0.0:
        tension *= own / start
    there, usual = format_number(factor * tension), format_number(tension)
    return left, f"its pretension were {there} N, not {usual} N"


def _rms(problem: Problem, places: Sequence[int], errors: Arrays) -> dict[str, float]:
    """Return each channel's RMS error [N m], with samples weighted by 1 / floor^2."""
    records = problem.plant.records
    weights = [records[k].counts / np.square(problem.floor[k]) for k in places]
    pairs = zip(weights, errors, strict=True)
    squares = np.sum([(w * error**2).sum(axis=1) for w, error in pairs], axis=0)
    total = np.sum([w.sum(axis=1) for w in weights], axis=0)
    found = np.sqrt(squares / total).tolist()
    return dict(zip(problem.plant.instruments.channels, found, strict=True))


VARIED_PARAMETERS = (
    *("friction", "pretension", "axial_stiffness", "friction_balance"),
    *("motor_torque_offset", "joint_torque_offset", "joint_angle_offset"),
)
"""Parameters that a rig may change between trials."""
SEQUENCE_ORDINATES = ("order of the trials", "time of the trials")


class TrialConstants(NamedTuple):
    """Values of one parameter fitted to each trial, all others being shared."""

    parameter: Tuned  # of the fit
    trials: tuple[str, ...]  # names, in the order of the data
    # (trials,) from their mean: of the logarithm where `Tuned.factor`, else in its unit
    change: FloatArray
    error: FloatArray  # (trials,) standard errors of `change`
    share: float  # of the squared error beyond the floor that these values explain
    # (trials,) in the parameter's unit, if no logarithm; NaN where the fit fails
    value: FloatArray = np.zeros(0)
    value_error: FloatArray = np.zeros(0)  # (trials,) standard errors of `value`


class Trend(NamedTuple):
    ordinate: str  # name of the regressor
    slope: float  # change per unit of it
    t: float  # slope over its standard error
    freedom: int  # degrees of freedom
    chance: float  # probability of such a t, in either direction, without a trend


def trial_constants(problem: Problem, x: FloatArray) -> tuple[TrialConstants, ...]:
    """Return up to two parameters that explain most if fitted by trial, best first."""
    by_trial = _ByTrial(problem, x, unhooked=False)
    if len(by_trial.trials) < Limit.min_trend_trials:
        return ()
    varied = [k for k, p in enumerate(problem.tuned) if p.name in VARIED_PARAMETERS]
    indices = filter(by_trial.affects_every_trial, varied)
    able = [_OneByTrial(by_trial, index) for index in indices]
    able.sort(key=lambda one: -one.foreseen)
    found = [one.fitted() for one in able[:2]]
    return tuple(sorted(found, key=lambda each: -each.share))


def constants_by_occasion(
    problem: Problem, x: FloatArray, indices: Sequence[int]
) -> tuple[TrialConstants, ...]:
    """Fit by occasion each parameter of these indices that affects every occasion."""
    by_occasion = _ByTrial(problem, x, lambda record: record.occasion)
    able = filter(by_occasion.affects_every_trial, indices)
    return tuple(_OneByTrial(by_occasion, index).fitted() for index in able)


def trial_trends(
    found: TrialConstants, ordinates: Mapping[str, FloatArray]
) -> tuple[Trend, ...]:
    """Regress a parameter's values by trial on each ordinate; best trend first."""
    tried = []
    for name, values in ordinates.items():
        good = np.isfinite(values) & np.isfinite(found.change)
        if good.sum() >= Limit.min_trend_trials and np.ptp(values[good]) != 0.0:
            known = values[good], found.change[good], found.error[good]
            tried.append(_trend(name, *known))
    return tuple(sorted(tried, key=lambda each: each.chance))


def _trend(name: str, at: FloatArray, change: FloatArray, error: FloatArray) -> Trend:
    """Test a trend by weighted regression with Student's t (Hartung and Knapp 2001).

    Trials may scatter beyond their standard `error` (DerSimonian and Laird 1986).
    """
    from scipy.special import stdtr

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
    slope = float(size[1])
    t = slope / math.sqrt(max(beyond / freedom, 1e-300) * inverse[1, 1])
    chance = float(2.0 * stdtr(freedom, -abs(t)))
    return Trend(name, slope, float(t), freedom, chance)


class _ByTrial:
    """Fitted model and its derivatives, for fits of single parameters by trial.

    `group` names what counts as a trial; those with cables off count if `unhooked`.
    """

    def __init__(
        self,
        problem: Problem,
        x: FloatArray,
        group: Callable[[Record], str] = lambda record: record.trial,
        unhooked: bool = True,
    ) -> None:
        records = problem.plant.records
        self.problem, self.x = problem, x
        self.masks = [r.counts & (unhooked or not r.unhooked) for r in records]
        self.seen = [k for k, mask in enumerate(self.masks) if mask.any()]
        groups = [group(records[k]) for k in self.seen]
        self.trials = tuple(dict.fromkeys(groups))
        places = [self.trials.index(each) for each in groups]
        self.of_trial = [
            [k for k, place in zip(self.seen, places, strict=True) if place == trial]
            for trial in range(len(self.trials))
        ]
        self.torques = problem.torques(x, self.seen)
        self._slopes = problem.slopes.of(problem, x, self.seen, self.torques)
        # Trial of every residual.
        sizes = [len(records[k].measured) * int(self.masks[k].sum()) for k in self.seen]
        self.rows = np.repeat(places, sizes)
        self.error = self.residual(self.torques)
        self.jacobian = self.derivatives(self.torques)
        pairs = zip(problem.noise_over_floor, self.masks, strict=True)
        squares = (float(np.sum(noise[:, mask] ** 2)) for noise, mask in pairs)
        self.noise = problem.weight**2 * sum(squares)
        self._beyond = float(self.error @ self.error) - self.noise

    def affects_every_trial(self, index: int) -> bool:
        square = np.bincount(self.rows, self.jacobian[:, index] ** 2, len(self.trials))
        return bool(np.all(square > 1e-4))

    def share(self, error: FloatArray) -> float:
        """Return the removed share of squared error beyond noise; 0 if too little."""
        if self._beyond <= 0.02 * self.noise:
            return 0.0
        return 1.0 - (float(error @ error) - self.noise) / self._beyond

    def plain(self, torques: Arrays) -> list[FloatArray]:
        """Return Huber's errors of every record; 0 (1, samples) in those left out."""
        found = [np.zeros(mask.size)[None] for mask in self.masks]
        for k, torque in zip(self.seen, torques, strict=True):
            off = self.problem.plant.records[k].measured - torque
            found[k] = fitting.huber_residual(off / self.problem.floor[k])
        return found

    def residual(self, torques: Arrays) -> FloatArray:
        """Return the residuals of the samples that count (rows,), without priors."""
        kept = fitting.kept_samples(self.plain(torques), self.masks)
        return self.problem.weight * kept

    def derivatives(self, torques: Arrays) -> FloatArray:
        """Return the derivatives of the residuals (rows, parameters)."""
        steep = fitting.residual_slopes(self.problem, torques, self.masks)
        return fitting.residual_changes(steep, self._slopes).T


class _OneByTrial:
    """Gauss-Newton fit of one parameter by trial, its values the last unknowns."""

    def __init__(self, model: _ByTrial, index: int) -> None:
        problem, trials = model.problem, np.zeros(len(model.trials))
        self._model, self._index = model, index
        tuned = [p for k, p in enumerate(problem.tuned) if k != index]
        # Inverse deviations of the priors, and places that these refer to; the values
        # of one trial have no prior.
        self._known = np.append([1.0 / p.prior for p in tuned], trials)
        self._home = np.append(np.delete(model.x, index), trials)
        own = [problem.tuned[index]] * trials.size
        self._scales = np.array([p.scale if p.factor else 0.0 for p in (*tuned, *own)])
        design = self._design(model.jacobian)
        self._first = self._step(design, model.error, np.zeros(self._home.size))
        # Share of the error that it explains by trial, to first order
        self.foreseen = model.share(model.error + design @ self._first)

    def fitted(self) -> TrialConstants:
        model, count = self._model, len(self._model.trials)
        place = np.zeros(self._home.size)
        torques, error, slopes = model.torques, model.error, model.jacobian
        best = self._cost(error, place)
        for _ in range(4):
            design = self._design(slopes)
            for damping in (0.0, 1e-3, 0.03, 1.0):  # Marquardt 1963
                step = self._step(design, error, place, damping)
                # No logarithm changes by more than a factor of 2.
                longest = float(np.max(np.abs(step) * self._scales))
                there = place + step * min(1.0, math.log(2.0) / max(longest, 1e-300))
                played = self._simulated(there)
                left = model.residual(played)
                cost = self._cost(left, there)
                if cost < best:
                    break
            else:
                break
            done = cost > (1.0 - 1e-3) * best
            place, torques, error, best = there, played, left, cost
            slopes = model.derivatives(torques)
            if done:
                break
        parameter = model.problem.tuned[self._index]
        design = self._design(slopes)
        square = design.T @ design + np.diag(self._known**2)
        # Errors of this model are weighted by the share of them that is independent.
        independent = fitting.independence_weight(model.plain(torques), model.masks)
        ratio = model.problem.weight / max(independent, 1e-300)
        covariance = np.linalg.pinv(square, rcond=1e-10, hermitian=True) * ratio**2
        own = covariance[-count:, -count:]
        centre = np.eye(count) - 1.0 / count
        change, value_error = (
            parameter.scale * np.sqrt(np.maximum(np.diag(spread), 0.0))
            for spread in (centre @ own @ centre, own)
        )
        value = model.x[self._index] + place[-count:]
        value = parameter.start + parameter.scale * value
        proposed = np.abs(self._first[-count:]) * parameter.scale
        if not place.any() and np.any(proposed > Limit.missed_sigmas * value_error):
            value = np.full(count, np.nan)
        moved = parameter.scale * (centre @ place[-count:])
        share = model.share(error)
        return TrialConstants(
            parameter, model.trials, moved, change, share, value, value_error
        )

    def _design(self, slopes: FloatArray) -> FloatArray:
        own = np.zeros((len(slopes), len(self._model.trials)))
        own[np.arange(len(slopes)), self._model.rows] = slopes[:, self._index]
        return np.concatenate([np.delete(slopes, self._index, axis=1), own], axis=1)

    def _cost(self, error: FloatArray, place: FloatArray) -> float:
        off = self._known * (self._home + place)
        return float(error @ error + off @ off)

    def _step(
        self, design: FloatArray, error: FloatArray, at: FloatArray, damp: float = 0.0
    ) -> FloatArray:
        square = design.T @ design + np.diag(self._known**2)
        slope = design.T @ error + self._known * (self._known * (self._home + at))
        size = np.sqrt(np.diag(square))
        size[size == 0.0] = 1.0
        scaled = square / np.outer(size, size)
        scaled[np.diag_indices_from(scaled)] *= 1.0 + damp
        return np.asarray(-np.linalg.lstsq(scaled, slope / size, 1e-10)[0] / size)

    def _simulated(self, place: FloatArray) -> list[FloatArray]:
        model, count = self._model, len(self._model.trials)
        shared = model.x + np.insert(place[:-count], self._index, 0.0)
        found: dict[int, FloatArray] = {}
        for chosen, own in zip(model.of_trial, place[-count:], strict=True):
            at = shared.copy()
            at[self._index] += own
            found |= zip(chosen, model.problem.torques(at, chosen), strict=True)
        return [found[k] for k in model.seen]


class TrialDifferences(NamedTuple):
    """Parameters that differ between trials, and quantities that may explain them."""

    constants: tuple[TrialConstants, ...]  # the best first
    ordinates: Mapping[str, FloatArray]  # (trials,) by name

    @classmethod
    def of(
        cls, problem: Problem, x: FloatArray, warmth: Mapping[str, float]
    ) -> TrialDifferences:
        """Fit the constants; `warmth` has the mean temperatures of trials [degC]."""
        constants = trial_constants(problem, x)
        names = constants[0].trials if constants else ()
        own = [[r for r in problem.plant.records if r.trial == name] for name in names]
        steps = [[np.gradient(r.motor_angle, r.dt) for r in each] for each in own]
        speeds = [math.sqrt(np.mean([np.mean(s**2) for s in each])) for each in steps]
        order, clock = SEQUENCE_ORDINATES
        starts, ends = (np.array([each[k].time[k] for each in own]) for k in (0, -1))
        one_clock = bool(np.all(ends[:-1] < starts[1:]))
        tensions = [each[0].pretension for each in own]
        ordinates = {
            **({clock: starts} if one_clock else {order: np.arange(float(len(names)))}),
            "temperature": np.array([warmth.get(name, math.nan) for name in names]),
            "speed of the trial": np.array(speeds),
            "declared pretension": np.array(tensions, dtype=float),
        }
        return cls(constants, ordinates)

    def at_random(self, misfit: float) -> str:
        """Return a sentence if a constant without trend explains nearly all, or ""."""
        for _, where in self.described(""):
            if where.axis == "trial" and where.share_of_error > Limit.random_share:
                return (
                    "The trials contradict each other: the error of the tuned scene is "
                    f"{format_number(misfit)} times the noise floor. {where.statement} "
                    "Effects were not searched, as they hold for all trials: find out "
                    "what was changed between them, or declare it."
                )
        return ""

    def described(self, worst: str) -> list[tuple[str, Where]]:
        """Describe the constant that explains most, briefly and fully; [] if little."""
        able = [each for each in self.constants if each.share >= Limit.min_trend_share]
        if not able:
            return []
        best, *others = able
        name, factor = plain_name(best.parameter.name), best.parameter.factor
        values = []  # of trials relative to the mean of all, with standard errors
        for change, error in zip(best.change, best.error, strict=True):
            if factor:
                change = math.exp(change)
                error = change * error
            parts = (format_number(each, 10.0 * error) for each in (change, error))
            values.append(" ± ".join(parts))
        table = [f"{t} {value}" for t, value in zip(best.trials, values, strict=True)]
        if len(table) > 12:
            table = [*table[:3], "...", *table[-3:]]
        unit = "times the mean" if factor else f"{best.parameter.unit} from the mean"
        able = [each for each in others if each.share > best.share - Limit.rival_margin]
        shares = [(plain_name(e.parameter.name), format_share(e.share)) for e in able]
        rivals = [f"{other} by trial would take {share}" for other, share in shares]
        takes = (
            f"A {name} of its own for every trial takes {format_share(best.share)} of "
            f"the squared error beyond the noise ({', '.join(table)}; "
            f"{unit}){'; ' if rivals else ''}{list_words(rivals)}."
        )
        tried = trial_trends(best, self.ordinates)
        level = Limit.trend_false_alarm_rate / max(len(self.constants) * len(tried), 1)
        tests = [
            f"along the {each.ordinate} t = {format_number(each.t)} with "
            f"{each.freedom} degrees of freedom, p = {format_number(each.chance)}"
            for each in tried
        ]
        clear = [t for each, t in zip(tried, tests, strict=True) if each.chance < level]
        if clear:
            trend, axis = tried[0], tried[0].ordinate
            along = f"with the {axis}"
            if axis in SEQUENCE_ORDINATES:
                along = "from trial to trial"
            ordinate = self.ordinates[axis]
            first, last = np.nanargmin(ordinate), np.nanargmax(ordinate)
            moves = f"{'rises' if trend.slope > 0.0 else 'falls'} steadily {along}"
            sizes = (
                f"from {values[first]} in {best.trials[first]} to {values[last]} in "
            )
            short = f"{moves}, {sizes}{best.trials[last]} ({unit})"
            test = f" Test of the trend: {'; '.join(clear)}."
        elif best.share < Limit.unordered_share:
            return []
        else:
            axis, moves = "trial", "differs from trial to trial"
            short = f"{moves} without a trend"
            test = f" It follows no trend ({tests[0]})." if tests else ""
        text = f"{capitalise(name)} {moves}. {takes}{test}"
        return [(f"{name} {short}", Where(worst, axis, best.share, text))]


def compare_occasions(
    problem: Problem, x: FloatArray, estimated: Mapping[str, Estimate]
) -> Occasions | None:
    """Compare parameters and sizes of effects by occasion; None for a single one."""
    names = problem.plant.occasions
    if len(names) < 2:
        return None
    tuned = {parameter.name: parameter for parameter in problem.tuned}
    cables = "friction", "pretension", "axial_stiffness", "friction_balance"
    reported = *cables, "joint_angle_offset"
    changes = []
    *earlier, last = names
    for since in reversed(earlier):
        for base in dict.fromkeys((*reported, *tuned)):
            name = simulation.change_name(base, since)
            if name in tuned and simulation.base_name(base) == base:
                change, words = describe_change(tuned[name], estimated[name])
                factor = tuned[name].factor
                changes.append(OccasionChange(base, since, last, change, factor, words))
    sizes = []
    for effect in problem.effects:
        places = amplitude_indices(problem, [effect])
        indices = [k for k in places if abs(x[k]) > 1e-6]  # others are at a bound
        for each in constants_by_occasion(problem, x, indices):
            shared = each.parameter.value(float(x[problem.tuned.index(each.parameter)]))
            sizes.append(compare_size(effect, each, shared))
    own = [e for e in changes if e.since == earlier[-1] and e.parameter in reported]
    own.sort(key=lambda each: each.change.holds(0.0))
    words = list_words(each.statement for each in own)
    if all(each.change.holds(0.0) for each in own):
        words = f"nothing that these data show; {words}"
    statement = f"Since {earlier[-1]}: {words}."
    return Occasions(names, tuple(changes), tuple(sizes), statement)


def describe_change(tuned: Tuned, earlier: Estimate) -> tuple[Estimate, str]:
    """Return the change that undoes an `earlier` ratio or difference, and in words."""
    low, high = earlier.ci95
    shown = change = Estimate(-earlier.value, earlier.unit, (-high, -low))
    if tuned.factor:
        low, high = 1.0 / high - 1.0, 1.0 / low - 1.0
        change = Estimate(1.0 / earlier.value - 1.0, "1", (low, high))
        shown = Estimate(100.0 * change.value, "%", (100.0 * low, 100.0 * high))
    low, high = shown.ci95
    unit, width = f" {shown.unit}".removesuffix(" 1"), high - low
    if math.isnan(low) or (tuned.factor and width > 100.0 * Limit.max_relative_width):
        words = "not determined"
    elif shown.holds(0.0):
        most = format_number(max(abs(low), abs(high)), width)
        words = f"unchanged within {most}{unit}"
    else:
        sign = "+" if shown.value > 0.0 else ""
        words = f"{sign}{format_estimate(shown, unit)}"
    return change, f"{plain_name(simulation.base_name(tuned.name))} {words}"


def compare_size(effect: str, found: TrialConstants, shared: float) -> OccasionSize:
    parameter, unit = found.parameter.name, found.parameter.unit
    name = plain_name(parameter)
    if not np.all(np.isfinite(found.value)):
        text = f"{name}: the fit to each occasion fails, so agreement is not known."
        return OccasionSize(effect, parameter, {}, True, text)
    sizes, able = {}, []
    sized = found.value.tolist(), found.value_error.tolist()
    for occasion, value, error in zip(found.trials, *sized, strict=True):
        reach = Limit.sigmas * error
        sizes[occasion] = Estimate(value, unit, (value - reach, value + reach))
        if Limit.visible_ratio * error < abs(shared):
            able.append(occasion)
    missing = [n for n in able if sizes[n].holds(0.0) or sizes[n].value * shared < 0.0]
    words = [f"{format_fitted(size)} on {each}" for each, size in sizes.items()]
    text = f"{name} [{unit or '1'}]: {list_words(words)}"
    if missing:
        text += f"; {list_words(missing)} could show it and does not"
    elif len(able) < len(sizes):
        blind = list_words(each for each in sizes if each not in able)
        text += f"; {blind} cannot show a size of {format_number(shared)}"
    return OccasionSize(effect, parameter, sizes, not missing, f"{text}.")
