"""Trajectories with an angle added: bumps at random times, or a tremor."""

from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco._validation import bounded, require_bounds, require_parameter
from cc_mujoco.human._motion import Motion, Trajectory
from cc_mujoco.native import FloatArray as Array


@dataclass(frozen=True)
class Disturbed(Trajectory):
    """Trajectory with an angle added to one joint of another trajectory, `base`.

    Phase and other joints are those of `base`.
    """

    base: Trajectory
    joint: str = ""  # to which the angle is added, if the trajectory has several

    def __post_init__(self) -> None:
        require_bounds(self)

    @abstractmethod
    def added(self, time: Array, duration: float, rng: np.random.Generator) -> Array:
        """Return added angle [rad], velocity and acceleration at the times (3, n)."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        step = float(time[1] - time[0])
        motion = self.base.sample(duration, step, rng)
        by = self.added(time, duration, rng)
        companions = dict(motion.companions)
        if self.joint in companions:
            companions[self.joint] = _plus(companions[self.joint], by)
        return replace(_plus(motion, by), companions=companions)


def unperturbed(source: Trajectory) -> Trajectory:
    while isinstance(source, Disturbed):
        source = source.base
    return source


@dataclass(frozen=True)
class Perturbed(Disturbed):
    """Trajectory with bumps at random times, each out and back to a random side.

    A bump is size 64 x^3 (1 - x)^3, where x goes from 0 to 1 over its width. Its
    acceleration is continuous.
    """

    size: float = bounded(0.1, 0.0, 3.0, "rad")  # largest angle of a bump
    width: float = bounded(0.2, 0.01, 10.0, "s")  # duration of a bump
    pause: float = bounded(0.8, 0.01, 1e3, "s")
    """Mean time from the end of a bump to the next [s]; at least half of it."""

    def added(self, time: Array, duration: float, rng: np.random.Generator) -> Array:
        bumps = np.zeros((3, time.size))
        clock = 1.0  # no bump in the first second
        while True:
            clock += rng.uniform(0.5, 1.5) * self.pause
            side = self.size * (1.0 if rng.random() < 0.5 else -1.0)
            if clock + self.width > duration:
                break
            bumps += side * self._bump(time - clock)
            clock += self.width
        return bumps

    def _bump(self, since: Array) -> Array:
        """Return a bump of size 1 with two derivatives (3, n); `since` in s."""
        x = np.clip(since / self.width, 0.0, 1.0)
        y, slope = x * (1.0 - x), 1.0 - 2.0 * x
        bend = 6.0 * y * (slope**2 - y) / self.width**2
        return 64.0 * np.stack([y**3, 3.0 * y**2 * slope / self.width, bend])


@dataclass(frozen=True)
class Tremor(Disturbed):
    """Trajectory with a tremor: a sine of random phase, added to one joint.

    Its frequency is drawn once per episode. Hands and ankles tremble at 4 to 12 Hz (G.
    Deuschl, P. Bain, M. Brin, "Consensus statement of the Movement Disorder Society on
    tremor", Movement Disorders 13, 1998).
    """

    size: float = bounded(0.02, 0.0, 1.0, "rad")  # amplitude
    low: float = bounded(4.0, 0.1, 50.0, "Hz")  # least frequency
    high: float = 8.0  # greatest frequency [Hz]

    def __post_init__(self) -> None:
        super().__post_init__()
        require_parameter(self, "high", self.low, 50.0, "Hz")

    def added(self, time: Array, duration: float, rng: np.random.Generator) -> Array:
        """Return the sine, faded in over 0.5 s, and its derivatives (3, n)."""
        rate = 2.0 * np.pi * rng.uniform(self.low, self.high)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        grown = 0.5  # time in which it grows to its size [s]
        x = np.clip(time / grown, 0.0, 1.0)
        size = self.size * x * x * (3.0 - 2.0 * x)
        growth = self.size * 6.0 * x * (1.0 - x) / grown
        bend = self.size * 6.0 * (1.0 - 2.0 * x) * (x < 1.0) / grown**2
        sine, cosine = np.sin(rate * time + phase), np.cos(rate * time + phase)
        velocity = growth * sine + size * rate * cosine
        bent = bend * sine + 2.0 * growth * rate * cosine - size * rate**2 * sine
        return np.stack([size * sine, velocity, bent])


def _plus(motion: Motion, by: Array) -> Motion:
    angle, velocity = motion.angle + by[0], motion.velocity + by[1]
    acceleration = motion.acceleration + by[2]
    return replace(motion, angle=angle, velocity=velocity, acceleration=acceleration)
