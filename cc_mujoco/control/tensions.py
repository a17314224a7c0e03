"""Controllers that use tension sensors along the cables (thesis Fig. 4.1, 3.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.checks import number
from cc_mujoco.compiled import FloatArray
from cc_mujoco.control.controller import wound
from cc_mujoco.control.drive import Drive
from cc_mujoco.control.model import CableModel
from cc_mujoco.control.predictive import PredictiveCompensation
from cc_mujoco.control.proportional_integral import ProportionalIntegral
from cc_mujoco.errors import CableError
from cc_mujoco.estimation.friction import FrictionEstimator
from cc_mujoco.estimation.fusion import fuse, gains
from cc_mujoco.sensing import TENSIONS
from cc_mujoco.transmission.thesis_solver import Mesh

SENSED_EVERY = 5
"""Steps between two readings that the friction estimators take."""


def _readings(observation: Mapping[str, Any]) -> NDArray[np.float64]:
    """Tensions (rows, cables, sensors) [N]."""
    if TENSIONS not in observation:
        raise CableError(
            f"this controller needs tension sensors; the observation has no {TENSIONS}."
        )
    told = np.asarray(observation[TENSIONS], dtype=float)
    return told[None] if told.ndim == 2 else told


def _require_sensors(drive: Drive, least: int) -> None:
    if not drive.sensors or min(len(s.nodes) for s in drive.sensors) < least:
        raise CableError(
            f"this controller needs at least {least} tension sensors along every "
            "cable; Drive.sensors has fewer."
        )


class FusedFeedback(ProportionalIntegral):
    """Feedback of fused tension sensors: no joint torque sensor is used.

    Noisy tension sensors along the cables are fused into the tensions at the joint
    (`estimation.fusion`); the model, driven by the motor's angle and the fused
    tensions, says which parts slip. Feed-forward and PI as in `pi` act on the torque
    that follows (thesis Fig. 4.1). Where slip ties no sensor to the joint, the last
    estimate stays.
    """

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device, with cables and at least one sensor along each.
            proportional: Kp [-].
            integral: Ki [1/s].

        Raises:
            CableError: If cables or sensors are not known, or a gain is negative.
        """
        super().__init__(drive, proportional, integral)
        _require_sensors(drive, 1)
        self.model = CableModel(drive)
        self._cables = [_Fused(drive, k) for k in range(len(drive.cables))]

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Start at rest in the pretension; see `Controller.reset`."""
        super().reset(where)
        self.model.reset(where)
        for cable in self._cables:
            cable.reset(where)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        desired = wound(observation, self.drive)["desired_torque_nm"]
        told = _readings(observation)
        torque = np.zeros(told.shape[0])
        for cable in self._cables:
            torque = torque - cable.distal * cable.tension
        self.model.follow(observation["motor_angle_rad"], torque)
        torque = np.zeros(told.shape[0])
        for k, cable in enumerate(self._cables):
            torque = torque - cable.distal * cable.fuse(told[:, k], self.model.slip(k))
        measured = float(torque[0]) if np.ndim(desired) == 0 else torque
        return self.closed(desired / self.drive.ratio, desired - measured)


class _Fused:
    """Distal tension of one cable in every environment."""

    def __init__(self, drive: Drive, cable: int) -> None:
        cable_drives = [row[cable] for row in drive.cable_drives]
        self.distal = cable_drives[0].distal
        meshes = [Mesh.of(cable_drive.cable) for cable_drive in cable_drives]
        self._mesh = dataclasses.replace(
            meshes[0], angle=np.stack([mesh.angle for mesh in meshes])
        )
        self._sensors = drive.sensors[cable]
        self._nodes = self._sensors.on(cable_drives[0].cable)
        self._rest = np.array(
            [cable_drive.cable.pretension for cable_drive in cable_drives]
        )
        self.reset(None)

    def reset(self, where: NDArray[np.bool_] | None) -> None:
        self.tension: NDArray[np.float64] = (
            self._rest if where is None else np.where(where, self._rest, self.tension)
        )

    def fuse(
        self, told: NDArray[np.float64], slip: NDArray[np.int8]
    ) -> NDArray[np.float64]:
        gain = gains(self._mesh, slip, self._nodes)[..., -1:]
        found = fuse(told, gain, self._sensors.deviation).tension[..., 0]
        self.tension = np.where(
            np.isfinite(found), np.maximum(found, 0.0), self.tension
        )
        return self.tension


class AdaptiveModel(PredictiveCompensation):
    """Predictive, with the friction of every cable from tension sensors along it.

    A `FrictionEstimator` per cable learns from the sensors and from the model's
    directions of slip; the model takes the estimate over (thesis 3.2.3). So friction
    need not be told apart from all else that the motor feels.
    """

    def __init__(self, drive: Drive, memory: float = 200.0, **settings: Any) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device, with cables and at least two sensors along each.
            memory: Readings after which one has faded to 1/e; one in `SENSED_EVERY`
                steps is read.
            **settings: See `PredictiveCompensation`; `learning` is 0.

        Raises:
            CableError: As `PredictiveCompensation`, or if sensors are not known.
        """
        super().__init__(drive, **{**settings, "learning": 0.0})
        _require_sensors(drive, 2)
        number("memory", memory, 1.0, 1e9, "readings")
        self._fading = memory
        self._estimators: list[list[FrictionEstimator]] = []
        self._calls: Any = 0

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Return to the drive's friction; see `Controller.reset`."""
        super().reset(where)
        self._calls = 0 if where is None else np.where(where, 0, self._calls)
        if where is None:
            self._estimators = []
        for row, estimators in enumerate(self._estimators):
            if where is not None and where[row]:
                for estimator in estimators:
                    estimator.reset()

    def rebend(self, angles: Sequence[FloatArray]) -> None:
        """Take the path from sensors of bend, so that friction alone is estimated.

        It counts from the first reading of the tension sensors on.
        """
        super().rebend(angles)
        for estimators in self._estimators:
            for estimator, angle in zip(estimators, angles, strict=True):
                estimator.rebend(angle)

    def friction(self) -> NDArray[np.float64]:
        """Estimates of the friction coefficient (rows, cables); empty at the start."""
        return np.array([[e.friction for e in row] for row in self._estimators])

    def learned(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        """What the drive's friction is to be multiplied by (rows, cables)."""
        told = _readings(observation)
        rows, model = range(told.shape[0]), self.model
        if not self._estimators:
            self._estimators = [self._row(row) for row in rows]
        due = np.broadcast_to(self._calls % SENSED_EVERY == 0, told.shape[0])
        self._calls = self._calls + 1
        for k in range(told.shape[1]) if due.any() else ():
            slip = model.slip(k)
            for row in np.flatnonzero(due & slip.any(axis=1)):
                self._estimators[row][k].update(told[row, k], slip[row])
        believed = [[one.cable.friction for one in model.cable_drives(r)] for r in rows]
        factor: NDArray[np.float64] = np.maximum(self.friction(), 1e-3) / believed
        return factor

    def _row(self, row: int) -> list[FrictionEstimator]:
        return [
            FrictionEstimator(cable_drive.cable, sensors, memory=self._fading)
            for cable_drive, sensors in zip(
                self.model.cable_drives(row), self.drive.sensors, strict=True
            )
        ]
