"""Choice of learned curves by cross-validation over whole trials.

The error is a sum of curves and of what tuning the model does, to first order: the
derivatives of its torques. A curve is linear between a few points, with a penalty on
bends and steps. Curves are added one after another, each the one that predicts left-out
trials best, with the penalty that does. All of this sees training trials only; the
share that is stated is that of trials which neither the choice nor the fit has seen.

All fits are of products summed by trial, so that a fold takes no pass over the samples.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
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


class CurveTerm(NamedTuple):
    """Curve of one quantity, or a candidate for one."""

    over: str  # of `QUANTITIES`
    times: str  # of `FACTORS`
    period: float = 0.0  # 0 for a curve that does not repeat
    sides: tuple[Side, ...] = ()  # torques that it changes
    penalty: float = Limit.first_penalty
    points: int = Limit.ranked_points  # of a curve that does not repeat
    formula: str = ""  # of `FORMULAS`, in place of a table
    shape: tuple[float, ...] = ()  # of the formula

    @property
    def key(self) -> CurveTerm:
        """Term of the same columns, without sides and penalty."""
        return self._replace(sides=(), penalty=0.0)


BASE = CurveTerm("", "", penalty=0.0)
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
    _kept: dict[CurveTerm, FloatArray] = field(default_factory=dict)
    _products: dict[tuple[CurveTerm, CurveTerm], FloatArray] = field(
        default_factory=dict
    )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the groups."""
        return tuple(dict.fromkeys(stretch.group for stretch in self.stretches))

    @cached_property
    def _thin(self) -> list[tuple[int, int]]:
        """Record's samples per sample of a curve, before and after its low pass."""
        finest = [
            s.signals.dt * Limit.samples_per_period * s.band for s in self.stretches
        ]
        first = [max(1, int(0.5 / each)) for each in finest]
        return [
            (n, n * max(1, int(1.0 / each / n)))
            for n, each in zip(first, finest, strict=True)
        ]

    def _laid(self, parts: Sequence[FloatArray], weighted: bool = True) -> FloatArray:
        """Join parts (columns, rows, samples) of records by group, padded with 0.

        The result is (groups, rows, samples, columns).
        """
        by_name: dict[str, list[FloatArray]] = {name: [] for name in self.names}
        for own, part, (_, step) in zip(self.stretches, parts, self._thin, strict=True):
            factor = own.weight[:, ::step] if weighted else 1.0
            by_name[own.group].append(part * factor)
        whole = [np.concatenate(each, axis=2) for each in by_name.values()]
        longest = max(each.shape[2] for each in whole)
        found = np.zeros((len(whole), *whole[0].shape[:2], longest))
        for into, each in zip(found, whole, strict=True):
            into[:, :, : each.shape[2]] = each
        return np.ascontiguousarray(found.transpose(0, 2, 3, 1))

    @cached_property
    def noise(self) -> FloatArray:
        """Sum of squared weighted noise of the sensors (groups,)."""
        pairs = zip(self.stretches, self._thin, strict=True)
        quiet = self._laid([own.noise[None, :, ::step] for own, (_, step) in pairs])
        return np.asarray(np.square(quiet).sum(axis=(1, 2, 3)))

    @cached_property
    def _values(self) -> dict[str, FloatArray]:
        """Every quantity (samples,) of the first row, all records joined."""
        places = range(len(self.stretches))
        return {
            name: np.concatenate([self._along(k, each, 1)[0] for k in places])
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

    def _along(self, k: int, quantity: Quantity, step: int) -> FloatArray:
        """Return every `step`-th sample of a quantity of record `k` (rows, samples)."""
        signals = self.stretches[k].signals
        return np.array([quantity.values(signals, side)[::step] for side in self.sides])

    def curve(
        self, k: int, term: CurveTerm, weights: FloatArray | None = None
    ) -> FloatArray:
        """Return the torques that a term adds to record `k` [N m].

        They are those of a unit at each point (points, rows, coarser samples), or of a
        table `weights` (rows, points) at all samples (rows, samples).
        """
        own, at = self.stretches[k], self.at(term)
        step = self._thin[k][0] if weights is None else 1
        along = self._along(k, QUANTITIES[term.over], step)
        factor = self._along(k, FACTORS[term.times], step)
        shapes = [hats(values, at, term.period) for values in along]
        if term.formula:
            given = FORMULAS[term.formula].functions
            shapes = [np.array(given(values, *term.shape)) for values in along]
        rate = 1.0 / own.signals.dt / step
        if weights is not None:
            tables = [w @ shape for w, shape in zip(weights, shapes, strict=True)]
            return low_pass(np.array(tables) * factor, own.band, rate)
        return low_pass(np.stack(shapes, axis=1) * factor, own.band, rate)

    def columns(self, term: CurveTerm) -> FloatArray:
        """Return a term's weighted columns (groups, rows, samples, points).

        Those of `BASE` are the slopes of the parameters and the error.
        """
        if term.key not in self._kept:
            parts = []
            for k, (own, (first, step)) in enumerate(
                zip(self.stretches, self._thin, strict=True)
            ):
                if term.key == BASE:
                    both = np.concatenate([own.slopes, own.error[None]])
                    parts.append(both[:, :, ::step])
                else:
                    parts.append(self.curve(k, term)[:, :, :: step // first])
            self._kept[term.key] = self._laid(parts)
        return self._kept[term.key]

    def _product(self, one: CurveTerm, other: CurveTerm) -> FloatArray:
        """Return products (groups, rows, points, points) summed over samples."""
        pair = one.key, other.key
        if pair not in self._products:
            left, right = self.columns(one), self.columns(other)
            both = np.matmul(left.transpose(0, 1, 3, 2), right)
            self._products[pair] = both
            self._products[pair[::-1]] = both.transpose(0, 1, 3, 2)
        return self._products[pair]

    def squares(self, terms: Sequence[CurveTerm]) -> FloatArray:
        """Return products (groups, n, n) of slopes, error and the tables by side."""
        blocks = [
            (BASE, -1),
            *((t, self.sides.index(s)) for t in terms for s in t.sides),
        ]
        sizes = [self.columns(term).shape[3] for term, _ in blocks]
        ends = np.cumsum([0, *sizes])
        found = np.zeros((len(self.names), ends[-1], ends[-1]))
        for i, j in itertools.combinations_with_replacement(range(len(blocks)), 2):
            (one, a), (other, b) = blocks[i], blocks[j]
            if min(a, b) >= 0 and a != b:
                continue
            both = self._product(one, other)
            part = both[:, max(a, b)] if max(a, b) >= 0 else both.sum(axis=1)
            rows, columns = (slice(ends[k], ends[k + 1]) for k in (i, j))
            found[:, rows, columns] = part
            found[:, columns, rows] = part.transpose(0, 2, 1)
        return found

    def solve(self, terms: Sequence[CurveTerm], whole: FloatArray) -> FloatArray:
        """Return factors (n,) of all columns for the least error, whose own is 1.

        `whole` (n, n) is the sum of `squares` over the training groups.
        """
        count = self.precise.size
        full = whole + 1e-9 * np.diag(np.diag(whole)) + 1e-12 * np.eye(len(whole))
        prior = np.column_stack([np.diag(self.precise), -self.precise * self.places])
        full[: count + 1, : count + 1] += prior.T @ prior
        first = count + 1
        for term in terms:
            size = self.columns(term).shape[3]
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

    def fitted(self, terms: Sequence[CurveTerm], groups: Groups) -> FloatArray:
        return self.solve(terms, self.squares(terms)[groups].sum(axis=0))

    def tables(self, terms: Sequence[CurveTerm], fit: FloatArray) -> list[FloatArray]:
        """Return each term's table (rows, points) in a fit (n,), 0 for other sides."""
        first, found = self.precise.size + 1, []
        for term in terms:
            size = self.columns(term).shape[3]
            table = np.zeros((len(self.sides), size))
            for side in term.sides:
                table[self.sides.index(side)] = -fit[first : first + size]
                first += size
            found.append(table)
        return found

    def left_out(
        self, terms: Sequence[CurveTerm], folds: Sequence[Groups]
    ) -> FloatArray:
        """Return the squared error of each group by a fit to the other folds."""
        squares, every = self.squares(terms), np.concatenate(folds)
        found = np.zeros(len(squares))
        for fold in folds:
            train = np.setdiff1d(every, fold)
            fit = self.solve(terms, squares[train].sum(axis=0))
            found[fold] = np.einsum("gij,i,j->g", squares[fold], fit, fit)
        return found[np.sort(every)]

    def _left(self, terms: Sequence[CurveTerm], groups: Groups) -> FloatArray:
        """Return the weighted error (groups, rows, samples) after a fit to `groups`."""
        fit = self.fitted(terms, groups)
        error = self.columns(BASE)[groups] @ fit[: self.precise.size + 1]
        for term, table in zip(terms, self.tables(terms, fit), strict=True):
            error -= np.einsum("grsp,rp->grs", self.columns(term)[groups], table)
        return np.asarray(error)

    def _signal(self, quantity: Quantity, weighted: bool) -> FloatArray:
        """Return a quantity (groups, rows, samples) at the samples of the columns."""
        steps = [step for _, step in self._thin]
        parts = [self._along(k, quantity, step)[None] for k, step in enumerate(steps)]
        return self._laid(parts, weighted)[..., 0]

    @cached_property
    def _waves(self) -> dict[str, tuple[FloatArray, NDArray[np.complex64]]]:
        """Frequencies [1/unit] by quantity, waves (orders, groups times samples)."""
        found = {}
        turns = float(np.ptp(self._values["motor angle"])) / math.tau
        for over in PERIODIC if turns > 0.0 else ():
            if over not in self.varying:
                continue
            values = self._signal(QUANTITIES[over], False)[:, 0]
            span = float(np.ptp(self._values[over]))
            base = math.tau / span
            first, last = Limit.min_periods * base, Limit.max_order * turns * base
            orders = np.arange(first, last, base / Limit.order_oversampling)
            orders = orders[: Limit.max_waves]
            if orders.size < 3:
                continue
            phases = np.multiply.outer(orders, values).astype(np.float32)
            found[over] = orders, np.exp(1j * phases).reshape(orders.size, -1)
        return found

    @cached_property
    def _factors(self) -> dict[str, FloatArray]:
        return {name: self._signal(each, True) for name, each in FACTORS.items()}

    def periodic(self, groups: Groups, terms: Sequence[CurveTerm]) -> list[CurveTerm]:
        """Return candidates of the periods that take most of the error left."""
        left, found = np.zeros(self.columns(BASE).shape[:3]), []
        left[groups] = self._left(terms, groups)
        for over, (orders, waves) in self._waves.items():
            for times, factor in self._factors.items():
                wanted = (factor * left).transpose(0, 2, 1).reshape(waves.shape[1], -1)
                size = np.maximum(np.sum(factor[groups] ** 2, axis=(0, 2)), 1e-300)
                power = np.abs(waves @ wanted.astype(np.float32)) ** 2 / size
                order = _peak(orders, power.sum(axis=1))
                found.append(CurveTerm(over, times, math.tau / order))
        return found


def _peak(places: FloatArray, heights: FloatArray) -> float:
    """Return the place of the largest height, by the parabola through its neighbours.

    Places are evenly spaced.
    """
    top = min(max(int(np.argmax(heights)), 1), heights.size - 2)
    before, most, after = heights[top - 1 : top + 2].tolist()
    bend = before - 2.0 * most + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    step = float(places[1] - places[0])
    return float(places[top]) + step * min(max(shift, -1.0), 1.0)


def choose(rows: ErrorRows, groups: Groups) -> list[CurveTerm]:
    """Return the curves that predict left-out groups best, [] if none does."""
    folds = split(groups)
    sides: list[tuple[Side, ...]] = [(side,) for side in rows.sides]
    sides += [rows.sides] if len(sides) > 1 else []
    plain = [CurveTerm(over, times) for over in rows.varying for times in FACTORS]
    terms: list[CurveTerm] = []
    before = rows.left_out(terms, folds)
    quiet = Limit.max_misfit**2 * float(rows.noise[groups].sum())
    while len(terms) < Limit.max_curves and before.sum() > quiet:
        taken = {(term.over, term.times) for term in terms}
        able = [*plain, *rows.periodic(groups, terms)]
        able = [t._replace(sides=rows.sides) for t in able if t[:2] not in taken]
        sums = [float(rows.left_out([*terms, term], folds).sum()) for term in able]
        best = [able[k] for k in np.argsort(sums)[: Limit.refined_curves]]
        tried = [
            term._replace(sides=own, penalty=penalty, points=Limit.curve_points)
            for term in best
            for own in sides
            for penalty in Limit.curve_penalties
        ]
        left = [rows.left_out([*terms, term], folds) for term in tried]
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
    folds = split(every)
    others = [*terms[:place], *terms[place + 1 :]]
    at, used = rows.at(curve), [rows.sides.index(side) for side in curve.sides]

    def errors(term: CurveTerm, train: Groups, test: Groups) -> float:
        made = [*others, term]
        fit = rows.fitted(made, train)
        return float(np.einsum("gij,i,j->", rows.squares(made)[test], fit, fit))

    def formed(name: str, groups: Groups) -> CurveTerm:
        table = rows.tables(terms, rows.fitted(terms, groups))[place][used]
        shape = best_shape(FORMULAS[name], at, table, curve.period)
        best = curve._replace(formula=name, shape=shape)
        for part in Limit.shape_steps:
            near = [best._replace(shape=s) for s in neighbours(name, best.shape, part)]
            best = min([best, *near], key=lambda term: errors(term, groups, groups))
        return best

    found, least = "", float(rows.left_out(terms, folds).sum())
    for name in FORMULAS:
        trained = [np.setdiff1d(every, fold) for fold in folds]
        pairs = zip(trained, folds, strict=True)
        left = sum(errors(formed(name, train), train, test) for train, test in pairs)
        if left < least:
            found, least = name, left
    return formed(found, every) if found else None


def split(groups: Groups) -> list[Groups]:
    """Return `groups` divided into the folds that are left out in turn."""
    count = min(Limit.curve_folds, groups.size)
    return [groups[k::count] for k in range(count)]


def helps(gain: FloatArray, before: FloatArray) -> bool:
    """Return whether errors `before` (groups,) fall by enough, and in most groups."""
    rest = np.arange(gain.size) != np.argmax(gain)
    least = Limit.min_reduction * before
    enough = gain.sum() > least.sum() and gain[rest].sum() > 0.5 * least[rest].sum()
    return bool(enough and np.median(gain) > 0.0)
