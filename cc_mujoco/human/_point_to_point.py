"""Trajectories made of point-to-point moves: sweep, ramp, reach, reversals.

Each move is a minimum-jerk step (`_motion.minimum_jerk`); of the ramp, the velocity is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cc_mujoco._validation import bounded, require_parameter
from cc_mujoco.errors import CableError
from cc_mujoco.human._motion import (
    Array,
    Motion,
    Scripted,
    cycle_fraction,
    episode_fraction,
    minimum_jerk,
    pointwise,
)


@dataclass(frozen=True)
class Sweep(Scripted):
    """Sweep to one side, hold, sweep to the other side, hold, and so on.

    Thesis Experiment 2 (section 2.4.4): at least 20 degrees to each side; the default
    is 22.9. The first sweep starts in the middle. Phase: one period is both sweeps.
    """

    amplitude: float = 0.4
    move: float = bounded(1.0, 0.01, 1e4, "s")
    """Duration of a sweep [s]."""
    hold: float = bounded(0.5, 0.0, 1e4, "s")
    """Rest at each side [s]."""

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        leg = self.move + self.hold
        index = np.floor(time / leg)
        side = np.where(index % 2 == 0, self.amplitude, -self.amplitude)
        start = np.where(index == 0, 0.0, -side)
        step = minimum_jerk((time - index * leg) / self.move)
        return Motion(
            time,
            start + (side - start) * step.value,
            (side - start) * step.rate / self.move,
            (side - start) * step.curvature / self.move**2,
            cycle_fraction(time, 2 * leg),
        )


@dataclass(frozen=True)
class Ramp(Scripted):
    """Constant velocity to the amplitude and back, again and again.

    Thesis section 4.3.2: 1.5 rad in 15 s, back to 0 at 30 s. The velocity is constant
    except for a corner at each end of a leg, where it rises from rest or falls to rest
    as a minimum-jerk step; the legs still take exactly their time, so the constant
    velocity is amplitude / (leg - corner), 0.7 % above the thesis's by default.
    Phase: one period is there and back.
    """

    amplitude: float = 1.5
    leg: float = bounded(15.0, 0.01, 1e4, "s")
    """Time from 0 to the amplitude [s]."""
    corner: float = 0.1
    """Duration of each corner [s]; at most half a leg."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_parameter(self, "corner", 0.001, self.leg / 2, "s")

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        index = np.floor(time / self.leg)
        back = index % 2 == 1
        elapsed = time - index * self.leg
        rise = minimum_jerk(elapsed / self.corner)
        fall = minimum_jerk((elapsed - (self.leg - self.corner)) / self.corner)
        speed = self.amplitude / (self.leg - self.corner)
        signed = np.where(back, -speed, speed)
        travel = speed * self.corner * (rise.integral - fall.integral)
        return Motion(
            time,
            # The integral of the corners rounds; the amplitude is a promise.
            np.clip(np.where(back, self.amplitude - travel, travel), 0, self.amplitude),
            signed * (rise.value - fall.value),
            signed * (rise.rate - fall.rate) / self.corner,
            cycle_fraction(time, 2 * self.leg),
        )


@dataclass(frozen=True)
class Reach(Scripted):
    """Minimum-jerk reaches to random targets, with a dwell at each.

    Targets, movement times and dwells are uniform in their ranges. Phase: fraction of
    the episode.
    """

    amplitude: float = 0.6
    fastest: float = bounded(0.5, 0.01, 1e4, "s")
    """Shortest reach [s]."""
    slowest: float = bounded(1.5, 0.01, 1e4, "s")
    """Longest reach [s]."""
    longest_dwell: float = bounded(0.8, 0.0, 1e4, "s")
    """Longest rest at a target [s]; the shortest is none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_range(self)

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        starts, spans, targets, clock = [], [], [], 0.0
        while clock < duration:
            starts.append(clock)
            spans.append(rng.uniform(self.fastest, self.slowest))
            targets.append(rng.uniform(-self.amplitude, self.amplitude))
            clock += spans[-1] + rng.uniform(0.0, self.longest_dwell)
        return _join_moves(time, duration, starts, spans, targets)


@dataclass(frozen=True)
class Reversals(Scripted):
    """Moves of random extent, each in the direction opposite to the last.

    Large and small reversals are mixed, so that motion fronts of every depth enter the
    conduit and meet older ones. Phase: fraction of the episode.
    """

    amplitude: float = 0.6
    fastest: float = bounded(0.3, 0.01, 1e4, "s")
    """Shortest move [s]."""
    slowest: float = bounded(1.2, 0.01, 1e4, "s")
    """Longest move [s]."""
    smallest: float = bounded(0.05, 0.0, 1.0, "of the amplitude")
    """Smallest extent of a move, as a fraction of the amplitude [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_range(self)

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        starts, spans, targets, clock = [], [], [], 0.0
        side, target = (1.0 if rng.random() < 0.5 else -1.0), 0.0
        while clock < duration:
            # In the frame turned to the present direction: from below to above. There
            # is always room, because the last move came that far or more.
            low = min(side * target + self.smallest, 1.0)
            target = side * rng.uniform(low, 1.0)
            starts.append(clock)
            spans.append(rng.uniform(self.fastest, self.slowest))
            targets.append(self.amplitude * target)
            clock += spans[-1]
            side = -side
        return _join_moves(time, duration, starts, spans, targets)


def _require_range(owner: Reach | Reversals) -> None:
    if owner.slowest < owner.fastest:
        where = type(owner).__name__
        raise CableError(
            f"{where}.slowest must be at least {where}.fastest = {owner.fastest:g} s, "
            f"not {owner.slowest:g} s."
        )


def _join_moves(
    time: Array,
    duration: float,
    starts: list[float],
    spans: list[float],
    targets: list[float],
) -> Motion:
    """Join minimum-jerk moves; move i ends at or before the start of move i + 1."""
    index = np.searchsorted(starts, time, side="right") - 1
    origin = np.array([0.0, *targets[:-1]])[index]
    extent = np.array(targets)[index] - origin
    span = np.array(spans)[index]
    step = minimum_jerk((time - np.array(starts)[index]) / span)
    return Motion(
        time,
        origin + extent * step.value,
        extent * step.rate / span,
        extent * step.curvature / span**2,
        episode_fraction(time, duration),
    )
