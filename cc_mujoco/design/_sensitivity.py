"""Sensitivity: main effects, and each variable's share of a metric's variance.

Sobol's indices split the variance of a metric among variables and pairs of them. If the
designs are a full grid and all have a number, the split is exact over that grid. Else a
surface is fitted (`Surface`), whose indices over the ranges are estimated as in
Saltelli et al. (2010) with `scipy.stats.sobol_indices`. Variance that the surface does
not predict belongs to no variable. The error of an index combines that part with the
scatter of indices of surfaces through random halves of the designs. An index below its
error is 0.
"""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from cc_mujoco.design._designs import Range
from cc_mujoco.design._plan import Plan
from cc_mujoco.device._variables import Value
from cc_mujoco.native import FloatArray as Array

if TYPE_CHECKING:
    from scipy.interpolate import RBFInterpolator

# First order, total, pairs
Indices = tuple[dict[str, float], dict[str, float], dict[tuple[str, str], float]]

LOG2_POINTS = 11  # log2 of the number of points of an estimate; errors use a quarter


@dataclass(frozen=True)
class Surface:
    """Smooth fit of a metric as a function of the design variables."""

    x: Array  # (n, variables) places of the designs on the scales of the variables
    y: Array  # (n,) metric of the designs
    active: tuple[int, ...]  # columns of `x` that the fit uses
    smoothing: float  # of the spline; 0 interpolates
    r_squared: float  # share of the variance explained in cross-validation

    @cached_property
    def _fitted(self) -> "RBFInterpolator":
        return _spline(self.x[:, self.active], self.y, self.smoothing)

    def __call__(self, x: Array) -> Array:
        return np.asarray(self._fitted(x[:, self.active]))

    def halves(self, count: int) -> "Iterator[Surface]":
        """Yield up to `count` surfaces through random halves that have a spline."""
        rng = np.random.default_rng(1)
        for _ in range(count):
            half = rng.permutation(len(self.y))[: (len(self.y) + 1) // 2]
            one = dataclasses.replace(self, x=self.x[half], y=self.y[half])
            with contextlib.suppress(np.linalg.LinAlgError, ValueError):
                _ = one._fitted
                yield one


@dataclass(frozen=True)
class Sensitivity:
    """Main effects and Sobol indices of one metric."""

    metric: str
    how: str  # origin of the numbers, for a reader
    first: dict[str, float]  # part of the variance that each variable makes alone
    total: dict[str, float]  # part that each variable makes with all its interactions
    pairs: dict[tuple[str, str], float]  # part that two variables make only together
    effects: dict[str, tuple[Array, Array]]  # values of a variable, mean metric there
    levels: dict[str, tuple[str, ...]]  # texts of values that are no numbers
    surface: Surface | None = None  # that the numbers are of, where they are not exact
    errors: Indices = ({}, {}, {})  # of `first`, `total`, `pairs`, if not exact

    def value_texts(self, name: str, text: Callable[[float], str]) -> Sequence[str]:
        """Return a variable's values in its effect as texts, numbers by `text`."""
        return self.levels.get(name) or [*map(text, self.effects[name][0].tolist())]

    def extremes(self, name: str, text: Callable[[float], str]) -> list[str]:
        """Return texts of the least and greatest mean over a variable, and where."""
        means, values = self.effects[name][1], self.value_texts(name, text)
        ends = int(np.argmin(means)), int(np.argmax(means))
        return [f"{text(float(means[k]))} at {values[k]}" for k in ends]

    @property
    def ranked(self) -> list[str]:
        """Names of the variables by decreasing total index."""
        return sorted(self.total, key=lambda name: -self.total[name])


def sensitivity(plan: Plan, table: pa.Table, metric: str) -> Sensitivity | None:
    """Return a metric's sensitivity; None if constant, or known of too few designs."""
    y = np.asarray(table[metric].to_numpy(zero_copy_only=False), dtype=np.float64)
    varied = plan.varied
    good = np.isfinite(y)
    if not varied or good.sum() < 2:
        return None
    if not np.ptp(y[good]) > 1e-12 * np.abs(y[good]).max():
        return None
    if plan.full and good.all():
        return _exact_indices(plan, metric, y)
    x = [plan.ranges[name].code([d[name] for d in plan.designs]) for name in varied]
    surface = fit(np.stack(x, axis=-1)[good], y[good])
    if surface is None:
        return None
    found = _surface_indices(plan, metric, surface)
    if lacking := int((~good).sum()):
        gap = f"{lacking} designs have no number, and it says nothing there"
        found = dataclasses.replace(found, how=f"{found.how}; {gap}")
    return found


def _exact_indices(plan: Plan, metric: str, y: Array) -> Sensitivity:
    """Return the sensitivity of a metric `y` that is known on a full grid."""
    names = plan.varied
    shape = [len(plan.ranges[name].levels) for name in plan.ranges]
    keep = [i for i, name in enumerate(plan.ranges) if name in names]
    cube = y.reshape(shape).reshape([shape[i] for i in keep])
    every = set(range(len(names)))
    variance = float(cube.var())

    def closed(*own: int) -> float:
        mean = cube.mean(axis=tuple(every - set(own)))
        return float(mean.var()) / variance

    first = {name: closed(i) for i, name in enumerate(names)}
    total = {name: 1.0 - closed(*(every - {i})) for i, name in enumerate(names)}
    if len(names) == 1:
        total = {names[0]: 1.0}
    pairs, means = {}, {}
    for (i, one), (j, other) in itertools.combinations(enumerate(names), 2):
        pairs[one, other] = closed(i, j) - first[one] - first[other]
    for i, name in enumerate(names):
        means[name] = plan.ranges[name].levels, cube.mean(axis=tuple(every - {i}))
    how = f"exact over the grid of {len(y)} designs"
    return Sensitivity(metric, how, first, total, pairs, *_main_effects(means))


def _surface_indices(plan: Plan, metric: str, surface: Surface) -> Sensitivity:
    from scipy.stats import qmc

    names, axes = plan.varied, [plan.ranges[name] for name in plan.varied]
    estimate = _indices(surface, axes, LOG2_POINTS, 0)
    # Surfaces through random halves of the designs, by which errors are found
    halves = enumerate(surface.halves(6), 1)
    less = LOG2_POINTS - 2
    spread = [_indices(half, axes, less, seed) - estimate for seed, half in halves]
    moved = np.sqrt(np.mean(np.square(spread), axis=0)) if spread else 1.0
    # What the surface does not explain may belong to any variable.
    errors = np.hypot(moved, 1.0 - surface.r_squared) + 0.0 * estimate
    estimate = estimate * surface.r_squared
    estimate = np.where(np.abs(estimate) > errors, estimate, 0.0)
    means: dict[str, tuple[Sequence[Value], Array]] = {}
    points_in = qmc.Sobol(len(names), rng=np.random.default_rng(1)).random_base2(9)
    for i, (name, axis) in enumerate(zip(names, axes, strict=True)):
        shares = axis.shares(9)  # points of a main effect
        mean = np.empty(shares.size)
        for k, share in enumerate(shares):
            points = points_in.copy()
            points[:, i] = share
            mean[k] = surface(_scale_points(axes, points)).mean()
        means[name] = axis.at(shares), mean
    how = (
        f"Saltelli's estimate on a thin-plate spline fitted to {len(surface.y)} "
        f"designs, R^2 = {surface.r_squared:.3f} at designs left out; what is below "
        "its error is -"
    )
    found, errors_of = (_named_indices(names, each) for each in (estimate, errors))
    return Sensitivity(metric, how, *found, *_main_effects(means), surface, errors_of)


def _main_effects(
    means: Mapping[str, tuple[Sequence[Value], Array]],
) -> tuple[dict[str, tuple[Array, Array]], dict[str, tuple[str, ...]]]:
    """Return the fields `effects` and `levels`, with texts numbered 0, 1, 2, ..."""
    levels = {
        name: tuple(map(str, values))
        for name, (values, _) in means.items()
        if any(isinstance(value, str) for value in values)
    }
    effects = {}
    for name, (values, mean) in means.items():
        places = range(len(values)) if name in levels else values
        effects[name] = np.array(places, dtype=np.float64), mean
    return effects, levels


def _named_indices(names: Sequence[str], found: Array) -> Indices:
    count, values = len(names), found.tolist()
    pairs = itertools.combinations(names, 2)
    return (
        dict(zip(names, values[:count], strict=True)),
        dict(zip(names, values[count : 2 * count], strict=True)),
        dict(zip(pairs, values[2 * count :], strict=True)),
    )


def _scale_points(axes: Sequence[Range], unit: Array) -> Array:
    """Return points of the unit cube, scaled as the fit's `x` (n, variables)."""
    columns = [axis.code(axis.at(u)) for axis, u in zip(axes, unit.T, strict=True)]
    return np.stack(columns, axis=-1)


def _indices(surface: Surface, axes: Sequence[Range], power: int, seed: int) -> Array:
    from scipy.stats import sobol_indices, uniform

    count, active = len(axes), surface.active
    first, total = np.zeros(count), np.zeros(count)
    pairs = np.zeros((count, count))

    def at(unit: Array) -> Array:
        whole = np.full((len(unit), count), 0.5)
        whole[:, active] = unit
        return surface(_scale_points(axes, whole))

    if len(active) == 1:
        first[active], total[active] = 1.0, 1.0
    else:
        found = sobol_indices(
            func=lambda unit: at(unit.T),
            n=2**power,
            dists=[uniform()] * len(active),
            rng=np.random.default_rng(seed),
        )
        first[list(active)] = np.ravel(found.first_order)
        total[list(active)] = np.ravel(found.total_order)
        pairs[np.ix_(active, active)] = _pair_effects(at, len(active), power, seed)
    places = list(itertools.combinations(range(count), 2))
    return np.array([*first, *total, *(pairs[place] for place in places)])


def _pair_effects(
    at: Callable[[Array], Array], count: int, power: int, seed: int
) -> Array:
    """Return the interaction index of every pair of variables (count, count)."""
    from scipy.stats import qmc

    rng = np.random.default_rng([2, seed])
    points = qmc.Sobol(2 * count, rng=rng).random_base2(power)
    one, other = points[:, :count], points[:, count:]
    base = at(one)
    variance, mean = float(base.var()), float(base.mean())

    def closed(*own: int) -> float:
        mixed = other.copy()
        mixed[:, own] = one[:, own]
        return float(np.mean((base - mean) * (at(mixed) - mean))) / variance

    alone = [closed(i) for i in range(count)]
    found = np.zeros((count, count))
    for i, j in itertools.combinations(range(count), 2):
        found[i, j] = closed(i, j) - alone[i] - alone[j]
    return found


def fit(x: Array, y: Array) -> Surface | None:
    """Return a surface for `y` (n,) over `x` (n, variables), or None if it fails."""
    rng = np.random.default_rng(0)
    # At most 1000 designs are fitted.
    shuffled = rng.permutation(len(y))[:1000]
    x, y = x[shuffled], y[shuffled]
    least = 3 * (x.shape[1] + 1)
    if len(y) < max(least, 10) or not np.ptp(y) > 0.0:
        return None
    active = _active_columns(x[:300], y[:300])  # enough to choose variables by
    if not active:
        return None
    smoothing, error = _best_smoothing(x[:, active], y)
    r_squared = 1.0 - float(np.mean(error) / np.var(y))
    if not r_squared > 0.0:
        return None
    return Surface(x, y, active, smoothing, r_squared)


def _active_columns(x: Array, y: Array) -> tuple[int, ...]:
    """Return the columns of `x` that improve the prediction of held-out designs."""
    active = tuple(range(x.shape[1]))
    while active:
        smoothing, error = _best_smoothing(x[:, active], y)
        help_of = {}
        for column in active:
            rest = tuple(other for other in active if other != column)
            gain = _left_out_errors(x[:, rest], y, smoothing) - error
            deviation = float(np.std(gain)) / np.sqrt(len(y))
            help_of[column] = float(np.mean(gain)) / max(deviation, 1e-300)
        least = min(active, key=lambda column: help_of[column])
        # A variable stays if it lowers the squared error by two standard errors.
        if help_of[least] > 2.0:
            break
        active = tuple(other for other in active if other != least)
    return active


def _best_smoothing(x: Array, y: Array) -> tuple[float, Array]:
    errors = {each: _left_out_errors(x, y, each) for each in (0.0, 1e-4, 1e-2, 1.0)}
    best = min(errors, key=lambda each: float(np.mean(errors[each])))
    return best, errors[best]


def _left_out_errors(x: Array, y: Array, smoothing: float) -> Array:
    """Return squared errors of splines at designs left out of them, in 5 folds."""
    error = np.zeros_like(y)
    for fold in range(5):
        out = np.arange(len(y)) % 5 == fold
        predicted: Any = np.mean(y[~out])  # all there is without variables, or a spline
        if x.shape[1]:
            with contextlib.suppress(np.linalg.LinAlgError):
                predicted = _spline(x[~out], y[~out], smoothing)(x[out])
        error[out] = predicted - y[out]
    return error**2


def _spline(x: Array, y: Array, smoothing: float) -> "RBFInterpolator":
    from scipy.interpolate import RBFInterpolator

    return RBFInterpolator(x, y, smoothing=smoothing, kernel="thin_plate_spline")
