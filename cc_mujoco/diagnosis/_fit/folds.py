"""Held-out data: every sample is predicted by parameters that were fitted to others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.fitting import (
    Masks,
    Problem,
    fit,
    huber_residual,
    plain_error,
)
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.estimation._least_squares import Fit
from cc_mujoco.native import FloatArray

BOOTSTRAP_BLOCK = 1.0
"""Length of a block of the bootstrap [s]."""


class Fold(NamedTuple):
    """One division of the samples: (samples,) of every record."""

    train: tuple[NDArray[np.bool_], ...]
    test: tuple[NDArray[np.bool_], ...]


def divided_samples(division: Sequence[Fold]) -> Masks:
    """Return the samples that a division holds, (samples,) of every record."""
    parts = [part for fold in division for part in fold]
    return tuple(np.any(own, axis=0) for own in zip(*parts, strict=True))


def interleaved_folds(records: Sequence[Record]) -> tuple[Fold, ...]:
    """Return two halves that predict each other, every other stretch of every record.

    Both halves see every trial, so that no result depends on which half holds, say, the
    only trial with slack. Trials that the dataset reserves for tests are left out.
    """
    free = [record.free for record in records]
    odd = [_odd_pieces(counts) for counts in free]
    one = tuple(counts & ~half for counts, half in zip(free, odd, strict=True))
    other = tuple(counts & half for counts, half in zip(free, odd, strict=True))
    return (Fold(one, other), Fold(other, one))


def _odd_pieces(counts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the second, fourth, ... piece of the samples that count."""
    place = np.cumsum(counts) / max(int(np.sum(counts)), 1)
    odd: NDArray[np.bool_] = (place * Limit.record_pieces * (1.0 - 1e-9)).astype(
        int
    ) % 2 == 1
    return odd


def trial_folds(records: Sequence[Record]) -> tuple[Fold, ...]:
    """Return folds of whole trials: the reserved ones, or a third in turn.

    Trials that repeat each other stay together. Trials of a kind (see `trial_kinds`)
    are spread over the folds, and one that is the only one of its kind is in every
    training part: the others cannot predict it, nor fix what it alone determines. Fewer
    trials than parts: `interleaved_folds`.
    """
    if any(record.split == "test" for record in records):
        return (
            Fold(
                tuple(record.free for record in records),
                tuple(record.reserved for record in records),
            ),
        )
    kinds = trial_kinds(records)
    if len(kinds) < Limit.trial_folds:
        return interleaved_folds(records)
    known = list(kinds.values())
    shared = [group for group in kinds if known.count(kinds[group]) > 1]
    groups = sorted(shared or kinds)
    groups.sort(key=lambda group: known.index(kinds[group]))
    found = []
    parts = min(Limit.trial_folds, len(groups))
    for part in range(parts):
        out = set(groups[part::parts])
        found.append(
            Fold(
                tuple(r.counts & (r.group not in out) for r in records),
                tuple(r.counts & (r.group in out) for r in records),
            )
        )
    return tuple(found)


def trial_kinds(records: Sequence[Record]) -> dict[str, tuple[object, ...]]:
    """Return the kind of every group of repeated trials.

    A kind is the held side, pretension (in steps of 20 %), tilt, known weights,
    exchanged sensors, load cell and occasion.
    """
    used = [record for record in records if record.counts.any()]
    angles = [(record.motor_angle, record.joint_angle) for record in used]
    spans = np.array([[np.ptp(angle) for angle in pair] for pair in angles])
    moved = spans > Limit.held_share * spans.max(axis=0, initial=0.0)
    kinds: dict[str, tuple[object, ...]] = {}
    for record, (motor, joint) in zip(used, moved.tolist(), strict=True):
        tension = record.pretension
        kinds.setdefault(
            record.group,
            (
                motor,
                joint,
                round(math.log(tension) / 0.2) if tension else tension,
                round(record.tilt, 1),
                record.known_torques,
                record.swapped,
                record.load_cell,
                record.occasion,
            ),
        )
    return kinds


def never_held_out(
    division: Sequence[Fold], records: Sequence[Record]
) -> tuple[str, ...]:
    """Return the trials that are in every training part, none if some are reserved."""
    if any(record.split == "test" for record in records):
        return ()
    held = {
        record.trial
        for fold in division
        for record, test in zip(records, fold.test, strict=True)
        if test.any()
    }
    used = (record.trial for record in records if record.counts.any())
    return tuple(name for name in dict.fromkeys(used) if name not in held)


class CrossValidation(NamedTuple):
    """One model fitted fold by fold.

    Attributes:
        problem: the model.
        fits: one per fold.
        errors: (2, samples) of every record, over the floor and by Huber as in
            `fitting`: of the fit that has not seen the sample, NaN where no fit was
            held out.
    """

    problem: Problem
    fits: tuple[Fit, ...]
    errors: tuple[FloatArray, ...]

    @property
    def held_out_mse(self) -> float:
        kept = [e[:, np.isfinite(e[0])] for e in self.errors]
        return float(np.mean(np.concatenate([k.ravel() for k in kept]) ** 2))

    @property
    def noise_mse(self) -> float:
        """Mean squared error if there was noise of the sensors only."""
        kept = [
            (noise / floor)[:, np.isfinite(error[0])].ravel()
            for noise, floor, error in zip(
                self.problem.sensed, self.problem.floor, self.errors, strict=True
            )
        ]
        return float(np.mean(np.concatenate(kept) ** 2))

    @property
    def misfit(self) -> float:
        """RMS held-out error over that of noise alone."""
        return self.misfit_by(self.problem.inflation)

    def misfit_by(self, inflation: float) -> float:
        """Compute the misfit with errors by Huber over a floor of another inflation.

        Misfits are compared by one; see `Problem.with_updated_floor`.
        """
        ratio = self.problem.inflation / inflation
        if ratio == 1.0:
            return math.sqrt(self.held_out_mse / self.noise_mse)
        kept = [
            huber_residual(ratio * plain_error(e[:, np.isfinite(e[0])])).ravel()
            for e in self.errors
        ]
        mean = float(np.mean(np.concatenate(kept) ** 2))
        return math.sqrt(mean / self.noise_mse) / ratio


def cross_validate(
    problem: Problem,
    division: Sequence[Fold],
    starts: Sequence[FloatArray],
) -> CrossValidation:
    """Fit a model on every fold and predict the held-out data."""
    fits: list[Fit] = []
    errors = [np.full(r.measured.shape, np.nan) for r in problem.plant.records]
    for fold, start in zip(division, starts, strict=True):
        if fits:  # what one fold has learnt
            start = start + fits[0].x - starts[0]
        found = fit(problem, start, fold.train)
        fits.append(found)
        for kept, error, mask in zip(
            errors, problem.errors(found.x, fold.test), fold.test, strict=True
        ):
            kept[:, mask] = error[:, mask]
    return CrossValidation(problem, tuple(fits), tuple(errors))


def blocks(crossed: CrossValidation) -> FloatArray:
    """Return sums of squared held-out errors in blocks of a second (blocks, 2)."""
    return _block_sums(crossed, crossed.errors)


def _block_sums(crossed: CrossValidation, parts: Sequence[FloatArray]) -> FloatArray:
    """Sum the squares of any (2, samples) per record where errors were held out."""
    found = []
    for record, error, part in zip(
        crossed.problem.plant.records, crossed.errors, parts, strict=True
    ):
        size = max(2, round(BOOTSTRAP_BLOCK / record.dt))
        kept = np.isfinite(error[0])
        squares = np.where(kept, part, 0.0) ** 2
        for first in range(0, kept.size, size):
            if np.any(kept[first : first + size]):
                found.append(np.sum(squares[:, first : first + size], axis=1))
    return np.array(found)


def excess(crossed: CrossValidation) -> float:
    """Return the excess of held-out errors over noise, in standard errors.

    The standard error is that of blocks: a few bad moments, say one stick that broke at
    another time, do not make a model wrong.
    """
    problem = crossed.problem
    noise = [n / f for n, f in zip(problem.sensed, problem.floor, strict=True)]
    beyond = (blocks(crossed) - _block_sums(crossed, noise)).sum(axis=1)
    return float(beyond.sum() / max(block_sum_deviation(beyond), 1e-300))


def block_sum_deviation(values: FloatArray) -> float:
    """Return the standard deviation of the sum of independent blocks (blocks,)."""
    return float(np.std(values)) * math.sqrt(values.size)
