"""Choice of learned curves by cross-validation over whole trials.

The error is a sum of curves and of what tuning the model does, to first order: the
derivatives of its torques. A curve is linear between a few points, with a penalty on
bends and steps. Curves are added one after another, each the one that predicts left-out
trials best, with the penalty that does. All of this sees training trials only; the
share that is stated is that of trials which neither the choice nor the fit has seen.

All fits are of products summed by trial, so that a fold takes no pass over the samples.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._learn.curves import FACTORS, QUANTITIES, Quantity, Side
from cc_mujoco.diagnosis._learn.formulas import FORMULAS, best_shape, neighbours
from cc_mujoco.diagnosis._rig.records import low_pass
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects._effect import Signals
from cc_mujoco.native import FloatArray

Groups = NDArray[np.intp]
"""Indices of groups in `ErrorRows.names`."""
PERIODIC = "motor angle", "joint angle", "cable position", "time"
"""Quantities in which a curve may repeat."""


class ErrorRecord(NamedTuple):
    """Signals, errors and slopes of one record, at its samples."""

    group: str  # name of the trials that repeat each other, which no fold parts
    signals: Signals  # simulated, of the model
    error: FloatArray  # (rows, samples) measured minus simulated [N m]
    slopes: FloatArray  # (parameters, rows, samples) of the torques [N m]
    weight: FloatArray  # (rows, samples) of the error, 0 for samples left out [1/N m]
    noise: FloatArray  # (rows, samples) deviation by the sensors [N m]
    band: float  # cut-off of the torques [Hz]

    @property
    def steps(self) -> tuple[int, int]:
        """Samples per sample of a curve, before and after its low pass."""
        finest = self.signals.dt * Limit.samples_per_period * self.band
        first = max(1, int(0.5 / finest))
        return first, first * max(1, int(1.0 / finest / first))


class CurveTerm(NamedTuple):
    """Curve of one quantity, or a candidate for one."""

    over: str  # of `QUANTITIES`
    times: str  # of `FACTORS`
    sides: tuple[Side, ...]  # torques that it changes
    period: float = 0.0  # 0 for a curve that does not repeat
    penalty: float = Limit.first_penalty
    points: int = Limit.ranked_points  # of a curve that does not repeat
    formula: str = ""  # of `FORMULAS`, in place of a table
    shape: tuple[float, ...] = ()  # of the formula


BASE = CurveTerm("", "", (), penalty=0.0)
"""Columns of the parameters and of the error, in place of a curve."""


def hats(values: FloatArray, at: FloatArray, period: float) -> FloatArray:
    """Return weights (points, samples) to interpolate a table at values (samples,).

    Its points are `at` (points,); it repeats after `period` where that is not 0.
    """
    if period:
        at, values = np.append(at, period), values % period
    place = np.clip(np.searchsorted(at, values, side="right") - 1, 0, at.size - 2)
    part = np.clip((values - at[place]) / (at[place + 1] - at[place]), 0.0, 1.0)
    found = np.zeros((at.size, values.size))
    samples = np.arange(values.size)
    found[place, samples] = 1.0 - part
    found[place + 1, samples] += part
    if period:
        found[0] += found[-1]
        found = found[:-1]
    return found


@lru_cache(maxsize=16)
def roughness(size: int, repeats: bool) -> FloatArray:
    """Return the matrix (size, size) that penalises bends and steps of a table."""
    eye = np.eye(size)
    steps = np.roll(eye, -1, 1) - eye if repeats else np.diff(eye, axis=0)
    bends = steps @ steps if repeats else np.diff(eye, 2, axis=0)
    both = Limit.curve_bends * (bends.T @ bends) + Limit.curve_steps * (steps.T @ steps)
    return np.asarray(both + Limit.curve_ridge * eye)


@dataclass(frozen=True, eq=False)
class ErrorRows:
    """Weighted torque errors by group, and their slopes by curves and parameters."""

    stretches: Sequence[ErrorRecord]
    sides: tuple[Side, ...]  # of the rows
    places: FloatArray  # (parameters,) of the model where its errors are taken
    precise: FloatArray  # (parameters,) inverse deviations of priors, 0 without one
    _kept: dict[tuple[CurveTerm, ...], FloatArray] = field(
        default_factory=dict, init=False
    )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the groups."""
        return tuple(dict.fromkeys(own.group for own in self.stretches))

    def _laid(
        self, columns: Callable[[ErrorRecord, int], FloatArray], weighted: bool = True
    ) -> FloatArray:
        """Join `columns(record, step)` (columns, rows, samples) of every record.

        The result is (groups, rows, samples, columns), padded with 0.
        """
        by_name: dict[str, list[FloatArray]] = {name: [] for name in self.names}
        for own in self.stretches:
            step = own.steps[1]
            factor = own.weight[:, ::step] if weighted else 1.0
            by_name[own.group].append(columns(own, step) * factor)
        whole = [np.concatenate(each, axis=2) for each in by_name.values()]
        longest = max(each.shape[2] for each in whole)
        found = np.zeros((len(whole), *whole[0].shape[:2], longest))
        for into, each in zip(found, whole, strict=True):
            into[:, :, : each.shape[2]] = each
        return np.ascontiguousarray(found.transpose(0, 2, 3, 1))

    @cached_property
    def noise(self) -> FloatArray:
        """Sum of squared weighted noise of the sensors (groups,)."""
        quiet = self._laid(lambda own, step: own.noise[None, :, ::step])
        return np.asarray(np.square(quiet).sum(axis=(1, 2, 3)))

    @cached_property
    def _values(self) -> dict[str, FloatArray]:
        """Every quantity (samples,) of the first row, all records joined."""
        side = self.sides[0]
        return {
            name: np.concatenate([each.values(s.signals, side) for s in self.stretches])
            for name, each in QUANTITIES.items()
        }

    @cached_property
    def varying(self) -> tuple[str, ...]:
        """Names of the quantities that vary by more than rounding."""
        sizes = {n: (np.ptp(v), np.max(np.abs(v))) for n, v in self._values.items()}
        return tuple(n for n, (span, most) in sizes.items() if span > 1e-6 * most)

    def at(self, term: CurveTerm) -> FloatArray:
        """Return the values (points,) of the quantity at which a term has points."""
        if term.period:
            return term.period * np.arange(Limit.period_points) / Limit.period_points
        values = self._values[term.over]
        shares = np.linspace(Limit.curve_edge, 1.0 - Limit.curve_edge, term.points)
        often = np.quantile(values, shares)
        return np.asarray(0.5 * (often + np.linspace(often[0], often[-1], term.points)))

    def curve(self, own: ErrorRecord, term: CurveTerm, step: int = 1) -> FloatArray:
        """Return torques (columns, rows, samples) of a unit at each point [N m].

        Columns are points (or functions of the formula) of its first side, then of its
        second; every `step`-th sample is returned.
        """
        at, parts = self.at(term), []
        for side in term.sides:
            along, factor = (
                known.values(own.signals, side)[::step]
                for known in (QUANTITIES[term.over], FACTORS[term.times])
            )
            shape = hats(along, at, term.period)
            if term.formula:
                functions = FORMULAS[term.formula].functions
                shape = np.array(functions(along, *term.shape))
            part = np.zeros((len(shape), len(self.sides), along.size))
            part[:, self.sides.index(side)] = shape * factor
            parts.append(part)
        return low_pass(np.concatenate(parts), own.band, 1.0 / own.signals.dt / step)

    def columns(self, term: CurveTerm) -> FloatArray:
        """Return a term's weighted columns (groups, rows, samples, columns).

        Those of `BASE` are the slopes of the parameters and the error.
        """

        def own_columns(own: ErrorRecord, step: int) -> FloatArray:
            if term == BASE:
                return np.concatenate([own.slopes, own.error[None]])[:, :, ::step]
            first = own.steps[0]
            return self.curve(own, term, first)[:, :, :: step // first]

        key = (term._replace(penalty=0.0),)
        if key not in self._kept:
            self._kept[key] = self._laid(own_columns)
        return self._kept[key]

    def _product(self, one: CurveTerm, other: CurveTerm) -> FloatArray:
        """Return products (groups, columns, columns) summed over rows and samples."""
        pair = one._replace(penalty=0.0), other._replace(penalty=0.0)
        if pair not in self._kept:
            left, right = self.columns(one), self.columns(other)
            both = np.matmul(left.transpose(0, 1, 3, 2), right).sum(axis=1)
            self._kept[pair], self._kept[pair[::-1]] = both, both.transpose(0, 2, 1)
        return self._kept[pair]

    def squares(self, terms: Sequence[CurveTerm]) -> FloatArray:
        """Return products (groups, n, n) of slopes, error and the columns of terms."""
        every = [BASE, *terms]
        return np.block(
            [[self._product(one, other) for other in every] for one in every]
        )

    def fitted(self, terms: Sequence[CurveTerm], groups: Groups) -> FloatArray:
        """Return factors (n,) of columns for the least error; the error's is 1."""
        whole, count = self.squares(terms)[groups].sum(axis=0), self.precise.size
        full = whole + 1e-9 * np.diag(np.diag(whole)) + 1e-12 * np.eye(len(whole))
        prior = np.column_stack([np.diag(self.precise), -self.precise * self.places])
        full[: count + 1, : count + 1] += prior.T @ prior
        first = count + 1
        for term in terms:
            size = self.columns(term).shape[3] // len(term.sides)
            rough = term.penalty * roughness(size, bool(term.period))
            if term.formula:
                rough = Limit.formula_ridge * np.eye(size)
            for _ in term.sides:
                own = slice(first, first + size)
                full[own, own] += np.trace(whole[own, own]) / size * rough
                first += size
        others = np.arange(len(full)) != count
        found = np.ones(len(full))
        found[others] = -np.linalg.solve(
            full[np.ix_(others, others)], full[others, count]
        )
        return found

    def table(
        self, terms: Sequence[CurveTerm], place: int, fit: FloatArray
    ) -> FloatArray:
        """Return the table (sides, points) of `terms[place]` in a fit (n,)."""
        ends = np.cumsum([self.columns(term).shape[3] for term in (BASE, *terms)])
        return -fit[ends[place] : ends[place + 1]].reshape(len(terms[place].sides), -1)

    def errors(
        self, terms: Sequence[CurveTerm], train: Groups, test: Groups
    ) -> FloatArray:
        """Return the squared error of each group of `test` by a fit to `train`."""
        fit = self.fitted(terms, train)
        return np.asarray(np.einsum("gij,i,j->g", self.squares(terms)[test], fit, fit))

    def left_out(self, terms: Sequence[CurveTerm], groups: Groups) -> FloatArray:
        """Return the squared error of each group by a fit to the other folds."""
        found = np.zeros(len(self.names))
        for train, test in folds(groups):
            found[test] = self.errors(terms, train, test)
        return found[groups]

    def _signal(self, quantity: Quantity, weighted: bool) -> FloatArray:
        """Return a quantity (groups, rows, samples) at the samples of the columns."""

        def values(own: ErrorRecord, step: int) -> FloatArray:
            rows = [quantity.values(own.signals, side)[::step] for side in self.sides]
            return np.array([rows])

        return self._laid(values, weighted)[..., 0]

    @cached_property
    def _waves(self) -> dict[str, tuple[FloatArray, NDArray[np.complex64]]]:
        """Frequencies [1/unit] by quantity, waves (orders, groups times samples)."""
        found = {}
        turns = float(np.ptp(self._values["motor angle"])) / math.tau
        for over in PERIODIC if turns > 0.0 else ():
            if over not in self.varying:
                continue
            values = self._signal(QUANTITIES[over], False)[:, 0]
            base = math.tau / float(np.ptp(self._values[over]))
            first, last = Limit.min_periods * base, Limit.max_order * turns * base
            orders = np.arange(first, last, base / Limit.order_oversampling)
            orders = orders[: Limit.max_waves]
            if orders.size >= 3:
                phases = np.multiply.outer(orders, values).astype(np.float32)
                found[over] = orders, np.exp(1j * phases).reshape(orders.size, -1)
        return found

    def periodic(self, groups: Groups, terms: Sequence[CurveTerm]) -> list[CurveTerm]:
        """Return candidates of the periods that take most of the error left."""
        fit, found = self.fitted(terms, groups), []
        every = [self.columns(term)[groups] for term in (BASE, *terms)]
        factors = {name: self._signal(each, True) for name, each in FACTORS.items()}
        left = np.zeros(self.columns(BASE).shape[:3])
        left[groups] = np.concatenate(every, axis=3) @ fit
        for over, (orders, waves) in self._waves.items():
            for times, factor in factors.items():
                wanted = (factor * left).transpose(0, 2, 1).reshape(waves.shape[1], -1)
                size = np.maximum(np.sum(factor[groups] ** 2, axis=(0, 2)), 1e-300)
                power = np.abs(waves @ wanted.astype(np.float32)) ** 2 / size
                order = _peak(orders, power.sum(axis=1))
                found.append(CurveTerm(over, times, self.sides, math.tau / order))
        return found


def _peak(places: FloatArray, heights: FloatArray) -> float:
    """Return the largest height's place, by a parabola; places are evenly spaced."""
    top = min(max(int(np.argmax(heights)), 1), heights.size - 2)
    before, most, after = heights[top - 1 : top + 2].tolist()
    bend = before - 2.0 * most + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    step = float(places[1] - places[0])
    return float(places[top]) + step * min(max(shift, -1.0), 1.0)


def choose(rows: ErrorRows, groups: Groups) -> list[CurveTerm]:
    """Return the curves that predict left-out groups best, [] if none does."""
    alone: list[tuple[Side, ...]] = [(side,) for side in rows.sides]
    sides = [*alone, rows.sides] if len(alone) > 1 else alone
    names = itertools.product(rows.varying, FACTORS)
    plain = [CurveTerm(over, times, rows.sides) for over, times in names]
    terms: list[CurveTerm] = []
    before = rows.left_out(terms, groups)
    quiet = Limit.max_misfit**2 * float(rows.noise[groups].sum())
    while len(terms) < Limit.max_curves and before.sum() > quiet:
        taken = {(term.over, term.times) for term in terms}
        every = *plain, *rows.periodic(groups, terms)
        able = [term for term in every if term[:2] not in taken]
        # Where one torque has no such curve, that of the other may predict well.
        own = [[(*terms, t._replace(sides=side)) for side in alone] for t in able]
        errors = [[float(rows.left_out(t, groups).sum()) for t in e] for e in own]
        order = np.minimum(errors, before.sum()).sum(axis=1).argsort()
        best = [able[k] for k in order[: Limit.refined_curves]]
        tried = [
            term._replace(sides=own, penalty=penalty, points=Limit.curve_points)
            for term in best
            for own in sides
            for penalty in Limit.curve_penalties
        ]
        left = [rows.left_out([*terms, term], groups) for term in tried]
        # A second torque has to take a share of its own.
        extra = [1.0 + Limit.form_error_share * (len(t.sides) - 1) for t in tried]
        sums = [by * float(e.sum()) for by, e in zip(extra, left, strict=True)]
        leader = int(np.argmin(sums))
        if not helps(before - left[leader], before):
            break
        terms.append(tried[leader])
        before = left[leader]
    return terms


def formula_of(
    rows: ErrorRows, terms: Sequence[CurveTerm], place: int
) -> CurveTerm | None:
    """Return `terms[place]` with the formula that beats its table, or None.

    Left-out trials decide; the shape is fitted to the table of the other trials.
    """
    every, curve = np.arange(len(rows.names)), terms[place]
    at, others = rows.at(curve), [*terms[:place], *terms[place + 1 :]]

    def errors(term: CurveTerm, train: Groups, test: Groups) -> float:
        return float(rows.errors([*others, term], train, test).sum())

    def formed(name: str, groups: Groups) -> CurveTerm:
        table = rows.table(terms, place, rows.fitted(terms, groups))
        shape = best_shape(FORMULAS[name], at, table, curve.period)
        best = curve._replace(formula=name, shape=shape)
        for part in Limit.shape_steps:
            near = [best._replace(shape=s) for s in neighbours(name, best.shape, part)]
            best = min([best, *near], key=lambda term: errors(term, groups, groups))
        return best

    found, least = "", float(rows.left_out(terms, every).sum())
    for name in FORMULAS:
        left = sum(errors(formed(name, each[0]), *each) for each in folds(every))
        if left < least:
            found, least = name, left
    return formed(found, every) if found else None


def folds(groups: Groups) -> list[tuple[Groups, Groups]]:
    """Return the groups to fit and to test when parts of `groups` are left out."""
    part = np.arange(groups.size) % min(Limit.curve_folds, groups.size)
    return [(groups[part != k], groups[part == k]) for k in np.unique(part)]


def helps(gain: FloatArray, before: FloatArray) -> bool:
    """Return whether errors `before` (groups,) fall by enough, and in most groups."""
    rest = np.arange(gain.size) != np.argmax(gain)
    least = Limit.min_reduction * before
    enough = gain.sum() > least.sum() and gain[rest].sum() > 0.5 * least[rest].sum()
    return bool(enough and np.median(gain) > 0.0)
