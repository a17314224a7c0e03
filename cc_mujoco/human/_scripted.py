"""Scripted trajectories by name: sines, sweeps, reaches, walking and others.

Periodic signals are multiplied by a minimum-jerk step (`_motion.minimum_jerk`), so that
they start at rest at angle 0. Moves from point to point are such steps; in `Ramp`, the
velocity rises and falls as one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco._validation import bounded, require_parameter
from cc_mujoco.errors import CableError
from cc_mujoco.human import _gait as gait
from cc_mujoco.human._gait import GaitJoint, gait_joints
from cc_mujoco.human._motion import (
    Motion,
    Scripted,
    cycle_fraction,
    episode_fraction,
    minimum_jerk,
    pointwise,
)
from cc_mujoco.human._pace import MEASURED_SPEED, SCENE_WEARER, Body, Pace
from cc_mujoco.native import FloatArray as Array


@dataclass(frozen=True)
class Sine(Scripted):
    """Sine that grows from rest to its full amplitude.

    Phase: the sine's own period.
    """

    amplitude: float = 0.4
    frequency: float = bounded(0.5, 1e-3, 50.0, "Hz")
    fade: float = bounded(1.0, 0.01, 1e4, "s")  # growth of the amplitude from 0

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        omega = 2 * math.pi * self.frequency
        sine, cosine = np.sin(omega * time), np.cos(omega * time)
        carrier = sine, omega * cosine, -(omega**2) * sine
        return _fade_in(self, time, carrier, cycle_fraction(time, 1 / self.frequency))


@dataclass(frozen=True)
class Chirp(Scripted):
    """Sine whose frequency grows exponentially over the episode.

    Every octave takes the same time. Phase: fraction of the episode.
    """

    amplitude: float = 0.3
    low: float = bounded(0.1, 1e-3, 50.0, "Hz")  # frequency at the start
    high: float = bounded(2.0, 1e-3, 50.0, "Hz")  # and at the end of the episode
    fade: float = bounded(1.0, 0.01, 1e4, "s")  # growth of the amplitude from 0

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_order(self, "low", "high", "Hz")

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        growth = math.log(self.high / self.low) / duration
        omega = 2 * math.pi * self.low * np.exp(growth * time)
        turn = 2 * math.pi * self.low * np.expm1(growth * time) / growth
        sine, cosine = np.sin(turn), np.cos(turn)
        carrier = sine, omega * cosine, omega * growth * cosine - omega**2 * sine
        return _fade_in(self, time, carrier, episode_fraction(time, duration))


@dataclass(frozen=True)
class Multisine(Scripted):
    """Sum of sines at every multiple of 1 / period in a band, with random phases.

    Amplitudes fall with 1 / frequency, so that all have the same velocity. Of `draws`
    random sets of phases the one with the lowest crest factor (peak over RMS) is kept.
    Phase: the signal's own period.
    """

    amplitude: float = 0.4
    low: float = bounded(0.1, 1e-3, 50.0, "Hz")  # lowest frequency
    high: float = bounded(1.5, 1e-3, 50.0, "Hz")  # highest frequency
    period: float = bounded(10.0, 0.01, 1e4, "s")
    draws: int = bounded(32, 1, 10_000, "sets of phases")  # that compete
    fade: float = bounded(1.0, 0.01, 1e4, "s")  # growth of the amplitude from 0

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_order(self, "low", "high", "Hz")
        lines = self._lines().size
        if not 1 <= lines <= 1000:
            raise CableError(
                f"Multisine must have 1 to 1000 lines, but {lines} multiples of "
                f"1 / {self.period:g} s lie in {self.low:g} to {self.high:g} Hz."
            )

    def _lines(self) -> Array:
        """Return the integers k for which k / period is in the band, ends included."""
        first = max(math.ceil(self.low * self.period - 1e-9), 1)
        last = math.floor(self.high * self.period + 1e-9)
        return np.arange(first, last + 1, dtype=np.float64)

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        lines = self._lines()
        # Between equidistant samples a trigonometric polynomial of degree n rises at
        # most by 1 / cos(pi n / samples) above the largest of them (Ehlich and Zeller,
        # 1964), so that the true peak is known to 0.2 %.
        per_cycle = 50
        samples = per_cycle * int(lines[-1])
        grid = 2 * math.pi * np.arange(samples) / samples
        # A Fourier transform gives the sum far faster than the lines one by one do, and
        # to far within 1e-9, so that it shows which draws may be the best.
        spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
        rivals: list[tuple[float, Array]] = []
        lowest = math.inf
        for _ in range(self.draws):
            phases = rng.uniform(0.0, 2 * math.pi, lines.size)
            spectrum[lines.astype(np.intp)] = samples / 2 * np.exp(1j * phases) / lines
            rough = float(np.abs(np.fft.irfft(spectrum, samples)).max())
            lowest = min(rough, lowest)
            if rough <= (1 + 1e-9) * lowest:
                rivals.append((rough, phases))
        # All draws have one RMS, so the lowest peak is the lowest crest factor.
        best, peak = np.zeros_like(lines), math.inf
        for rough, phases in rivals:
            if rough <= (1 + 1e-9) * lowest:
                found = np.abs(_sum_of_cosines(grid, lines, 1 / lines, phases)).max()
                if found < peak:
                    best, peak = phases, float(found)
        weights = math.cos(math.pi / per_cycle) / peak / lines
        omega = 2 * math.pi / self.period
        turn = omega * time
        quarter = math.pi / 2
        carrier = (
            _sum_of_cosines(turn, lines, weights, best),
            omega * _sum_of_cosines(turn, lines, weights * lines, best + quarter),
            omega**2
            * _sum_of_cosines(turn, lines, weights * lines**2, best + 2 * quarter),
        )
        return _fade_in(self, time, carrier, cycle_fraction(time, self.period))


def _sum_of_cosines(turn: Array, lines: Array, weights: Array, phases: Array) -> Array:
    """Return the sum of weight cos(line turn + phase) over lines, at each `turn`."""
    total = np.zeros_like(turn)
    for line, weight, phase in zip(lines, weights, phases, strict=True):
        total += weight * np.cos(line * turn + phase)
    return total


def _require_order(
    owner: Scripted, low: str, high: str, unit: str, or_equal: bool = False
) -> None:
    """Refuse parameters unless `high` > `low` (`high` >= `low` if `or_equal`)."""
    least, most = getattr(owner, low), getattr(owner, high)
    if most < least or (most == least and not or_equal):
        where = type(owner).__name__
        raise CableError(
            f"{where}.{high} must be {'at least' if or_equal else 'above'} "
            f"{where}.{low} = {least:g} {unit}, not {most:g} {unit}."
        )


def _fade_in(
    owner: Sine | Chirp | Multisine,
    time: Array,
    carrier: tuple[Array, Array, Array],
    phase: Array,
) -> Motion:
    """Return the motion of a carrier (with two derivatives) that fades in."""
    size, fade = owner.amplitude, owner.fade
    step, (value, rate, curvature) = minimum_jerk(time / fade), carrier
    growth, bend = step.rate / fade, step.curvature / fade**2
    velocity = growth * value + step.value * rate
    acceleration = bend * value + 2 * growth * rate + step.value * curvature
    angle = size * step.value * value
    return Motion(time, angle, size * velocity, size * acceleration, phase)


@dataclass(frozen=True)
class Loops(Scripted):
    """Slow sine about `centre` whose swing grows from rest and then shrinks.

    Phase: fraction of the episode.
    """

    amplitude: float = 0.5
    centre: float = bounded(0.0, -10.0, 10.0, "rad")  # where it begins at rest
    frequency: float = bounded(0.3, 1e-3, 50.0, "Hz")

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        # The swing is full after 15 % of the episode, shrinks from 40 % on, and has
        # 15 % of its size at the end.
        rise, full, fall = 0.15 * duration, 0.4 * duration, (1.0 - 0.4) * duration
        up, down = minimum_jerk(time / rise), minimum_jerk((time - full) / fall)
        lost = 1.0 - 0.15
        kept = 1.0 - lost * down.value
        share = up.value * kept
        rate = up.rate / rise * kept - up.value * lost * down.rate / fall
        curvature = (
            up.curvature / rise**2 * kept
            - 2.0 * lost * up.rate / rise * down.rate / fall
            - up.value * lost * down.curvature / fall**2
        )
        omega = 2.0 * math.pi * self.frequency
        sine, cosine = np.sin(omega * time), np.cos(omega * time)
        angle = self.centre + self.amplitude * share * sine
        speed = rate * sine + share * omega * cosine
        bent = (curvature - share * omega**2) * sine + 2.0 * rate * omega * cosine
        derivatives = self.amplitude * speed, self.amplitude * bent
        return Motion(time, angle, *derivatives, episode_fraction(time, duration))


@dataclass(frozen=True)
class Sweep(Scripted):
    """Move to one side, hold, move to the other side, hold, and so on.

    Thesis Experiment 2 (section 2.4.4): at least 20 degrees to each side; the default
    is 22.9. The first sweep starts in the middle. Phase: one period has both sweeps.
    """

    amplitude: float = 0.4
    move: float = bounded(1.0, 0.01, 1e4, "s")  # duration of a sweep
    hold: float = bounded(0.5, 0.0, 1e4, "s")  # rest at each side

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        leg = self.move + self.hold
        index = np.floor(time / leg)
        side = np.where(index % 2 == 0, self.amplitude, -self.amplitude)
        start, phase = np.where(index == 0, 0.0, -side), cycle_fraction(time, 2 * leg)
        return _moves(time, index * leg, self.move, (start, side), phase)


@dataclass(frozen=True)
class Ramp(Scripted):
    """Move at constant velocity to the amplitude and back, repeatedly.

    Thesis section 4.3.2: 1.5 rad in 15 s, back to 0 at 30 s. At each end of a leg (one
    way) the velocity rises from 0 or falls to 0 as a minimum-jerk step of duration
    `corner`. A leg still takes its exact time, so that the constant velocity is
    amplitude / (leg - corner), by default 0.7 % above the thesis's. Phase: one period
    has both legs.
    """

    amplitude: float = 1.5
    leg: float = bounded(15.0, 0.01, 1e4, "s")  # time from 0 to the amplitude
    corner: float = 0.1  # duration of each corner [s]; at most half a leg

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
        # The integral of the corners rounds; the amplitude is a promise.
        far = np.where(back, self.amplitude - travel, travel)
        angle = np.clip(far, 0, self.amplitude)
        velocity = signed * (rise.value - fall.value)
        bent = signed * (rise.rate - fall.rate) / self.corner
        return Motion(time, angle, velocity, bent, cycle_fraction(time, 2 * self.leg))


@dataclass(frozen=True)
class _RandomMoves(Scripted):
    """Moves of random durations."""

    amplitude: float = 0.6
    fastest: float = bounded(0.5, 0.01, 1e4, "s")  # shortest move
    slowest: float = bounded(1.5, 0.01, 1e4, "s")  # longest move

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_order(self, "fastest", "slowest", "s", or_equal=True)


@dataclass(frozen=True)
class Reach(_RandomMoves):
    """Minimum-jerk reaches to random targets, with a rest at each.

    Targets, movement times and rests are uniform in their ranges. Phase: fraction of
    the episode.
    """

    longest_dwell: float = bounded(0.8, 0.0, 1e4, "s")  # at a target; shortest is none

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        moves, clock = [], 0.0
        while clock < duration:
            span = rng.uniform(self.fastest, self.slowest)
            moves.append((clock, span, rng.uniform(-self.amplitude, self.amplitude)))
            clock += span + rng.uniform(0.0, self.longest_dwell)
        return _join_moves(time, duration, moves)


@dataclass(frozen=True)
class Reversals(_RandomMoves):
    """Moves of random extent, each in the direction opposite to the last.

    Large and small reversals are mixed, so that the slip that each starts reaches
    different depths of the conduit. Phase: fraction of the episode.
    """

    fastest: float = bounded(0.3, 0.01, 1e4, "s")  # shortest move
    slowest: float = bounded(1.2, 0.01, 1e4, "s")  # longest move
    smallest: float = bounded(0.05, 0.0, 1.0, "of the amplitude")  # extent of a move

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        moves, clock, target = [], 0.0, 0.0
        side = 1.0 if rng.random() < 0.5 else -1.0
        while clock < duration:
            # In the frame turned to the present direction: from below to above. There
            # is always room, because the last move came that far or more.
            low = min(side * target + self.smallest, 1.0)
            target = side * rng.uniform(low, 1.0)
            span = rng.uniform(self.fastest, self.slowest)
            moves.append((clock, span, self.amplitude * target))
            clock += span
            side = -side
        return _join_moves(time, duration, moves)


def _join_moves(
    time: Array, duration: float, moves: list[tuple[float, float, float]]
) -> Motion:
    """Return the motion of moves (start [s], span [s], target [rad]), from angle 0."""
    starts, spans, targets = np.array(moves).T
    index = np.searchsorted(starts, time, side="right") - 1
    ends = np.append(0.0, targets)[index], targets[index]
    phase = episode_fraction(time, duration)
    return _moves(time, starts[index], spans[index], ends, phase)


def _moves(
    time: Array, start: Array, span: Any, ends: tuple[Array, Array], phase: Array
) -> Motion:
    """Return minimum-jerk moves between `ends` [rad], from `start`, in `span` [s]."""
    extent = ends[1] - ends[0]
    step = minimum_jerk((time - start) / span)
    velocity, bent = extent * step.rate / span, extent * step.curvature / span**2
    return Motion(time, ends[0] + extent * step.value, velocity, bent, phase)


@dataclass(frozen=True)
class Walk(Scripted):
    """Level walking: motion of the ankle; its companions are all joints of the leg.

    The cadence grows from 0 at heel strike to its full value in the time `start`, as a
    minimum-jerk step. Phase: the gait cycle. Angles are those of `_gait`, and the
    amplitude of the ankle scales them all. The `speed` changes ranges of motion and the
    phase of toe-off, see `Pace`, but not `period`; `Walk.at` sets both.
    """

    amplitude: float = 0.252  # peak of the ankle in a cycle, rounded up
    period: float = bounded(gait.GAIT_PERIOD, 0.2, 20.0, "s")
    """Duration of a gait cycle at full cadence [s]."""
    start: float = bounded(1.0, 0.01, 1e4, "s")
    """Time in which the cadence grows from 0 [s]."""
    speed: float = MEASURED_SPEED  # [m/s]
    joints: tuple[GaitJoint, ...] = ()
    """Joints of a device that walk; by default one leg's, `ankle`, `knee` and `hip`."""

    @classmethod
    def at(cls, speed: float | None, body: Body = SCENE_WEARER) -> Walk:
        """Return the walk at a speed [m/s], with its stride time.

        `speed` is that of `body`, see `Body.pace`. The field `speed` of the walk is
        that at which the wearer of the scenes walks similarly.
        """
        pace = body.pace(speed)
        return cls(period=gait.GAIT_PERIOD * pace.stride * body.time, speed=pace.speed)

    def on_joints(self, joints: Mapping[str, tuple[float, float]]) -> Walk:
        """Return the walk of a device's joints; see `gait_joints`.

        `joints` are their ranges [rad] by name, that of the driven joint first.
        """
        driven = next(iter(joints))
        found = gait_joints(joints)
        if driven not in {joint.name for joint in found}:
            raise CableError(
                f"a walk moves {', '.join(gait.GAIT_ANGLES)}, and the device drives "
                f"the joint {driven!r}; choose another trajectory, such as 'sine'."
            )
        plain = tuple(GaitJoint(joint.name, joint.name) for joint in found)
        same = driven in gait.GAIT_ANGLES and found == plain
        return self if same else replace(self, joints=found)

    def describe(self) -> str:
        """Return a sentence that lists the joints of the device that walk, and how."""
        each = []
        for joint in self.joints:
            words = f"as {joint.part}"
            words += ", half a cycle later" if joint.other_leg else ""
            words += ", turned" if joint.turned else ""
            words += f", shifted by {joint.shift:g} rad" if joint.shift else ""
            each.append(f"{joint.name} ({words})")
        return f"the walk moves {', '.join(each or gait.GAIT_ANGLES)}"

    @property
    def pace(self) -> Pace:
        """Ratios to the measured walk at this `speed`."""
        return Pace(self.speed)

    def __post_init__(self) -> None:
        super().__post_init__()
        Pace(self.speed)

    @pointwise
    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        step = minimum_jerk(time / self.start)
        cycles = step.integral * self.start / self.period
        rate = step.value / self.period
        acceleration = step.rate / self.start / self.period
        # The default amplitude is the peak rounded up; it means the angles as measured.
        scale = self.amplitude / Walk.amplitude
        pace = self.pace

        def leg(start: float) -> _Leg:
            phase = np.asarray(np.mod(cycles + start, 1.0))
            slowed = pace.slope(phase)
            bent = slowed * acceleration + pace.bend(phase) * rate**2
            return _Leg(phase, pace.phase(phase), slowed * rate, bent)

        def joint(
            leg: _Leg, name: str, far: float, others: dict[str, Motion]
        ) -> Motion:
            profile, at = gait.GAIT_ANGLES[name], leg.measured
            slope = profile.derivative()
            far = far * pace.excursion(name)
            bent = slope.derivative()(at) * leg.rate**2 + slope(at) * leg.acceleration
            velocity = far * slope(at) * leg.rate
            angle = far * profile(at)
            return Motion(time, angle, velocity, far * bent, leg.phase, others, at)

        first = leg(0.0)
        if not self.joints:
            others = {name: joint(first, name, scale, {}) for name in gait.GAIT_ANGLES}
            return joint(first, "ankle", scale, others)
        legs = {False: first, True: leg(0.5)}
        moved = {}
        for one in self.joints:
            far = -scale if one.turned else scale
            motion = joint(legs[one.other_leg], one.part, far, {})
            moved[one.name] = replace(motion, angle=motion.angle + one.shift)
        return replace(moved[self.joints[0].name], companions=moved)


class _Leg(NamedTuple):
    """Phase of a leg (n + 1,), that of the measured walk, and two derivatives of it."""

    phase: Array
    measured: Array
    rate: Array
    acceleration: Array


TRAJECTORIES: dict[str, Scripted] = {
    "sweep": Sweep(),
    "ramp": Ramp(),
    "sine": Sine(),
    "chirp": Chirp(),
    "multisine": Multisine(),
    "reach": Reach(),
    "reversals": Reversals(),
    "walk": Walk(),
}
"""Every scripted trajectory with its default parameters."""
