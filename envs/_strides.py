"""Strides of a walking person: lengths, times and work.

Work is that of muscles at the joints, without passive damping and stops. Positive and
negative work are summed separately for each joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.human._walking_body import metabolic_energy

Array = NDArray[np.float64]


class Stride(NamedTuple):
    """Measures of a stride, from one strike of the right heel to the next."""

    time: float  # duration [s]
    length: float  # distance that the right heel has moved [m]
    step_time: Array
    """Time from the other foot's strike to that of the right, left foot (2,) [s]."""
    step_length: Array
    """Distance from the other heel at the strike of the right, left foot (2,) [m]."""
    positive_work: Array  # positive work of the person (legs, joints) [J]
    negative_work: Array  # negative work of the person (legs, joints), at most 0 [J]
    assistance: Array  # work of the ropes on the ankles (legs,) [J]
    motors: Array  # positive work of the motors (legs,) [J]

    @property
    def metabolic_power(self) -> float:
        """Estimate of the metabolic power of walking, above that of standing [W]."""
        energy = metabolic_energy(self.positive_work.sum(), self.negative_work.sum())
        return float(energy / self.time)


def mean_stride(strides: Sequence[Stride]) -> Stride:
    """Return the mean of each field over strides."""
    return Stride(*(np.mean(values, axis=0) for values in zip(*strides, strict=True)))


class StrideMeter:
    """Integrator of the work of each stride.

    Attributes:
        strides: strides that are complete.
    """

    def __init__(self) -> None:
        self.strides: list[Stride] = []
        self._begun: tuple[float, float] | None = None
        self._struck = np.full(2, np.nan)
        self._steps = np.full((2, 2), np.nan)  # time and length, by leg
        self._clear()

    def _clear(self) -> None:
        self._work = np.zeros((2, 2, 3))
        self._ropes, self._motors = np.zeros(2), np.zeros(2)

    def add(self, person: Array, ropes: Array, motors: Array, period: float) -> None:
        """Add work: power during `period` [s].

        `person` is the power of the joints (legs, joints), `ropes` that of the ropes on
        the ankles, `motors` that of the motors (legs,) [W].
        """
        self._work[0] += period * np.maximum(person, 0.0)
        self._work[1] += period * np.minimum(person, 0.0)
        self._ropes += period * ropes
        self._motors += period * np.maximum(motors, 0.0)

    def strike(self, leg: int, time: float, heels: Array) -> None:
        """Record that a foot has struck the ground at `time` [s].

        The right `leg` is 0; `heels` are positions along the way (legs,) [m].
        """
        other = 1 - leg
        self._steps[:, leg] = time - self._struck[other], heels[leg] - heels[other]
        self._struck[leg] = time
        if leg:
            return
        position = float(heels[0])
        if self._begun is not None and np.isfinite(self._steps).all():
            whole = time - self._begun[0], position - self._begun[1]
            work = *self._work, self._ropes, self._motors
            self.strides.append(Stride(*whole, *self._steps.copy(), *work))
        self._begun = (time, position)
        self._clear()
