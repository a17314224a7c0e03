"""Motion of one joint of a scripted human, and the shapes it is made of.

    >>> import numpy as np
    >>> from cc_mujoco.human import TRAJECTORIES
    >>> motion = TRAJECTORIES["sine"].sample(4.0, 0.002, np.random.default_rng(0))
    >>> motion.angle.shape, float(motion.angle[0]), float(motion.velocity[0])
    ((2001,), 0.0, 0.0)

Promises kept by every trajectory: `velocity` and `acceleration` are the analytic
derivatives of `angle`; the motion starts at rest, so that an episode can begin without
a jerk; it is a function of its parameters, the duration and the random generator,
sampled and not changed by the time step. Scripted motions start at angle 0 (`walk`: at
heel strike of the gait cycle) and their acceleration is continuous and starts at 0;
recorded ones start at their first angle.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._validation import require_parameter
from cc_mujoco.errors import CableError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """A joint's motion, sampled at equal steps; all arrays have shape (n + 1,)."""

    time: Array
    """Time from the start of the episode [s]."""
    angle: Array
    """Joint angle [rad]."""
    velocity: Array
    """Time derivative of `angle` [rad/s]."""
    acceleration: Array
    """Time derivative of `velocity` [rad/s^2]."""
    phase: Array
    """Fraction of the gait cycle, or of the trajectory's own period, in [0, 1);
    the fraction of the episode where a trajectory has no period."""
    companions: Mapping[str, Motion] = field(default_factory=dict)
    """Motions of joints that belong together: `ankle`, `knee`, `hip` of `walk`. A
    device whose joint is one of them is moved by that one."""
    measured: Array | None = None
    """Phase of the measured walk in which the leg is as far; None where that is
    `phase`."""


class Trajectory(ABC):
    """A recipe for a motion; subclasses are frozen dataclasses of its parameters."""

    def sample(self, duration: float, dt: float, rng: np.random.Generator) -> Motion:
        """Make the motion of one episode.

        Args:
            duration: Length of the episode [s], rounded to whole steps.
            dt: Time between samples [s].
            rng: Source of every random choice; unused by trajectories without any.

        Returns:
            The motion at times 0, dt, ..., n dt with n = round(duration / dt).

        Raises:
            CableError: If `duration` or `dt` is not a positive finite number, or if
                `dt` is longer than the episode.
        """
        for name, value in (("duration", duration), ("dt", dt)):
            if not (math.isfinite(value) and value > 0):
                raise CableError(
                    f"{name} must be a positive number of seconds, not {value!r}."
                )
        if dt > duration:
            raise CableError(
                f"dt must not exceed the duration of {duration:g} s, but is {dt:g} s."
            )
        steps = round(duration / dt)
        time: Array = np.arange(steps + 1, dtype=np.float64) * dt
        return self._motion(time, steps * dt, rng)

    @abstractmethod
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        """Evaluate the trajectory at the times (n + 1,) of an episode."""


@dataclass(frozen=True)
class Scripted(Trajectory):
    """A trajectory that never leaves the band of plus or minus its amplitude."""

    amplitude: float
    """Bound on the absolute angle [rad]."""

    def __post_init__(self) -> None:
        """Refuse parameters that describe no motion."""
        require_parameter(self, "amplitude", 0.001, 2 * math.pi, "rad")


class Ease(NamedTuple):
    """The smooth step from 0 to 1 on [0, 1]: its integral, value and derivatives."""

    integral: Array
    value: Array
    rate: Array
    curvature: Array


def minimum_jerk(x: Array) -> Ease:
    """Evaluate the minimum-jerk step s(x) = 10 x^3 - 15 x^4 + 6 x^5.

    s is 0 before x = 0 and 1 after x = 1, with continuous first and second derivatives;
    it is the straight reach of least jerk (Flash and Hogan, 1985, J. Neurosci. 5(7)).

    Args:
        x: Normalised time [-].

    Returns:
        Integral of s from 0, s, ds/dx and d2s/dx2, each of the shape of `x`.
    """
    y = np.clip(x, 0.0, 1.0)
    after = np.maximum(x - 1.0, 0.0)
    return Ease(
        y**4 * (2.5 + y * (y - 3.0)) + after,
        y**3 * (10.0 + y * (6.0 * y - 15.0)),
        30.0 * (y * (1.0 - y)) ** 2,
        60.0 * y * (1.0 - y) * (1.0 - 2.0 * y),
    )


def cycle_fraction(time: Array, period: float) -> Array:
    """Return the fraction of the current period, in [0, 1)."""
    return np.asarray(np.mod(time / period, 1.0))


def episode_fraction(time: Array, duration: float) -> Array:
    """Return the fraction of the episode, kept below 1."""
    return np.minimum(time / duration, np.nextafter(1.0, 0.0))
