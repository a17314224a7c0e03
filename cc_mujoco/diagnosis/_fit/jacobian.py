"""Derivatives of simulated torques by parameters: differenced once, then kept true.

They hardly change over a few percent of a parameter, and every simulation elsewhere
says how they did change along the way there (Broyden, Math. Comp. 19, 1965). They are
differences of coarse simulations (`SimulatedRig.coarse`). Fits, folds and stages share
them; a model with an effect more, or a finer one, begins with those it had. What
changes only what is shown of a replay, say an offset, is differenced anew each time: it
needs no simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._rig.occasions import base_name, values_on
from cc_mujoco.diagnosis._rig.records import Record
from cc_mujoco.diagnosis._rig.replays import Setting
from cc_mujoco.estimation._least_squares import FACTOR_STEP, Tuned, differences
from cc_mujoco.native import FloatArray

if TYPE_CHECKING:
    from cc_mujoco.diagnosis._fit.fitting import Masks, Problem

HUBER_DELTA = 3.0
"""Errors beyond this many deviations of noise count less than their squares."""
_PARAMETER_STEPS = {
    "clock_offset": 0.05,
    "joint_angle_offset": 0.02,
    "pretension": 0.03,
}
_DEFAULT_STEP = 0.05
_VALID_LOG_CHANGE, _VALID_CHANGE = 0.05, 0.3
"""Change of a parameter over which derivatives hold: of its logarithm, in scales."""
_MIN_CHANGE = 0.1
"""Least change, over that, along which they can be seen to change."""
_MAX_MISSED_SHARE = 0.3
"""Share of a change's square that they may miss beyond that before they are retaken."""


@dataclass
class _Tangent:
    """Derivatives of the torques of one record.

    Attributes:
        taken: place where they were differenced.
        place: where they were last compared with a simulation.
        torque: (2, samples) there [N m].
        slopes: (parameters, 2, samples) [N m].
    """

    taken: FloatArray
    place: FloatArray
    torque: FloatArray
    slopes: FloatArray

    def follow(self, x: FloatArray, torque: FloatArray, reach: FloatArray) -> bool:
        """Update from a simulation elsewhere; return False if no longer valid.

        Args:
            x: place of the parameters.
            torque: (2, samples) there [N m].
            reach: (parameters,) change over which derivatives hold.
        """
        moved = (x - self.place) / reach
        if np.max(np.abs(moved)) < _MIN_CHANGE:
            return True
        change = torque - self.torque
        missed = change - np.tensordot(x - self.place, self.slopes, 1)
        far = np.max(np.abs(x - self.taken) / reach) > 1.0
        if far and np.sum(missed**2) > _MAX_MISSED_SHARE * np.sum(change**2):
            return False
        along = moved / reach / (moved @ moved)
        self.slopes += along[:, None, None] * missed
        self.place, self.torque = x.copy(), torque
        return True


class TorqueDerivatives:
    """Derivatives of a model's torques, by record."""

    def __init__(self, narrower: TorqueDerivatives | None = None) -> None:
        """Start without slopes, or from those of the model without one effect."""
        self._narrower_slopes = narrower
        self._kept: dict[Record, _Tangent] = {}
        self._inner: list[bool] = []

    def of(
        self,
        problem: Problem,
        x: FloatArray,
        seen: Sequence[int],
        torques: Sequence[FloatArray],
    ) -> list[FloatArray]:
        """Return the slopes of these records (parameters, 2, samples) [N m].

        Args:
            problem: the model.
            x: place of the parameters.
            seen: indices of the records.
            torques: (2, samples) of these there [N m].
        """
        steps = [_step(p, place) for p, place in zip(problem.tuned, x, strict=True)]
        inner = self._inner = self._inner or _need_replays(problem, x, steps)
        records = [problem.plant.records[k] for k in seen]

        def take(first: int, places: Sequence[int], again: bool) -> None:
            """Difference from a parameter on, what needs a replay or all else."""
            wanted = {k: steps[k] for k in range(first, x.size) if inner[k] is again}
            if not wanted:
                return
            used = problem.coarse if again else problem
            chosen = [seen[p] for p in places]
            here = (
                [torques[p] for p in places]
                if used is problem
                else used.torques(x, chosen)
            )
            columns = differences(
                lambda there: used.torques(there, chosen), x, wanted, here
            )
            for k, column in columns.items():
                for p, slope in zip(places, column, strict=True):
                    self._kept[records[p]].slopes[k] = slope

        new: dict[int, list[int]] = {}
        for p, (record, torque) in enumerate(zip(records, torques, strict=True)):
            if record not in self._kept:
                known = self._begin(record, x, torque)
                new.setdefault(known, []).append(p)
        take(0, range(len(seen)), False)
        for known, places in new.items():
            take(known, places, True)
        reach = np.array([_valid_change(p) for p in problem.tuned])
        reach[~np.array(inner)] = np.inf
        gone = [
            p
            for p, (record, torque) in enumerate(zip(records, torques, strict=True))
            if not self._kept[record].follow(x, torque, reach)
        ]
        for p in gone:
            tangent = self._kept[records[p]]
            tangent.taken = tangent.place = x.copy()
            tangent.torque = torques[p]
        if gone:
            take(0, gone, True)
        return [self._kept[record].slopes for record in records]

    def forget(self) -> None:
        """Free the stored slopes."""
        self._narrower_slopes = None
        self._kept.clear()

    def _begin(self, record: Record, x: FloatArray, torque: FloatArray) -> int:
        """Allocate memory for a record; return how many of its parameters are known."""
        slopes = np.zeros((x.size, *torque.shape))
        tangent = _Tangent(x.copy(), x.copy(), torque, slopes)
        self._kept[record] = tangent
        before = self._narrower_slopes and self._narrower_slopes._kept.get(record)
        if not before:
            return 0
        known = len(before.slopes)
        slopes[:known] = before.slopes
        tangent.taken[:known] = before.taken
        return known


def jacobian(
    problem: Problem, x: FloatArray, masks: Masks, explained: bool = False
) -> FloatArray:
    """Compute the derivative of `Problem.residual` (residuals, parameters).

    Args:
        problem: the model.
        x: place of the parameters.
        masks: samples that count.
        explained: as if the model explained the data, see `plain_residual_slopes`.
    """
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    priors = np.diag([-1.0 / p.prior for p in problem.tuned])
    priors = priors[:, [np.isfinite(p.prior) for p in problem.tuned]]
    torques = problem.torques(x, seen)
    slopes = problem.slopes.of(problem, x, seen, torques)
    steep = (
        plain_residual_slopes(problem, masks)
        if explained
        else residual_slopes(problem, torques, masks)
    )
    rows = residual_changes(steep, slopes)
    return np.concatenate([rows, priors], axis=1).T


def residual_slopes(
    problem: Problem, torques: Sequence[FloatArray], masks: Masks
) -> list[tuple[FloatArray, NDArray[np.bool_]]]:
    """Change of residuals (2, samples) per torque [1/N m], and the samples that count.

    Of every record with such, of which `torques` are given.
    """
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    found = []
    for k, torque in zip(seen, torques, strict=True):
        size = np.abs(problem.plant.records[k].measured - torque) / problem.floor[k]
        root = np.sqrt(
            np.maximum(2.0 * HUBER_DELTA * size - HUBER_DELTA**2, HUBER_DELTA**2)
        )
        slope = np.where(size <= HUBER_DELTA, 1.0, HUBER_DELTA / root)
        steep = -problem.weight * slope / problem.floor[k]
        found.append((steep[:, masks[k]], masks[k]))
    return found


def plain_residual_slopes(
    problem: Problem, masks: Masks
) -> list[tuple[FloatArray, NDArray[np.bool_]]]:
    """Return the same where no error is large, so that every sample counts."""
    return [
        (-problem.weight / floor[:, mask], mask)
        for floor, mask in zip(problem.floor, masks, strict=True)
        if mask.any()
    ]


def residual_changes(
    steep: Sequence[tuple[FloatArray, NDArray[np.bool_]]],
    changes: Sequence[FloatArray],
) -> FloatArray:
    """Return first-order changes of `Problem.residual` without priors (k, residuals).

    Args:
        steep: of `residual_slopes`.
        changes: of the torques (k, 2, samples) of the same records [N m].
    """
    return np.concatenate(
        [
            (change[:, :, mask] * each).reshape(len(change), -1)
            for (each, mask), change in zip(steep, changes, strict=True)
        ],
        axis=1,
    )


def _need_replays(
    problem: Problem, x: FloatArray, steps: Sequence[float]
) -> list[bool]:
    """Return whether a change of each parameter takes a replay, or only its readout."""
    plant = problem.plant
    seen = {
        (plant.conditions_of(record, problem.effects), record.occasion)
        for record in plant.records
    }

    def settings(place: FloatArray) -> list[Setting]:
        values = problem.values(place)
        return [
            plant.setting(values_on(values, day), problem.effects, None, own)
            for own, day in seen
        ]

    here = settings(x)
    return [
        here != settings(x + step * (np.arange(x.size) == k))
        for k, step in enumerate(steps)
    ]


def _step(parameter: Tuned, place: float) -> float:
    """Change of a parameter over which torques are differenced, within its bounds."""
    step = _PARAMETER_STEPS.get(
        base_name(parameter.name), FACTOR_STEP if parameter.factor else _DEFAULT_STEP
    )
    return -step if place + step > parameter.high else step


def _valid_change(parameter: Tuned) -> float:
    """Change over which the derivatives hold."""
    return (
        min(_VALID_LOG_CHANGE / parameter.scale, 3.0)
        if parameter.factor
        else _VALID_CHANGE
    )
