r"""The kernel as an observer: it knows directions and partial motion by itself.

    observer = CableObserver(cable, sensors, dt=0.001)
    observer.update(encoder, measured)       # in every step
    observer.tension, observer.direction

The thesis finds directions of slip by a vote among sensors. But the encoder at the
proximal end and the tension at the distal one drive the model completely, so that only
one number of each instant is unknown: the distal tension. It is estimated by a Kalman
filter for a local trend (level and rate, the rate a random walk) from all sensors that
slip ties to the distal end, each carried there by the capstan factors of the model's
own directions; and it drives the model. What a standing part of the cable remembers,
the model remembers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import Conduit
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.estimation._fusion import fuse, tension_gains
from cc_mujoco.native import FloatArray


class CableObserver:
    """Estimate of all tensions by a model that encoder and sensors drive."""

    def __init__(
        self, cable: Cable, sensors: Sensors, dt: float, *, agility: float = 300.0
    ) -> None:
        """Start at rest in the pretension.

        Args:
            cable: parameters; friction terms beyond Coulomb's must be off.
            sensors: the sensors.
            dt: time between readings [s].
            agility: standard deviation of what the rate of the distal tension changes
                by in one second [N/s]; less is smoother and later.
        """
        self._noise = np.array(sensors.deviation)
        self._nodes, self._mesh = sensors.on(cable), Mesh.of(cable)
        self._model = Conduit(cable)
        self._dt = dt
        self._ahead = np.array([[1.0, dt], [0.0, 1.0]])
        wander = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        self._drift_variance = agility**2 * wander
        self._state = np.array([self._model.tension_distal, 0.0])
        self._spread = np.diag([float(np.mean(self._noise)) ** 2, 0.0])

    @property
    def tension(self) -> FloatArray:
        """Tension of every node (n + 1,) [N]."""
        return self._model.tension

    @property
    def direction(self) -> NDArray[np.int8]:
        """Direction of slip of every segment in the last step (n,), 0 = rest."""
        return self._model.direction

    def update(self, u_proximal: float, reading: ArrayLike) -> FloatArray:
        """Take encoder [m] and sensors (m,) [N]; return the nodes' tensions [N]."""
        reading = np.asarray(reading, dtype=float)
        state = self._ahead @ self._state
        spread = self._ahead @ self._spread @ self._ahead.T + self._drift_variance
        gain = tension_gains(self._mesh, self.direction, self._nodes)[:, -1:]
        found = fuse(reading, gain, self._noise)
        measured, deviation = float(found.tension[0]), float(found.deviation[0])
        if np.isfinite(measured):
            share = spread[:, 0] / (spread[0, 0] + deviation**2)
            state = state + share * (measured - state[0])
            spread = spread - np.outer(share, spread[0])
        self._state, self._spread = state, spread
        self._model.step(
            self._dt, u_proximal=u_proximal, tension_distal=max(float(state[0]), 0.0)
        )
        return self.tension
