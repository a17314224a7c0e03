"""A rig of finite elements with mass, stepped by implicit Euler.

A node is held by a contact that gives elastically up to `ELASTIC` of what makes it
slide and yields gradually from there on (an elastoplastic friction model: Dupont,
Hayward, Armstrong, Altpeter, IEEE Trans. Autom. Control 47(5), 2002; here with a law of
yielding that can be integrated),

    dz/dx = 1                          below  e = ELASTIC d,
    dz/dx = (d - |z|) / (d - e)        beyond, where it goes on,

    F = mu bend N z / d, N the mean tension of both sides. All nodes of a step are found
at once by Newton's method on a tridiagonal system. A step takes 0.1 ms, half that where
a pulley meets a handle, a quarter where friction falls with speed.

Every hidden effect is off at its default, 0. Imperfections that no builder can avoid (a
compliant shaft, a gear, an amplifier with a torque limit) are sampled from the rig's
seed and are no effects.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig import engine
from rig.engine import copy, row_of, solve, total
from rig.nominal import Rig

ELEMENTS = 40  # elements per cable, with a node between two
FINER = 0.7  # length per node at the ends over the mean length per node


TENSION = 80.0  # tension at which constants are those stated [N]
STRAND_TIME = 1e-5  # damping of the strand over its stiffness [s]
CREEP_SLIP = 5e-5  # travel that renews a contact [m]
FERRULE_TIME = 3e-3  # damping of the fastening over its stiffness [s]


class Plant(NamedTuple):
    """All constants of the equations; SI and radians, arrays are (2, ...) by cable."""

    bench: engine.Bench
    stiffness: FloatMatrix  # stiffness of every element (2, elements) [N/m]
    mass: FloatMatrix  # mass at every inner node (2, elements - 1) [kg]
    bend: FloatMatrix  # bend of the conduit at every inner node (2, elements - 1) [rad]
    middle: FloatArray
    """Position of the inner nodes, 0 at the motor to 1 at the joint (elements - 1,)."""
    friction: FloatArray  # coefficient of friction (2,)
    yielding: FloatMatrix = np.full((2, 1), 8e-7)
    """Deflection at which a contact slides (2, 1 or elements - 1) [m]."""

    # --- friction ------------------------------------------------------------
    grease: float = 0.0
    """Force per speed of a slow cable [N s/m]; more of it towards the joint."""
    grease_thins: float = 1e9  # speed at which the grease has half its viscosity [m/s]
    striction: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    striction_speed: float = 0.01
    nap: float = 0.0
    """Relative excess of friction of cable a against the nap of its liner."""
    tight: float = 0.0  # load-independent friction of one cable in a tight liner [N]
    polish: float = 0.0
    """Loss of friction coefficient per tension over the reference, relative."""
    creep: float = 0.0  # growth of static friction in a second of rest, relative
    creep_power: float = 0.3
    leaning: float = 0.0
    """Wrap gained per joint angle, over the half of the conduit next the joint."""
    warming: float = 0.0  # change of friction from cold to warm, relative
    warming_time: float = 4.0
    worn: float = 0.0
    """Relative amplitude of the friction coefficient along the travel of the cable."""
    worn_pitch: float = 0.02
    worn_phase: float = 0.0

    # --- elasticity ----------------------------------------------------------
    toe: float = 0.0  # relative deficit in stiffness of a slack strand, in [0, 1)
    toe_tension: float = 40.0
    ferrule: float = 0.0  # compliance of the fastening of cable a at the motor [m/N]


def plant_of(rig: Rig, elements: int = ELEMENTS) -> Plant:
    """Return the plant without a hidden effect; its seed samples imperfections."""
    random = np.random.default_rng([rig.seed, 0xE1E])
    border = np.linspace(0.0, 1.0, elements)
    # Short parts at the ends, where the torques are read; a node in the middle of each.
    border -= (1.0 - FINER) / (2.0 * math.pi) * np.sin(2.0 * math.pi * border)
    node = 0.5 * (border[:-1] + border[1:])
    length = np.diff(np.concatenate([[0.0], node, [1.0]]))
    bend = np.stack([rig.wrap * _swaying(border, random) for _ in range(2)])
    bench = engine.bench_of(
        rig, overtone=3.0, overtone_share=1.0 / 3.0, oval=0.5, softening=1.2,
        loss_time=5.0, fast_loss=0.4, contact_stiffness=1e6, rounded=True,
        **_lived_with(random),
    )  # fmt: skip
    return Plant(
        bench, np.tile(rig.axial_stiffness / (length * rig.length), (2, 1)),
        np.tile(rig.line_density * rig.length * np.diff(border), (2, 1)), bend, node,
        np.array([rig.friction_a, rig.friction_b]),
    )  # fmt: skip


def _swaying(border: FloatArray, random: Generator) -> FloatArray:
    phase = random.uniform(-math.pi, math.pi)
    size = 0.25 * random.uniform(0.3, 1.0)  # over the mean curvature
    turn = 3.0 * math.pi

    def till(s: FloatArray) -> FloatArray:
        return s - size / turn * (np.cos(turn * s + phase) - math.cos(phase))

    part = np.diff(till(border))
    return np.asarray(part / part.sum())


def _lived_with(random: Generator) -> dict[str, float]:
    has_shaft, has_gear, has_limit = random.random(3) < 0.5
    stiff, teeth, limit = random.uniform([1.2e4, 1e-5, 7.0], [4e4, 4e-5, 12.0])
    phase = random.uniform(-math.pi, math.pi)
    order = float(random.integers(24, 61))
    found = {"teeth_order": order, "teeth_phase": phase}
    if has_shaft:
        found["shaft"] = 1.0 / stiff
    if has_gear:
        found["teeth"] = teeth
    if has_limit:
        found["amplifier"] = limit
    return found


ELASTIC = 0.6
_ENOUGH = 1e-7
_ITERATIONS = 60


class Cables(NamedTuple):
    """State of both cables; displacements are towards the motor [m]."""

    place: FloatMatrix  # displacement of the inner nodes (2, elements - 1) [m]
    speed: FloatMatrix  # velocity of the inner nodes [m/s]
    slow: FloatMatrix  # low-pass filtered velocity, on which friction depends [m/s]
    deflection: FloatMatrix  # deflection of every contact (2, elements - 1) [m]
    age: FloatMatrix  # age of every contact [s]
    tension: FloatMatrix  # tension of every element (2, elements) [N]
    elastic: FloatMatrix  # the same without damping [N]
    ferrule: FloatArray  # elongation of the fastening at the motor (2,) [m]
    work: FloatMatrix  # work of friction and of damping, by cable (2, 2) [J]
    room: FloatMatrix  # work space (10, elements), see `engine.Row`


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, displaced by `arcs` [m]."""
    inner = p.mass.shape[1]
    return Cables(
        np.repeat(np.array(arcs)[:, None], inner, axis=1), *np.zeros((4, 2, inner)),
        *np.full((2, 2, inner + 1), pretension),
        np.array([pretension * p.ferrule, 0.0]), np.zeros((2, 2)),
        np.zeros((10, inner + 1)),
    )  # fmt: skip


@compiled
def deflected(z: float, moved: float, slides: float) -> tuple[float, float]:
    """Return a contact's deflection after a move [m], and its derivative by the move.

    `z` is the deflection before, `slides` that at which it slides [m].
    """
    way = 1.0 if moved >= 0.0 else -1.0
    # Seen in the direction of the move: elastic up to `bound`, then yielding.
    before, go = way * z, abs(moved)
    bound = ELASTIC * slides
    if before + go <= bound:
        return way * (before + go), 1.0
    room = slides - bound
    left = go if before >= bound else go - (bound - before)
    gap = (slides - max(before, bound)) * math.exp(-left / room)
    return way * (slides - gap), gap / room


@internal
def pull(k: float, stretch: float, p: Plant, tight: float) -> tuple[float, float]:
    """Return an element's tension [N] and slope [N/m]; `tight` is that at stretch 0."""
    if p.toe == 0.0:
        tension = tight + k * stretch
        return (tension, k) if tension > 0.0 else (0.0, 0.0)
    # dT/dx = k (1 - toe exp(-T / toe_tension)), from slack at T = 0.
    scale, lack = p.toe_tension, p.toe
    laid = scale * math.log((math.exp(tight / scale) - lack) / (1.0 - lack))
    x = laid + k * stretch
    if x <= 0.0:
        return 0.0, 0.0
    grown = (1.0 - lack) * math.exp(min(x / scale, 600.0))
    return scale * math.log(lack + grown), k * grown / (lack + grown)


@internal
def _coefficients(p: Plant, cables: Cables, c: int, joint: float, time: float) -> None:
    """Fill in friction over load and load-independent friction."""
    row = row_of(cables.room)
    held, dry = row.held, row.dry
    inner = held.size
    overall = p.friction[c]
    whole, last = total(p.bend[c]), p.yielding.shape[1] - 1
    if p.warming != 0.0:
        overall *= 1.0 + p.warming * (1.0 - math.exp(-time / p.warming_time))
    for i in range(inner):
        speed = cables.slow[c, i]
        factor = overall
        if p.striction != 0.0:
            factor *= 1.0 + p.striction * math.exp(-abs(speed) / p.striction_speed)
        if p.creep != 0.0:
            aged = min(cables.age[c, i], 5.0) ** p.creep_power
            factor *= 1.0 + p.creep * aged
        if p.nap != 0.0 and c == 0:
            leant = cables.deflection[c, i] / p.yielding[c, min(i, last)]
            factor *= 1.0 + 0.5 * p.nap * leant
        if p.worn != 0.0:
            turn = 2.0 * math.pi * cables.place[c, i] / p.worn_pitch
            factor *= 1.0 + p.worn * math.sin(turn - p.worn_phase)
        bend = p.bend[c, i]
        if p.leaning != 0.0 and p.middle[i] > 0.5:
            # None in the middle, most at the joint, 1 in all.
            weight = 4.0 * (2.0 * p.middle[i] - 1.0)
            bend += p.leaning * joint * weight * p.bend[c, i] / whole
        held[i] = factor * max(bend, 0.0)
        dry[i] = 0.0
        if p.tight != 0.0:
            s = p.middle[i]
            dry[i] = p.tight * p.bend[c, i] / whole * (0.5 + 3.0 * s * (1.0 - s))


@internal
def _balance(
    p: Plant,
    cables: Cables,
    c: int,
    tight: float,
    ends: tuple[float, float, float, float],
    dt: float,
) -> float:
    """Fill the row for the places and return the largest residual force [N].

    `tight` is the tension at rest, `ends` as in `_advanced`.
    """
    place, row = cables.place[c], row_of(cables.room)
    inner = place.size
    tension = cables.tension[c]
    old, held, dry = row.old, row.held, row.dry
    old_near, near, old_far, far = ends
    soft = p.ferrule if c == 0 else 0.0
    for e in range(inner + 1):
        ahead = near if e == 0 else place[e - 1]
        behind = far if e == inner else place[e]
        ahead_old = old_near if e == 0 else old[e - 1]
        behind_old = old_far if e == inner else old[e]
        k = p.stiffness[c, e]
        stretch = ahead - behind
        if e == 0 and soft != 0.0:
            # A spring with a damper in it; the first element is straight then.
            mix = dt / (dt + FERRULE_TIME)
            kept = cables.ferrule[c] * (1.0 - mix)
            line = k / (1.0 + k * soft * mix)
            value = line * (stretch - kept + tight / k + tight * soft)
            rate = line
            if not value > 0.0:
                value, rate = 0.0, 0.0
            k = line
        else:
            value, rate = pull(k, stretch, p, tight)
        cables.elastic[c, e] = value
        rub = STRAND_TIME * k / dt
        damping = rub * (stretch - (ahead_old - behind_old))
        # A strand that is hardly taut has little to damp with.
        if damping >= value:
            value, rate = 2.0 * value, 2.0 * rate
        elif damping <= -value:
            value, rate = 0.0, 0.0
        else:
            value, rate = value + damping, rate + rub
        tension[e] = value
        row.slope[e] = rate
    worst = 0.0
    for i in range(inner):
        load = 0.5 * (tension[i] + tension[i + 1])
        grip, grip_slope = held[i] * load, held[i]
        if p.polish != 0.0:
            over = load / TENSION - 1.0
            factor = max(1.0 - p.polish * over, 0.2)
            grip *= factor
            grip_slope *= factor
        slides = p.yielding[c, min(i, p.yielding.shape[1] - 1)]
        moved = place[i] - old[i]
        z, yields = deflected(cables.deflection[c, i], moved, slides)
        row.other[i] = z
        part = z / slides
        thin = 1.0 + abs(cables.speed[c, i]) / p.grease_thins
        # Less near the motor, where it was wiped off.
        drag = p.grease * (0.5 + p.middle[i]) / inner / thin / dt
        row.force[i] = (grip + dry[i]) * part + drag * moved
        inert = p.mass[c, i] / (dt * dt)
        push = inert * (moved - dt * cables.speed[c, i])
        row.left[i] = tension[i] - tension[i + 1] - row.force[i] - push
        half = 0.5 * grip_slope * part
        row.low[i] = -row.slope[i] * (1.0 - half)
        row.high[i] = -row.slope[i + 1] * (1.0 + half)
        row.mid[i] = (
            row.slope[i] * (1.0 - half)
            + row.slope[i + 1] * (1.0 + half)
            + (grip + dry[i]) * yields / slides
            + drag
            + inert
        )
        worst = max(worst, abs(row.left[i]))
    return worst


@compiled
def step(
    p: Plant,
    cables: Cables,
    c: int,
    tight: float,
    near: tuple[float, float],
    far: tuple[float, float],
    joint: float,
    time: float,
    dt: float,
) -> tuple[float, float, bool]:
    """Advance a cable by `dt` [s]; return end tensions [N] and whether it converged.

    It fails if Newton's method does not converge however often the step is halved.
    `tight` is the tension at rest [N]; `near` and `far` are displacements of the ends
    at motor and joint before and after [m]; `joint` is the joint's angle [rad].
    """
    part, done, halved = 1.0, 0.0, 0
    while done < 1.0:
        till = min(done + part, 1.0)
        ends = (
            near[0] + done * (near[1] - near[0]), near[0] + till * (near[1] - near[0]),
            far[0] + done * (far[1] - far[0]), far[0] + till * (far[1] - far[0]),
        )  # fmt: skip
        if _advanced(p, cables, c, tight, ends, joint, time, part * dt):
            done = till
            continue
        halved += 1
        if halved > 8:
            return 0.0, 0.0, False
        part *= 0.5
    return cables.tension[c, 0], cables.tension[c, cables.place.shape[1]], True


@internal
def _advanced(
    p: Plant,
    cables: Cables,
    c: int,
    tight: float,
    ends: tuple[float, float, float, float],
    joint: float,
    time: float,
    dt: float,
) -> bool:
    """Return whether the nodes after dt are found; otherwise the cable is unchanged.

    `ends` are the displacements of both ends, before and after each.
    """
    place, row = cables.place[c], row_of(cables.room)
    inner, old = place.size, row.old
    copy(place, old)
    _coefficients(p, cables, c, joint, time)
    for i in range(inner):
        place[i] += dt * cables.speed[c, i]
    enough = _ENOUGH * TENSION
    worst = _balance(p, cables, c, tight, ends, dt)
    part, turn = 1.0, 0
    while not worst <= enough:
        turn += 1
        if turn > _ITERATIONS:
            copy(old, place)
            return False
        solve(row.low, row.mid, row.high, row.left)
        for i in range(inner):
            place[i] += part * row.left[i]
        now = _balance(p, cables, c, tight, ends, dt)
        # Shorter steps where contacts go over from one side to the other for ever.
        if turn > 6:
            part = 0.5 if now > 0.7 * worst else min(1.0, 1.5 * part)
        worst = now
    mix = dt / (4e-3 + dt)  # friction follows speed with a lag of 4 ms
    for i in range(inner):
        moved = place[i] - old[i]
        cables.speed[c, i] = moved / dt
        cables.slow[c, i] += mix * (moved / dt - cables.slow[c, i])
        cables.deflection[c, i] = row.other[i]
        grown = cables.age[c, i] + dt
        cables.age[c, i] = grown / (1.0 + abs(moved) / CREEP_SLIP)
        cables.work[c, 0] += row.force[i] * moved
    tension = cables.tension[c]
    for e in range(inner + 1):
        ahead = ends[1] - ends[0] if e == 0 else place[e - 1] - old[e - 1]
        behind = ends[3] - ends[2] if e == inner else place[e] - old[e]
        cables.work[c, 1] += (tension[e] - cables.elastic[c, e]) * (ahead - behind)
    if p.ferrule != 0.0 and c == 0:
        given = dt / (dt + FERRULE_TIME)
        longer = p.ferrule * cables.elastic[c, 0] - cables.ferrule[c]
        cables.ferrule[c] += given * longer
    return True


@compiled
def _run(p: Plant, cables: Cables, run: engine.Run) -> bool:
    shafts, now, dt = run.shafts, run.now, run.dt
    inner = p.mass.shape[1]
    for k in range(run.records.shape[0] * run.steps):
        drive, hold = engine.torques(run, k)
        old_a, old_b = shafts[engine.ARC_A], shafts[engine.ARC_B]
        old_far = p.bench.joint_radius * shafts[engine.HUB]
        engine.turn_shafts(p.bench, run, drive, hold, 1.0)
        # What holds between two steps belongs to both of them.
        engine.record(run, k, 0.5)
        time, angle = (k + 1) * dt, shafts[engine.HUB]
        tight = engine.tension_at_rest(p.bench, run.pretension, time)
        near, far = (
            (old_a, shafts[engine.ARC_A]),
            (old_far, p.bench.joint_radius * angle),
        )
        now[engine.NEAR_A], now[engine.FAR_A], found_a = step(
            p, cables, 0, tight, near, far, angle, time, dt
        )
        near, far = (-old_b, -shafts[engine.ARC_B]), (-far[0], -far[1])
        now[engine.NEAR_B], now[engine.FAR_B], found_b = step(
            p, cables, 1, tight, near, far, angle, time, dt
        )
        if not (found_a and found_b):
            return False
        engine.balance(p.bench, run)
        if (k + 1) % run.steps == 0:
            stored = 0.0
            for c in range(2):
                for i in range(inner):
                    stored += 0.5 * p.mass[c, i] * cables.speed[c, i] ** 2
                for e in range(inner + 1):
                    stored += 0.5 * cables.elastic[c, e] ** 2 / p.stiffness[c, e]
            engine.close(
                run, k, cables.work[0, 0] + cables.work[1, 0],
                cables.work[0, 1] + cables.work[1, 1], stored,
            )  # fmt: skip
    return True


# Falling friction and impacts take more steps per record.
LAW = engine.Law(
    start, _run, lambda p: 8 if p.striction else 4 if p.bench.backlash else 2
)
