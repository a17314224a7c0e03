"""Sensors of drawn plants: each with noise, a bias and a delay of its own.

Steps of encoders and the velocities taken from them are those of `cc_mujoco.sensing`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cc_mujoco.benchmark.plant import Plant
from cc_mujoco.control import Drive
from cc_mujoco.sensing import TENSIONS, Measuring, Sensing


class DrawnSensors:
    """Readings of the controllers of several plants, during one episode."""

    def __init__(
        self,
        sensing: Sensing,
        drive: Drive,
        cables: Sequence[str],
        plants: Sequence[Plant],
        steps: int,
    ) -> None:
        """Draw the noise of the episode.

        Args:
            sensing: The sensors; how noisy, biased and late they are say the plants, as
                multiples of this noise and instead of this delay.
            drive: Says where tension sensors are.
            cables: Names of the cables that the motor winds.
            plants: One per device.
            steps: Control steps of the episode.
        """
        seeds = [plant.seed for plant in plants]
        silent = dataclasses.replace(
            sensing, torque_noise=0.0, tension_noise=0.0, delay=0
        )
        self._measuring = Measuring(silent, drive, cables, seeds, steps)
        self._shape = len(plants), len(cables), len(drive.sensors[0].nodes)
        width = 1 + self._shape[1] * self._shape[2]
        scale = np.full(width, sensing.tension_noise)
        scale[0] = sensing.torque_noise
        self._errors = np.empty((steps + 1, len(plants), width))
        for row, plant in enumerate(plants):
            random = np.random.default_rng([plant.seed, 1])
            noise = random.normal(size=(steps + 1, width))
            self._errors[:, row] = scale * (plant.noise * noise + plant.bias[:width])
        self._delays = np.array([plant.delay for plant in plants])
        self._rows = np.arange(len(plants))
        self._size = int(self._delays.max()) + 1
        self._kept: dict[str, Any] = {}
        self._step = 0

    def measure(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Return what controllers read of the columns of this step, (plants, ...)."""
        seen = self._measuring.measure(columns)
        errors = self._errors[self._step]
        seen["joint_torque_nm"] = seen["joint_torque_nm"] + errors[:, 0]
        told = seen[TENSIONS] + errors[:, 1:].reshape(self._shape)
        seen[TENSIONS] = np.maximum(told, 0.0, out=told)
        if not self._kept:
            # Before the first measurement arrives there is the one at rest.
            self._kept = {
                name: np.repeat(np.asarray(value)[None], self._size, axis=0)
                for name, value in seen.items()
            }
        late = (self._step - self._delays) % self._size
        found = {}
        for name, value in seen.items():
            kept = self._kept[name]
            kept[self._step % self._size] = value
            found[name] = kept[late, self._rows]
        self._step += 1
        return found
