"""Seven kinds of motion of both cable ends that exercise every regime of a cable.

    u_proximal, u_distal = motion("two_tones", stretch, np.random.default_rng(1))

The cable is at rest in its pretension at the first sample, so
`u_distal[0] - u_proximal[0]` is the stretch that the pretension causes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ends = tuple[Array, Array]

_LEGS = 20
# Extremes of each number that a seed varies: nominal value last.
_CYCLES, _RATIO, _PHASE = (1.5, 2.5, 2.0), (1.3, 1.9, 1.6), (0.5, 1.3, 1.0)


class _Draw:
    """Numbers of a motion: nominal without a generator, drawn with one."""

    def __init__(self, samples: int, rng: np.random.Generator | None) -> None:
        self.rng = rng
        self.progress = np.linspace(0.0, 1.0, samples)
        self.ramp = np.minimum(4.0 * self.progress, 1.0)
        self.angle = 2.0 * np.pi * self.pick(_CYCLES) * self.progress

    def pick(self, bounds: tuple[float, float, float]) -> float:
        low, high, nominal = bounds
        return nominal if self.rng is None else self.rng.uniform(low, high)

    def tone(self) -> Array:
        """Second tone, zero at the start."""
        ratio, phase = self.pick(_RATIO), self.pick(_PHASE)
        tone: Array = np.sin(ratio * self.angle + phase) - np.sin(phase)
        return tone

    def legs(self) -> Array:
        """Straight legs between random knots in [-1, 1], zero at the start."""
        rng = np.random.default_rng(0) if self.rng is None else self.rng
        knots = np.concatenate([[0.0], rng.uniform(-1.0, 1.0, _LEGS)])
        legs: Array = np.interp(self.progress, np.linspace(0.0, 1.0, _LEGS + 1), knots)
        return legs


def _distal_locked(draw: _Draw) -> Ends:
    return -np.sin(draw.angle), np.zeros_like(draw.angle)


def _proximal_locked(draw: _Draw) -> Ends:
    return np.zeros_like(draw.angle), np.sin(draw.angle)


def _both_follow(draw: _Draw) -> Ends:
    return np.sin(draw.angle), np.sin(draw.angle) + 0.15 * draw.ramp


def _opposed_stretch_release(draw: _Draw) -> Ends:
    pull = 0.5 * (1.0 - np.cos(draw.angle))
    return -draw.pick((0.5, 1.1, 0.8)) * pull, pull


def _two_tones(draw: _Draw) -> Ends:
    return -draw.ramp * np.sin(draw.angle), 1.5 * draw.ramp + 0.15 * draw.tone()


def _slack_and_back(draw: _Draw) -> Ends:
    return -draw.ramp * np.sin(draw.angle), 0.5 * draw.tone()


def _random_reversals(draw: _Draw) -> Ends:
    return draw.legs(), 1.1 * draw.ramp + 0.9 * draw.legs()


MOTIONS: dict[str, Callable[[_Draw], Ends]] = {
    "distal_locked": _distal_locked,
    "proximal_locked": _proximal_locked,
    "both_follow": _both_follow,
    "opposed_stretch_release": _opposed_stretch_release,
    "two_tones": _two_tones,
    "slack_and_back": _slack_and_back,
    "random_reversals": _random_reversals,
}


def motion(
    name: str,
    cable_pretension_stretch: float,
    rng: np.random.Generator | None = None,
    samples: int = 4000,
    amplitude: float | None = None,
) -> Ends:
    """Displacement of both cable ends over one motion.

    Args:
        name: A key of `MOTIONS`.
        cable_pretension_stretch: Stretch of the whole cable at rest [m].
        rng: Draws cycles, tones, phases and legs, and scales the amplitude by 0.7 to
            1.3; without one the motion has its nominal shape.
        samples: Number of samples.
        amplitude: Amplitude of the ends [m]; four times the stretch at rest if omitted.

    Returns:
        Displacement of the proximal and of the distal end [m], (samples,) each.

    Raises:
        KeyError: No motion has this name.
    """
    draw = _Draw(samples, rng)
    scale = 4.0 * cable_pretension_stretch if amplitude is None else amplitude
    scale *= draw.pick((0.7, 1.3, 1.0))
    proximal, distal = MOTIONS[name](draw)
    return scale * proximal, cable_pretension_stretch + scale * distal
