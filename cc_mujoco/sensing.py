"""Measurements of a device and their quality: steps, noise and delay.

Encoders count in steps; velocities are differences of counts through a low-pass. The
joint torque sensor and the tension sensors along the cables have white noise. All that
is measured, the desired torque too, comes late by whole control steps.

    drive = sensing.equip(env.unwrapped.drive)     # as good as these tension sensors
    measuring = Measuring(sensing, drive, ("flexor", "extensor"), seed, steps)
    torque = controller.torque(measuring.measure(info))
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cc_mujoco.checks import parameter
from cc_mujoco.errors import CableError

# Devices are known before MuJoCo and Numba are loaded.
if TYPE_CHECKING:
    from cc_mujoco.control import Drive
    from cc_mujoco.transmission import Cable

MEASURED = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "joint_angle_rad",
    "joint_velocity_rad_s",
    "joint_torque_nm",
    "desired_torque_nm",
    "phase_sine",
    "phase_cosine",
)
"""All that a controller may read: encoders, a joint torque sensor, the task, and the
phase of the gait cycle.

The names are those of the columns of an episode log, hence keys of `info`. Cable
tensions, slip, slack and the wearer's intention are known to a simulation alone.
"""

WINDING = ("winding_angle_rad", "winding_velocity_rad_s", "leverage_ratio")
"""Further readings of a controller with a model: what the encoders of all joints on a
cable's way say of its distal end, as if it were wound on a round pulley of the neutral
arm, and the arm of the joint over that one.
"""

TENSIONS = "tension_sensors_n"
"""Further measurement where `Drive.sensors` says so: (..., cables, sensors) [N].
"""


@dataclass(frozen=True)
class Sensors:
    """Tension sensors along a cable.

    Attributes:
        nodes: node of every sensor, 0 is the proximal end.
        deviation: standard deviation of the noise of each [N].

    Raises:
        CableError: not one positive deviation per sensor, or no sensor.
    """

    nodes: tuple[int, ...]
    deviation: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.nodes or len(self.nodes) != len(self.deviation):
            raise CableError(
                f"sensors have {len(self.nodes)} nodes and {len(self.deviation)} "
                "deviations; give one of each per sensor"
            )
        for node, deviation in zip(self.nodes, self.deviation, strict=True):
            if not (np.isfinite(deviation) and deviation > 0.0):
                raise CableError(
                    f"the sensor at node {node} has deviation {deviation!r} N; "
                    "it must be positive and finite"
                )

    @classmethod
    def at(
        cls, cable: Cable, positions: Sequence[float], deviation: ArrayLike
    ) -> Sensors:
        """Sensors at the nodes nearest to these places [m] from the proximal end.

        Args:
            cable: the cable.
            positions: of the sensors along the conduit [m].
            deviation: of each (m,), or one for all [N].

        Raises:
            CableError: a place off the cable.
        """
        for position in positions:
            if not 0.0 <= position <= cable.length:
                raise CableError(
                    f"a sensor is at {position:g} m; the cable has {cable.length:g} m"
                )
        from cc_mujoco.transmission.conduit import node_places

        index = np.interp(positions, node_places(cable), np.arange(cable.segments + 1))
        nodes = tuple(round(i) for i in index.tolist())
        return cls(nodes, tuple(np.broadcast_to(deviation, len(nodes)).tolist()))

    @classmethod
    def everywhere(cls, cable: Cable, deviation: ArrayLike) -> Sensors:
        """One sensor at every node, with deviations (n + 1,) or one for all [N]."""
        nodes = range(cable.segments + 1)
        return cls(tuple(nodes), tuple(np.broadcast_to(deviation, len(nodes)).tolist()))

    def on(self, cable: Cable) -> NDArray[np.intp]:
        """The nodes as an array, when all of them are on the cable.

        Raises:
            CableError: a node that the cable does not have.
        """
        for node in self.nodes:
            if not 0 <= node <= cable.segments:
                raise CableError(
                    f"a sensor is at node {node}; the cable has nodes 0 to "
                    f"{cable.segments}"
                )
        return np.array(self.nodes)


@dataclass(frozen=True)
class Sensing:
    """Quality of the measurements of a device."""

    torque_noise: float
    """Standard deviation of the joint torque sensor [Nm]."""
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

    def __post_init__(self) -> None:
        """Refuse sensors that cannot be."""
        for name in ("torque_noise", "tension_noise"):
            parameter(self, name, 0.0, 1e6, "")
        for name in ("motor_steps", "joint_steps"):
            parameter(self, name, 0.0, 1e12, "steps")
        parameter(self, "cutoff", 1e-3, math.inf, "Hz")
        if not (isinstance(self.delay, int) and 0 <= self.delay <= 1000):
            raise CableError(
                f"Sensing.delay must be 0 to 1000 whole steps, not {self.delay!r}."
            )

    def equip(self, drive: Drive) -> Drive:
        """A drive that is measured like this.

        It has tension sensors at both ends and the middle of every cable, and knows how
        late its measurements are and how noisy its torque sensor.
        """
        deviation = max(self.tension_noise, 1e-6)
        sensors = tuple(
            Sensors((0, _middle(cable), cable.segments), (deviation,) * 3)
            for cable in (cable_drive.cable for cable_drive in drive.cables)
        )
        return dataclasses.replace(
            drive, sensors=sensors, delay=self.delay, torque_noise=self.torque_noise
        )

    def to_json(self) -> dict[str, float | None]:
        """The fields as plain JSON; an infinite `cutoff` is null."""
        fields = dataclasses.asdict(self)
        return {n: v if math.isfinite(v) else None for n, v in fields.items()}


def _middle(cable: Cable) -> int:
    """The last node of the proximal half."""
    from cc_mujoco.transmission.conduit import node_places

    half = 0.5 * cable.length * (1.0 + 1e-9)
    return int(np.searchsorted(node_places(cable), half, side="right")) - 1


PERFECT = Sensing(0.0, 0.0, 0.0, 0.0, cutoff=math.inf, delay=0)
"""Sensors that tell the truth at once."""


class Measuring:
    """Sensors of one environment, or of many, during one episode."""

    def __init__(
        self,
        sensing: Sensing,
        drive: Drive,
        cables: Sequence[str],
        seeds: int | Sequence[int],
        steps: int,
    ) -> None:
        """Draw the noise of the episode.

        Args:
            sensing: The sensors.
            drive: Says where tension sensors are.
            cables: Names of the cables, as in the columns.
            seeds: Of one environment, or one for each of many; each alone determines
                that one's noise.
            steps: Control steps of the episode.
        """
        self._sensing = sensing
        sensors = zip(cables, drive.sensors, strict=True) if drive.sensors else ()
        self._taps = [
            (f"tension_{name}_nodes_n", _index(s.nodes)) for name, s in sensors
        ]
        self._shape = len(self._taps), len(drive.sensors[0].nodes) if self._taps else 0
        self._period = drive.period
        self._share = -math.expm1(-2.0 * math.pi * sensing.cutoff * drive.period)
        self._noise: NDArray[np.float64] | None = None
        if sensing.torque_noise or sensing.tension_noise:
            width = 1 + math.prod(self._shape)
            draws = [
                np.random.default_rng([seed, 1]).normal(size=(steps + 1, width))
                for seed in np.atleast_1d(seeds)
            ]
            self._noise = np.stack(draws, axis=1) if np.ndim(seeds) else draws[0]
        self._step = 0
        self._last: dict[str, Any] = {}
        self._late: list[dict[str, Any]] = []

    def measure(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Return what the controller reads of the columns of this step.

        Args:
            columns: `MEASURED`, perhaps `WINDING` and, where the drive has tension
                sensors, the tensions of the nodes of every cable, which may be below 0
                where it is slack: numbers and (nodes,), or of n environments (n,) and
                (n, nodes).

        Returns:
            `MEASURED`, `WINDING` if it was there and, where there are such sensors,
            `TENSIONS`; nothing in it is shared with the columns.
        """
        sensing = self._sensing
        noise = None if self._noise is None else self._noise[self._step]
        names = (*MEASURED, *WINDING) if WINDING[0] in columns else MEASURED
        seen = {name: _own(columns[name]) for name in names}
        if noise is not None:
            seen["joint_torque_nm"] = (
                seen["joint_torque_nm"] + sensing.torque_noise * noise[..., 0]
            )
        self._encode("motor", sensing.motor_steps, seen)
        self._encode("joint", sensing.joint_steps, seen)
        if WINDING[0] in seen:
            self._encode("winding", sensing.joint_steps, seen)
        if self._taps:
            # `np.stack` takes several times as long for small arrays.
            told = np.empty((*np.shape(seen["joint_angle_rad"]), *self._shape))
            for place, (name, nodes) in enumerate(self._taps):
                told[..., place, :] = columns[name][..., nodes]
            if noise is not None:
                told += sensing.tension_noise * noise[..., 1:].reshape(told.shape)
            seen[TENSIONS] = np.maximum(told, 0.0, out=told)
        self._last, self._step = seen, self._step + 1
        self._late.append(seen)
        # Before the first measurement arrives there is the one at rest.
        if len(self._late) > sensing.delay + 1:
            self._late.pop(0)
        return self._late[0]

    def _encode(self, side: str, steps: float, seen: dict[str, Any]) -> None:
        """Round an angle to steps of an encoder, and take the velocity from it."""
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


def _own(value: Any) -> Any:
    """An array that nobody else holds; a number as it is."""
    return value.copy() if isinstance(value, np.ndarray) else value


def _index(nodes: Sequence[int]) -> Any:
    """Return the index of nodes in an array: a slice (faster) where equally apart."""
    apart = set(np.diff(nodes).tolist())
    if len(apart) == 1 and (step := apart.pop()) > 0:
        return slice(nodes[0], nodes[-1] + 1, step)
    return np.array(nodes)
