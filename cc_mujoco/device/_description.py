"""Description of a device: its axes, and the properties that MJCF cannot express.

    knee.device.toml, beside knee.xml

        meaning = "knee exoskeleton, pulled straight by one Bowden cable"
        trajectory = "sine"

        [axis]
        motor = "knee_motor"          # actuator
        joint = "knee"
        safe_torque = 40              # N m

        [wearer.knee]
        actuator = "human"            # or stiffness = 300, damping = 6

Every key is optional; `_derivation` derives or assumes those that are missing.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.device._axis_columns import column_prefixes
from cc_mujoco.device._sensors import Sensing
from cc_mujoco.errors import CableError

ENDING = ".device.toml"  # ending of the file beside a scene

PERIOD = 1e-3
"""Time between two calls of a controller, unless a device says otherwise [s]."""


@dataclass(frozen=True)
class Slip:
    """Friction of an axis's cables, from which its safe joint torque is derived."""

    friction: float = 0.0  # friction coefficient times wrap
    rest: float = 0.0  # torque of the pretension that holds two cables taut [N m]

    def held(self, torque: float) -> float:
        """Return the motor torque, referred to the joint, that moves a load [N m]."""
        taut = torque + self.rest * self.friction
        return max(torque * math.exp(self.friction), taut)

    def safe_torque(self, demand: float) -> float:
        """Return a safe joint torque with room for `demand`, at least twice it [N m].

        A motor that holds the demand against friction overshoots it by twice that
        friction when the joint reverses, before a controller can respond.
        """
        turned = demand + 2.0 * (self.held(demand) - demand)
        return rounded(max(2.0 * demand, turned))


@dataclass(frozen=True)
class Cuff:
    """Compliance between a device and the limb that it is strapped to.

    The cables turn a frame about the axis of the joint. A spring and a damper connect
    it to the limb: torque = stiffness times deflection + damping times deflection rate.
    """

    stiffness: float  # above 0 [N m/rad]
    damping: float  # at least 0 [N m s/rad]
    inertia: float  # inertia of the frame about the axis [kg m^2]
    tendon: str  # tendon that is the spring and the damper


@dataclass(frozen=True)
class Axis:
    """A motor, the cables that it winds and the joint that they drive."""

    name: str  # name in columns, variables and options of a device with several axes
    motor: str  # actuator of the motor
    drum: str  # joint that the motor turns
    joint: str  # joint that the cables drive
    limb: str
    """Joint that the wearer moves there: that of the cables, or the one behind the
    cuff."""
    cables: tuple[str, ...]  # cables that the motor winds
    pull_pull: bool
    """True if two cables keep each other taut; both slack is then a failure."""
    torque: float  # largest torque of the motor at its drum [N m]
    reach: float
    """Amplitude limit of built-in trajectories about `centre` [rad]; leaves room before
    the stops."""
    centre: float  # angle about which built-in trajectories move [rad]
    torque_scale: float  # torque error that costs a reward of 1 per second [N m]
    units: Mapping[str, float]
    """Observed columns by name, and the value that divides each; see `Observed`."""
    task: str  # default task: torque that the device renders at the joint
    safe_torque: float = math.inf
    """Largest torque that the cables may put into the joint of a wearer [N m]."""
    safe_is_assumed: bool = False
    """True if `safe_torque` is not given, but follows from motor and task."""
    slip: Slip = Slip()
    """Friction of the cables, from which an assumed `safe_torque` follows."""
    safe_speed: float = math.inf
    """Speed of that joint beyond which the motor brakes [rad/s]."""
    safe_power: float = math.inf
    """Power of the cables into that joint beyond which the motor brakes [W]."""
    motor_pulley: float = 0.0
    """Inertia of the motor's pulley about its axis [kg m^2], which grows as radius^4;
    0 where unknown."""
    gearing: float | None = None
    """Turns of the rotor per turn of the motor's pulley; None if the scene has a geared
    motor and does not state its ratio."""
    joint_pulley: float = 0.0
    """Inertia of the joint's pulley [kg m^2]; 0 for a lever, which keeps its own."""
    lever: tuple[str, ...] = ()
    """Sites that move with the lever: the two ends of the free rope at the joint."""
    cuff: Cuff | None = None
    """Compliance between frame and limb; None where they are one body."""


@dataclass(frozen=True)
class Description:
    """Axes, wearer, sensors, default motion and ropes of a device."""

    scene: str  # name of a built-in scene, or path of an MJCF file
    meaning: str  # description of the device in a line
    axes: tuple[Axis, ...]  # axes, at least one
    movers: Mapping[str, str]
    """Joints that the wearer moves, and the actuators that do so, as springs and
    dampers."""
    sensing: Sensing  # quality of the measurements
    trajectory: str  # default motion of the wearer
    strength: float = math.nan  # breaking load of a cable [N]; NaN where unknown
    diameter: float = math.nan  # diameter of a cable [m]; NaN where unknown
    period: float = PERIOD  # time between two calls of a controller [s]
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)
    """Origin of each property by its key in the file: `given`, `scene` (derived from
    it) or `assumed`."""
    hysteresis: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(
        default_factory=dict
    )
    """Parameters of position controllers by axis and name, see `_device_files`."""

    def axis(self, name: str | None = None) -> Axis:
        """Return the axis called `name`; a device with a single axis needs no name.

        Raises:
            CableError: No axis has that name, or no name is given for several axes.
        """
        named = {axis.name: axis for axis in self.axes}
        if name is None and len(named) == 1:
            return self.axes[0]
        if name is None:
            raise CableError(
                f"device {self.scene!r} has the axes {', '.join(named)}; name one."
            )
        if name not in named:
            raise CableError.unknown(f"axis of device {self.scene!r}", name, named)
        return named[name]

    def limbs(self, first: Axis) -> tuple[str, ...]:
        """Return the wearer's joints at all axes, that of the axis `first` first."""
        return tuple(dict.fromkeys(axis.limb for axis in (first, *self.axes)))

    def frame_skip(self, timestep: float) -> int:
        """Return the physics steps of `timestep` [s] in a period; refuse a fraction."""
        steps = round(self.period / timestep)
        if steps < 1 or abs(steps * timestep - self.period) > 1e-9:
            raise CableError(
                f"device {self.scene!r}: the control period of {1e3 * self.period:g} "
                f"ms must be a whole number of time steps of {1e3 * timestep:g} ms; "
                "change `timestep` in <option>, or `period` in the description, for "
                f"example period = {max(steps, 1) * timestep:g}."
            )
        return steps

    @property
    def prefixes(self) -> tuple[str, ...]:
        """Prefix of each axis's log columns: `NAME.`, or "" for a single axis."""
        return column_prefixes(axis.name for axis in self.axes)


def device_label(scene: str) -> str:
    """Return the name of a device for tables: its path without folder and ending."""
    name = Path(scene).name
    return name.removesuffix(ENDING) if name.endswith(ENDING) else Path(name).stem


GIVEN, SCENE, ASSUMED = "given", "scene", "assumed"  # origins of a property


class Keys(NamedTuple):
    """Reader of a table that notes the origin of each value or default in `sources`."""

    table: Table
    sources: dict[str, str]  # origins by key, written
    label: str = ""  # beginning of the keys in `sources`

    def given(self, key: str, value: Any, default: Any, origin: str = ASSUMED) -> Any:
        """Return `value` or, if None, `default`; note the origin of the one used."""
        self.sources[self.label + key] = origin if value is None else GIVEN
        return default if value is None else value

    def text(self, key: str, default: str) -> str:
        return str(self.given(key, self.table.text(key), default))

    def number(
        self,
        key: str,
        default: float,
        origin: str = ASSUMED,
        low: float = 0.0,
        high: float = math.inf,
    ) -> float:
        value = self.table.number(key, low)
        if value is not None and value > high:
            raise self.table.wrong(key, f"at most {high:.4g}, in SI units and radians")
        return float(self.given(key, value, default, origin))


def rounded(value: float, digits: int = 2) -> float:
    return float(f"{value:.{digits}g}")
