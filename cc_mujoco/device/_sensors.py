"""Sensors of a device and their quality: encoder steps, noise and delay.

Encoders count in steps; velocities are differences of counts through a low-pass. The
joint torque sensor and the tension sensors along the cables have white noise. All
measurements, and the desired torque, are late by a number of control steps.

    drive = sensing.equip(env.unwrapped.drive)     # with tension sensors
    measuring = Measuring(sensing, drive, ("flexor", "extensor"), seed, steps)
    torque = controller.torque(measuring.measure(info))
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.arguments import MAX_FORCE, numbers, require_kind
from cc_mujoco._validation import require_parameter
from cc_mujoco.device._axis_columns import axis_columns
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array

# Devices are known before MuJoCo is loaded.
if TYPE_CHECKING:
    from cc_mujoco.cable import Cable
    from cc_mujoco.device._drive import Drive


MEASURED_COLUMNS = (
    "motor_angle_rad", "motor_velocity_rad_s", "joint_angle_rad",
    "joint_velocity_rad_s", "joint_torque_nm", "desired_torque_nm", "phase_sine",
    "phase_cosine",
)  # fmt: skip
"""Columns that a controller may read: encoders, joint torque sensor, task, and phase of
the gait cycle. Names are those of an episode log, hence keys of `info`. Cable tensions,
slip, slack and the wearer's intention are known only to the simulation."""

WINDING_COLUMNS = ("winding_angle_rad", "winding_velocity_rad_s", "leverage_ratio")
"""Further readings for controllers with a model: angle and velocity of the round
pulley, of the joint's neutral arm, that would move the cable's distal end equally, and
the present arm over the neutral one. They follow from the encoders of all joints that
the cable passes."""

RATIO_COLUMN = "torque_ratio_{joint}"
"""Further reading if the cables of an axis pass the joint of another: torque at that
joint per torque of the motor, without friction in the present pose, signed [-]."""

REFERENCE_COLUMN = "reference_angle_rad"
"""Further reading if `Drive.commands_angle`: the desired angle of the joint."""

JOINT_COLUMNS = (*MEASURED_COLUMNS[2:6], *WINDING_COLUMNS)
"""Readings that need a sensor at the joint, from which the desired torque follows too;
`RATIO_COLUMN` is another."""

TENSION_COLUMN = "tension_sensors_n"
"""Further reading if there are `Drive.sensors`: (..., cables, sensors) [N]."""


@dataclass(frozen=True)
class Sensors:
    """Tension sensors along a cable."""

    nodes: tuple[int, ...]
    """Node of every sensor, 0 is the proximal end."""
    deviation: tuple[float, ...]
    """Standard deviation of the noise of each [N]."""

    def __post_init__(self) -> None:
        for name in ("nodes", "deviation"):
            require_kind(f"Sensors.{name}", getattr(self, name), tuple)
        if not self.nodes or len(self.nodes) != len(self.deviation):
            raise CableError(
                f"sensors have {len(self.nodes)} nodes and {len(self.deviation)} "
                "deviations; give one of each per sensor"
            )
        for node, deviation in zip(self.nodes, self.deviation, strict=True):
            label = f"deviation of the sensor at node {node!r:.80}"
            numbers("Sensors.nodes", node, ())
            if numbers(label, deviation, (), MAX_FORCE, "N") <= 0.0:
                raise CableError(f"{label} is {deviation!r} N; it must be positive")

    @classmethod
    def at(
        cls, cable: Cable, positions: Sequence[float], deviation: ArrayLike
    ) -> Sensors:
        """Return sensors at the nodes nearest to `positions`.

        `positions` (m,) are distances from the proximal end [m]; `deviation` is the
        standard deviation of each sensor (m,) or of all [N].
        """
        own, places = _node_places(cable), np.ravel(numbers("positions", positions))
        for position in places:
            if not 0.0 <= position <= cable.length:
                raise CableError(
                    f"a sensor is at {position:g} m; the cable has {cable.length:g} m"
                )
        index = np.interp(places, own, np.arange(cable.segments + 1))
        nodes = tuple(round(i) for i in index.tolist())
        return cls(nodes, _per_sensor(deviation, len(nodes)))

    @classmethod
    def everywhere(cls, cable: Cable, deviation: ArrayLike) -> Sensors:
        """Return a sensor at each of the n + 1 nodes of a cable.

        `deviation` is the standard deviation of each sensor (n + 1,) or of all [N].
        """
        nodes = range(len(_node_places(cable)))
        return cls(tuple(nodes), _per_sensor(deviation, len(nodes)))

    def on(self, cable: Cable) -> NDArray[np.intp]:
        """Return the node indices (sensors,), after a check that `cable` has them."""
        for node in self.nodes:
            if not 0 <= node <= cable.segments:
                raise CableError(
                    f"a sensor is at node {node}; the cable has nodes 0 to "
                    f"{cable.segments}"
                )
        return np.array(self.nodes)


def _node_places(cable: Cable) -> Array:
    """Return the positions of a cable's nodes from its proximal end (n + 1,) [m]."""
    from cc_mujoco.cable import Cable
    from cc_mujoco.cable._conduit import node_places

    require_kind("cable", cable, Cable)
    return node_places(cable)


def _per_sensor(deviation: ArrayLike, count: int) -> tuple[float, ...]:
    given = numbers("deviation", deviation)
    if given.shape not in ((), (count,)):
        raise CableError(
            f"deviation has shape {given.shape}; it must be one number, or {count}"
        )
    return tuple(np.broadcast_to(given, count).tolist())


@dataclass(frozen=True)
class Sensing:
    """Quality of a device's sensors: noise, encoder steps, velocity filter, delay."""

    torque_noise: float
    """Standard deviation of the joint torque sensor [N m]."""
    tension_noise: float
    """Standard deviation of every tension sensor [N]."""
    motor_steps: float = 16384.0
    """Steps of the motor's encoder in a turn; 0 is a perfect one, of velocity too."""
    joint_steps: float = 131072.0
    """Steps of the joint's encoder in a turn; 0 is a perfect one, of velocity too."""
    cutoff: float = 100.0
    """Cutoff of the low-pass of both velocities [Hz]; infinite for none."""
    delay: int = 1
    """Control steps by which measurements are late."""
    joint_sensor: bool = True
    """False if a controller reads neither angle nor torque of the joint, nor
    tensions."""

    def __post_init__(self) -> None:
        for name in ("torque_noise", "tension_noise"):
            require_parameter(self, name, 0.0, 1e6, "")
        for name in ("motor_steps", "joint_steps"):
            require_parameter(self, name, 0.0, 1e12, "steps")
        require_parameter(self, "cutoff", 1e-3, math.inf, "Hz")
        if not (isinstance(self.delay, int) and 0 <= self.delay <= 1000):
            raise CableError(
                f"Sensing.delay must be 0 to 1000 whole steps, not {self.delay!r}."
            )
        if not isinstance(self.joint_sensor, bool):
            raise CableError(
                f"Sensing.joint_sensor must be True or False, not "
                f"{self.joint_sensor!r}."
            )

    def equip(self, drive: Drive, **changed: Any) -> Drive:
        """Return a drive with these sensors, and with other fields `changed`.

        It has tension sensors at both ends and the middle of every cable, the delay,
        and the noise of the torque sensor; without a joint sensor it has the delay
        alone.
        """
        changed |= {"delay": self.delay, "sensors": ()}
        if self.joint_sensor:
            deviations = (max(self.tension_noise, 1e-6),) * 3
            for cable in (one.cable for one in drive.cables):
                half = 0.5 * cable.length * (1.0 + 1e-9)
                # The middle is the last node of the proximal half.
                middle = np.searchsorted(_node_places(cable), half, side="right") - 1
                nodes = 0, int(middle), cable.segments
                changed["sensors"] += (Sensors(nodes, deviations),)
            changed["torque_noise"] = self.torque_noise
        return dataclasses.replace(drive, joint_sensor=self.joint_sensor, **changed)

    def to_json(self) -> dict[str, float | None]:
        """Return the fields as a dictionary for JSON; an infinite `cutoff` is None."""
        fields = dataclasses.asdict(self)
        return {n: v if math.isfinite(v) else None for n, v in fields.items()}


BIAS = 2.0  # standard deviation of a sensor's random bias, as a multiple of its noise

PERFECT_SENSING = Sensing(0.0, 0.0, 0.0, 0.0, cutoff=math.inf, delay=0)
"""Sensors without noise, steps, filter or delay."""


class Measuring:
    """Sensors of one environment, or of n, during an episode.

    A reading is the true value, rounded to encoder steps or with the noise of this
    control step, and arrives late. Tensions, and readings of them, are at least 0.
    """

    def __init__(
        self,
        sensing: Sensing,
        drive: Drive,
        cables: Sequence[str],
        seeds: int | Sequence[int],
        steps: int,
        *,
        delay: ArrayLike | None = None,
        noise: ArrayLike = 1.0,
        bias: ArrayLike = 0.0,
    ) -> None:
        """Draw the noise of the episode.

        `seeds` is one seed, or one for each of n environments; a seed alone determines
        the noise of its environment. `cables` are the names in the columns; () reads no
        tensions. `steps` is the number of control steps. `delay` [control steps]
        replaces that of `sensing`; `noise` is a factor of its noise; `bias` shifts the
        torque and tension sensors, as a multiple of their noise. Each is one number, or
        one per environment.
        """
        self._sensing = sensing
        self._commands_angle = drive.commands_angle
        self._ratios = tuple(RATIO_COLUMN.format(joint=j) for j in drive.shared_ratios)
        sensors = zip(cables, drive.sensors, strict=True) if drive.sensors else ()
        tapped = sensors if cables else ()
        self._taps = [(f"tension_{n}_nodes_n", _node_index(s.nodes)) for n, s in tapped]
        self._shape = len(self._taps), len(drive.sensors[0].nodes) if self._taps else 0
        self._period = drive.period
        self._share = -math.expm1(-2.0 * math.pi * sensing.cutoff * drive.period)
        shape = np.shape(seeds)
        self._rows = tuple(np.arange(count) for count in shape)
        self._errors: Array | None = None
        if sensing.torque_noise or sensing.tension_noise:
            width = 1 + math.prod(self._shape)
            scale = np.full(width, sensing.tension_noise)
            scale[0] = sensing.torque_noise
            self._errors = np.empty((steps + 1, *shape, width))
            factors = np.broadcast_to(noise, shape)
            biases = np.broadcast_to(bias, (*shape, width))
            for row in np.ndindex(shape):
                random = np.random.default_rng([int(np.asarray(seeds)[row]), 1])
                drawn = factors[row] * random.normal(size=(steps + 1, width))
                self._errors[(slice(None), *row)] = scale * (drawn + biases[row])
        late = sensing.delay if delay is None else delay
        self._delays = np.array(np.broadcast_to(late, shape), dtype=np.intp)
        self._size = int(self._delays.max(initial=0)) + 1
        self._step = 0
        self._last: dict[str, Any] = {}
        self._kept: dict[str, Array] = {}

    def measure(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Return the readings of the next control step, in new arrays.

        `columns` has the true values: `MEASURED_COLUMNS`, and as needed
        `WINDING_COLUMNS`, ratios, the reference angle, and the node tensions of every
        cable. They are numbers and (nodes,), or (n,) and (n, nodes) of n environments.
        Readings have the same names, with `TENSION_COLUMN` for the tensions. Without a
        joint sensor none is of `JOINT_COLUMNS`.
        """
        self._last = seen = self._read(columns)
        late = seen if self._size == 1 else self._delayed(seen)
        self._step += 1
        return late

    def _read(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        sensing, errors = self._sensing, None
        names = [*MEASURED_COLUMNS]
        if WINDING_COLUMNS[0] in columns:
            names += WINDING_COLUMNS
        if self._commands_angle:
            names.append(REFERENCE_COLUMN)
        names += self._ratios
        if not sensing.joint_sensor:
            unseen = {*JOINT_COLUMNS, *self._ratios}
            names = [name for name in names if name not in unseen]
        seen = {name: copy.copy(columns[name]) for name in names}
        if self._errors is not None and sensing.joint_sensor:
            errors = self._errors[min(self._step, len(self._errors) - 1)]
            seen["joint_torque_nm"] = seen["joint_torque_nm"] + errors[..., 0]
        self._encode("motor", sensing.motor_steps, seen)
        if "joint_angle_rad" in seen:
            self._encode("joint", sensing.joint_steps, seen)
        if WINDING_COLUMNS[0] in seen:
            self._encode("winding", sensing.joint_steps, seen)
        if self._taps:
            # `np.stack` takes several times as long for small arrays.
            tensions = np.empty((*np.shape(seen["motor_angle_rad"]), *self._shape))
            for place, (name, nodes) in enumerate(self._taps):
                tensions[..., place, :] = columns[name][..., nodes]
            np.maximum(tensions, 0.0, out=tensions)
            if errors is not None:
                tensions += errors[..., 1:].reshape(tensions.shape)
                np.maximum(tensions, 0.0, out=tensions)
            seen[TENSION_COLUMN] = tensions
        return seen

    def _encode(self, side: str, steps: float, seen: dict[str, Any]) -> None:
        """Round the angle of `side` to `steps` per turn; write a filtered velocity."""
        if not steps and self._share == 1.0:
            return
        angle, rate = f"{side}_angle_rad", f"{side}_velocity_rad_s"
        if steps:
            unit = 2.0 * math.pi / steps
            seen[angle] = unit * np.round(seen[angle] / unit)
            before = self._last.get(angle, seen[angle])
            seen[rate] = (seen[angle] - before) / self._period
        if self._share < 1.0:
            before = self._last.get(rate, seen[rate])
            seen[rate] = before + self._share * (seen[rate] - before)

    def _delayed(self, seen: Mapping[str, Any]) -> dict[str, Any]:
        """Return the readings that arrive now, and store those of this step."""
        found = {}
        for name, value in seen.items():
            if name not in self._kept:
                # Before the first measurement arrives there is the one at rest.
                self._kept[name] = np.repeat(np.asarray(value)[None], self._size, 0)
            kept = self._kept[name]
            kept[self._step % self._size] = value
            late = (self._step - self._delays) % self._size
            found[name] = kept[(late, *self._rows)].copy()
        return found


class AxesMeasuring:
    """Sensors of all axes of a device, each with its own noise and delay."""

    def __init__(self, prefixes: Sequence[str], axes: Sequence[Measuring]) -> None:
        self._prefixes, self._axes = tuple(prefixes), tuple(axes)

    def measure(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        if len(self._axes) == 1:
            return self._axes[0].measure(columns)
        found: dict[str, Any] = {}
        for prefix, axis in zip(self._prefixes, self._axes, strict=True):
            seen = axis.measure(axis_columns(columns, prefix, self._prefixes))
            found |= {prefix + name: value for name, value in seen.items()}
        return found


def _node_index(nodes: Sequence[int]) -> Any:
    """Return an index that selects nodes of an array: a slice if equally spaced."""
    spacings = set(np.diff(nodes).tolist())
    if len(spacings) == 1 and (step := spacings.pop()) > 0:
        return slice(nodes[0], nodes[-1] + 1, step)
    return np.array(nodes)
