"""Check that a simulation is fine enough for its comparison, and a finer one."""

from __future__ import annotations

import numpy as np

from cc_mujoco.diagnosis._fit.fitting import Masks, Problem, huber_residual
from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig
from cc_mujoco.native import FloatArray

MAX_NUMERICAL_ERROR = 0.35
"""RMS change by a finer simulation, over the noise floor, that is harmless."""
MAX_NUMERICAL_SHARE = 0.15
"""Harmless change over the RMS error of the model.

Halved steps show half of an error of first order, so at most 9 % of the squared error
is numerical, less than any effect takes.
"""
MAX_CABLE_SEGMENTS = 64
"""Most segments per cable."""
MAX_SUBSTEPS = 8
"""Most simulation steps per sample."""


def refine_simulation(problem: Problem, x: FloatArray, masks: Masks) -> Problem | None:
    """Return the same problem simulated more finely; None where that changes nothing.

    Or where it is as fine as it gets.
    """
    plant = problem.plant
    if 2 * plant.segments > MAX_CABLE_SEGMENTS and 2 * plant.substeps > MAX_SUBSTEPS:
        return None
    change, finer = refinement_change(problem, x, masks)
    parts = zip(problem.errors(x, masks), masks, strict=True)
    kept = np.concatenate([error[:, mask].ravel() for error, mask in parts])
    left = float(np.sqrt(np.mean(kept**2)))
    harmless = max(MAX_NUMERICAL_ERROR, MAX_NUMERICAL_SHARE * left)
    if change <= harmless or finer is None:
        return None
    return problem.simulated_by(finer)


def refinement_change(
    problem: Problem, x: FloatArray, masks: Masks
) -> tuple[float, SimulatedRig | None]:
    """Return the RMS change over the floor by a finer plant, and that plant.

    Segments or steps are halved, whichever changes more; the parameters stay, and
    errors are by Huber as in fits. The plant is None where neither may be halved.
    Arguments as in `refine_simulation`.
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
        fine = finer.segments > MAX_CABLE_SEGMENTS or finer.substeps > MAX_SUBSTEPS
        tried.append((change, None if fine else finer))
    return max(tried, key=lambda each: each[0])
