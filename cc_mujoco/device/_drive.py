"""Drive of a device as its controller knows it: motor, ratio, cables, sensors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cc_mujoco._validation import require_parameter
from cc_mujoco.cable._cable import Cable
from cc_mujoco.device._observation import Observed
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class CableDrive:
    """Cable between the pulleys of motor and joint, with data-sheet values.

    Displacements of a cable are positive from the motor to the joint: a cable that a
    positive motor angle draws in has a negative `proximal`.
    """

    cable: Cable
    proximal: float
    """Displacement of the proximal end per motor angle [m/rad], signed."""
    distal: float
    """Displacement of the distal end per joint angle [m/rad], signed."""

    def __post_init__(self) -> None:
        for name in ("proximal", "distal"):
            value = getattr(self, name)
            require_parameter(self, name, -math.inf, math.inf, "")
            if not (math.isfinite(value) and value != 0.0):
                raise CableError(
                    f"CableDrive.{name} must be a finite length other than 0, "
                    f"not {value!r} m."
                )


@dataclass(frozen=True)
class Drive:
    """Axis as its controller knows it: data sheet, transmission ratio, sensors."""

    ratio: float
    """Joint torque per motor torque without friction, signed [-]."""
    low: float
    """Least torque of the motor [N m]."""
    high: float
    """Greatest torque of the motor [N m]."""
    period: float
    """Time between two calls of a controller [s]."""
    one_way: bool = False
    """True if the cables transmit only positive motor torque, as one cable pulls and no
    other pulls back."""
    cables: tuple[CableDrive, ...] = ()
    """The cables, as far as they are known. Controllers with a model need them."""
    sensors: tuple[Sensors, ...] = ()
    """Tension sensors along every cable, where the device has them."""
    inertia: float = 0.0
    """Inertia of the motor with its pulley, by its data sheet [kg m^2]."""
    damping: float = 0.0
    """Damping of the motor's bearings [N m s/rad]."""
    joint_inertia: float = 0.0
    """Inertia of the joint with its limb in the neutral pose [kg m^2]; 0: unknown."""
    delay: int = 0
    """Delay of the measurements in control steps."""
    torque_noise: float = 0.0
    """Standard deviation of the joint torque sensor [N m]."""
    motor_lag: float = 0.0
    """Time constant of the motor's torque behind its command, first order [s]."""
    torque_rate: float = math.inf
    """Largest rate of the commanded torque that the host allows [N m/s]."""
    safe_torque: float = math.inf
    """Largest torque that the cables may put into the joint [N m]; of a lever, in the
    neutral pose. Well below it, controllers that measure a torque release the joint,
    see `guard`."""
    safe_speed: float = math.inf
    """Speed of the joint above which those controllers brake the motor [rad/s]."""
    safe_power: float = math.inf
    """Power of the cables into the joint above which they brake the motor [W]."""
    crossed: tuple[str, ...] = ()
    """Joints besides the driven one that move the cables' distal ends. Controllers with
    a model then need `device.WINDING_COLUMNS`."""
    joint: str = ""
    """Name of the driven joint; empty if nothing depends on it."""
    shared_ratios: Mapping[str, float] = field(default_factory=dict)
    """Joints of other axes that the cables also turn, and the torque there per motor
    torque, without friction in the neutral pose, signed [-]. Controllers that decouple
    axes read `device.RATIO_COLUMN` of each."""
    shared_joint: bool = False
    """True if cables of other axes also turn the joint, so that the measured torque
    includes theirs."""
    lever: bool = False
    """True if the cables pull a lever, whose arm changes with its angle; `distal` is
    the arm in the neutral pose. Controllers with a model then need
    `device.WINDING_COLUMNS`."""
    joint_sensor: bool = True
    """False if a controller reads nothing of the joint."""
    commands_angle: bool = False
    """True if the task commands an angle of the joint, which controllers read as
    `device.REFERENCE_COLUMN`; then `control.POSITION_CONTROLLERS` are the built-in
    ones."""
    joint_neutral: float = 0.0
    """Angle of the joint in the neutral pose [rad]."""
    hysteresis: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Parameters of position controllers by their name, as `control.fit_hysteresis`
    finds them."""
    observed: Observed | None = None
    """Observation of the device's environment; saved policies need it."""

    def __post_init__(self) -> None:
        for name in ("low", "high", "period", "motor_lag", "torque_rate", "ratio"):
            require_parameter(self, name, -math.inf, math.inf, "")
        if not (math.isfinite(self.ratio) and self.ratio != 0.0):
            raise CableError(
                f"Drive.ratio must be a finite number other than 0, not {self.ratio!r}."
            )
        if not self.low < self.high:
            raise CableError(
                f"Drive.low must be below Drive.high = {self.high!r} N m, "
                f"not {self.low!r} N m."
            )
        if not (math.isfinite(self.period) and self.period > 0.0):
            raise CableError(
                f"Drive.period must be a positive number of seconds, "
                f"not {self.period!r}."
            )
        if not 0.0 <= self.motor_lag <= 1.0:
            raise CableError(
                "Drive.motor_lag must be a time constant of 0 to 1 s, not "
                f"{self.motor_lag!r}; 3 ms are 0.003."
            )
        if not self.torque_rate > 0.0:
            raise CableError(
                "Drive.torque_rate must be above 0 N m/s, or math.inf for no limit, "
                f"not {self.torque_rate!r}."
            )
        for name, unit in (("torque", "N m"), ("speed", "rad/s"), ("power", "W")):
            if not getattr(self, f"safe_{name}") > 0.0:
                raise CableError(
                    f"Drive.safe_{name} must be above 0 {unit}, not "
                    f"{getattr(self, f'safe_{name}')!r}."
                )
        if self.sensors and len(self.sensors) != len(self.cables):
            raise CableError(
                f"Drive.sensors must be given for each of the {len(self.cables)} "
                f"cables, not for {len(self.sensors)}."
            )

    @property
    def reach(self) -> tuple[float, float]:
        """Least and greatest joint torque without friction [N m]."""
        ends = self.ratio * (0.0 if self.one_way else self.low), self.ratio * self.high
        return min(ends), max(ends)
