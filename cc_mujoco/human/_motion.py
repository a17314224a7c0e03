"""Motion of a joint of a scripted human, base of all trajectories, and smooth steps.

    >>> import numpy as np
    >>> from cc_mujoco.human import TRAJECTORIES
    >>> motion = TRAJECTORIES["sine"].sample(4.0, 0.002, np.random.default_rng(0))
    >>> motion.angle.shape, float(motion.angle[0]), float(motion.velocity[0])
    ((2001,), 0.0, 0.0)

In every trajectory `velocity` and `acceleration` are the analytic derivatives of
`angle`. It starts at rest, so that an episode begins without a jerk. It is a function
of its parameters, the duration and the random generator; the time step samples it and
does not change it. Scripted motions start at angle 0 (`walk`: at heel strike of the
gait cycle) with a continuous acceleration from 0; recorded ones start at their first
angle.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._validation import require_bounds, require_parameter
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray as Array


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a joint, sampled at equal steps; all arrays have shape (n + 1,)."""

    time: Array  # from the start of the episode [s]
    angle: Array  # of the joint [rad]
    velocity: Array  # time derivative of `angle` [rad/s]
    acceleration: Array  # time derivative of `velocity` [rad/s^2]
    phase: Array
    """Fraction of the gait cycle, or of the trajectory's own period, in [0, 1);
    the fraction of the episode where a trajectory has no period."""
    companions: Mapping[str, Motion] = field(default_factory=dict)
    """Motions of other joints by name: `ankle`, `knee`, `hip` of `walk`. If a device
    drives one of these joints, it follows that motion."""
    measured: Array | None = None
    """Phase of the measured walk at equal progress of the leg; None: it is `phase`."""

    def part(self, first: int, end: int) -> Motion:
        """Return the samples with indices from `first` to `end` - 1."""
        arrays = {
            one.name: value[first:end]
            for one in fields(self)
            if isinstance(value := getattr(self, one.name), np.ndarray)
        }
        others = {name: one.part(first, end) for name, one in self.companions.items()}
        return replace(self, companions=others, **arrays)


MotionFunction = Callable[[Any, Array, float, np.random.Generator], Motion]

_POINTWISE: set[MotionFunction] = set()


def pointwise(function: MotionFunction) -> MotionFunction:
    """Mark a `Trajectory._motion` that computes each sample from its own time only.

    Its random numbers must not depend on the times. A long motion is then sampled in
    parts.
    """
    _POINTWISE.add(function)
    return function


class Trajectory(ABC):
    """Rule for a motion; subclasses are frozen dataclasses of its parameters."""

    def sample(self, duration: float, dt: float, rng: np.random.Generator) -> Motion:
        """Return the motion of an episode at the times 0, `dt`, ..., n `dt` [s].

        n is `duration` / `dt`, rounded; both are positive, and `dt` is no longer than
        the episode. `rng` is the source of all random numbers.
        """
        steps = _sample_steps(duration, dt)
        time: Array = np.arange(steps + 1, dtype=np.float64) * dt
        return self._motion(time, steps * dt, rng)

    @property
    def is_pointwise(self) -> bool:
        """True if each sample follows from its own time only; see `pointwise`."""
        return type(self)._motion in _POINTWISE

    @abstractmethod
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        """Return the motion at times (n + 1,) of an episode of `duration` [s]."""


class SampledMotion:
    """Motion of one episode in parts that equal `Trajectory.sample` bit for bit.

    If the trajectory `is_pointwise` and the episode has at least `rows` steps, each
    part is computed on request and not kept; else the whole motion is in memory.
    """

    def __init__(
        self,
        source: Trajectory,
        duration: float,
        dt: float,
        rng: np.random.Generator,
        rows: int,
    ) -> None:
        """Sample the motion now unless it `is_pointwise` and has `rows` steps."""
        self._source, self._dt = source, dt
        self._steps = _sample_steps(duration, dt)
        self._rng = copy.deepcopy(rng)
        self._whole: Motion | None = None
        if self._steps < rows or not source.is_pointwise:
            self._whole = source.sample(duration, dt, rng)
        else:
            source._motion(np.zeros(1), self._steps * dt, rng)

    def part(self, first: int, end: int) -> Motion:
        if self._whole is not None:
            return self._whole.part(first, end)
        time: Array = np.arange(first, end, dtype=np.float64) * self._dt
        rng = copy.deepcopy(self._rng)
        return self._source._motion(time, self._steps * self._dt, rng)


def _sample_steps(duration: float, dt: float) -> int:
    for name, value in (("duration", duration), ("dt", dt)):
        if not (math.isfinite(value) and value > 0):
            raise CableError(
                f"{name} must be a positive number of seconds, not {value!r}."
            )
    if dt > duration:
        raise CableError(
            f"dt must not exceed the duration of {duration:g} s, but is {dt:g} s."
        )
    return round(duration / dt)


@dataclass(frozen=True)
class Scripted(Trajectory):
    """Trajectory whose angle stays within plus or minus its amplitude."""

    amplitude: float  # bound on the absolute angle [rad]

    def __post_init__(self) -> None:
        require_parameter(self, "amplitude", 0.001, 2 * math.pi, "rad")
        require_bounds(self)


class Ease(NamedTuple):
    """Smooth step from 0 to 1 on [0, 1]: its integral, value and two derivatives."""

    integral: Array
    value: Array
    rate: Array
    curvature: Array


def minimum_jerk(x: Array) -> Ease:
    """Evaluate the minimum-jerk step s(x) = 10 x^3 - 15 x^4 + 6 x^5.

    s is 0 before x = 0 and 1 after x = 1, with continuous first and second derivatives.
    It is the straight reach of least jerk (Flash and Hogan, 1985, J. Neurosci. 5(7)).
    Returns the integral of s from 0, s, ds/dx and d2s/dx2, each of the shape of `x`.
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
    """Return the phase within a period [s] at each time [s], in [0, 1)."""
    return np.asarray(np.mod(time / period, 1.0))


def episode_fraction(time: Array, duration: float) -> Array:
    """Return the fraction of the episode at each time [s], below 1 at its end too."""
    return np.minimum(time / duration, np.nextafter(1.0, 0.0))
