"""Observation of a device's environment: the one definition that all share.

    history = ObservationHistory(observed, 1)   # of one device; many are rows
    history.begin(measured)                 # (1, k), what is measured at the start
    history.observation()                   # (1, size) of float32, about 1
    history.act(share)                      # (1,), the action that follows
    history.add(measured)                  # after every sample that it is held for

Environments observe it, and a saved policy is fed it wherever it plays.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from cc_mujoco._validation import require_number, require_parameter
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

Array = NDArray[np.float64]

OBSERVATION_LIMIT = 10.0
"""Value at which an observation saturates."""

PLAY_HALF_WIDTHS = (0.1, 0.3, 1.0)
"""Half widths of the plays of `Observed.memory`, in units of the twist."""

(
    MOTOR_ANGLE,
    MOTOR_VELOCITY,
    JOINT_ANGLE,
    JOINT_VELOCITY,
    JOINT_TORQUE,
    DESIRED_TORQUE,
) = range(6)
"""Places of what is measured: angle and velocity of the motor, of the joint; torques.
"""


@dataclass(frozen=True)
class Observed:
    """Observed quantities of a device and their units.

    A *frame* is twist of motor against joint, velocity of the motor, angle and velocity
    of the joint, what is lacking of the desired torque, and that torque; then, where
    the device knows it, sine and cosine of the phase of the gait, and the angle that
    a task commands. Motor angles are
    taken at the joint, divided by the ratio. Each number is divided by its unit and cut
    at `OBSERVATION_LIMIT`.
    """

    device: str
    """Name of the device."""
    columns: tuple[str, ...]
    """Measured quantities, columns of an episode log."""
    units: tuple[float, ...]
    """Values that are 1 in a frame: twist [rad], velocity of the motor at the joint
    [rad/s], angle [rad] and velocity [rad/s] of the joint, torque error and desired
    torque [N m], and of the phase [-]."""
    ratio: float
    """Motor angle per joint angle of an unstretched cable, signed [-]."""
    period: float
    """Time between two samples of the sensors [s]."""
    torque: float
    """Torque of the motor at an action of 1 [N m]."""
    hold: int = 1
    """Samples for which an action is held."""
    history: int = 0
    """Earlier frames, each with the action that followed it, newest first."""
    memory: bool = False
    """True if the plays of friction memory are observed: `min(max(p, x - r), x + r)`
    for angles x of the motor and of the joint and the half widths r of
    `PLAY_HALF_WIDTHS`; each as (x - p) / r. They know the last reversals, as a cable
    with friction does (M. A. Krasnosel'skii and A. V. Pokrovskii, Systems with
    Hysteresis, 1989, ch. 2)."""

    def __post_init__(self) -> None:
        require_number("hold", self.hold, 1, 1000, "samples")
        require_number("history", self.history, 0, 1000, "frames")
        for name in ("hold", "history"):
            if not isinstance(getattr(self, name), int):
                raise CableError(
                    f"{name} must be a whole number, not {getattr(self, name)!r}."
                )
        if not isinstance(self.memory, bool):
            raise CableError(f"memory must be True or False, not {self.memory!r}.")
        require_parameter(self, "period", 1e-7, 1e3, "s")
        require_parameter(self, "torque", 1e-9, 1e9, "N m")
        if len(self.columns) < 6 or len(self.columns) != len(self.units):
            raise CableError(
                "Observed needs a unit for each column, and at least six columns."
            )

    @property
    def frame(self) -> int:
        """Numbers in a frame."""
        return len(self.units)

    @property
    def space(self) -> Box:
        """The observation space of the environment: frame, plays, history."""
        size = self.frame + 2 * len(PLAY_HALF_WIDTHS) * self.memory
        size += self.history * (self.frame + 1)
        return Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (size,), dtype=np.float32)

    def with_reference(self) -> Observed:
        """Return the observation with the angle that a task commands, in last place."""
        return dataclasses.replace(
            self,
            columns=(*self.columns, "reference_angle_rad"),
            units=(*self.units, self.units[JOINT_ANGLE]),
        )

    def of(self, columns: Mapping[str, Any]) -> Array:
        """Return the observation: (k,) for numbers, (n, k) for n environments."""
        return np.ascontiguousarray(
            np.array([columns[name] for name in self.columns]).T
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain JSON."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Observed:
        """Rebuild an observation from the JSON of `to_dict`.

        Raises:
            CableError: If fields are missing, unknown or impossible.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        if set(fields) != names:
            raise CableError(f"what is observed must say {', '.join(sorted(names))}.")
        listed = {name: tuple(fields[name]) for name in ("columns", "units")}
        return cls(**{**fields, **listed})


class ObservationHistory:
    """Observation of n environments, with its past."""

    def __init__(self, observed: Observed, count: int) -> None:
        """Prepare n environments; `begin` before anything else."""
        self.observed = observed
        width = observed.frame
        self._units = np.array(observed.units)
        self._measured = np.zeros((count, width))
        reach = np.array(PLAY_HALF_WIDTHS) * observed.units[0]
        self._reach = np.concatenate((reach, reach))
        self._play_positions = np.zeros((count, self._reach.size))
        self._frame_history = np.zeros((count, observed.history, width + 1))

    def begin(self, measured: Array, rows: Any = slice(None)) -> None:
        """Start an episode, in all environments or some, with a past at rest."""
        self._measured[rows] = measured
        self._play_positions[rows] = self._angles()[rows]
        self._frame_history[rows] = 0.0
        self._frame_history[rows, :, :-1] = self._frame()[rows][:, None]

    def act(self, share: Array, rows: Any = slice(None)) -> None:
        """Record the actions (n,) after the present observations of these rows."""
        past = self._frame_history
        if past.shape[1]:
            past[rows, 1:] = past[rows, :-1]
            past[rows, 0, :-1] = self._frame()[rows]
            past[rows, 0, -1] = share[rows]

    def add(self, measured: Array) -> None:
        """Take a new sample of the measurements (n, k)."""
        self._measured[:] = measured
        if self.observed.memory:
            angles, reach = self._angles(), self._reach
            near = np.maximum(self._play_positions, angles - reach)
            self._play_positions = np.minimum(near, angles + reach)

    def observation(self) -> NDArray[np.float32]:
        """Return the current observation, (n, size)."""
        parts = [self._frame()]
        if self.observed.memory:
            parts.append((self._angles() - self._play_positions) / self._reach)
        count, frames, width = self._frame_history.shape
        if frames:
            parts.append(self._frame_history.reshape(count, frames * width))
        whole = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        return whole.astype(np.float32)

    def _frame(self) -> Array:
        frame = np.empty_like(self._measured)
        _compute_frame(self._measured, self.observed.ratio, self._units, frame)
        return frame

    def _angles(self) -> Array:
        """Return the angles of motor and joint, once for every play (n, plays)."""
        seen, ratio = self._measured, self.observed.ratio
        both = np.stack((seen[:, MOTOR_ANGLE] / ratio, seen[:, JOINT_ANGLE]), axis=1)
        angles: Array = np.repeat(both, len(PLAY_HALF_WIDTHS), axis=1)
        return angles


@compiled
def _compute_frame(
    measured: FloatMatrix, ratio: float, units: FloatArray, frame: FloatMatrix
) -> None:
    """Compute the frames (n, k) of measurements (n, k); see `Observed`."""
    for row in range(measured.shape[0]):
        for place in range(measured.shape[1]):
            value = measured[row, place]
            if place == MOTOR_ANGLE:
                value = value / ratio - measured[row, JOINT_ANGLE]
            elif place == MOTOR_VELOCITY:
                value = value / ratio
            elif place == JOINT_TORQUE:
                value = measured[row, DESIRED_TORQUE] - value
            value = max(value / units[place], -OBSERVATION_LIMIT)
            frame[row, place] = min(value, OBSERVATION_LIMIT)
