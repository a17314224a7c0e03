"""Derivatives of simulated torques by parameters, taken once per neighbourhood.

They hardly change over a few percent of a parameter. So fits that pass the same
neighbourhood, like those of the folds of one model, share them. What a torque sensor's
offset or lateness does needs no simulation, nor does a record of which no sample is
looked at, say one that is reserved.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.diagnosis.inference.plant import LATE, OFFSETS, shifted
from cc_mujoco.estimation.least_squares import FACTOR_STEP, Tuned, differences

if TYPE_CHECKING:
    from cc_mujoco.diagnosis.inference.fitting import Masks, Problem

HUBER_DELTA = 3.0
"""Errors beyond this many deviations of noise count less than their squares."""
_STEPS = {"clock_offset": 0.05, "joint_angle_offset": 0.02, "pretension": 0.03}
_STEP = 0.05
_NEAR_FACTOR, _NEAR = 0.05, 0.3
"""Change of a parameter over which derivatives hold: of its logarithm, in scales."""


class Jacobian:
    """Derivatives of a problem's torques, kept where they were taken."""

    def __init__(self, problem: Problem) -> None:
        """Start without any."""
        self._problem = problem
        self._taken: list[tuple[FloatArray, dict[int, FloatArray]]] = []
        self._last: tuple[bytes, dict[int, FloatArray]] = (b"", {})
        self._reach = np.array([_reach(p) for p in problem.tuned])

    def errors(self, x: FloatArray, masks: Masks) -> list[FloatArray]:
        """Errors over the floor, see `Problem.plainly`; the last ones are kept.

        They are NaN in records of which no sample is set.
        """
        found = self._errors(x, _seen(masks))
        return [
            found[k] if k in found else np.full(floor.shape, np.nan)
            for k, floor in enumerate(self._problem.floor)
        ]

    def jacobian(self, x: FloatArray, masks: Masks) -> FloatArray:
        """Derivative of `Problem.residual` (residuals, parameters)."""
        problem, seen = self._problem, _seen(masks)
        slopes, errors = self._near(x, seen), self._errors(x, seen)
        parts = []
        for k in seen:
            error = errors[k]
            size = np.abs(error)
            root = np.sqrt(
                np.maximum(2.0 * HUBER_DELTA * size - HUBER_DELTA**2, HUBER_DELTA**2)
            )
            steep = (
                problem.weight
                * np.where(size <= HUBER_DELTA, 1.0, HUBER_DELTA / root)
                / problem.floor[k]
            )
            parts.append((slopes[k] * -steep)[:, :, masks[k]].reshape(x.size, -1))
        priors = np.diag([-1.0 / p.prior for p in problem.tuned])
        priors = priors[:, [np.isfinite(p.prior) for p in problem.tuned]]
        return np.concatenate([*parts, priors], axis=1).T

    def _errors(self, x: FloatArray, seen: Sequence[int]) -> dict[int, FloatArray]:
        """Errors over the floor, by the index of the record, of these at least."""
        key = x.tobytes()
        if self._last[0] != key:
            self._last = (key, {})
        known = self._last[1]
        if new := [k for k in seen if k not in known]:
            known.update(zip(new, self._problem.plainly(x, new), strict=True))
        return known

    def _near(self, x: FloatArray, seen: Sequence[int]) -> dict[int, FloatArray]:
        """Derivatives by the index of the record, of these at least."""
        near = [t for t in self._taken if np.all(np.abs(x - t[0]) <= self._reach)]
        if not near:
            near = [(x.copy(), {})]
            self._taken += near
        place, slopes = near[0]
        if new := [k for k in seen if k not in slopes]:
            slopes.update(zip(new, self._take(place, new), strict=True))
        return slopes

    def _take(self, x: FloatArray, chosen: Sequence[int]) -> list[FloatArray]:
        """(parameters, 2, samples) of these records."""
        problem = self._problem
        records = [problem.plant.records[k] for k in chosen]
        errors = self._errors(x, chosen)
        here = [
            record.measured - errors[k] * problem.floor[k]
            for k, record in zip(chosen, records, strict=True)
        ]
        steps = {
            index: _step(parameter, place)
            for index, (parameter, place) in enumerate(
                zip(problem.tuned, x.tolist(), strict=True)
            )
        }
        columns = differences(
            lambda place: problem.plant.simulate(
                problem.values(place), problem.effects, chosen
            ),
            x,
            {k: step for k, step in steps.items() if not _sensed(problem.tuned[k])},
            here,
        )
        for k in steps.keys() - columns.keys():
            columns[k] = [
                _shown(torque, problem.tuned[k], steps[k], record.dt) / steps[k]
                for torque, record in zip(here, records, strict=True)
            ]
        return [
            np.array(record)
            for record in zip(*(columns[k] for k in steps), strict=True)
        ]


def _seen(masks: Masks) -> list[int]:
    """Indices of the records of which samples are set."""
    return [k for k, mask in enumerate(masks) if mask.any()]


def _sensed(parameter: Tuned) -> bool:
    """Whether only what the torque sensors show depends on a parameter."""
    return parameter.name in OFFSETS or parameter.name in LATE


def _step(parameter: Tuned, place: float) -> float:
    """Change of a parameter over which torques are differenced, within its bounds."""
    step = _STEPS.get(parameter.name, FACTOR_STEP if parameter.factor else _STEP)
    return -step if place + step > parameter.high else step


def _reach(parameter: Tuned) -> float:
    """Change over which the derivatives hold."""
    if _sensed(parameter):
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
