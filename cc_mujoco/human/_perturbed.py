"""A motion with bumps at random times: something jolts the wearer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco._validation import require_parameter
from cc_mujoco.human._motion import Array, Motion, Trajectory

QUIET_TIME = 1.0
"""Beginning of an episode without bumps [s]."""


@dataclass(frozen=True)
class Perturbed(Trajectory):
    """Another trajectory, jolted: out and back, to a random side, at random times.

    A bump is size 64 x^3 (1 - x)^3, x the time since its beginning over its width, so
    that its acceleration is continuous. Phase and other joints are the other's own.
    """

    base: Trajectory
    """Motion that is jolted."""
    joint: str = ""
    """Joint that is jolted, where the trajectory has companions."""
    size: float = 0.1
    """Largest angle of a bump [rad]."""
    width: float = 0.2
    """Duration of a bump [s]."""
    pause: float = 0.8
    """Mean time from the end of a bump to the next [s]; at least half of it."""

    def __post_init__(self) -> None:
        """Refuse parameters that describe no bump."""
        require_parameter(self, "size", 0.0, 3.0, "rad")
        require_parameter(self, "width", 0.01, 10.0, "s")
        require_parameter(self, "pause", 0.01, 1e3, "s")

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        step = float(time[1] - time[0])
        motion = self.base.sample(duration, step, rng)
        bumps = np.zeros((3, time.size))
        clock = QUIET_TIME
        while True:
            clock += rng.uniform(0.5, 1.5) * self.pause
            side = self.size * (1.0 if rng.random() < 0.5 else -1.0)
            if clock + self.width > duration:
                break
            bumps += side * self._bump(time - clock)
            clock += self.width
        companions = dict(motion.companions)
        if self.joint in companions:
            companions[self.joint] = _add_bumps(companions[self.joint], bumps)
        return replace(_add_bumps(motion, bumps), companions=companions)

    def _bump(self, since: Array) -> Array:
        """Return the angle, velocity and acceleration of a bump of size 1, (3, n)."""
        x = np.clip(since / self.width, 0.0, 1.0)
        y = x * (1.0 - x)
        slope = 1.0 - 2.0 * x
        return 64.0 * np.stack(
            [
                y**3,
                3.0 * y**2 * slope / self.width,
                6.0 * y * (slope**2 - y) / self.width**2,
            ]
        )


def _add_bumps(motion: Motion, by: Array) -> Motion:
    return replace(
        motion,
        angle=motion.angle + by[0],
        velocity=motion.velocity + by[1],
        acceleration=motion.acceleration + by[2],
    )
