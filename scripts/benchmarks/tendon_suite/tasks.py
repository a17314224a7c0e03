"""Tasks of the tendon suite: machines, closed forms and what is measured; no engine.

SI units. There is no gravity: weights are forces along their joints. The rope has no
mass and does not stretch; engines whose ropes do choose a stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

Array = np.ndarray
Vector = tuple[float, float, float]
Setting = dict[str, Any]
DOWN, ALONG_Y = (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)
NO_SLIP = math.inf


class Body(NamedTuple):
    """A body with one joint; its axes are those of the world at the start.

    An end of the rope slides away from the rope; a positive turn of a drum winds it.
    """

    name: str  # of the body and its joint
    place: Vector  # of joint and centre of mass, in the world at the start
    joint: str  # `slide` along the axis, or `hinge` about it
    mass: float
    inertia: float = 1e-3  # about all axes
    axis: Vector = DOWN
    parent: str = ""  # body that carries it; "" is the world


class Bend(NamedTuple):
    """A cylinder along y around which the rope runs.

    The rope arrives at the angle `start`, from +z towards +x, and leaves at `start` +
    `turn`; a negative turn goes the other way round.
    """

    centre: Vector
    radius: float
    start: float
    turn: float
    climb: float = 0.0  # motion along y on the way
    body: str = ""  # that carries the cylinder

    def point(self, share: float, out: float = 1.0) -> Array:
        """Return the point (3,) [m] at a fraction of the arc, at `out` radii."""
        angle, r = self.start + share * self.turn, out * self.radius
        along = (share - 0.5) * self.climb
        return np.add(self.centre, (r * math.sin(angle), along, r * math.cos(angle)))

    def direction(self, share: float) -> Array:
        """Return the direction (3,) of the rope at a fraction of the arc."""
        angle, around = self.start + share * self.turn, self.radius * self.turn
        along = (around * math.cos(angle), self.climb, -around * math.sin(angle))
        return np.array(along) / np.linalg.norm(along)

    @property
    def wrap(self) -> float:
        """Turn of the rope's direction, along a helix too [rad]."""
        around = self.radius * abs(self.turn)
        return abs(self.turn) * around / math.hypot(around, self.climb)


class Machine(NamedTuple):
    """A rope from the body `pull` to the body `load`, with the places of its ends."""

    bodies: tuple[Body, ...]  # parents first
    pull: tuple[str, Vector]
    load: tuple[str, Vector]
    bends: tuple[Bend, ...]  # from `pull` to `load`
    friction: float  # Coulomb's coefficient, or `NO_SLIP`
    tension: float = 10.0  # everywhere at the start
    drum: float = 0.0  # radius of the drum that `pull` is; 0 where the rope is tied

    @property
    def ratio(self) -> float:
        """Largest ratio of the end tensions that friction can hold, at the start."""
        return math.exp(self.friction * sum(bend.wrap for bend in self.bends))

    def turns(self, bend: Bend) -> bool:
        """Return whether a bend is a pulley: it turns about its own axis."""
        return any((b.name, b.place) == (bend.body, bend.centre) for b in self.bodies)


class NotExpressible(Exception):
    """The engine has no element for a machine; the text of the exception says why."""


class Simulation(Protocol):
    """A machine simulated by an engine, from rest."""

    timestep: float

    def step(self, forces: Array) -> None:
        """Advance a step with a force [N] or torque [N m] on every body's joint."""

    def state(self) -> tuple[Array, Array]:
        """Return displacement [m, rad] and velocity of every body's joint (bodies,)."""


class Engine(NamedTuple):
    """An engine; its settings have at least a `timestep`.

    `settings(task, tune)` gives the best one first, with `tune` all that are tried.
    `build(machine, setting)` raises `NotExpressible` if there is no way.
    """

    settings: Callable[[str, bool], list[Setting]]
    build: Callable[[Machine, Setting], Simulation]


Build = Callable[[Machine], Simulation]


class Quantity(NamedTuple):
    """A result, and its value by the closed form; its error is relative to `scale`."""

    name: str
    found: float
    right: float
    scale: float = 0.0

    @property
    def error(self) -> float:
        error = abs(self.found - self.right) / (self.scale or abs(self.right))
        return error if math.isfinite(error) else math.inf


def smooth(share: float) -> float:
    """Return a step from 0 to 1 whose first two derivatives vanish at its ends."""
    x = min(max(share, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


Force = Callable[[float, Array, Array], Array]
RAMP, FREE = 0.15, 0.4
"""Time in which loads rise from the first tension, and time in which they act."""


def play(sim: Simulation, force: Force, seconds: float) -> tuple[Array, Array, Array]:
    """Return times [s], displacements and velocities, under forces from these."""
    states = [sim.state()]
    for k in range(round(seconds / sim.timestep)):
        sim.step(force(k * sim.timestep, *states[-1]))
        states.append(sim.state())
    place, speed = (np.array(each[1:]) for each in zip(*states, strict=True))
    return sim.timestep * np.arange(1, len(states)), place, speed


def accelerate(
    sim: Simulation, rest: Sequence[float], forces: Sequence[float]
) -> tuple[Array, Array]:
    """Raise forces from `rest` to `forces`; return accelerations, displacements."""
    start, rise = np.array(rest), np.subtract(forces, rest)
    time, place, speed = play(
        sim, lambda t, *_: start + smooth(t / RAMP) * rise, RAMP + FREE
    )
    late = time > RAMP + 0.25 * FREE
    slope = np.polyfit(time[late], speed[late], 1)[0]
    return slope, np.ptp(place[time > RAMP], axis=0)


def vector(array: Array) -> Vector:
    x, y, z = np.round(array, 9).tolist()
    return x, y, z


def two_ends(
    bends: Sequence[Bend], friction: float, mass: float = 3.0, free: float = 0.6
) -> Machine:
    """Return a machine of two bodies that slide along the straight ends of a rope."""
    first, last, ends, bodies = bends[0], bends[-1], [], []
    for name, end, away in (
        ("pull", first.point(0.0), -first.direction(0.0)),
        ("load", last.point(1.0), last.direction(1.0)),
    ):
        ends.append((name, vector(end + free * away)))
        bodies.append(Body(*ends[-1], "slide", mass, axis=vector(away)))
    return Machine(tuple(bodies), *ends, tuple(bends), friction)


def slip_ratios(build: Build, machine: Machine) -> Iterator[Quantity]:
    """Yield tension ratios of a machine that slips, in both directions at two loads."""
    ratio, mass, first = machine.ratio, machine.bodies[0].mass, machine.tension
    rest = (first, first)
    for load in (first, 3.0 * first):
        for way, name in (1, f"up at {load:g} N"), (-1, f"down at {load:g} N"):
            forces = np.array((load * (1.3 * ratio) ** way, load))
            pull, past = forces - mass * accelerate(build(machine), rest, forces)[0]
            yield Quantity(f"ratio {name}", (pull / past) ** way, ratio)
            forces = (load * (0.95 * ratio) ** way, load)
            _, crept = accelerate(build(machine), rest, forces)
            free = 0.25 * abs(forces[0] - load) / mass * FREE**2
            yield Quantity(f"creep at 0.95 of the limit {name}", crept[0], 0.0, free)


OVER = Bend((0.0, 0.0, 0.0), 0.05, -math.pi / 2, math.pi)


def capstan(build: Build) -> Iterator[Quantity]:
    """Measure T2 / T1 = exp(mu pi) (Euler 1769; Eytelwein 1808)."""
    yield from slip_ratios(build, two_ends((OVER,), 0.2))


def ladder(build: Build) -> Iterator[Quantity]:
    """Measure T2 / T1 = exp(mu sum(theta)) (Eytelwein) over six posts in a row."""
    radius, gap, bends = 0.03, 0.12, []
    lean = math.asin(2.0 * radius / gap)
    for i in range(6):
        # Above and below in turn; the first and the last bend leave the rope level.
        way, top = (1, 0.0) if i % 2 == 0 else (-1, math.pi)
        start, end = (0.0 if i == 0 else -lean), (0.0 if i == 5 else lean)
        place = (gap * i, 0.0, 0.0)
        bends.append(Bend(place, radius, top + way * start, way * (end - start)))
    yield from slip_ratios(build, two_ends(bends, 0.2))


def helix(build: Build) -> Iterator[Quantity]:
    """Measure T2 / T1 = exp(mu phi cos(beta)) along a helix that climbs by beta.

    Of Konyukhov and Izi, Introduction to Computational Contact Mechanics, 2015.
    """
    bend = Bend((0.0, 0.0, 0.0), 0.05, -math.pi / 2, math.pi, climb=0.1)
    yield from slip_ratios(build, two_ends((bend,), 0.2))


def over_pulley(
    build: Build, friction: float, inertia: float, masses: tuple[float, float],
    loads: Sequence[tuple[float, float]],
) -> Iterator[Quantity]:  # fmt: skip
    """Load two weights over a pulley; the rope slips beyond a ratio of tensions."""
    radius, centre = 0.1, (0.0, 0.0, 0.0)
    ends = [("pull", (-radius, 0.0, -0.8)), ("load", (radius, 0.0, -0.8))]
    weights = [
        Body(*end, "slide", mass) for end, mass in zip(ends, masses, strict=True)
    ]
    pulley = Body("pulley", centre, "hinge", 1.0, inertia, ALONG_Y)
    bend = Bend(centre, radius, -math.pi / 2, math.pi, body="pulley")
    machine = Machine((*weights, pulley), *ends, (bend,), friction)
    ratio, (m1, m2) = machine.ratio, masses
    for a, b in loads:
        speeding = (b - a) / (m1 + m2 + inertia / radius**2)
        turning = speeding / radius
        if b - m2 * speeding > ratio * (a + m1 * speeding):
            speeding = (b - ratio * a) / (m2 + ratio * m1)
            turning = (ratio - 1.0) * (a + m1 * speeding) * radius / inertia
        rest = (machine.tension, machine.tension, 0.0)
        (_, weight, turned), _ = accelerate(build(machine), rest, (a, b, 0.0))
        yield Quantity(f"weight with {a:g} and {b:g} N", weight, speeding)
        yield Quantity(f"pulley with {a:g} and {b:g} N", turned, turning)


def atwood(build: Build) -> Iterator[Quantity]:
    """Measure a = (m2 - m1) g / (m1 + m2 + I / r^2) (Atwood 1784), without slip."""
    loads = ((9.81, 19.62), (18.0, 9.0))
    yield from over_pulley(build, NO_SLIP, 0.02, (1.0, 2.0), loads)


def turning_pulley(build: Build) -> Iterator[Quantity]:
    """Measure Newton's second law as one, or beyond T2 / T1 = exp(mu pi) with slip."""
    loads = ((10.0, 18.0), (10.0, 30.0), (20.0, 36.0), (20.0, 60.0))
    yield from over_pulley(build, 0.1, 0.04, (3.0, 3.0), loads)


def cycles(build: Build, count: int = 100) -> Iterator[Quantity]:
    """Measure the work of closed cycles (R - 1 / R) k (x2^2 - x1^2) / 2.

    It is the integral of Eytelwein's force k x R out to x2 = F2 / (k R), and k x / R
    back to x1 = F1 R / k, against a spring k.
    """
    machine = two_ends((OVER,), 0.2, mass=0.05, free=0.15)
    ratio, first, spring, period = machine.ratio, machine.tension, 1000.0, 0.4
    for low, high, turns in (5.0, 40.0, count), (2.5, 20.0, 2):
        sim, pulls = build(machine), []

        def force(t: float, place: Array, speed: Array) -> Array:
            phase = t / period % 1.0
            share = smooth(2.0 * phase) - smooth(2.0 * phase - 1.0)
            start = low if t >= 0.5 * period else first  # noqa: B023
            # Damped, or it would overshoot where it starts to slip.
            pull = start * (high / start) ** share - 15.0 * speed[0]  # noqa: B023
            pulls.append(pull)  # noqa: B023
            return np.array([pull, first - spring * place[1]])

        place = play(sim, force, turns * period)[1][:, 0]
        work = pulls * np.diff(place, prepend=0.0)
        short, long = low * ratio / spring, high / (ratio * spring)
        right = 0.5 * (ratio - 1.0 / ratio) * spring * (long**2 - short**2)
        cycle = round(period / sim.timestep)
        for k in sorted({1, turns - 1}):
            found = work[k * cycle : (k + 1) * cycle].sum()
            yield Quantity(f"work of cycle {k + 1} up to {high:g} N", found, right)
        drift = place[-cycle:].max() - place[cycle : 2 * cycle].max()
        yield Quantity(f"drift up to {high:g} N", drift, 0.0, long - short)


def finger(build: Build) -> Iterator[Quantity]:
    """Measure T_i = T_(i-1) exp(-+ mu phi_i) with springs k (phi_0 - phi_i) = r T_i."""
    radius, bent, spring, friction, first, seconds = 0.01, 0.6, 0.1, 0.3, 2.0, 3.0
    pull = "pull", (-0.08, 0.0, radius)
    bodies, bends = [Body(*pull, "slide", 0.05, axis=(-1.0, 0.0, 0.0))], []
    at = np.zeros(3)
    for i, length in enumerate((0.05, 0.035, 0.03)):
        parent, joint = f"link{i}" if i else "", vector(at)
        bends.append(Bend(joint, radius, i * bent, bent, body=parent))
        bodies.append(Body(f"link{i + 1}", joint, "hinge", 0.02, 2e-5, ALONG_Y, parent))
        at = at + length * bends[-1].direction(1.0)
    tip = "link3", vector(at + bends[-1].point(1.0) - bends[-1].centre)
    sim = build(Machine(tuple(bodies), pull, tip, tuple(bends), friction, first))
    relaxed = bent + radius * first / spring

    def torque(place: Array, speed: Array) -> Array:
        return spring * (relaxed - bent - place) - 5e-4 * speed

    for start, end, way in (first, 6.0, 1), (6.0, first, -1):

        def force(t: float, place: Array, speed: Array) -> Array:
            pull = start + t / seconds * (end - start)  # noqa: B023
            return np.append(pull, torque(place, speed)[1:])

        # While it moves, as friction may have any value within its limits at rest.
        time, place, speed = play(sim, force, seconds)
        late = time > 0.9 * seconds
        found = torque(place[late], speed[late]).mean(axis=0) / radius
        tension = start + 0.95 * (end - start)
        for i in range(3):
            angle, before = bent, tension
            for _ in range(60):  # a contraction by mu r T / k
                tension = before * math.exp(-way * friction * angle)
                angle = relaxed - radius * tension / spring
            name = f"tension past joint {i + 1}, {'pulled' if way > 0 else 'released'}"
            yield Quantity(name, found[i + 1], tension)


def hoist(build: Build) -> Iterator[Quantity]:
    """Measure a = (tau / r - R F) / (J / r^2 + R m) of a drum that lifts over a post.

    Down, R = exp(mu pi / 2) becomes 1 / R (Newton's second law with Eytelwein's).
    """
    drum, post, mass, inertia = 0.03, 0.05, 3.0, 2e-3
    load = "load", (post, 0.0, -1.5)
    bodies = (
        Body("pull", (-0.4, 0.0, 0.0), "hinge", 1.0, inertia, (0.0, -1.0, 0.0)),
        Body(*load, "slide", mass),
    )
    bend = Bend((0.0, 0.0, drum - post), post, 0.0, math.pi / 2)
    leaves = "pull", (-0.4, 0.0, drum)
    machine = Machine(bodies, leaves, load, (bend,), 0.3, drum=drum)
    first = machine.tension
    for weight in (first, 3.0 * first):
        for way, name in (1, f"lifting {weight:g} N"), (-1, f"lowering {weight:g} N"):
            past = machine.ratio**way
            pull = weight * past * 1.4**way
            right = (past * weight - pull) / (inertia / drum**2 + past * mass)
            rest, forces = (first * drum, first), (pull * drum, weight)
            (turned, moved), _ = accelerate(build(machine), rest, forces)
            yield Quantity(f"load, {name}", moved, right)
            yield Quantity(f"drum, {name}", turned, -right / drum)


TASKS = {
    task.__name__.replace("_", " "): task
    for task in (capstan, atwood, turning_pulley, ladder, cycles, helix, finger, hoist)
}
