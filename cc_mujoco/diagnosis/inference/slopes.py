"""Derivatives of simulated torques by parameters, taken once per neighbourhood.

Friction makes simulations piecewise smooth: derivatives are differences over steps that
are large enough to cross the pieces, and hardly change over a few percent of a
parameter. So fits that pass the same neighbourhood, like those of the folds of one
model, share them. What a torque sensor's offset or lateness does needs no simulation.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.plant import LATE, OFFSETS, Tuned, shifted

if TYPE_CHECKING:
    from cc_mujoco.diagnosis.inference.fitting import Problem

THREADS = max(1, min(os.cpu_count() or 1, 8))
WILD = 3.0
"""Errors beyond this many deviations of noise count less than their squares."""
_STEPS = {"clock_offset": 0.05, "joint_angle_offset": 0.02, "pretension": 0.03}
_FACTOR_STEP, _STEP = 3e-3, 0.05
_NEAR_FACTOR, _NEAR = 0.05, 0.3
"""Change of a parameter over which derivatives hold: of its logarithm, in scales."""


class Slopes:
    """Derivatives of a problem's torques, kept where they were taken."""

    def __init__(self, problem: Problem) -> None:
        """Start without any."""
        self._problem = problem
        self._taken: list[tuple[FloatArray, list[FloatArray]]] = []
        self._last: tuple[bytes, list[FloatArray]] = (b"", [])
        self._reach = np.array([_reach(p) for p in problem.tuned])

    def errors(self, at: FloatArray) -> list[FloatArray]:
        """Simulated less measured over the floor; the last ones are kept."""
        key = at.tobytes()
        if self._last[0] != key:
            self._last = (key, self._problem.plainly(at))
        return self._last[1]

    def jacobian(
        self, at: FloatArray, masks: Sequence[NDArray[np.bool_]]
    ) -> FloatArray:
        """Derivative of `Problem.residual` (residuals, parameters)."""
        problem = self._problem
        parts = []
        for slope, error, floor, mask in zip(
            self._near(at), self.errors(at), problem.floor, masks, strict=True
        ):
            size = np.abs(error)
            root = np.sqrt(np.maximum(2.0 * WILD * size - WILD**2, WILD**2))
            steep = problem.weight * np.where(size <= WILD, 1.0, WILD / root) / floor
            parts.append((slope * steep)[:, :, mask].reshape(at.size, -1))
        priors = np.diag([1.0 / p.prior for p in problem.tuned])
        priors = priors[:, [np.isfinite(p.prior) for p in problem.tuned]]
        return np.concatenate([*parts, priors], axis=1).T

    def _near(self, at: FloatArray) -> list[FloatArray]:
        for place, slopes in self._taken:
            if np.all(np.abs(at - place) <= self._reach):
                return slopes
        self._taken.append((at.copy(), self._take(at)))
        return self._taken[-1][1]

    def _take(self, at: FloatArray) -> list[FloatArray]:
        """(parameters, 2, samples) of every record."""
        problem = self._problem
        here = [
            error * floor + record.measured
            for error, floor, record in zip(
                self.errors(at), problem.floor, problem.plant.records, strict=True
            )
        ]

        def column(index: int) -> list[FloatArray]:
            parameter = problem.tuned[index]
            step = _STEPS.get(
                parameter.name, _FACTOR_STEP if parameter.factor else _STEP
            )
            if at[index] + step > parameter.high:
                step = -step
            if parameter.name in OFFSETS or parameter.name in LATE:
                return [
                    _shown(torque, parameter, step, record.dt) / step
                    for torque, record in zip(here, problem.plant.records, strict=True)
                ]
            moved = at.copy()
            moved[index] += step
            there = problem.plant.simulate(problem.values(moved), problem.effects)
            return [(a - b) / step for a, b in zip(there, here, strict=True)]

        with ThreadPoolExecutor(THREADS) as pool:
            columns = list(pool.map(column, range(at.size)))
        return [np.array(record) for record in zip(*columns, strict=True)]


def _reach(parameter: Tuned) -> float:
    """Change over which the derivatives hold."""
    if parameter.name in OFFSETS or parameter.name in LATE:
        return np.inf
    return min(_NEAR_FACTOR / parameter.scale, 3.0) if parameter.factor else _NEAR


def _shown(torque: FloatArray, parameter: Tuned, step: float, dt: float) -> FloatArray:
    """Change of torques (2, samples) by a step of what only their sensors have."""
    change = np.zeros_like(torque)
    if parameter.name in OFFSETS:
        change[OFFSETS.index(parameter.name)] = parameter.scale * step
    else:
        row = LATE.index(parameter.name)
        late = parameter.scale * step / dt
        change[row] = shifted(torque[row], -late) - torque[row]
    return change
