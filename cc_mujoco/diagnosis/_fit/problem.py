"""Fit of the simulated rig to records by least squares, and on held-out data.

A place `x` (parameters,) is the vector that a fit optimises: each parameter less its
start, or the logarithm of their ratio, over its scale (`Tuned`).

Residuals are divided by the noise floor of their channel and weighted by the share of
them that is independent, so that priors and intervals keep their meaning.

Derivatives of the torques are differences of coarse simulations, taken once. They
hardly change over a few percent of a parameter, and later simulations update them
(Broyden, Math. Comp. 19, 1965). Fits, folds and stages share them; a model with one
more effect, or with a finer simulation, starts from those of its predecessor.
Parameters that change only the reading of a replay, such as a torque offset, need no
simulation and are differenced anew each time.

In a cross-validation every sample is predicted by a fit to others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from cc_mujoco.diagnosis._rig import simulation
from cc_mujoco.diagnosis._rig.records import Arrays, Indices, Record, Setting
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Gap
from cc_mujoco.diagnosis.effects._effect import EffectParameter, form_key
from cc_mujoco.estimation import _least_squares as least_squares
from cc_mujoco.estimation._least_squares import (
    FACTOR_STEP,
    Fit,
    Tuned,
    autocorrelation,
    differences,
)
from cc_mujoco.native import FloatArray

_STEPS = {"clock_offset": 0.05, "joint_angle_offset": 0.02, "pretension": 0.03}


@dataclass
class _Tangent:
    taken: FloatArray  # place where the slopes were differenced
    place: FloatArray  # where they were last compared with a simulation
    torque: FloatArray  # (2, samples) there [N m]
    slopes: FloatArray  # (parameters, 2, samples) [N m]

    def follow(self, x: FloatArray, torque: FloatArray, reach: FloatArray) -> bool:
        """Update the slopes by the torque simulated at `x`; return False if invalid."""
        moved = (x - self.place) / reach
        if np.max(np.abs(moved)) < Limit.min_change:
            return True
        change = torque - self.torque
        missed = change - np.tensordot(x - self.place, self.slopes, 1)
        far = np.max(np.abs(x - self.taken) / reach) > 1.0
        if far and np.sum(missed**2) > Limit.max_missed_share * np.sum(change**2):
            return False
        along = moved / reach / (moved @ moved)
        self.slopes += along[:, None, None] * missed
        self.place, self.torque = x.copy(), torque
        return True


class TorqueDerivatives:
    """Derivatives of simulated torques with respect to the parameters, by record."""

    def __init__(self, narrower: TorqueDerivatives | None = None) -> None:
        self._narrower = narrower
        self._kept: dict[Record, _Tangent] = {}
        self._inner: list[bool] = []

    def of(
        self, problem: Problem, x: FloatArray, seen: Sequence[int], torques: Arrays
    ) -> list[FloatArray]:
        """Return the derivatives (parameters, 2, samples) of the records `seen` [N m].

        `torques` are those of these records at `x`, (2, samples) each [N m].
        """
        steps = []  # changes for differences, within the parameters' bounds
        for tuned, place in zip(problem.tuned, x, strict=True):
            usual = FACTOR_STEP if tuned.factor else 0.05
            step = _STEPS.get(simulation.base_name(tuned.name), usual)
            steps.append(-step if place + step > tuned.high else step)
        inner = self._inner = self._inner or _need_replay(problem, x, steps)
        records = [problem.plant.records[k] for k in seen]
        pairs = list(zip(records, torques, strict=True))

        def take(first: int, places: Sequence[int], again: bool) -> None:
            wanted = {k: steps[k] for k in range(first, x.size) if inner[k] is again}
            if not wanted:
                return
            used = problem.coarse if again else problem
            chosen, here = [seen[p] for p in places], [torques[p] for p in places]
            if used is not problem:
                here = used.torques(x, chosen)
            columns = differences(lambda at: used.torques(at, chosen), x, wanted, here)
            for k, column in columns.items():
                for p, slope in zip(places, column, strict=True):
                    self._kept[records[p]].slopes[k] = slope

        new: dict[int, list[int]] = {}
        for p, (record, torque) in enumerate(pairs):
            if record not in self._kept:
                new.setdefault(self._begin(record, x, torque), []).append(p)
        take(0, range(len(seen)), False)
        for known, places in new.items():
            take(known, places, True)
        reach = np.full(x.size, np.inf)
        for k, tuned in enumerate(problem.tuned):
            if inner[k]:
                reach[k] = Limit.valid_change
                if tuned.factor:
                    reach[k] = min(Limit.valid_log_change / tuned.scale, 3.0)
        gone = []
        for p, (record, torque) in enumerate(pairs):
            tangent = self._kept[record]
            if not tangent.follow(x, torque, reach):
                gone.append(p)
                tangent.taken = tangent.place = x.copy()
                tangent.torque = torque
        if gone:
            take(0, gone, True)
        return [self._kept[record].slopes for record in records]

    def forget(self) -> None:
        self._narrower = None
        self._kept.clear()

    def _begin(self, record: Record, x: FloatArray, torque: FloatArray) -> int:
        """Allocate slopes of a record; return how many come from a narrower model."""
        slopes = np.zeros((x.size, *torque.shape))
        tangent = _Tangent(x.copy(), x.copy(), torque, slopes)
        self._kept[record] = tangent
        before = self._narrower and self._narrower._kept.get(record)
        if not before:
            return 0
        known = len(before.slopes)
        slopes[:known] = before.slopes
        tangent.taken[:known] = before.taken
        return known


def jacobian(
    problem: Problem, x: FloatArray, masks: Masks, explained: bool = False
) -> FloatArray:
    """Return d`Problem.residual`/dx (residuals, x); quadratic loss if `explained`."""
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    priors = np.diag([-1.0 / p.prior for p in problem.tuned])
    priors = priors[:, [np.isfinite(p.prior) for p in problem.tuned]]
    torques = problem.torques(x, seen)
    slopes = problem.slopes.of(problem, x, seen, torques)
    steep = residual_slopes(problem, None if explained else torques, masks)
    rows = residual_changes(steep, slopes)
    return np.concatenate([rows, priors], axis=1).T


def residual_slopes(
    problem: Problem, torques: Arrays | None, masks: Masks
) -> list[tuple[FloatArray, NDArray[np.bool_]]]:
    """Return residual change per torque (2, counted samples) [1/N m], and masks.

    If the records' `torques` are None, Huber's loss is quadratic for all errors.
    """
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    delta, found = Limit.huber_delta, []
    for place, k in enumerate(seen):
        slope: FloatArray | float = 1.0
        if torques is not None:
            error = problem.plant.records[k].measured - torques[place]
            size = np.abs(error) / problem.floor[k]
            root = np.sqrt(np.maximum(2.0 * delta * size - delta**2, delta**2))
            slope = np.where(size <= delta, 1.0, delta / root)
        steep = -problem.weight * slope / problem.floor[k]
        found.append((steep[:, masks[k]], masks[k]))
    return found


def residual_changes(
    steep: Sequence[tuple[FloatArray, NDArray[np.bool_]]], changes: Arrays
) -> FloatArray:
    """Return torque `changes` times `residual_slopes` `steep`, (k, residuals)."""
    pairs = zip(changes, steep, strict=True)
    kept = ((c.compress(mask, axis=2), each) for c, (each, mask) in pairs)
    parts = [(own * each).reshape(len(own), -1) for own, each in kept]
    return np.concatenate(parts, axis=1)


def _need_replay(problem: Problem, x: FloatArray, steps: Sequence[float]) -> list[bool]:
    plant, effects = problem.plant, problem.effects
    seen = {(plant.conditions_of(r, effects), r.occasion) for r in plant.records}

    def settings(place: FloatArray) -> list[Setting]:
        values = problem.values(place)
        on_days = [(own, simulation.values_on(values, day)) for own, day in seen]
        return [plant.setting(there, effects, None, own) for own, there in on_days]

    here, one = settings(x), np.eye(x.size)
    return [here != settings(x + step * one[k]) for k, step in enumerate(steps)]


Masks = Sequence[NDArray[np.bool_]]
"""Samples that take part (samples,), by record."""


def tuned_effect_parameter(
    parameter: EffectParameter, start: float, plant: SimulatedRig
) -> Tuned:
    """Return an effect's parameter as one of a fit; sizes have a prior about 0."""
    described, size = parameter.parameter, parameter.typical
    low, high = described.low, described.high
    if parameter.shape:
        bounds = (low - start) / size, (high - start) / size
        found = Tuned(described, start, size, *bounds)
    elif not parameter.linear:
        bounds = math.log(low / start), math.log(high / start)
        found = Tuned(described, start, 1.0, *bounds)
    else:
        prior = 0.5 * simulation.plausible_range(parameter, plant)[1] / size
        found = Tuned(described, 0.0, size, low / size, high / size, prior)
    # No rounding may leave the bounds of a cable's parameter.
    while found.value(found.low) < low:
        found = found._replace(low=math.nextafter(found.low, math.inf))
    while found.value(found.high) > high:
        found = found._replace(high=math.nextafter(found.high, -math.inf))
    return found


@dataclass(frozen=True)
class Problem:
    """Model with free parameters, and the records that these are fitted to."""

    plant: SimulatedRig  # simulates
    tuned: tuple[Tuned, ...]  # every free parameter, baseline first
    effects: tuple[str, ...]  # ids that are present
    noise: tuple[FloatArray, ...]  # (2, samples) each, unexplained by any model [N m]
    # The same, by which errors are divided, see `noise_floor.NoiseFloor` [N m]
    floor: tuple[FloatArray, ...]
    # Of a residual over its floor; below 1 where neighbours are not independent or
    # where the model is known not to reach the floor
    weight: float = 1.0
    # Factor of the floor where the model is far off, see `with_inflated_noise`
    inflation: float = 1.0
    # The part of `noise` beyond that of sensors; a wrong model makes some of it
    scatter: FloatArray | float = 0.0
    # Values that select the forms of effects, see `form_key`
    forms: Mapping[str, float] = field(default_factory=dict)
    # (2, samples) of every record added to the torques, if any, see `corrected` [N m]
    defect: tuple[FloatArray, ...] = ()
    # Derivatives of the plant's torques, shared by problems of other noise
    slopes: TorqueDerivatives = field(
        default_factory=TorqueDerivatives, compare=False, repr=False
    )

    def with_inflated_noise(self, x: FloatArray, masks: Masks) -> Problem:
        """Return the problem with a floor so large that most errors are not outliers.

        Otherwise, where sensors are much better than the model, Huber's loss would
        follow only the small errors.
        """
        kept = np.abs(kept_samples(self.plainly(x), masks))
        usual = self.inflation * float(np.median(kept)) / Limit.normal_median
        factor = max(1.0, usual / Limit.huber_delta)
        change = factor / self.inflation
        floor = tuple(change * floor for floor in self.floor)
        return replace(self, floor=floor, inflation=factor)

    def with_updated_floor(self, x: FloatArray, masks: Masks) -> Problem:
        """Return the problem with floor and weight by the errors of this model at `x`.

        With those of the baseline, large where an effect is missing, the data would
        hardly count against the priors.
        """
        problem = self.with_inflated_noise(x, masks)
        return replace(problem, weight=independence_weight(problem.errors(x), masks))

    def sharing(self, known: Sequence[Problem]) -> Problem:
        """Return the problem with derivatives of the last equal model in `known`."""
        for other in reversed(known):
            if other.tuned == self.tuned and other.effects == self.effects:
                return replace(self, slopes=TorqueDerivatives(other.slopes))
        return self

    @property
    def coarse(self) -> Problem:
        """Same problem with a coarse simulation, enough for differences."""
        plant = self.plant.coarse
        return self if plant is self.plant else replace(self, plant=plant)

    def corrected(self, x: FloatArray, seen: Sequence[int]) -> Problem:
        """Return `coarse` plus a constant, which has this model's torques at `x`.

        The constant is of the records `seen`. Near `x` it is off by the change of the
        numerical error (defect correction: Stetter, Numerische Mathematik 29, 1978).
        """
        rough = self.coarse
        defect = [np.zeros(record.measured.shape) for record in self.plant.records]
        fine = self.torques(x, seen)
        for k, a, b in zip(seen, fine, rough.torques(x, seen), strict=True):
            defect[k] = a - b
        return replace(rough, defect=tuple(defect))

    def form(self, name: str) -> str:
        """Return the form in which the model has an effect; "" if it has only one."""
        return self.plant.library.effects[name].form(self.forms)

    @property
    def sensed(self) -> tuple[FloatArray, ...]:
        """Noise floor (2, samples) of every record due to sensors alone [N m]."""
        part = np.square(self.scatter)
        return tuple(np.sqrt(np.maximum(n**2 - part, 0.0)) for n in self.noise)

    @property
    def noise_over_floor(self) -> list[FloatArray]:
        """Noise due to sensors over the floor, (2, samples) per record."""
        return [n / f for n, f in zip(self.sensed, self.floor, strict=True)]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.tuned)

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return the parameters by name at a place, clipped to their bounds."""
        pairs = [(p, float(place)) for p, place in zip(self.tuned, x, strict=True)]
        fitted = {p.name: p.value(min(max(at, p.low), p.high)) for p, at in pairs}
        return {**self.forms, **fitted}

    def place(self, values: Mapping[str, float]) -> FloatArray:
        """Return the place (parameters,) of these values; others are at their start."""
        return np.array([p.place(values.get(p.name, p.start)) for p in self.tuned])

    def with_effect(self, name: str, start: Mapping[str, float]) -> Problem:
        """Return the problem with one more effect; `start` has its shape and form."""
        key = form_key(name)
        parameters = self.plant.library.effects[name].parameters
        starts = [(p, start.get(p.name, p.typical)) for p in parameters]
        more = [tuned_effect_parameter(p, at, self.plant) for p, at in starts]
        tuned, effects = (*self.tuned, *more), (*self.effects, name)
        forms = {**self.forms, **{k: v for k, v in start.items() if k == key}}
        wider = replace(self, tuned=tuned, effects=effects, forms=forms)
        return replace(wider, slopes=TorqueDerivatives(self.slopes))

    def placed(self, x: FloatArray, start: Mapping[str, float]) -> FloatArray:
        """Return the place `x` of a narrower model, extended by an effect's `start`."""
        more = self.tuned[x.size :]
        new = [0.0 if p.factor else (start[p.name] - p.start) / p.scale for p in more]
        return np.concatenate([x, new])

    def without(self, name: str) -> Problem:
        effect = self.plant.library.effects[name]
        gone = {parameter.name for parameter in effect.parameters}
        tuned = tuple(p for p in self.tuned if p.name not in gone)
        effects = tuple(e for e in self.effects if e != name)
        forms = {k: v for k, v in self.forms.items() if k != form_key(name)}
        slim = replace(self, tuned=tuned, effects=effects, forms=forms)
        return replace(slim, slopes=TorqueDerivatives())

    def errors(self, x: FloatArray, masks: Masks | None = None) -> list[FloatArray]:
        """Return Huber's errors (2, samples); NaN in records that `masks` leave out."""
        found = [np.full(floor.shape, np.nan) for floor in self.floor]
        seen = [k for k in range(len(found)) if masks is None or masks[k].any()]
        for k, error in zip(seen, self.plainly(x, seen), strict=True):
            found[k] = huber_residual(error)
        return found

    def plainly(self, x: FloatArray, only: Indices | None = None) -> list[FloatArray]:
        """Return measured minus simulated over the floor, (2, samples) per record."""
        chosen = range(len(self.floor)) if only is None else only
        pairs = zip(chosen, self.deviations(x, chosen), strict=True)
        return [deviation / self.floor[k] for k, deviation in pairs]

    def deviations(
        self, x: FloatArray, only: Indices | None = None
    ) -> list[FloatArray]:
        """Return measured minus simulated torques (2, samples) per record [N m]."""
        chosen = range(len(self.floor)) if only is None else only
        pairs = zip(chosen, self.torques(x, chosen), strict=True)
        return [self.plant.records[k].measured - torque for k, torque in pairs]

    def misfit(self, places: Indices, errors: Arrays) -> float:
        """Return the RMS of records' errors by Huber's loss, over that of sensor noise.

        `errors` (2, samples) [N m] are of the records `places`.
        """
        masks = [self.plant.records[k].counts for k in places]
        pairs = zip(places, errors, strict=True)
        over = (huber_residual(error / self.floor[k]) for k, error in pairs)
        off, noise = kept_samples(over, masks), self.noise_over_floor
        usual = kept_samples((noise[k] for k in places), masks)
        return math.sqrt(float(np.mean(off**2)) / float(np.mean(usual**2)))

    def torques(self, x: FloatArray, only: Indices | None = None) -> list[FloatArray]:
        """Return the simulated torques of each record (2, samples) [N m]."""
        played = self.plant.simulate(self.values(x), self.effects, only)
        if not self.defect:
            return played
        chosen = range(len(self.defect)) if only is None else only
        return [t + self.defect[k] for k, t in zip(chosen, played, strict=True)]

    def residual(self, x: FloatArray, masks: Masks) -> FloatArray:
        """Return the weighted errors of masked samples, then deviations from priors."""
        pairs = zip(self.tuned, x, strict=True)
        known = [-place / p.prior for p, place in pairs if math.isfinite(p.prior)]
        kept = self.weight * kept_samples(self.errors(x, masks), masks)
        return np.concatenate([kept, known])


def kept_samples(parts: Iterable[FloatArray], masks: Masks) -> FloatArray:
    """Return the masked values (samples,) of parts (rows, samples), joined."""
    kept = zip(parts, masks, strict=True)
    return np.concatenate([part[:, mask].ravel() for part, mask in kept])


def huber_residual(error: FloatArray) -> FloatArray:
    """Return residuals whose squares are Huber's loss, linear for large errors."""
    size, delta = np.abs(error), Limit.huber_delta
    root = np.sqrt(np.maximum(2.0 * delta * size - delta**2, 0.0))
    return np.where(size <= delta, error, np.sign(error) * root)


def plain_error(residual: FloatArray) -> FloatArray:
    """Return the errors of residuals: the inverse of `huber_residual`."""
    size = np.abs(residual)
    large = (size**2 + Limit.huber_delta**2) / (2.0 * Limit.huber_delta)
    return np.where(size <= Limit.huber_delta, residual, np.sign(residual) * large)


def independence_weight(errors: Arrays, masks: Masks) -> float:
    """Return the weight by which correlated errors count as independent ones.

    It is the square root of the share of independent samples, by the sum of
    autocorrelations up to their first zero, over the RMS error where that exceeds 1.
    """
    lags = 200
    total = np.zeros(lags)
    count, square = 0, 0.0
    for error, mask in zip(errors, masks, strict=True):
        kept = np.where(mask, error, 0.0)
        for row in kept:
            correlation = autocorrelation(row)[:lags]
            total[: correlation.size] += correlation
        count += len(error) * int(np.sum(mask))
        square += float(np.sum(kept**2))
    shape = total / max(total[0], 1e-300)
    end = int(np.argmax(shape < 0.02)) or lags
    independent = 1.0 / max(1.0 + 2.0 * float(np.sum(shape[1:end])), 1.0)
    return math.sqrt(independent) / max(math.sqrt(square / max(count, 1)), 1.0)


def fit(
    problem: Problem,
    start: FloatArray,
    masks: Masks,
    evaluations: int = Limit.fitting_max_evaluations,
    tolerance: float = Limit.relative_tolerance,
) -> Fit:
    """Fit least squares within bounds to the masked samples, from the place `start`.

    A fine simulation is fitted by `Problem.corrected`, until it improves no more. A fit
    ends when the relative change of its cost is below `tolerance`.
    """
    if problem.coarse is problem:
        return least_squares.fit(
            lambda x: problem.residual(x, masks),
            lambda x: jacobian(problem, x, masks),
            problem.tuned,
            start,
            tolerance=tolerance,
            evaluations=evaluations,
        )

    def cost_at(x: FloatArray) -> float:
        error = problem.residual(x, masks)
        return 0.5 * float(error @ error)

    low, high = (
        np.array([getattr(p, k) for p in problem.tuned]) for k in ("low", "high")
    )
    x: FloatArray = np.clip(start, low, high)
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    cost = cost_at(x)
    for _ in range(4):
        rough = problem.corrected(x, seen)
        there = fit(rough, x, masks, evaluations, tolerance).x
        gain = cost - cost_at(there)
        if gain > 0.0:
            x, cost = there, cost - gain
        if gain <= tolerance * cost:
            break
    return Fit(x, cost)


def fit_until_settled(problem: Problem, start: FloatArray, masks: Masks) -> Fit:
    """Fit until the cost is within a tenth of a standard deviation of the least.

    Along a flat valley a relative change of a thousandth may be several deviations.
    """
    found = fit(problem, start, masks)
    least = Limit.cost_tolerance
    tolerance = min(Limit.relative_tolerance, least / max(found.cost, least))
    return fit(problem, found.x, masks, tolerance=tolerance)


BOOTSTRAP_BLOCK = 1.0
"""Length of a block of the bootstrap [s]."""


class Fold(NamedTuple):
    """Samples to fit and to test: a mask (samples,) each for every record."""

    train: tuple[NDArray[np.bool_], ...]
    test: tuple[NDArray[np.bool_], ...]


Folds = Sequence[Fold]


def divided_samples(division: Folds) -> Masks:
    """Return the masks (samples,), by record, of the samples in any of the folds."""
    parts = [part for fold in division for part in fold]
    return tuple(np.any(own, axis=0) for own in zip(*parts, strict=True))


def interleaved_folds(records: Sequence[Record]) -> tuple[Fold, ...]:
    """Return two halves, alternate stretches of every record, that predict each other.

    Both see every trial that is not reserved, as one may be the only one with slack.
    """
    halves = []
    for record in records:
        counts = record.free
        place = np.cumsum(counts) / max(int(np.sum(counts)), 1)
        piece = (place * Limit.record_pieces * (1.0 - 1e-9)).astype(int)
        halves.append((counts & (piece % 2 == 0), counts & (piece % 2 == 1)))
    one, other = (tuple(half) for half in zip(*halves, strict=True))
    return (Fold(one, other), Fold(other, one))


def trial_folds(records: Sequence[Record]) -> tuple[Fold, ...]:
    """Return folds of whole trials: test on the reserved ones, or on a third in turn.

    Repeats stay together; trials of a kind are spread over the folds; unless all are,
    the only one of its kind is never tested. Few trials give `interleaved_folds`.
    """
    if any(record.split == "test" for record in records):
        free = tuple(record.free for record in records)
        return (Fold(free, tuple(record.reserved for record in records)),)
    kinds = trial_kinds(records)
    if len(kinds) < Limit.trial_folds:
        return interleaved_folds(records)
    known = list(kinds.values())
    shared = [group for group in kinds if known.count(kinds[group]) > 1]
    groups = sorted(shared or kinds)
    groups.sort(key=lambda group: known.index(kinds[group]))
    parts = min(Limit.trial_folds, len(groups))
    outs = [set(groups[part::parts]) for part in range(parts)]
    return tuple(
        Fold(
            tuple(r.counts & (r.group not in out) for r in records),
            tuple(r.counts & (r.group in out) for r in records),
        )
        for out in outs
    )


def trial_kinds(records: Sequence[Record]) -> dict[str, tuple[object, ...]]:
    """Return, by group of repeats, its kind: the sides that move and declared facts."""
    used = [record for record in records if record.counts.any()]
    spans = np.array([[np.ptp(r.motor_angle), np.ptp(r.joint_angle)] for r in used])
    moved = spans > Limit.held_share * spans.max(axis=0, initial=0.0)
    kinds: dict[str, tuple[object, ...]] = {}
    for record, sides in zip(used, moved.tolist(), strict=True):
        tension = record.pretension
        steps = round(math.log(tension) / 0.2) if tension else tension
        facts = record.known_torques, record.swapped, record.load_cell, record.occasion
        kind = (*sides, steps, round(record.tilt, 1), *facts)
        kinds.setdefault(record.group, kind)
    return kinds


def never_held_out(division: Folds, records: Sequence[Record]) -> tuple[str, ...]:
    """Return the trials that no fold tests; () if some are reserved for tests."""
    if any(record.split == "test" for record in records):
        return ()
    tests = [zip(records, fold.test, strict=True) for fold in division]
    held = {r.trial for pairs in tests for r, test in pairs if test.any()}
    used = dict.fromkeys(record.trial for record in records if record.counts.any())
    return tuple(name for name in used if name not in held)


class CrossValidation(NamedTuple):
    """Model fitted to the training part of each fold, and its errors on the tests."""

    problem: Problem  # the model
    fits: tuple[Fit, ...]  # one per fold
    # (2, samples) over the floor by Huber, of the fit without the sample; else NaN
    errors: tuple[FloatArray, ...]
    division: Folds = ()  # folds that it was fitted on

    @property
    def x(self) -> FloatArray:
        """Mean of the fitted places of the folds."""
        return np.asarray(np.mean([fit.x for fit in self.fits], axis=0))

    def mean_square(self, parts: Iterable[FloatArray]) -> float:
        """Return the mean square of parts (2, samples) over the held-out samples."""
        masks = [np.isfinite(error[0]) for error in self.errors]
        return float(np.mean(kept_samples(parts, masks) ** 2))

    @property
    def held_out_mse(self) -> float:
        return self.mean_square(self.errors)

    @property
    def noise_mse(self) -> float:
        """Mean square of the errors that sensor noise alone makes."""
        return self.mean_square(self.problem.noise_over_floor)

    @property
    def misfit(self) -> float:
        """RMS held-out error over that of noise alone."""
        return self.misfit_by(self.problem.inflation)

    def misfit_by(self, inflation: float) -> float:
        """Return `misfit` for another inflation of the noise floor."""
        ratio = self.problem.inflation / inflation
        if ratio == 1.0:
            return math.sqrt(self.held_out_mse / self.noise_mse)
        parts = (huber_residual(ratio * plain_error(error)) for error in self.errors)
        mean = self.mean_square(parts)
        return math.sqrt(mean / self.noise_mse) / ratio


def cross_validate(problem: Problem, folds: Folds, starts: Arrays) -> CrossValidation:
    fits: list[Fit] = []
    errors = [np.full(r.measured.shape, np.nan) for r in problem.plant.records]
    for fold, start in zip(folds, starts, strict=True):
        if fits:  # what one fold has learnt
            start = start + fits[0].x - starts[0]
        found = fit(problem, start, fold.train)
        fits.append(found)
        tested = problem.errors(found.x, fold.test)
        for kept, error, mask in zip(errors, tested, fold.test, strict=True):
            kept[:, mask] = error[:, mask]
    return CrossValidation(problem, tuple(fits), tuple(errors), folds)


def blocks(crossed: CrossValidation, parts: Arrays | None = None) -> FloatArray:
    """Return sums of squares of errors or `parts` over blocks of 1 s (blocks,)."""
    masks = [np.isfinite(error[0]) for error in crossed.errors]
    kept = zip(crossed.errors if parts is None else parts, masks, strict=True)
    squares = [np.where(mask, part, 0.0) ** 2 for part, mask in kept]
    return np.asarray(block_sums(crossed.problem, masks, squares).sum(axis=1))


def block_sums(problem: Problem, masks: Masks, parts: Arrays) -> FloatArray:
    """Return sums of parts (k, samples) by record over blocks of 1 s (blocks, k)."""
    found = []
    for record, mask, part in zip(problem.plant.records, masks, parts, strict=True):
        size = max(2, round(BOOTSTRAP_BLOCK / record.dt))
        starts = (k for k in range(0, mask.size, size) if mask[k : k + size].any())
        found += [part[:, first : first + size].sum(axis=1) for first in starts]
    return np.array(found)


def excess(crossed: CrossValidation) -> float:
    """Return the held-out squared error beyond noise, over its standard error."""
    beyond = blocks(crossed) - blocks(crossed, crossed.problem.noise_over_floor)
    return float(beyond.sum() / max(block_sum_deviation(beyond), 1e-300))


def block_sum_deviation(values: FloatArray) -> float:
    """Return the standard deviation of the sum of independent values (blocks,)."""
    return float(np.std(values)) * math.sqrt(values.size)


def refine_simulation(problem: Problem, x: FloatArray, masks: Masks) -> Problem | None:
    """Return the problem simulated finer; None if needless or beyond the limits."""
    plant = problem.plant
    counts = plant.segments, plant.substeps
    if 2 * counts[0] > Limit.max_cable_segments and 2 * counts[1] > Limit.max_substeps:
        return None
    change, finer = refinement_change(problem, x, masks)
    kept = kept_samples(problem.errors(x, masks), masks)
    left = float(np.sqrt(np.mean(kept**2)))
    harmless = max(Limit.max_numerical_error, Limit.max_numerical_share * left)
    if change <= harmless or finer is None:
        return None
    # Derivatives hardly depend on the resolution of the simulation.
    return replace(problem, plant=finer, slopes=TorqueDerivatives(problem.slopes))


def refinement_change(
    problem: Problem, x: FloatArray, masks: Masks
) -> tuple[float, SimulatedRig | None]:
    """Return the RMS torque change over the floor by a finer rig, and that rig.

    Segments or steps are doubled, whichever changes more; a rig beyond limits is None.
    """
    plant = problem.plant
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    here = problem.torques(x, seen)
    tried: list[tuple[float, SimulatedRig | None]] = []
    limits = {"segments": Limit.max_cable_segments, "substeps": Limit.max_substeps}
    for name, most in limits.items():
        count = 2 * getattr(plant, name)
        finer = replace(plant, **{name: count})
        there = replace(problem, plant=finer).torques(x, seen)
        pairs = zip(seen, here, there, strict=True)
        over = ((a - b) / problem.floor[k] for k, a, b in pairs)
        changes = [huber_residual(each) for each in over]
        kept = kept_samples(changes, [masks[k] for k in seen])
        change = float(np.sqrt(np.mean(kept**2)))
        tried.append((change, None if count > most else finer))
    return max(tried, key=lambda each: each[0])


def predicted(
    problem: Problem, start: FloatArray, division: Folds
) -> tuple[FloatArray, ...]:
    """Return torques (2, samples) of every record by fits to the other folds.

    Samples in all fits are predicted by the first, those in none by the last.
    """
    found = [np.zeros(record.measured.shape) for record in problem.plant.records]
    for fold in division:
        played = problem.torques(fit(problem, start, fold.train, 6).x)
        for kept, torque, train in zip(found, played, fold.train, strict=True):
            kept[:, ~train] = torque[:, ~train]
            empty = np.all(kept == 0.0, axis=0)
            kept[:, empty] = torque[:, empty]
    return tuple(found)


def gaps(
    problem: Problem, before: Arrays, after: Arrays, division: Folds, seed: int = 0
) -> dict[str, Gap]:
    """Return the `Gap` of each channel on the held-out samples of a division."""
    random = np.random.default_rng(seed)
    sums = _gap_sums(problem, before, after, division)
    return {channel: _gap_of_sums(own, random) for channel, own in sums.items()}


def whole_gap(
    problem: Problem, before: Arrays, after: Arrays, division: Folds, seed: int = 0
) -> Gap:
    """Return the `Gap` of all channels together, as `gaps` has it of each."""
    sums = _gap_sums(problem, before, after, division)
    whole = np.sum([*sums.values()], axis=0)
    return _gap_of_sums(whole, np.random.default_rng(seed))


def _gap_sums(
    problem: Problem, before: Arrays, after: Arrays, division: Folds
) -> dict[str, FloatArray]:
    """Return sums of squares (blocks, 4) by channel, for `_gap_of_sums`."""
    records, found = problem.plant.records, {}
    tests = zip(*(fold.test for fold in division), strict=True)
    masks = [np.any(own, axis=0) for own in tests]
    for row, channel in enumerate(problem.plant.instruments.channels):
        squares = []
        for record, mask, old, new, noise, floor in zip(
            records, masks, before, after, problem.noise, problem.floor, strict=True
        ):
            read = record.measured[row]
            errors = read - old[row], read - new[row], noise[row], np.ones(mask.size)
            squares.append(np.square(errors) * mask / floor[row] ** 2)
        found[channel] = block_sums(problem, masks, squares)
    return found


def _gap_of_sums(squares: FloatArray, random: Generator) -> Gap:
    """Compute a gap from block sums (blocks, 4): before, after, floor, weights."""
    draws = random.integers(0, len(squares), (400, len(squares)))
    shares = [_closed_share(*squares[draw, :3].sum(axis=0)) for draw in draws]
    old, new, floor, weights = squares.sum(axis=0)
    low = high = math.nan
    if np.mean(np.isfinite(shares)) > Limit.min_draw_share:
        low, high = np.nanquantile(shares, [0.025, 0.975]).tolist()
    sizes = (float(np.sqrt(each / weights)) for each in (old, new, floor))
    before, after, least = sizes
    return Gap(before, after, least, _closed_share(old, new, floor), (low, high))


def _closed_share(old: float, new: float, floor: float) -> float:
    """Return the removed share of RMS error above `floor`, by squares; NaN if none."""
    if old <= 1.02 * floor:
        return math.nan
    before, after, least = (math.sqrt(square) for square in (old, new, floor))
    return 1.0 - (after - least) / (before - least)


def overall_share(found: Mapping[str, Gap]) -> float:
    before, after = floor_ratios(found)
    return _closed_share(before**2, after**2, 1.0)


def floor_ratios(found: Mapping[str, Gap]) -> tuple[float, float]:
    if not found:
        return math.nan, math.nan
    before = [(gap.rmse_before / gap.noise_floor) ** 2 for gap in found.values()]
    after = [(gap.rmse_after / gap.noise_floor) ** 2 for gap in found.values()]
    return math.sqrt(np.mean(before)), math.sqrt(np.mean(after))


class Held(NamedTuple):
    """Held-out torques (2, samples) of every record, predicted by the others."""

    before: tuple[FloatArray, ...]  # without the added effects [N m]
    after: tuple[FloatArray, ...]  # with them [N m]
    gap: dict[str, Gap]  # of both, by channel
    never: tuple[str, ...] = ()  # trials that were never held out


class Holdout:
    """Predictions of held-out data by models; the baseline's are computed once."""

    def __init__(self, baseline: Problem, x: FloatArray, seed: int) -> None:
        self._baseline, self._x, self._seed = baseline, x, seed
        records = baseline.plant.records
        # Whole trials; stretches of all where a single trial shows an effect, which the
        # others cannot determine.
        self._divisions = trial_folds(records), interleaved_folds(records)
        self._before: dict[int, tuple[FloatArray, ...]] = {}

    def out(self, problem: Problem, x: FloatArray) -> Held | None:
        """Predict held-out trials, or stretches; None if effects make both worse."""
        baseline = self._baseline
        for place, division in enumerate(self._divisions):
            if place not in self._before:
                self._before[place] = predicted(baseline, self._x, division)
            before = self._before[place]
            after = predicted(problem, x, division) if problem.effects else before
            gap = gaps(baseline, before, after, division, self._seed)
            squares = [(g.rmse_before**2 - g.rmse_after**2, g) for g in gap.values()]
            better = sum(square / g.noise_floor**2 for square, g in squares)
            if not problem.effects or better >= 0.0:
                never = never_held_out(division, problem.plant.records)
                return Held(before, after, gap, never)
        return None
