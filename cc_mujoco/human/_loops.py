"""Course of a joint that goes through loops of many sizes, to calibrate hysteresis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco._validation import require_parameter
from cc_mujoco.human._motion import (
    Array,
    Motion,
    Scripted,
    episode_fraction,
    minimum_jerk,
    pointwise,
)

RISE, FALL, LAST = 0.15, 0.4, 0.15
"""Shares of the episode until the swing is full and from which it shrinks, and what is
left of it at the end."""


@dataclass(frozen=True)
class Loops(Scripted):
    """A slow sine about an angle whose swing grows from rest and then shrinks.

    Phase: fraction of the episode.
    """

    amplitude: float = 0.5
    centre: float = 0.0
    """Angle about which it swings, and where it begins at rest [rad]."""
    frequency: float = 0.3
    """Frequency [Hz]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_parameter(self, "centre", -10.0, 10.0, "rad")
        require_parameter(self, "frequency", 1e-3, 50.0, "Hz")

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        rise, fall = RISE * duration, (1.0 - FALL) * duration
        up = minimum_jerk(time / rise)
        down = minimum_jerk((time - FALL * duration) / fall)
        lost = 1.0 - LAST
        share = up.value * (1.0 - lost * down.value)
        rate = (
            up.rate / rise * (1.0 - lost * down.value)
            - up.value * lost * down.rate / fall
        )
        curvature = (
            up.curvature / rise**2 * (1.0 - lost * down.value)
            - 2.0 * lost * up.rate / rise * down.rate / fall
            - up.value * lost * down.curvature / fall**2
        )
        omega = 2.0 * math.pi * self.frequency
        sine, cosine = np.sin(omega * time), np.cos(omega * time)
        size = self.amplitude
        speed = rate * sine + share * omega * cosine
        bent = (curvature - share * omega**2) * sine + 2.0 * rate * omega * cosine
        return Motion(
            time,
            self.centre + size * share * sine,
            size * speed,
            size * bent,
            episode_fraction(time, duration),
        )
