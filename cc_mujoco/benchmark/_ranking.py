"""Significance of differences between controllers: Student's t, paired by seed.

    errors = normalise_errors(rms)       # controller -> (conditions, seeds)
    for place in rank_controllers(errors): print(place.name, place.first, place.last)

Conditions are fixed. Seeds are drawn anew for each set of plants that conditions share,
and all controllers meet the same. With two or three seeds intervals are wide.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

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


def mean_interval(
    errors: Array, plants: Sequence[str] = (), tests: int = 1
) -> Difference:
    """Return the mean of errors, or of differences, with its 95 % interval.

    Errors are (conditions, seeds). Conditions with equal entries of `plants` share
    them; by default each has its own. The interval is widened for `tests` comparisons
    (Bonferroni), and has as many degrees of freedom as one set of plants.
    """
    conditions, seeds = errors.shape
    mean = float(np.mean(errors))
    if seeds < 2:
        return Difference(mean, math.nan, math.nan)
    names, variance = np.array(plants or range(conditions)), 0.0
    for own in dict.fromkeys(names.tolist()):
        over = errors[names == own].sum(axis=0) / conditions
        variance += float(np.var(over, ddof=1)) / seeds
    quantile = float(stdtrit(seeds - 1, 1.0 - 0.5 * (1.0 - 0.95) / tests))
    half = quantile * math.sqrt(variance)
    return Difference(mean, mean - half, mean + half)


def rank_controllers(
    errors: Mapping[str, Array], plants: Sequence[str] = ()
) -> list[Place]:
    """Return the places of all controllers, the lowest mean error first.

    One controller is better than another if the interval of their difference, corrected
    for the number of pairs, excludes 0. For the arguments see `mean_interval`.
    """
    pairs = list(combinations(errors, 2))
    better: dict[str, list[str]] = {name: [] for name in errors}
    for a, b in pairs:
        found = mean_interval(errors[a] - errors[b], plants, len(pairs))
        if found.real:
            winner, loser = (a, b) if found.mean < 0.0 else (b, a)
            better[winner].append(loser)
    places = []
    for name in sorted(errors, key=lambda n: float(np.mean(errors[n]))):
        mean, low, high = mean_interval(errors[name], plants)
        low = max(low, 0.0)  # no error is negative, whatever few seeds say
        first = 1 + sum(name in losers for losers in better.values())
        last, worse = len(errors) - len(better[name]), tuple(better[name])
        places.append(Place(name, mean, low, high, first, last, worse))
    return places
