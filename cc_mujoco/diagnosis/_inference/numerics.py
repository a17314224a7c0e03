"""Check that a simulation is fine enough for its comparison, and a finer one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cc_mujoco._utils.compilation import FloatArray
from cc_mujoco.diagnosis._inference.bench_simulation import SimulatedRig
from cc_mujoco.diagnosis._inference.fitting import Problem, huber_residual
from cc_mujoco.diagnosis._inference.jacobian import TorqueDerivatives

MAX_NUMERICAL_ERROR = 0.35
"""RMS change by a finer simulation, over the noise floor, that is harmless."""
MAX_CABLE_SEGMENTS = 64
"""Most segments per cable."""
MAX_SUBSTEPS = 8
"""Most simulation steps per sample."""


def refine_simulation(problem: Problem, x: FloatArray) -> Problem | None:
    """Return the same problem simulated more finely; None where that changes nothing.

    Or where it is as fine as it gets.
    """
    change, finer = refinement_change(problem, x)
    if change <= MAX_NUMERICAL_ERROR or finer is None:
        return None
    return replace(problem, plant=finer, slopes=TorqueDerivatives())


def refinement_change(
    problem: Problem, x: FloatArray
) -> tuple[float, SimulatedRig | None]:
    """Return the RMS change over the floor by a finer plant, and that plant.

    Segments or steps are halved, whichever changes more; the parameters stay, and
    errors are by Huber as in fits. The plant is None where neither may be halved.
    """
    plant = problem.plant
    values = problem.values(x)
    here = plant.simulate(values, problem.effects)
    tried = []
    for finer in (plant.finer(segments=2), plant.finer(substeps=2)):
        there = finer.simulate(values, problem.effects)
        changes = [
            huber_residual((a - b) / floor)[:, record.counts].ravel()
            for a, b, floor, record in zip(
                here, there, problem.floor, plant.records, strict=True
            )
        ]
        change = float(np.sqrt(np.mean(np.concatenate(changes) ** 2)))
        fine = finer.segments > MAX_CABLE_SEGMENTS or finer.substeps > MAX_SUBSTEPS
        tried.append((change, None if fine else finer))
    return max(tried, key=lambda each: each[0])
