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

from cc_mujoco.cable._parameters import Cable
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._fusion import tension_gains
from cc_mujoco.native import FloatArray

REWEIGHTINGS = 5
"""Times that the weights are renewed."""


class SensorNoise:
    """Standard deviation of every sensor, followed while the cable runs.

    It learns while the whole cable moves one way. During partial motion the sensors do
    not measure one tension; where the direction changes along the cable, it does so
    inside a segment, whose factor is then neither of the two; and at rest the tension
    of an end may change before its segment slips. Then it waits.

    Attributes:
        learnt: samples that the estimate rests on, faded ones in part.
    """

    def __init__(
        self, cable: Cable, sensors: Sensors, *, memory: float = 300.0
    ) -> None:
        """Start from the deviations stated with the sensors.

        Args:
            cable: parameters; friction terms beyond Coulomb's must be off.
            sensors: at least three, or nothing tells whose the noise is.
            memory: samples after which what was learnt has faded to 1/e.

        Raises:
            CableError: fewer than three sensors, one off the cable, or a memory that is
                shorter than one sample.
        """
        if len(sensors.nodes) < 3:
            raise CableError(
                f"there are {len(sensors.nodes)} sensors; to tell their noises apart "
                "takes at least 3"
            )
        if not memory >= 1.0:
            raise CableError(f"memory is {memory!r} samples; it must be at least 1")
        self.sensors = sensors
        self._fading = float(np.exp(-1.0 / memory))
        nodes, segments = sensors.on(cable), cable.segments
        mesh = Mesh.of(cable)
        count = nodes.size
        apart = np.eye(count - 1, count) - np.eye(count - 1, count, 1)
        self._contrast = {
            slip_direction: apart
            * tension_gains(mesh, np.full(segments, slip_direction), nodes)[:, -1]
            for slip_direction in (-1.0, 1.0)
        }
        self.reset()

    def reset(self) -> None:
        """Reset the state."""
        size = len(self.sensors.nodes) - 1
        self._moment = {
            slip_direction: np.zeros((size, size)) for slip_direction in self._contrast
        }
        self._weight = dict.fromkeys(self._contrast, 0.0)

    def update(self, reading: ArrayLike, direction: ArrayLike) -> None:
        """Take the readings of the next instant.

        Args:
            reading: of every sensor (m,) [N].
            direction: slip of every segment (n,).

        Raises:
            CableError: not one reading per sensor.
        """
        told = np.asarray(reading, dtype=float)
        if told.shape != (len(self.sensors.nodes),):
            raise CableError(
                f"reading has shape {told.shape}; it must be "
                f"({len(self.sensors.nodes)},)"
            )
        sign = np.sign(np.asarray(direction, dtype=float))
        slip_direction = float(sign[0])
        if slip_direction == 0.0 or not np.all(sign == slip_direction):
            return
        for each in self._moment:
            self._moment[each] *= self._fading
            self._weight[each] *= self._fading
        contrast = self._contrast[slip_direction] @ told
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
        stated = np.array(self.sensors.deviation)
        if self.learnt < 10.0 * stated.size:
            return stated
        variance = np.full(stated.size, float(np.mean(stated**2)))
        for _ in range(REWEIGHTINGS):
            variance = self._fit(variance)
        found: FloatArray = np.sqrt(variance)
        return found

    def _fit(self, guess: FloatArray) -> FloatArray:
        """Return the variances by least squares, weighted by `guess`."""
        from scipy.optimize import nnls

        rows, right = [], []
        for slip_direction, weight in self._weight.items():
            if weight == 0.0:
                continue
            contrast = self._contrast[slip_direction]
            # In the coordinates in which the contrasts would be white and of unit size.
            root = np.linalg.cholesky((contrast * guess) @ contrast.T)
            white = np.linalg.solve(root, contrast)
            seen = np.linalg.solve(root, self._moment[slip_direction] / weight)
            seen = np.linalg.solve(root, seen.T)
            rows.append(np.sqrt(weight) * np.einsum("ai,bi->abi", white, white))
            right.append(np.sqrt(weight) * seen)
        matrix = np.concatenate([row.reshape(-1, guess.size) for row in rows])
        size = np.linalg.norm(matrix, axis=0)
        found = (
            nnls(matrix / size, np.concatenate([s.ravel() for s in right]))[0] / size
        )
        least: FloatArray = np.maximum(found, 1e-4 * np.max(found))
        return least
