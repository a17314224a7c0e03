"""Observation of a device, as environments return it and saved policies receive it.

    history = ObservationHistory(observed, 1)   # one device; several are rows
    history.begin(measured)                 # (1, k), measurements at the start
    history.observation()                   # (1, size) of float32, about 1
    history.act(share)                      # (1,), the action that follows
    history.add(measured)                   # after every sample while it is held

It may include earlier frames and the states of play operators, which remember the last
reversals as a cable with friction does.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from cc_mujoco._validation import require_number, require_parameter
from cc_mujoco.errors import CableError
from cc_mujoco.native import (
    FloatArray,
    FloatCube,
    FloatMatrix,
    IntArray,
    compiled,
    internal,
)
from cc_mujoco.native import FloatArray as Array

OBSERVATION_LIMIT = 10.0  # value at which an observation saturates

PLAY_HALF_WIDTHS = (0.1, 0.3, 1.0)
"""Half widths of the plays of `Observed.memory`, in units of the twist."""

(
    MOTOR_ANGLE, MOTOR_VELOCITY, JOINT_ANGLE, JOINT_VELOCITY, JOINT_TORQUE,
    DESIRED_TORQUE,
) = range(6)  # fmt: skip
"""Places of the measurements: angle and velocity of motor and joint; torques."""


@dataclass(frozen=True)
class Observed:
    """Observed quantities of a device and their units.

    A *frame* has the twist (motor angle minus joint angle), the velocity of the motor,
    angle and velocity of the joint, the torque error (desired minus measured), and the
    desired torque; then, where the device has them, sine and cosine of the phase of the
    gait and the commanded angle. Motor angles are divided by the ratio, so that they
    are those of the joint. Each number is divided by its unit and cut at
    `OBSERVATION_LIMIT`.
    """

    device: str  # name of the device
    columns: tuple[str, ...]  # measured quantities, columns of an episode log
    units: tuple[float, ...]
    """Values that are divided by: twist [rad], velocity of the motor at the joint
    [rad/s], angle [rad] and velocity [rad/s] of the joint, torque error and desired
    torque [N m], phase [-]."""
    ratio: float  # motor angle per joint angle of an unstretched cable, signed [-]
    period: float  # time between two samples of the sensors [s]
    torque: float  # torque of the motor at an action of 1 [N m]
    hold: int = 1  # number of samples for which an action is held
    history: int = 0
    """Number of earlier frames, each with the action that followed it, newest first."""
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
        """Number of values in a frame."""
        return len(self.units)

    @property
    def space(self) -> Box:
        """Gymnasium space of the observation: a frame, the plays, earlier frames."""
        size = self.frame + 2 * len(PLAY_HALF_WIDTHS) * self.memory
        size += self.history * (self.frame + 1)
        return Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (size,), dtype=np.float32)

    def with_reference(self) -> "Observed":
        """Return the observation with the joint's commanded angle as last column."""
        columns = *self.columns, "reference_angle_rad"
        units = *self.units, self.units[JOINT_ANGLE]
        return dataclasses.replace(self, columns=columns, units=units)

    def of(self, columns: Mapping[str, Any]) -> Array:
        """Return columns in the order of a frame, unscaled: (k,) or (n, k)."""
        found = np.array([columns[name] for name in self.columns])
        return np.ascontiguousarray(found.T)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as a dictionary for JSON."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> "Observed":
        """Return the observation that `to_dict` wrote as JSON."""
        names = {field.name for field in dataclasses.fields(cls)}
        if set(fields) != names:
            raise CableError(f"what is observed must say {', '.join(sorted(names))}.")
        listed = {name: tuple(fields[name]) for name in ("columns", "units")}
        return cls(**{**fields, **listed})


class Past(NamedTuple):
    """Arrays of an `ObservationHistory` of n environments."""

    ratio: float
    units: FloatArray
    reach: FloatArray  # half width of every play, the motor's first [rad]; or empty
    measured: FloatMatrix  # last measurements (n, k)
    plays: FloatMatrix  # positions of the plays (n, plays) [rad]
    frames: FloatCube  # earlier, with their actions, newest first (n, history, k + 1)


class ObservationHistory:
    """Observations of n environments, with their earlier frames and play operators."""

    def __init__(self, observed: Observed, count: int) -> None:
        """Allocate arrays for `count` environments; call `begin` first of all."""
        self.observed, self.size = observed, observed.space.shape[0]
        width, self._all = observed.frame, np.arange(count)
        reach = np.tile(np.array(PLAY_HALF_WIDTHS) * observed.units[0], 2)
        reach = reach if observed.memory else reach[:0]
        frames = np.zeros((count, observed.history, width + 1))
        rows = np.zeros((count, width)), np.zeros((count, reach.size)), frames
        self.past = Past(observed.ratio, np.array(observed.units), reach, *rows)

    def begin(self, measured: Array, rows: Any = slice(None)) -> None:
        """Start episodes in `rows`, at rest at the measurements (rows, k)."""
        self.past.measured[rows] = measured
        _begin(self.past, self._all[rows])

    def act(self, share: Array, rows: Any = slice(None)) -> None:
        """Append the frames of `rows`, with the actions (n,) that follow them."""
        if self.observed.history:
            _act(self.past, self._all[rows], np.array(share, np.float64))

    def add(self, measured: Array, rows: Any = slice(None)) -> None:
        """Take new measurements (rows, k), and update the play operators."""
        self.past.measured[rows] = measured
        if self.observed.memory:
            _follow(self.past, self._all[rows])

    def take(self, other: "ObservationHistory") -> None:
        """Copy measurements, plays and earlier frames of a history of equal shape."""
        for own, its in zip(self.past[1:], other.past[1:], strict=True):
            own[...] = its

    def observation(self) -> NDArray[np.float32]:
        whole = np.empty((len(self.past.measured), self.size))
        write_observation(self.past, whole, 0)
        return whole.astype(np.float32)


@internal
def _frame_value(past: Past, row: int, place: int) -> float:
    """Return number `place` of the present frame, scaled and cut as in `Observed`."""
    measured = past.measured
    value = measured[row, place]
    if place == MOTOR_ANGLE:
        value = value / past.ratio - measured[row, JOINT_ANGLE]
    elif place == MOTOR_VELOCITY:
        value = value / past.ratio
    elif place == JOINT_TORQUE:
        value = measured[row, DESIRED_TORQUE] - value
    value = max(value / past.units[place], -OBSERVATION_LIMIT)
    return float(min(value, OBSERVATION_LIMIT))


@internal
def _play_angle(past: Past, row: int, play: int) -> float:
    """Return the input of a play operator: angle of the motor or of the joint [rad]."""
    if 2 * play < past.reach.size:
        return float(past.measured[row, MOTOR_ANGLE] / past.ratio)
    return float(past.measured[row, JOINT_ANGLE])


@internal
def begin_past(past: Past, row: int) -> None:
    """Reset plays and earlier frames of a row, as if at rest at its measurements."""
    for play in range(past.reach.size):
        past.plays[row, play] = _play_angle(past, row, play)
    width = past.units.size
    for k in range(past.frames.shape[1]):
        for place in range(width):
            past.frames[row, k, place] = _frame_value(past, row, place)
        past.frames[row, k, width] = 0.0


@internal
def act_past(past: Past, row: int, share: float) -> None:
    width, frames = past.units.size, past.frames
    for k in range(frames.shape[1] - 1, 0, -1):
        for place in range(width + 1):
            frames[row, k, place] = frames[row, k - 1, place]
    if frames.shape[1] > 0:
        for place in range(width):
            frames[row, 0, place] = _frame_value(past, row, place)
        frames[row, 0, width] = share


@internal
def follow_past(past: Past, row: int) -> None:
    for play in range(past.reach.size):
        angle, reach = _play_angle(past, row, play), past.reach[play]
        near = max(past.plays[row, play], angle - reach)
        past.plays[row, play] = min(near, angle + reach)


@internal
def write_row(past: Past, row: int, whole: FloatMatrix, first: int) -> None:
    """Write the observation of a row into `whole[row]`, from column `first` on."""
    width = past.units.size
    for i in range(width):
        whole[row, first + i] = np.float32(_frame_value(past, row, i))
    place = first + width
    for play in range(past.reach.size):
        moved = _play_angle(past, row, play) - past.plays[row, play]
        whole[row, place + play] = np.float32(moved / past.reach[play])
    place = place + past.reach.size
    for k in range(past.frames.shape[1]):
        for i in range(width + 1):
            whole[row, place + i] = np.float32(past.frames[row, k, i])
        place = place + width + 1


@compiled
def write_observation(past: Past, whole: FloatMatrix, first: int) -> None:
    """Write the observations of all rows as float32 values, from column `first` on."""
    for row in range(whole.shape[0]):
        write_row(past, row, whole, first)


@compiled
def _begin(past: Past, rows: IntArray) -> None:
    for i in range(rows.size):
        begin_past(past, rows[i])


@compiled
def _act(past: Past, rows: IntArray, share: FloatArray) -> None:
    for i in range(rows.size):
        act_past(past, rows[i], share[rows[i]])


@compiled
def _follow(past: Past, rows: IntArray) -> None:
    for i in range(rows.size):
        follow_past(past, rows[i])
