"""Sensors of environments that are late and noisy, each as its plant defines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control.observed import TORQUE

from .plant import LATEST, Plant

Array = NDArray[np.float64]

BIAS = 2.0
"""Standard deviation of a bias, as a multiple of that of the noise."""


class LateSensors:
    """Sensors of n environments; angles and velocities are exact."""

    def __init__(self, count: int, width: int, torque_noise: float) -> None:
        """Prepare; `begin` before anything else.

        Args:
            count: Number of environments, n.
            width: Numbers that are measured, k.
            torque_noise: Standard deviation of the device's joint torque sensor [Nm].
        """
        self._deviation = torque_noise
        self._kept = np.zeros((1, count, width))
        self._delays = np.zeros(count, dtype=np.intp)
        self._steps = np.zeros(count, dtype=np.intp)
        self._rows = np.arange(count)
        self._errors: Array = np.zeros((count, 0))

    def begin(
        self, row: int, plant: Plant, samples: int, rng: np.random.Generator
    ) -> None:
        """Start an episode of one environment; draws from `rng` if there is noise."""
        self._delays[row] = plant.delay
        if plant.delay >= len(self._kept):
            # One size for all delays, so that what is kept need not be sorted anew.
            kept = np.zeros((LATEST + 1, *self._kept.shape[1:]))
            kept[:] = self._kept[0]
            self._kept = kept
        if plant.noise and not self._errors.size:
            self._errors = np.zeros((self._rows.size, samples + 1))
        if plant.noise:
            scale = plant.noise * self._deviation
            bias = BIAS * rng.normal()
            self._errors[row] = scale * (bias + rng.normal(size=samples + 1))
        elif self._errors.size:
            self._errors[row] = 0.0

    def first(self, measured: Array, rows: Any = slice(None)) -> Array:
        """Return the readings of measurements (rows, k) at the start of an episode."""
        self._steps[rows] = 0
        read = self._noisy(measured, rows)
        # Before the first measurement arrives there is the one at rest.
        self._kept[:, rows] = read
        return read

    def read(self, measured: Array, going: Any = True) -> Array:
        """Return the readings after one more sample of the measurements, (n, k).

        Args:
            measured: Measurements of all environments.
            going: Mask (n,) of those in which time went on; of the others it is what it
                was at the last sample.
        """
        self._steps += going
        size = len(self._kept)
        if size == 1:  # nothing is late
            return self._noisy(measured, slice(None))
        self._kept[self._steps % size, self._rows] = self._noisy(measured, slice(None))
        late: Array = self._kept[(self._steps - self._delays) % size, self._rows]
        return late

    def _noisy(self, measured: Array, rows: Any) -> Array:
        if not self._errors.size:
            return measured
        measured = measured.copy()
        step = np.minimum(self._steps[rows], self._errors.shape[1] - 1)
        measured[:, TORQUE] += self._errors[self._rows[rows], step]
        return measured
