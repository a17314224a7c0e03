"""Share of the gap that is closed on trials the parameters have not seen.

Errors are weighted by how well the angles tell the torque at that moment: where an end
of the cable sticks, the last digit of its angle is worth newtons, and a handful of such
samples would decide over all others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cc_mujoco.diagnosis._fit.baseline import BaselineFit
from cc_mujoco.diagnosis._fit.fitting import Problem, fit
from cc_mujoco.diagnosis._fit.folds import (
    BOOTSTRAP_BLOCK,
    Fold,
    interleaved_folds,
    never_held_out,
    trial_folds,
)
from cc_mujoco.diagnosis._report_data import TrialTrace
from cc_mujoco.diagnosis._verdict import Gap
from cc_mujoco.native import FloatArray

GAP_BOOTSTRAP_DRAWS = 400
MIN_DRAW_SHARE = 0.95
"""Share of draws with a gap to close from which on its closing has an interval."""


def predicted(
    problem: Problem, start: FloatArray, division: Sequence[Fold]
) -> tuple[FloatArray, ...]:
    """Return torques of every record predicted from other samples (2, samples).

    Samples that no fold holds out are predicted by the last fit.
    """
    records = problem.plant.records
    found = [np.zeros(record.measured.shape) for record in records]
    for fold in division:
        x = fit(problem, start, fold.train, 6).x
        played = problem.plant.simulate(problem.values(x), problem.effects)
        for kept, torque, train in zip(found, played, fold.train, strict=True):
            kept[:, ~train] = torque[:, ~train]
            empty = np.all(kept == 0.0, axis=0)
            kept[:, empty] = torque[:, empty]
    return tuple(found)


def gaps(
    problem: Problem,
    before: Sequence[FloatArray],
    after: Sequence[FloatArray],
    division: Sequence[Fold],
    seed: int = 0,
) -> dict[str, Gap]:
    """Return the gap of each channel on the samples that are held out."""
    records = problem.plant.records
    masks = [np.zeros(r.counts.size, dtype=bool) for r in records]
    for fold in division:
        for mask, test in zip(masks, fold.test, strict=True):
            mask |= test
    found = {}
    random = np.random.default_rng(seed)
    for row, channel in enumerate(problem.plant.instruments.channels):
        squares = []
        for record, mask, old, new, noise, floor in zip(
            records, masks, before, after, problem.noise, problem.floor, strict=True
        ):
            size = max(2, round(BOOTSTRAP_BLOCK / record.dt))
            columns = (
                np.array(
                    [
                        (record.measured[row] - old[row]) ** 2,
                        (record.measured[row] - new[row]) ** 2,
                        noise[row] ** 2,
                        np.ones(mask.size),
                    ]
                )
                * mask
                / floor[row] ** 2
            )
            for first in range(0, mask.size, size):
                if np.any(mask[first : first + size]):
                    squares.append(columns[:, first : first + size].sum(axis=1))
        found[channel] = _gap_of_sums(np.array(squares), random)
    return found


def _gap_of_sums(squares: FloatArray, random: np.random.Generator) -> Gap:
    """Compute a gap from block sums (blocks, 4): before, after, floor, weights."""
    draws = random.integers(0, len(squares), (GAP_BOOTSTRAP_DRAWS, len(squares)))
    shares = [_closed_share(*squares[draw, :3].sum(axis=0)) for draw in draws]
    old, new, floor, weights = squares.sum(axis=0)
    low = high = math.nan
    if np.mean(np.isfinite(shares)) > MIN_DRAW_SHARE:
        low, high = np.nanquantile(shares, [0.025, 0.975]).tolist()
    return Gap(
        float(np.sqrt(old / weights)),
        float(np.sqrt(new / weights)),
        float(np.sqrt(floor / weights)),
        _closed_share(old, new, floor),
        (low, high),
    )


def _closed_share(old: float, new: float, floor: float) -> float:
    """Return the closed share of the gap of squared RMS errors, NaN without one."""
    if old <= 1.02 * floor:
        return math.nan
    before, after, least = (math.sqrt(square) for square in (old, new, floor))
    return 1.0 - (after - least) / (before - least)


def overall_share(found: Mapping[str, Gap]) -> float:
    """Return the closed share of the gap of all channels, NaN without a gap."""
    before, after = floor_ratios(found)
    return _closed_share(before**2, after**2, 1.0)


def floor_ratios(found: Mapping[str, Gap]) -> tuple[float, float]:
    """Compute the RMS error of all channels over the noise floor, before and after."""
    if not found:
        return math.nan, math.nan
    before = [(gap.rmse_before / gap.noise_floor) ** 2 for gap in found.values()]
    after = [(gap.rmse_after / gap.noise_floor) ** 2 for gap in found.values()]
    return math.sqrt(np.mean(before)), math.sqrt(np.mean(after))


def traces(
    problem: Problem, before: Sequence[FloatArray], after: Sequence[FloatArray]
) -> tuple[TrialTrace, ...]:
    """Return the series that the report draws."""
    channels = problem.plant.instruments.channels
    return tuple(
        TrialTrace(
            record.trial,
            record.time,
            record.motor_angle,
            record.joint_angle,
            dict(zip(channels, record.measured, strict=True)),
            dict(zip(channels, old, strict=True)),
            dict(zip(channels, new, strict=True)),
            record.counts.astype(float),
        )
        for record, old, new in zip(problem.plant.records, before, after, strict=True)
    )


class Held(NamedTuple):
    """Torques (2, samples) of every record without and with the added effects.

    Those that are held out, predicted by the others; the gap of them; and the trials
    that were never held out.
    """

    before: tuple[FloatArray, ...]
    after: tuple[FloatArray, ...]
    gap: dict[str, Gap]
    never: tuple[str, ...] = ()


class Holdout:
    """Cache of held-out predictions, those of the baseline computed once."""

    def __init__(self, baseline_fit: BaselineFit, seed: int) -> None:
        problem = baseline_fit.problem
        records = problem.plant.records
        self._problem, self._x, self._seed = problem, baseline_fit.whole.x, seed
        # Whole trials. An effect that a single trial shows, say the only one at low
        # pretension, is not to be had from the others: then it is stretches of all.
        self._divisions = trial_folds(records), interleaved_folds(records)
        self._before: dict[int, tuple[FloatArray, ...]] = {}

    def out(self, problem: Problem, x: FloatArray) -> Held | None:
        """Predict the held-out data; None if they do not support the effects."""
        for place, division in enumerate(self._divisions):
            if place not in self._before:
                self._before[place] = predicted(self._problem, self._x, division)
            before = self._before[place]
            after = predicted(problem, x, division) if problem.effects else before
            gap = gaps(self._problem, before, after, division, self._seed)
            better = sum(
                (g.rmse_before**2 - g.rmse_after**2) / g.noise_floor**2
                for g in gap.values()
            )
            if not problem.effects or better >= 0.0:
                records = problem.plant.records
                return Held(before, after, gap, never_held_out(division, records))
        return None
