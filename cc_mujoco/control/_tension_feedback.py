"""Controllers that use tension sensors along the cables (thesis Fig. 4.1, 3.2)."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco._validation import require_number
from cc_mujoco.cable._segments import Mesh
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.control._cable_model import CableModel
from cc_mujoco.control._controller import LawTables, as_round_pulley, readings
from cc_mujoco.control._feedback import ProportionalIntegral
from cc_mujoco.control._law_steps import LAW_INPUTS
from cc_mujoco.control._predictive import PredictiveCompensation
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._sensors import TENSION_COLUMN
from cc_mujoco.errors import CableError
from cc_mujoco.estimation._fusion import fuse, tension_gains
from cc_mujoco.estimation._tension_slope import require_bend_between, require_slope
from cc_mujoco.native import FloatArray


def _readings(observation: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the readings of tension sensors (rows, cables, sensors) [N]."""
    if TENSION_COLUMN not in observation:
        raise CableError(
            "this controller needs tension sensors; the observation has no "
            f"{TENSION_COLUMN}."
        )
    tensions = np.asarray(observation[TENSION_COLUMN], dtype=float)
    return tensions[None] if tensions.ndim == 2 else tensions


def _require_sensors(drive: Drive, least: int) -> None:
    found = min((len(each.nodes) for each in drive.sensors), default=0)
    if found < least:
        raise CableError(
            f"this controller needs at least {least} tension sensors along every "
            f"cable, and Drive.sensors has {found}; the readings of a rig that "
            "`cc-mujoco run` drives have none."
        )


class FusedFeedback(ProportionalIntegral):
    """Feedback of fused tension sensors: no joint torque sensor is used.

    Noisy tension sensors along the cables are fused into the tensions at the joint
    (`estimation._fusion`). The cable model, driven by the motor's angle and the fused
    tensions, determines which parts slip. Feed-forward and PI as in `pi` act on the
    resulting torque (thesis Fig. 4.1). While no slipping part connects a sensor to the
    joint, the last estimate stays.
    """

    def __init__(
        self, drive: Drive, proportional: float = 1.0, integral: float = 2.0
    ) -> None:
        """Prepare for the first episode, with the gains K_p [-] and K_i [1/s].

        Raises:
            CableError: If cables, or a sensor along each, are not known, or a gain is
                negative.
        """
        super().__init__(drive, proportional, integral)
        _require_sensors(drive, 1)
        self.model = CableModel(drive)
        self._own = [
            (Mesh.of(one.cable), own.on(one.cable), own.deviation)
            for one, own in zip(drive.cables, drive.sensors, strict=True)
        ]
        self._rest = np.array([[one.cable.pretension] for one in drive.cables])
        self._tensions = self._rest
        """Tensions of the cables at the joint (cables, rows) [N]."""

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        super().reset(where)
        self.model.reset(where)
        if where is None:
            self._tensions = self._rest
        else:
            self._tensions = np.where(where, self._rest, self._tensions)

    def measured(self, observation: Mapping[str, Any]) -> FloatArray:
        """Return the measurements of `pi`, with the torque of the fused tensions."""
        observation = as_round_pulley(observation, self.drive)
        tensions, last = _readings(observation), self._tensions
        self.model.follow(observation["motor_angle_rad"], self._torque(len(tensions)))
        fused = []
        for k, (mesh, nodes, deviation) in enumerate(self._own):
            gain = tension_gains(mesh, self.model.slip(k), nodes)[..., -1:]
            found = fuse(tensions[:, k], gain, deviation).tension[..., 0]
            fused.append(np.where(np.isfinite(found), np.maximum(found, 0.0), last[k]))
        self._tensions = np.array(fused)
        seen = readings(observation, LAW_INPUTS)
        seen[:, guard.TORQUE] = self._torque(len(tensions))
        return seen

    def _torque(self, rows: int) -> FloatArray:
        """Return the torque of the cables at the joint (rows,) [N m]."""
        torque = np.zeros(rows)
        for one, tension in zip(self.drive.cables, self._tensions, strict=True):
            torque = torque - one.distal * tension
        return torque


class AdaptiveModel(PredictiveCompensation):
    """Predictive, with the friction of every cable from tension sensors along it.

    Friction is the slope of the logarithm of tension against wrap angle where the model
    predicts that a cable slips (`estimation._tension_slope`); the model adopts the
    estimate (thesis 3.2.3). So friction need not be distinguished from other torques on
    the motor.
    """

    stepped = dataclasses.replace(
        PredictiveCompensation.stepped,
        step=planner_steps.step_sensed,
        unread=frozenset({"learning"}),
        fixed=PredictiveCompensation.stepped.fixed | {"learning"},
        needs_slope=True,
    )

    def __init__(self, drive: Drive, memory: float = 200.0, **settings: Any) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device, with cables and at least two sensors along each. Friction
                of 0 is replaced by 0.001 in the model.
            memory: Number of readings after which the weight of one is 1/e; one in
                `_planner_steps.READING_INTERVAL` steps is read.
            **settings: See `PredictiveCompensation`; `learning` is 0.

        Raises:
            CableError: As `PredictiveCompensation`, if sensors are not known or not as
                many along every cable, or as `estimation._tension_slope.require_slope`.
        """
        require_kind("drive", drive, Drive)
        cables = tuple(map(_with_minimum_friction, drive.cables))
        drive = dataclasses.replace(drive, cables=cables)
        super().__init__(drive, **{**settings, "learning": 0.0})
        _require_sensors(drive, 2)
        require_number("memory", memory, 1.0, 1e9, "readings")
        counts = [len(own.nodes) for own in drive.sensors]
        if len(set(counts)) > 1:
            raise CableError(
                "Drive.sensors must be as many along every cable, not "
                f"{', '.join(map(str, counts))}."
            )
        for own, one in zip(drive.sensors, drive.cables, strict=True):
            require_bend_between(one.cable, own)
        self.taps = planner_steps.Taps(
            np.array([own.nodes for own in drive.sensors], dtype=np.int64),
            np.array([own.deviation for own in drive.sensors]),
            1.0 - math.exp(-1.0 / memory),
        )
        """Places of the sensors, and the estimates by them."""

    def parameters(self) -> list[float]:
        return [*super().parameters(), *self.taps.noise.ravel().tolist()]

    def law_tables(self) -> LawTables:
        own, nodes = super().law_tables(), self.taps.nodes
        shape = *own.shape, nodes.shape[1], *nodes.ravel().tolist()
        return self._laid_out(shape, (*own.numbers, self.taps.fading))

    def friction(self) -> NDArray[np.float64]:
        """Return friction coefficients (rows, cables), empty before the first step."""
        cables, size = len(self.drive.cables), planner_steps.ESTIMATE_SIZE
        if not len(self._memory):
            return np.zeros((0, cables))
        end = self._tables.size
        kept = self._memory[:, end - cables * size : end]
        return kept[:, planner_steps.COEFFICIENT :: size].copy()

    def measured(self, observation: Mapping[str, Any]) -> FloatArray:
        """Return the measurements (rows, readings), the tensions [N] last.

        Raises:
            CableError: A tension is no number, or beyond `guard.MAX_READING`; then
                nothing changes.
        """
        tensions = _readings(observation)
        rows = np.size(observation["motor_angle_rad"])
        expected = (rows, *self.taps.noise.shape)
        if tensions.shape != expected or not np.all(guard.is_heard(tensions)):
            raise CableError(
                f"{TENSION_COLUMN} must be finite numbers of shape {expected[1:]} for "
                f"every device, not {tensions.tolist()}."
            )
        return np.hstack([super().measured(observation), tensions.reshape(rows, -1)])


def _with_minimum_friction(one: CableDrive) -> CableDrive:
    """Return the drive with the least friction that can be scaled and estimated."""
    cable = one.cable
    require_slope(cable)
    least, still = planner_steps.MIN_BELIEVED_FRICTION, cable.static_friction
    if cable.friction >= least:
        return one
    still = max(still, least) if still > 0.0 else still
    believed = cable.replace(friction=least, static_friction=still)
    return dataclasses.replace(one, cable=believed)
