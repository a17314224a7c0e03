"""Tasks by name: virtual environments that a device should render.

    >>> from cc_mujoco.human import TASKS
    >>> TASKS["tunnel"].torque(angle=0.25, velocity=0.0, phase=0.0)
    -0.1

A task maps joint angle [rad], joint velocity [rad/s] and phase of the cycle [-] to the
torque that the device should put into the joint [N m], in the joint's own direction. It
works elementwise on scalars and arrays and gives the same bits for both.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import bounded, require_bounds
from cc_mujoco.errors import CableError, shown
from cc_mujoco.human import _gait as gait
from cc_mujoco.human._pace import Pace, Real


class Task(ABC):
    """Virtual environment; subclasses are frozen dataclasses of its parameters."""

    of_phase: ClassVar[bool] = False
    """True if the torque depends on `phase` alone; a subclass may set it."""
    of_time: ClassVar[bool] = False
    """True if `phase` is the time since the start [s]; a subclass may set it."""
    about_reference: ClassVar[bool] = False
    """True if `angle` is relative to the trajectory's; a subclass may set it."""
    commands_angle: ClassVar[bool] = False
    """True if the joint should track the trajectory; a subclass may set it. Controllers
    then read the angle as `device.REFERENCE_COLUMN`."""

    __post_init__ = require_bounds

    @property
    def follows_gait(self) -> bool:
        """True if the torque at rest at angle 0 depends on the phase of a gait."""
        phases = np.linspace(0.0, 1.0, 101)
        still = np.zeros_like(phases)
        return not self.of_time and bool(
            np.ptp(task_torque(self, still, still, phases))
        )

    @abstractmethod
    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        """Return the torque that the device should put into the joint [N m].

        `angle` is that of the joint, minus the reference if the task is
        `about_reference` [rad], `velocity` that of the joint [rad/s]. `phase` is the
        fraction of the gait cycle or of the trajectory's period [-], or the time if the
        task is `of_time` [s]. The result has their shape, or is one number for all.
        """


def task_torque(
    task: Task,
    angle: NDArray[np.float64],
    velocity: NDArray[np.float64],
    phase: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the torque of a task [N m] in the shape of `angle`, checked.

    It must be finite where angle and velocity are.
    """
    name = getattr(task, "name", type(task).__name__)
    given = np.asarray(task.torque(angle, velocity, phase))
    if given.dtype.kind not in "fiu" or given.shape not in ((), angle.shape):
        raise CableError(
            f"task {name!r} gave {shown(given.tolist())} at angles of shape "
            f"{angle.shape}; it must give torques in N m of this shape, or one."
        )
    torque: NDArray[np.float64] = np.broadcast_to(given, angle.shape)
    missing = ~np.isfinite(torque) & np.isfinite(angle) & np.isfinite(velocity)
    if missing.any():
        first = tuple(index[0] for index in np.nonzero(missing))
        raise CableError(
            f"task {name!r} gave {torque[first]} N m at angle {angle[first]:.4g} rad, "
            f"velocity {velocity[first]:.4g} rad/s and phase {phase[first]:.4g}; it "
            "must give finite torques."
        )
    return torque


def peak_demand(task: Task, centre: float, reach: float, speed: float) -> float:
    """Return the largest absolute torque that a task demands [N m].

    The joint moves up to `reach` [rad] from `centre` [rad], at up to `speed` [rad/s].
    """
    if task.about_reference:
        centre = reach = 0.0
    angle = np.linspace(centre - reach, centre + reach, 21)[:, None, None]
    velocity = np.array([-speed, 0.0, speed])[:, None]
    # A task of time is looked at for a minute.
    phase = np.linspace(0.0, 60.0 if task.of_time else 1.0, 601)
    grid = (np.ravel(one) for one in np.broadcast_arrays(angle, velocity, phase))
    return float(np.abs(task_torque(task, *grid)).max())


@dataclass(frozen=True)
class Tunnel(Task):
    """A free band with a soft wall on each side, thesis equation 2.29.

    The torque is 0 inside the band. Outside, it is stiffness times depth in the wall,
    towards the band, up to the limit, which by default is reached at 0.45 rad.
    """

    half_width: float = bounded(0.05, 0.0, 10.0, "rad")  # half the free band
    stiffness: float = bounded(0.5, 0.0, 1e6, "N m/rad")  # of the walls
    limit: float = bounded(0.2, 0.0, 1e6, "N m")  # largest torque

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return tunnel_torque(angle, self.half_width, self.stiffness, self.limit)


@dataclass(frozen=True)
class Spring(Task):
    """A spring to angle 0: torque = -stiffness angle (thesis section 4.3.2)."""

    stiffness: float = bounded(1.0, 0.0, 1e6, "N m/rad")

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return spring_torque(angle, self.stiffness)


@dataclass(frozen=True)
class Transparent(Task):
    """No torque: the device should follow the wearer without resistance."""

    of_phase = True

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        # Adding 0.0 turns -0.0 into 0.0.
        return 0.0 * angle + 0.0


@dataclass(frozen=True)
class Assist(Task):
    """Assistance of the ankle's push-off over the gait cycle.

    torque = -peak assistance(phase): plantarflexion, negative because the ankle counts
    dorsiflexion positive. The shape is `assistance` of `_gait`.
    """

    of_phase = True
    peak: float = bounded(30.0, 0.0, 1e6, "N m")  # a quarter of the biological moment

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return -self.peak * gait.assistance(phase)


@dataclass(frozen=True)
class Swing(Task):
    """Assistance of the hip's swing over the gait cycle.

    torque = peak (1 - x^2)^3, flexion, and 0 outside |x| < 1, where x is the phase from
    the peak over half the width of the pulse. It begins in late stance, as the
    biological moment does, and ends as the leg swings; peak and timing are assumed.
    """

    of_phase = True
    peak: float = bounded(10.0, 0.0, 1e6, "N m")  # a seventh of the biological moment
    middle: float = bounded(0.58, 0.0, 1.0, "")  # phase of the peak
    half_width: float = bounded(0.18, 0.01, 0.5, "")  # from the peak to its end

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        away = clamp((phase - self.middle) / self.half_width, -1.0, 1.0)
        inside = 1.0 - away * away
        return self.peak * (inside * inside * inside)


@dataclass(frozen=True)
class Hold(Task):
    """A constant torque, as of a fingertip that presses on something."""

    of_phase = True
    pull: float = bounded(-0.15, -1e6, 1e6, "N m")  # 2.7 N at 55 mm from a knuckle

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return 0.0 * angle + self.pull


@dataclass(frozen=True)
class Impedance(Task):
    """A spring and a damper about the angle of the played trajectory.

    torque = -stiffness (angle - reference) - damping velocity, an impedance as in N.
    Hogan, "Impedance control: an approach to manipulation", J. Dynamic Systems,
    Measurement, and Control 107, 1985, without its inertia.
    """

    about_reference = True
    stiffness: float = bounded(1.0, 0.0, 1e6, "N m/rad")
    damping: float = bounded(0.02, 0.0, 1e6, "N m s/rad")

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return -self.stiffness * angle - self.damping * velocity


@dataclass(frozen=True)
class Position(Task):
    """Angle of the played trajectory, to be tracked at any torque."""

    commands_angle = True

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return 0.0 * angle + 0.0


TASKS: dict[str, Task] = {
    "tunnel": Tunnel(),
    "spring": Spring(),
    "transparent": Transparent(),
    "assist": Assist(),
    "swing": Swing(),
    "hold": Hold(),
    "impedance": Impedance(),
    "position": Position(),
}
"""Every virtual environment with its default parameters."""


# `simulation._compiled_episode` compiles what follows.
def tunnel_torque(
    angle: Real, half_width: float, stiffness: float, limit: float
) -> Real:
    """Return the torque [N m] of `Tunnel` at a joint angle [rad]."""
    wall = stiffness * (clamp(angle, -half_width, half_width) - angle)
    return clamp(wall, -limit, limit)


def spring_torque(angle: Real, stiffness: float) -> Real:
    """Return the torque [N m] of `Spring` at a joint angle [rad]."""
    return -stiffness * angle


def clamp(value: Real, low: float, high: float) -> Real:
    """Limit a number or array to [low, high]; faster on scalars than `np.clip`."""
    if isinstance(value, np.ndarray):
        return np.clip(value, low, high)
    return min(max(value, low), high)


@dataclass(frozen=True)
class Paced(Task):
    """Task of the measured walk, `base`, for a walk at another speed.

    torque = share base(angle, velocity, w(phase)), with w of `Pace.phase`: the torque
    keeps its place relative to heel strike and toe-off.
    """

    of_phase = True
    base: Task  # of the phase alone, at the speed of the measured walk
    pace: Pace
    share: float = 1.0  # torque over that of `base` [-]

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        return self.share * self.base.torque(angle, velocity, self.pace.phase(phase))


def scale_task(task: Task, pace: Pace, size: float = 1.0) -> Task:
    """Return a task scaled to another wearer or walking speed.

    `task` is for the scenes' wearer at the measured speed; `size` is the ratio of
    moments of the two wearers [-], see `Body.moment`. `Assist` and `Swing` scale with
    the moment of their joint and follow the stride; profiles and other tasks stay
    unchanged.
    """
    if pace == Pace() and size == 1.0:
        return task
    if isinstance(task, Assist):
        return Paced(task, pace, size * pace.moment("ankle"))
    if isinstance(task, Swing):
        return Paced(task, pace, size * pace.moment("hip"))
    return task
