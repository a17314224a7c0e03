r"""Least squares on simulations: fits, covariance, intervals, undetermined directions.

Residuals are (measured - simulated) / noise. Friction makes them piecewise smooth in
the parameters, with jumps where regions of slip meet. Derivatives are therefore
differences over steps that are large enough to cross many pieces.

    friction = Parameter("friction", scale="log")
    free = (Tuned(friction, 0.1, 1.0, -5.0, 3.0),)
    found = fit(residual, jacobian, free, [0.0])
    spread = np.sqrt(np.diag(covariance(jacobian(found.x))))
    estimate(free[0], found.x[0], spread[0]).ci95
"""

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.native import FloatArray

THREADS = max(1, min(os.cpu_count() or 1, 8))
FACTOR_STEP = 3e-3
"""Step of a parameter's logarithm over which simulations are differenced."""
MAX_FREEDOM = 1e9
"""Degrees of freedom from which on the variance counts as known (t, F)."""
_Item = TypeVar("_Item")
_Found = TypeVar("_Found")


class Tuned(NamedTuple):
    """Free parameter of a fit, and the scaled coordinate ("place") that is varied.

    Its value is start exp(scale place) or, if not logarithmic, start + scale place.
    """

    parameter: Parameter  # fitted as a logarithm where its scale is
    start: float  # value where the place is 0
    scale: float  # size of one unit of the place; relative where `factor`
    low: float  # bounds of the place
    high: float
    prior: float = math.inf  # standard deviation of the place; inf: only data count

    @property
    def name(self) -> str:
        return self.parameter.name

    @property
    def unit(self) -> str:
        return self.parameter.unit

    @property
    def factor(self) -> bool:
        """True if the parameter is fitted as a logarithm."""
        return self.parameter.scale == "log"

    def value(self, x: float) -> float:
        if self.factor:
            return self.start * math.exp(self.scale * x)
        return self.start + self.scale * x

    def place(self, value: float) -> float:
        """Return the coordinate of the parameter at `value`, cut to its bounds."""
        found = -math.inf
        if not self.factor:
            found = (value - self.start) / self.scale
        elif value > 0.0:
            found = math.log(value / self.start) / self.scale
        return min(max(found, self.low), self.high)


@dataclass(frozen=True)
class Estimate:
    """A fitted number with its 95 % confidence interval, NaN if not determined."""

    value: float
    unit: str
    ci95: tuple[float, float]

    def holds(self, value: float) -> bool:
        """Return whether `value` is in the interval; True if there is no interval."""
        low, high = self.ci95
        return math.isnan(low) or low <= value <= high


class Fit(NamedTuple):
    """End point of a fit: coordinates and cost."""

    x: FloatArray  # place of the parameters
    cost: float  # half the sum of squares there


def fit(
    residual: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    free: Sequence[Tuned],
    start: ArrayLike,
    *,
    tolerance: float = 1e-9,
    evaluations: int = 60,
) -> Fit:
    """Fit by least squares within bounds, from a start that is clamped to them.

    Damped Gauss-Newton steps on the normal equations (Levenberg 1944, Marquardt 1963).
    As simulations cost more than algebra, no step is tried that promises too little to
    continue. Coordinates are those of `Tuned`.

    `residual` maps them (parameters,) to residuals (residuals,), which must include the
    priors of `free`; `jacobian` returns its derivative (residuals, parameters). The fit
    ends when a step takes, or promises, less than the share `tolerance` of the cost, or
    after `evaluations` of the residual.
    """
    low, high = np.array([p.low for p in free]), np.array([p.high for p in free])
    factors = np.array([p.scale if p.factor else 0.0 for p in free])
    x: FloatArray = np.clip(start, low, high)
    error = residual(x)
    # The damping is relative to the diagonal of the normal equations.
    cost, damping, left = 0.5 * float(error @ error), 1e-4, evaluations - 1
    while left > 0:
        slopes = jacobian(x)
        square, slope = slopes.T @ slopes, slopes.T @ error
        shorter, failures = True, 0
        while shorter and left > 0:
            step = bounded_step(square, slope, damping, low - x, high - x)
            # Beyond a factor of 2 derivatives say nothing.
            step /= max(1.0, float(np.max(np.abs(step) * factors)) / math.log(2.0))
            promised = -float(slope @ step + 0.5 * step @ square @ step)
            if promised <= tolerance * cost:
                return Fit(x, cost)
            there = residual(x + step)
            taken = cost - 0.5 * float(there @ there)
            left -= 1
            shorter = taken <= 0.0
            if shorter:
                failures += 1
                # By as much the cost jumps with friction.
                flat = promised <= 4.0 * tolerance * cost
                if flat or failures == 4:
                    return Fit(x, cost)
                damping = max(30.0 * damping, 0.01)
                continue
            damping = max(damping * (10.0 if taken < 0.25 * promised else 0.1), 1e-9)
        if shorter:
            break
        x, error, cost = x + step, there, cost - taken
        if taken < tolerance * cost and taken > 0.25 * promised:
            break
    return Fit(x, cost)


def bounded_step(
    square: FloatArray,
    slope: FloatArray,
    damping: float,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Return the step (parameters,) that minimises a quadratic cost within bounds.

    `square` is J^T J of the Jacobian J, `slope` the gradient of the cost. `damping`
    times its diagonal is added to `square`. The range from `low` to `high` includes 0.
    """
    size = np.sqrt(np.diag(square))
    size[size == 0.0] = 1.0
    scaled = square / np.outer(size, size) + damping * np.eye(size.size)
    step = np.zeros(size.size)
    free = np.ones(size.size, dtype=bool)
    for _ in range(size.size + 1):
        # Parameters at a bound stay there; the others are solved for.
        rest = -(slope / size + scaled @ (step * size * ~free))[free]
        step[free] = np.linalg.lstsq(scaled[np.ix_(free, free)], rest, 1e-12)[0]
        step[free] /= size[free]
        beyond = (step < low) | (step > high)
        if not np.any(beyond & free):
            break
        free &= ~beyond
        step = np.clip(step, low, high)
    return step


def differences(
    function: Callable[[FloatArray], Sequence[FloatArray]],
    x: FloatArray,
    steps: Mapping[int, float],
    here: Sequence[FloatArray] = (),
) -> dict[int, list[FloatArray]]:
    """Return the derivatives of arrays by each parameter, keyed by its index.

    `function` returns arrays at coordinates (parameters,), and runs in several threads.
    `steps` has the change of each parameter, by index. Differences are central, or
    one-sided if `here` has the arrays at `x`.
    """

    def column(index: int) -> list[FloatArray]:
        step = steps[index]
        moved = x.copy()
        moved[index] += step
        there = function(moved)
        if here:
            return [(a - b) / step for a, b in zip(there, here, strict=True)]
        moved[index] = x[index] - step
        back = function(moved)
        return [(a - b) / (2.0 * step) for a, b in zip(there, back, strict=True)]

    return dict(zip(steps, in_threads(column, list(steps)), strict=True))


def in_threads(
    function: Callable[[_Item], _Found], items: Sequence[_Item]
) -> list[_Found]:
    """Return `function` of every item, in order, from a pool of threads.

    Compiled code runs in parallel, as it releases Python's lock. A nested call stays in
    its thread.
    """
    if len(items) < 2 or THREADS < 2 or getattr(_THREAD_STATE, "inside", False):
        return [function(item) for item in items]
    return list(_thread_pool().map(function, items))


def single_threaded_blas() -> AbstractContextManager[Any]:
    """Return a context in which BLAS uses one thread in the whole process.

    The products here are long and narrow. BLAS's own threads would not speed them up,
    and would occupy the cores of `in_threads` while they wait.
    """
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[Any] = threadpool_limits(1, user_api="blas")
    return limits


_THREAD_STATE = threading.local()


@cache
def _thread_pool() -> ThreadPoolExecutor:
    mark = partial(setattr, _THREAD_STATE, "inside", True)
    return ThreadPoolExecutor(THREADS, initializer=mark)


def covariance(
    jacobian: FloatArray, residuals: Sequence[FloatArray] = ()
) -> FloatArray:
    """Return the covariance of fitted parameters (parameters, parameters).

    `jacobian` (residuals, parameters) is that of residuals over their noise. Directions
    without effect get a large finite variance. `residuals`, one array per signal, are
    allowed for as correlated in time: sandwich covariance with Bartlett weights (Newey
    and West 1987). Without them residuals are taken as independent, of variance 1.
    """
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    values = np.maximum(values, 1e-12 * max(float(values[-1]), 1e-100))
    bread = vectors / values
    if not residuals:
        return np.asarray(bread @ vectors.T)
    # In the eigenvectors: a direction without effect must not spoil the others.
    scores = jacobian @ vectors
    meat = np.zeros_like(vectors)
    first = 0
    for residual in residuals:
        score = scores[first : first + residual.size] * residual[:, None]
        meat += _long_run_covariance(score, _correlation_lags(residual))
        first += residual.size
    # White noise of the stated size is the least that there can be.
    excess, axes = np.linalg.eigh(meat - np.diag(values))
    meat = np.diag(values) + (axes * np.maximum(excess, 0.0)) @ axes.T
    return np.asarray(bread @ meat @ bread.T)


def _long_run_covariance(score: FloatArray, lags: int) -> FloatArray:
    """Return the covariance of the sum of rows, with Bartlett weights up to `lags`."""
    total: FloatArray = score.T @ score
    for lag in range(1, lags + 1):
        cross = score[lag:].T @ score[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return total


def _correlation_lags(residual: FloatArray) -> int:
    """Return twice the lag at which a residual's autocorrelation falls to 0.1."""
    correlation = autocorrelation(residual - np.mean(residual))
    crossing = int(np.argmax(correlation <= 0.1 * max(correlation[0], 1e-300)))
    return min(2 * crossing, residual.size // 4)


def autocorrelation(values: FloatArray) -> FloatArray:
    """Return the sum of products of samples, for each lag between them (samples,)."""
    power = np.abs(np.fft.rfft(values, 1 << (2 * values.size).bit_length())) ** 2
    return np.asarray(np.fft.irfft(power)[: values.size], dtype=np.float64)


def estimate(
    parameter: Tuned, place: float, deviation: float, freedom: float = math.inf
) -> Estimate:
    """Return value and 95 % interval of a parameter.

    The fit ended at the coordinate `place`, with standard deviation `deviation` and
    `freedom` degrees of freedom; the interval is that of Student's t.
    """
    from scipy.special import stdtrit

    # Largest half width of an interval of a logarithm: beyond, numbers overflow.
    most = 50.0 / parameter.scale if parameter.factor else math.inf
    wide = float(stdtrit(min(freedom, MAX_FREEDOM), 0.975))
    reach = min(wide * deviation, most)
    low, high = sorted(parameter.value(place + side) for side in (-reach, reach))
    return Estimate(parameter.value(place), parameter.unit, (low, high))


def undetermined_directions(covariance: FloatArray, limit: float) -> FloatArray:
    """Return the parameter combinations whose standard deviation reaches `limit`.

    Rows (combinations, parameters) have unit length, the least certain comes first.
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors.T[::-1][values[::-1] >= limit**2])
