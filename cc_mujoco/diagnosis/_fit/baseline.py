"""Fit of the baseline, and its error on held-out data.

The baseline holds all that is uncertain of the scene and is fitted before anything is
named, by a simulation that is as fine as the noise floor requires. Held-out errors are
weighted by how well the angles determine the torque at that moment: where an end of the
cable sticks, the last digit of its angle is worth newtons, and a handful of such
samples would outweigh all others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.fitting import (
    Masks,
    Problem,
    TorqueDerivatives,
    fit,
    huber_residual,
    independence_weight,
)
from cc_mujoco.diagnosis._fit.folds import (
    BOOTSTRAP_BLOCK,
    CrossValidation,
    Fold,
    cross_validate,
    interleaved_folds,
    never_held_out,
    trial_folds,
)
from cc_mujoco.diagnosis._fit.noise_floor import noise_floor
from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig, baseline_parameters
from cc_mujoco.diagnosis._rig.records import Filtering, Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis._verdict import Gap, TrialTrace
from cc_mujoco.estimation._least_squares import Fit, Tuned
from cc_mujoco.native import FloatArray


def refine_simulation(problem: Problem, x: FloatArray, masks: Masks) -> Problem | None:
    """Return the problem with a finer simulation; None where that changes nothing.

    Also None where it cannot be finer.
    """
    plant = problem.plant
    if (
        2 * plant.segments > Limit.max_cable_segments
        and 2 * plant.substeps > Limit.max_substeps
    ):
        return None
    change, finer = refinement_change(problem, x, masks)
    parts = zip(problem.errors(x, masks), masks, strict=True)
    kept = np.concatenate([error[:, mask].ravel() for error, mask in parts])
    left = float(np.sqrt(np.mean(kept**2)))
    harmless = max(Limit.max_numerical_error, Limit.max_numerical_share * left)
    if change <= harmless or finer is None:
        return None
    return problem.simulated_by(finer)


def refinement_change(
    problem: Problem, x: FloatArray, masks: Masks
) -> tuple[float, SimulatedRig | None]:
    """Return the RMS change over the floor by a finer plant, and that plant.

    Segments or steps are halved, whichever changes more; the parameters stay, and
    errors are by Huber as in fits. The plant is None where neither may be halved.
    """
    plant = problem.plant
    values = problem.values(x)
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    here = plant.simulate(values, problem.effects, seen)
    tried = []
    for finer in (plant.finer(segments=2), plant.finer(substeps=2)):
        there = finer.simulate(values, problem.effects, seen)
        changes = [
            huber_residual((a - b) / problem.floor[k])[:, masks[k]].ravel()
            for k, a, b in zip(seen, here, there, strict=True)
        ]
        change = float(np.sqrt(np.mean(np.concatenate(changes) ** 2)))
        fine = (
            finer.segments > Limit.max_cable_segments
            or finer.substeps > Limit.max_substeps
        )
        tried.append((change, None if fine else finer))
    return max(tried, key=lambda each: each[0])


@dataclass(frozen=True)
class BaselineFit:
    """The baseline, ready for the search."""

    problem: Problem
    whole: Fit
    crossed: CrossValidation
    change: float
    """RMS change by a finer simulation, over the floor."""
    notes: tuple[str, ...] = ()
    """Sentences on requested effects that the data cannot show."""
    temperatures: Mapping[str, float] = field(default_factory=dict)
    """Mean temperature of trials by name, where it is known [degC]."""


def plant_of(
    dataset: Dataset,
    bench: Bench,
    records: tuple[Record, ...],
    given: Mapping[str, float] | None = None,
) -> SimulatedRig:
    """Return the initial plant.

    `given` has values of the scene that the bench no longer has, see `SimulatedRig`.
    """
    return SimulatedRig(
        bench,
        records,
        Limit.min_segments,
        instruments=dataset.instruments,
        constants=dataset.constants,
        given=given or {},
    )


def fit_baseline(
    dataset: Dataset, plant: SimulatedRig, filtering: Filtering, seed: int
) -> BaselineFit:
    """Fit the baseline, simulated as finely as it needs to be."""
    records = plant.records
    free = baseline_parameters(
        plant.bench, records, dataset.constants, dataset.instruments, plant.given
    )
    counts = [record.free for record in records]
    x = np.zeros(len(free))
    starts, slopes = _start_points(free, x), TorqueDerivatives()
    while True:
        flat = tuple(
            np.full(r.measured.shape, 0.02 * float(np.std(r.measured)) + 1e-9)
            for r in records
        )
        problem = Problem(plant, free, (), flat, flat, 0.2, slopes=slopes)
        tried = [fit(problem, start, counts) for start in starts]
        x = min(tried, key=lambda found: found.cost).x
        floor = noise_floor(dataset, plant, filtering, problem.values(x), seed=seed)
        problem = replace(
            problem, noise=floor.noise, floor=floor.tolerance, scatter=floor.scatter
        )
        problem = problem.with_inflated_noise(x, counts)
        x = fit(problem, x, counts).x
        problem = replace(
            problem, weight=independence_weight(problem.errors(x), counts)
        )
        whole = fit(problem, x, counts)
        change, finer = refinement_change(problem, whole.x, [r.counts for r in records])
        if change <= Limit.max_numerical_error or finer is None:
            break
        plant, starts = finer, [whole.x]
        slopes = TorqueDerivatives(problem.slopes)
    division = interleaved_folds(records)
    crossed = cross_validate(problem, division, [whole.x] * len(division))
    return BaselineFit(problem, whole, crossed, change)


def _start_points(free: Sequence[Tuned], x: FloatArray) -> list[FloatArray]:
    """Return the start points: several pretensions where it is unknown.

    Fits end in different minima, depending on whether the slack side of a pair goes
    slack.
    """
    starts = [x]
    for index, parameter in enumerate(free):
        if (
            parameter.name == "pretension"
            and parameter.scale > Limit.multistart_uncertainty
        ):
            for factor in Limit.multistart_factors:
                start = x.copy()
                start[index] = math.log(factor) / parameter.scale
                starts.append(start)
    return starts


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
    """Return the gap of each channel on the held-out samples."""
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
    draws = random.integers(0, len(squares), (400, len(squares)))
    shares = [_closed_share(*squares[draw, :3].sum(axis=0)) for draw in draws]
    old, new, floor, weights = squares.sum(axis=0)
    low = high = math.nan
    if np.mean(np.isfinite(shares)) > Limit.min_draw_share:
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
    before, after = floor_ratios(found)
    return _closed_share(before**2, after**2, 1.0)


def floor_ratios(found: Mapping[str, Gap]) -> tuple[float, float]:
    if not found:
        return math.nan, math.nan
    before = [(gap.rmse_before / gap.noise_floor) ** 2 for gap in found.values()]
    after = [(gap.rmse_after / gap.noise_floor) ** 2 for gap in found.values()]
    return math.sqrt(np.mean(before)), math.sqrt(np.mean(after))


def traces(
    problem: Problem, before: Sequence[FloatArray], after: Sequence[FloatArray]
) -> tuple[TrialTrace, ...]:
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

    They are held out, predicted by the others; `gap` is of them. The trials of the last
    field were never held out.
    """

    before: tuple[FloatArray, ...]
    after: tuple[FloatArray, ...]
    gap: dict[str, Gap]
    never: tuple[str, ...] = ()


class Holdout:
    """Cache of held-out predictions; those of the baseline are computed once."""

    def __init__(self, baseline_fit: BaselineFit, seed: int) -> None:
        problem = baseline_fit.problem
        records = problem.plant.records
        self._problem, self._x, self._seed = problem, baseline_fit.whole.x, seed
        # Whole trials. If a single trial shows an effect, say the only one at low
        # pretension, the others cannot determine it: then stretches of all trials are
        # held out.
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
