"""Three naive ways to name a missing effect: in bins, sparse, by refits.

Samples of all records that count stand side by side, each over its noise floor.
Residual and features are weighted like the errors of every fit, so that the naive ways
differ from the diagnosis in how they name and in nothing else.

`binned`: the mean of every bin of the residual over a feature takes out what does not
depend on the feature, as the eye does in a plot of friction error over speed; the
effect whose formula runs through the means best is named.

`sparse` (SINDy discrepancy model, with pysindy; Kaheman, Kaiser, Strom, Kutz, Brunton,
arXiv 1909.08574): all looks of all effects stand side by side as columns of one table
for each channel; sequentially thresholded least squares drops the small ones. The
effect with the largest part of what is left over is named.

`bic` (Schwarz, Annals of Statistics 6, 1978): full refits of the likeliest effects to
all data. BIC = n ln(S/n) + k ln n with the sum of squares S of n samples and k
parameters, as if neighbouring samples were independent and the model exact.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.features import FAMILIES, Signal, Term, looks
from baselines.signals import Signals, signals
from cc_mujoco.diagnosis import (
    EFFECTS,
    BaselineFit,
    Problem,
    fit,
    huber_residual,
    low_pass,
    screen,
)
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class Guess(NamedTuple):
    """The name that a naive way gives to what is missing."""

    named: str | None  # id of the effect, or None where it finds nothing missing
    ranking: tuple[str, ...]  # ids, the likeliest first; named or not
    # of the squared residual that is explained, by the first of the ranking or, where a
    # model has several effects, by that model
    share: float


def gathered(
    records: Sequence[Signals], of: Callable[[Signals], FloatArray]
) -> FloatArray:
    """Return a signal where samples count, one record after the other (samples,)."""
    return np.concatenate([of(s)[s.counts] for s in records])


def weights(records: Sequence[Signals], channel: int) -> FloatArray:
    """Return one over the noise floor of a channel (samples,) [1/N m]."""
    return 1.0 / gathered(records, lambda s: s.floor[channel])


def errors(records: Sequence[Signals], channel: int) -> FloatArray:
    """Return a channel's residual over its floor, without offset (samples,)."""
    residual = gathered(records, lambda s: s.residual[channel] / s.floor[channel])
    return _levelled(huber_residual(residual), weights(records, channel))


def column(records: Sequence[Signals], of: Signal, channel: int) -> FloatArray:
    """Return a feature over the floor, low-passed like torques, levelled (samples,)."""

    def passed(s: Signals) -> FloatArray:
        signal = low_pass(of(s, channel), s.band, 1.0 / s.dt)
        return signal / s.floor[channel]

    return _levelled(gathered(records, passed), weights(records, channel))


def _levelled(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Remove the effect of a torque offset, which the baseline has tuned."""
    unit = weight / np.linalg.norm(weight)
    return values - unit * (unit @ values)


BINS = 40  # bins with as many samples each
LEAST = 0.06
"""Share of the squared residual below which nothing is named.

Development rigs without any effect reach half of it.
"""


def binned(baseline_fit: BaselineFit) -> Guess:
    """Return the effect whose formula runs best through the binned residual."""
    return regressed(signals(baseline_fit))


def regressed(records: Sequence[Signals], least: float = LEAST) -> Guess:
    """Return the same from signals."""
    residual = [errors(records, channel) for channel in (0, 1)]
    total = sum(float(error @ error) for error in residual)
    shares = {
        family.id: sum(
            max(
                _taken(records, residual[channel], term, channel)
                for term in family.terms
            )
            for channel in family.channels
        )
        / total
        for family in FAMILIES
    }
    ranking = tuple(sorted(shares, key=lambda name: -shares[name]))
    first = shares[ranking[0]]
    return Guess(ranking[0] if first >= least else None, ranking, first)


def _taken(
    records: Sequence[Signals], residual: FloatArray, term: Term, channel: int
) -> float:
    """Return the reduction of squares by a weighted regression of bin means."""
    bins = in_bins(gathered(records, lambda s: term.over(s, channel)))
    weight = weights(records, channel)
    root = np.sqrt(np.bincount(bins, weight**2))

    def means(values: FloatArray) -> FloatArray:
        """Return the weighted mean of every bin, times the root of its weight."""
        return np.bincount(bins, weight * values) / root

    seen = means(residual)
    columns = [means(column(records, part, channel)) for part in term.columns]
    table = np.column_stack(columns)
    left = seen - table @ np.linalg.lstsq(table, seen, rcond=1e-9)[0]
    return float(seen @ seen - left @ left)


def in_bins(over: FloatArray) -> NDArray[np.intp]:
    """Return the bin of every sample (samples,), none of them empty."""
    edges = np.unique(np.quantile(over, np.arange(1, BINS) / BINS))
    place = np.searchsorted(edges, over, side="right")
    return np.unique(place, return_inverse=True)[1]


THRESHOLD = 0.15
"""Coefficient that is dropped; columns and residual have unit length.

On development rigs without any effect columns are left over at 0.1, none at this.
"""
RIDGE = 0.05  # weight of squared coefficients, pysindy's own default


def sparse(baseline_fit: BaselineFit) -> Guess:
    """Return the effect with the largest part of a sparse model of the residual."""
    return selected(signals(baseline_fit))


def selected(records: Sequence[Signals], threshold: float = THRESHOLD) -> Guess:
    """Return the same from signals."""
    residual = [errors(records, channel) for channel in (0, 1)]
    scale = float(np.sqrt(sum(error @ error for error in residual)))
    parts: dict[str, float] = {}
    left = 0.0
    for channel, error in enumerate(residual):
        names, table = library(records, channel)
        target = error / scale
        found = thresholded(table, target, threshold)
        left += float(np.sum((target - table @ found) ** 2))
        for name in dict.fromkeys(names):
            part = table @ np.where([n == name for n in names], found, 0.0)
            parts[name] = parts.get(name, 0.0) + float(part @ part)
    kept = [name for name, part in parts.items() if part > 0.0]
    ranking = tuple(sorted(kept, key=lambda name: -parts[name]))
    return Guess(ranking[0] if ranking else None, ranking, max(1.0 - left, 0.0))


def library(
    records: Sequence[Signals], channel: int
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names of the columns and columns of unit length (samples, k)."""
    names, columns = [], []
    for name, where, term in looks():
        if where != channel:
            continue
        for part in term.columns:
            signal = column(records, part, channel)
            length = float(np.linalg.norm(signal))
            if length > 0.0:
                names.append(name)
                columns.append(signal / length)
    return tuple(names), np.column_stack(columns)


def thresholded(table: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """Return the coefficients of sequentially thresholded least squares (k,)."""
    from pysindy import STLSQ

    model = STLSQ(threshold=threshold, alpha=RIDGE)
    with warnings.catch_warnings():
        # It warns where nothing is left, which is an answer here.
        warnings.simplefilter("ignore")
        model.fit(table, target)
    return np.asarray(model.coef_, dtype=np.float64).ravel()


EVALUATIONS = 12
"""Simulations with new parameters per refit; screening has found a start."""


REFITTED = 6  # effects that are refitted: those that would explain most to first order


def bic(
    baseline_fit: BaselineFit,
    evaluations: int = EVALUATIONS,
    ids: Sequence[str] = tuple(EFFECTS),
) -> Guess:
    """Return the effect with the lowest BIC, named if that is below the baseline's.

    Args:
        evaluations: most of each refit.
    """
    problem, x = baseline_fit.problem, baseline_fit.whole.x
    counts = [record.counts for record in problem.plant.records]
    before, baseline = _scored(problem, x)
    scores, squares = {}, {}
    for signature in screen(problem, x, counts, ids)[:REFITTED]:
        wider = problem.with_effect(signature.id, signature.start)
        start = wider.placed(x, signature.start)
        try:
            found = fit(wider, start, counts, evaluations)
        except CableError:  # cannot be simulated, so it is no candidate
            continue
        squares[signature.id], scores[signature.id] = _scored(wider, found.x)
    ranking = tuple(sorted(scores, key=lambda name: scores[name]))
    if not ranking:
        return Guess(None, (), 0.0)
    first = ranking[0]
    named = first if scores[first] < baseline else None
    return Guess(named, ranking, 1.0 - squares[first] / before)


def _scored(problem: Problem, x: FloatArray) -> tuple[float, float]:
    """Return the sum of squared errors, and BIC."""
    kept = [
        error[:, record.counts].ravel()
        for error, record in zip(problem.errors(x), problem.plant.records, strict=True)
    ]
    squares = float(sum(part @ part for part in kept))
    count = sum(part.size for part in kept)
    score = count * math.log(squares / count) + x.size * math.log(count)
    return squares, score
