"""Significance of differences between controllers: paired bootstrap over seeds.

    errors = normalise_errors(rms)       # controller -> (conditions, seeds)
    for place in rank_controllers(errors): print(place.name, place.first, place.last)

Conditions are fixed. A resample draws seeds with replacement within each set of plants
that conditions share, the same seeds for all controllers.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from cc_mujoco.benchmark._conditions import SCALE_CONTROLLER
from cc_mujoco.native import FloatArray as Array


class Place(NamedTuple):
    """Mean error of a controller, its 95 % interval (NaN with one seed) and ranks."""

    name: str
    score: float  # mean normalised error
    low: float
    high: float  # upper end of its interval
    first: int
    last: int  # last of its possible ranks, 1 is the best
    better_than: tuple[str, ...]

    def __str__(self) -> str:
        if math.isnan(self.low):
            return f"{self.score:.3f}"
        return f"{self.score:.3f} ({self.low:.3f} to {self.high:.3f})"


class Difference(NamedTuple):
    mean: float
    low: float
    high: float

    @property
    def real(self) -> bool:
        """True if its interval excludes 0."""
        return self.low > 0.0 or self.high < 0.0

    def __str__(self) -> str:
        if math.isnan(self.low):
            return f"{self.mean:+.3f}"
        return f"{self.mean:+.3f} ({self.low:+.3f} to {self.high:+.3f})"


def normalise_errors(rms: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return errors relative to the mean error of `none` in the same condition.

    `rms` has the RMS error by controller and condition, (seeds, axes), NaN where it
    diverged; the result is (conditions, seeds) by controller. The error of a device is
    the mean over its axes, each relative to its own scale.
    """
    unit = {
        name: np.array([np.nanmean(axis) for axis in values.T])
        for name, values in rms[SCALE_CONTROLLER].items()
    }
    found = {}
    for name, own in rms.items():
        rows = np.array([own[condition] / unit[condition] for condition in unit])
        most = 10.0  # error of an episode that diverged, and the largest that counts
        limited = np.minimum(np.where(np.isfinite(rows), rows, most), most)
        found[name] = limited.mean(axis=-1)
    return found


def bootstrap_means(
    errors: Mapping[str, Array], plants: Sequence[str] = (), resamples: int = 10_000
) -> dict[str, Array]:
    """Return bootstrap means of the errors by controller, (resamples,), paired by seed.

    Errors are (conditions, seeds) by controller. Conditions with equal entries of
    `plants` share their plants; by default each has its own.
    """
    conditions, seeds = next(iter(errors.values())).shape
    names = np.array(plants or range(conditions))
    random = np.random.default_rng(0)
    total = {name: np.zeros(resamples) for name in errors}
    for own in dict.fromkeys(names.tolist()):
        chosen = random.integers(seeds, size=(resamples, seeds))
        for name, values in errors.items():
            over = values[names == own].sum(axis=0)
            total[name] += over[chosen].mean(axis=1) / conditions
    # Of n seeds a resample varies less than n new ones would, by (n - 1) / n.
    wider = math.sqrt(seeds / (seeds - 1.0)) if seeds > 1 else math.nan
    return {
        name: float(np.mean(errors[name])) + wider * (means - np.mean(errors[name]))
        for name, means in total.items()
    }


def compare_resamples(
    one: Array, other: Array, mean: float, tests: int = 1
) -> Difference:
    """Return the difference `mean` with its 95 % interval from bootstrap means.

    It is widened for `tests` comparisons (Bonferroni).
    """
    return Difference(mean, *_interval(one - other, tests))


def _interval(values: Array, tests: int = 1) -> tuple[float, float]:
    """Return the 95 % interval of `values`, Bonferroni-corrected for `tests`."""
    tail = 50.0 * (1.0 - 0.95) / tests
    low, high = map(float, np.percentile(values, [tail, 100.0 - tail]))
    return low, high


def rank_controllers(
    errors: Mapping[str, Array], plants: Sequence[str] = ()
) -> list[Place]:
    """Return the places of all controllers, the lowest mean error first.

    One controller is better than another if the interval of their difference, corrected
    for the number of pairs, excludes 0. For the arguments see `bootstrap_means`.
    """
    means = {name: float(np.mean(values)) for name, values in errors.items()}
    draws = bootstrap_means(errors, plants)
    pairs = list(combinations(errors, 2))
    better: dict[str, list[str]] = {name: [] for name in errors}
    for a, b in pairs:
        found = compare_resamples(draws[a], draws[b], means[a] - means[b], len(pairs))
        if found.real:
            winner, loser = (a, b) if found.mean < 0.0 else (b, a)
            better[winner].append(loser)
    places = []
    for name in sorted(errors, key=lambda n: means[n]):
        low, high = _interval(draws[name])
        low = max(low, 0.0)  # no error is negative, whatever few seeds say
        first = 1 + sum(name in losers for losers in better.values())
        last, worse = len(errors) - len(better[name]), tuple(better[name])
        places.append(Place(name, means[name], low, high, first, last, worse))
    return places
