"""The baseline: all that is uncertain of the scene, fitted before anything is named."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._trials import Dataset
from cc_mujoco.diagnosis._fit.fitting import Problem, fit, independence_weight
from cc_mujoco.diagnosis._fit.folds import (
    CrossValidation,
    cross_validate,
    interleaved_folds,
)
from cc_mujoco.diagnosis._fit.jacobian import TorqueDerivatives
from cc_mujoco.diagnosis._fit.noise_floor import noise_floor
from cc_mujoco.diagnosis._fit.numerics import MAX_NUMERICAL_ERROR, refinement_change
from cc_mujoco.diagnosis._rig.bench_simulation import (
    MIN_SEGMENTS,
    SimulatedRig,
    baseline_parameters,
)
from cc_mujoco.diagnosis._rig.records import Filtering, Record
from cc_mujoco.estimation._least_squares import Fit, Tuned
from cc_mujoco.native import FloatArray

MULTISTART_UNCERTAINTY = 0.3
"""Relative uncertainty of a pretension from which more than one start is tried."""

MULTISTART_FACTORS = (0.1, 0.3, 3.0)
"""Such starts, over the value that was given."""


@dataclass(frozen=True)
class BaselineFit:
    """The baseline, ready for the search."""

    problem: Problem
    whole: Fit
    crossed: CrossValidation
    change: float
    """RMS change by a finer simulation, over the floor."""


def plant_of(
    dataset: Dataset,
    bench: Bench,
    records: tuple[Record, ...],
    given: Mapping[str, float] | None = None,
) -> SimulatedRig:
    """Return the plant to begin with.

    Args:
        dataset: of the records.
        bench: to start from.
        records: to explain.
        given: values of the scene that the bench no longer has, see `SimulatedRig`.
    """
    return SimulatedRig(
        bench,
        records,
        MIN_SEGMENTS,
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
        if change <= MAX_NUMERICAL_ERROR or finer is None:
            break
        plant, starts = finer, [whole.x]
        slopes = TorqueDerivatives(problem.slopes)
    division = interleaved_folds(records)
    crossed = cross_validate(problem, division, [whole.x] * len(division))
    return BaselineFit(problem, whole, crossed, change)


def _start_points(free: Sequence[Tuned], x: FloatArray) -> list[FloatArray]:
    """Return the places to fit from: several pretensions where it is anybody's guess.

    Whether the slack side of a pair goes slack makes fits end in one valley or another.
    """
    starts = [x]
    for index, parameter in enumerate(free):
        if parameter.name == "pretension" and parameter.scale > MULTISTART_UNCERTAINTY:
            for factor in MULTISTART_FACTORS:
                start = x.copy()
                start[index] = math.log(factor) / parameter.scale
                starts.append(start)
    return starts
