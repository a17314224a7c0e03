r"""Noise of every tension sensor, learnt while the cable runs (3.2.2).

    noise = SensorNoise(cable, sensors)
    noise.update(measured, direction)        # in every step
    fusion.noise = noise.deviation           # now and then

While the whole cable slips one way all sensors measure one tension, each times a known
capstan factor, :math:`y_i = g_i T + v_i`. So :math:`y_i/g_i - y_j/g_j` holds noise
alone, whatever the tension does. The covariance of these contrasts is linear in the
variances of the sensors; they follow by least squares, as in the autocovariance method
(`noise`) but without its filter and its model of the tension. Each residual is weighted
by its own statistical error under the last estimate, and old samples fade, so that it
follows sensors that change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls

from cc_mujoco.cable._parameters import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray

REWEIGHTINGS = 5  # times that the weights are renewed


class SensorNoise:
    """Standard deviation of every sensor, followed while the cable runs.

    It learns while the whole cable moves one way. During partial motion the sensors do
    not measure one tension; where the direction changes along the cable, it does so
    inside a segment, whose factor is then neither of the two; and at rest the tension
    of an end may change before its segment slips. Then it waits.
    """

    def __init__(
        self, cable: Cable, sensors: Sensors, *, memory: float = 300.0
    ) -> None:
        """Start from the deviations stated with the sensors.

        Args:
            cable: parameters; friction terms beyond Coulomb's must be off.
            sensors: at least three, or nothing tells whose the noise is.
            memory: samples after which what was learnt has faded to 1/e.
        """
        self._stated = np.array(sensors.deviation)
        self._fading = float(np.exp(-1.0 / memory))
        nodes, segments = sensors.on(cable), cable.segments
        mesh = Mesh.of(cable)
        count = nodes.size
        apart = np.eye(count - 1, count) - np.eye(count - 1, count, 1)
        self._contrast = {
            way: apart * tension_gains(mesh, np.full(segments, way), nodes)[:, -1]
            for way in (-1.0, 1.0)
        }
        size = count - 1
        self._moment = {way: np.zeros((size, size)) for way in self._contrast}
        self._weight = dict.fromkeys(self._contrast, 0.0)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Take the sensors' readings (m,) [N] and the segments' slip (n,)."""
        sign = np.sign(np.asarray(direction, dtype=float))
        slip_direction = float(sign[0])
        if slip_direction == 0.0 or not np.all(sign == slip_direction):
            return
        for each in self._moment:
            self._moment[each] *= self._fading
            self._weight[each] *= self._fading
        contrast = self._contrast[slip_direction] @ np.asarray(reading, dtype=float)
        self._moment[slip_direction] += np.outer(contrast, contrast)
        self._weight[slip_direction] += 1.0

    @property
    def learnt(self) -> float:
        """Samples that the estimate rests on, faded ones in part."""
        return sum(self._weight.values())

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of every sensor (m,) [N].

        It is the stated one until ten times as many samples are learnt as there are
        sensors, and never less than a hundredth of the largest, so that no sensor is
        ever trusted alone.
        """
        stated = self._stated
        if self.learnt < 10.0 * stated.size:
            return stated
        variance = np.full(stated.size, float(np.mean(stated**2)))
        for _ in range(REWEIGHTINGS):
            variance = self._fit(variance)
        return np.sqrt(variance)

    def _fit(self, guess: FloatArray) -> FloatArray:
        """Return the variances by least squares, weighted by `guess`."""
        rows, right = [], []
        for way, weight in self._weight.items():
            if weight == 0.0:
                continue
            contrast = self._contrast[way]
            # In the coordinates in which the contrasts would be white and of unit size.
            root = np.linalg.cholesky((contrast * guess) @ contrast.T)
            white = np.linalg.solve(root, contrast)
            seen = np.linalg.solve(root, self._moment[way] / weight)
            seen = np.linalg.solve(root, seen.T)
            rows.append(np.sqrt(weight) * np.einsum("ai,bi->abi", white, white))
            right.append(np.sqrt(weight) * seen)
        matrix = np.concatenate([row.reshape(-1, guess.size) for row in rows])
        size = np.linalg.norm(matrix, axis=0)
        found = nnls(matrix / size, np.concatenate([s.ravel() for s in right]))[0]
        found = found / size
        return np.maximum(found, 1e-4 * np.max(found))
