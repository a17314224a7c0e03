"""A tendon over posts in one plane, by closed forms: a rig that shares no code.

From a winch over a post, through an eye and over the knuckle of a finger, as the scene
`finger` has it: straight pieces and the parts of an arc hold some unstretched length of
tendon, m, along their length l and have the tension EA (l / m - 1). The knuckle takes
along what lies on it. Where the tendon is bent it rubs as a capstan,

    T_high = T_low E + (f l + c l v) (E - 1) / ln E,   E = exp(mu wrap),

with a drag f and a viscosity c per length l of contact. Which bends slip, and which
way, is tried from how it was: the bend that errs most is put right until none does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled import compiled

Array = NDArray[np.float64]
Ways = NDArray[np.int64]
EXIT, EYE = (-0.068, -0.04), (-0.025, 0.015)
POST, POST_RADIUS = (-0.06, 0.0), 0.008
KNUCKLE_RADIUS, WINCH_RADIUS = 0.012, 0.008
INSERTION, HALF_FLEXED = (0.03, 0.008), 0.75
PARTS = 8
"""Number of parts of every arc."""


class Tendon(NamedTuple):
    """Composition of the rig, and the effects it hides; SI.

    Attributes:
        friction: coefficient of friction mu.
        stiffness: axial stiffness EA [N].
        pretension: tension at rest with the finger half flexed [N].
        drag: drag f per length of contact [N/m].
        viscosity: viscosity c per length of contact [N s/m^2].
        compliance: compliance of the fastening at the finger [m/N].
    """

    friction: float = 0.22
    stiffness: float = 1850.0
    pretension: float = 5.3
    drag: float = 0.0
    viscosity: float = 0.0
    compliance: float = 0.0


class Path(NamedTuple):
    """Lengths of the four pieces [m], and wrap [rad] and contact [m] of the bends."""

    pieces: Array
    wrap: Array
    contact: Array


@compiled
def path(flexed: float) -> Path:
    """Return the path where the finger is flexed by an angle from half flexed [rad]."""
    angle = HALF_FLEXED + flexed
    x, z = INSERTION
    tip = (
        x * math.cos(angle) + z * math.sin(angle),
        -x * math.sin(angle) + z * math.cos(angle),
    )
    up, first = _tangent(EXIT, POST, POST_RADIUS, 1.0)
    over, second = _tangent(EYE, POST, POST_RADIUS, -1.0)
    down, third = _tangent(EYE, (0.0, 0.0), KNUCKLE_RADIUS, 1.0)
    along, fourth = _tangent(tip, (0.0, 0.0), KNUCKLE_RADIUS, -1.0)
    over, along = over + math.pi, along + math.pi  # they leave the post, the knuckle
    wrap = np.array([_turn(up, over), abs(_turn(over, down)), _turn(down, along)])
    contact = np.array([POST_RADIUS * wrap[0], 0.0, KNUCKLE_RADIUS * wrap[2]])
    return Path(np.array([first, second, third, fourth]), wrap, contact)


@compiled
def _tangent(
    point: tuple[float, float], centre: tuple[float, float], radius: float, side: float
) -> tuple[float, float]:
    """Return direction [rad] and length [m] from a point to its tangent's contact."""
    x, z = centre[0] - point[0], centre[1] - point[1]
    away = math.hypot(x, z)
    return (
        math.atan2(z, x) + side * math.asin(radius / away),
        math.sqrt(away**2 - radius**2),
    )


@compiled
def _turn(before: float, after: float) -> float:
    """Return the angle by which the path turns clockwise [rad]."""
    turn = before - after
    return turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)


def played(rig: Tendon, dt: float, motor: Array, joint: Array) -> tuple[Array, Array]:
    """Compute the torques of motor and joint along a motion from rest [N m].

    Args:
        rig: the tendon.
        dt: time between samples [s].
        motor: angle of the winch, positive where it winds [rad].
        joint: angle of the finger, positive where the tendon pulls it [rad].

    Raises:
        ValueError: the tendon goes slack, or no state of it fits.
    """
    tensions, reached, fits = _run(Tendon(*map(float, rig)), dt, motor, joint)
    if reached < motor.size:
        if fits:
            raise ValueError(f"the tendon goes slack at sample {reached}; pull more")
        raise ValueError("no state of the tendon fits; take smaller steps")
    return WINCH_RADIUS * tensions[0], KNUCKLE_RADIUS * tensions[1]


@compiled
def _run(rig: Tendon, dt: float, motor: Array, joint: Array) -> tuple[Array, int, bool]:
    """Return end tensions, the first sample not reached, and whether a state fits."""
    length = _lengths(path(-joint[0]))
    tension = np.full(length.size, rig.pretension)
    strained = 1.0 + rig.pretension / rig.stiffness
    way = np.zeros(length.size - 1, dtype=np.int64)
    ends = np.empty((2, motor.size))
    for k in range(motor.size):
        if k > 0:
            here, held = path(-joint[k]), length / (1.0 + tension / rig.stiffness)
            now = _lengths(here)
            held = _carried(held, length, now)
            held[0] -= WINCH_RADIUS * (motor[k] - motor[k - 1]) / strained
            tension, fits = _stepped(rig, here, now, held, tension, dt, way)
            if not fits:
                return ends, k, False
            length = now
        if not tension.min() > 0.0:
            return ends, k, True
        ends[0, k], ends[1, k] = tension[0], tension[-1]
    return ends, motor.size, True


@compiled
def _lengths(here: Path) -> Array:
    """Return lengths of straight pieces and parts of arcs, winch to finger [m]."""
    length = np.empty(2 * PARTS + 2)
    post, knuckle = here.contact[0] / PARTS, here.contact[2] / PARTS
    length[1:PARTS] = post
    length[PARTS + 2 : 2 * PARTS + 1] = knuckle
    length[0] = here.pieces[0] + 0.5 * post
    length[PARTS] = here.pieces[1] + 0.5 * post
    length[PARTS + 1] = here.pieces[2] + 0.5 * knuckle
    length[-1] = here.pieces[3] + 0.5 * knuckle
    return length


@compiled
def _carried(held: Array, before: Array, now: Array) -> Array:
    """Return the unstretched lengths along another path without slip [m].

    The parts move over a tendon that sticks.
    """
    edges = np.zeros(held.size + 1)
    edges[1:] = np.cumsum(before)
    whole = np.zeros(held.size + 1)
    whole[1:] = np.cumsum(held)
    inside = whole.copy()
    inside[1:-1] = np.interp(edges[1:-1] + np.cumsum(now - before)[:-1], edges, whole)
    return inside[1:] - inside[:-1]


@compiled
def _stepped(
    rig: Tendon,
    here: Path,
    length: Array,
    held: Array,
    tension: Array,
    dt: float,
    way: Ways,
) -> tuple[Array, bool]:
    """Return the tensions once all has slipped that does, and whether a state fits.

    `held` is the unstretched length before it slips [m]; `way`, the directions of slip,
    is brought up to date. Straight lines near the tensions before the step give the
    slip, the law then the tensions.
    """
    ratio = 1.0 + tension / rig.stiffness
    soft = length / (rig.stiffness * ratio**2)
    soft[-1] += rig.compliance
    near = tension + (length / ratio - held) / soft
    after, fits = _settled(rig, here, 1.0 / soft, near, dt, way)
    left = length / ratio - (after - tension) * soft
    found = rig.stiffness * (length / left - 1.0)
    # The spring at the finger is drawn by the last piece, whose line is right enough.
    if rig.compliance > 0.0:
        found[-1] = after[-1]
    return found, fits


@compiled
def _settled(
    rig: Tendon, here: Path, spring: Array, tension: Array, dt: float, way: Ways
) -> tuple[Array, bool]:
    """Return the tensions once all has slipped that does, and whether a state fits."""
    bends = _bends(rig, here, dt, way.size)
    after = tension.copy()
    for _ in range(200):
        slip = _slip(way, spring, tension, bends)
        after[:] = tension
        after[:-1] += spring[:-1] * slip
        after[1:] -= spring[1:] * slip
        worst, error, turned = -1, 1e-10, 0
        for k in range(way.size):
            near, far = after[k], after[k + 1]
            # Beyond what friction holds, towards the finger and away from it.
            onward = (far - bends.most[k] * near - bends.drag[k]) / (near + far)
            back = (near - bends.most[k] * far - bends.drag[k]) / (near + far)
            wrong = 0.0
            if way[k] == 0:
                wrong = max(onward, back)
            elif way[k] * slip[k] < 0.0:
                wrong = abs(slip[k]) * spring[0] / tension[0]
            if wrong > error:
                worst, error, turned = k, wrong, 1 if onward > back else -1
        if worst < 0:
            return after, True
        way[worst] = turned if way[worst] == 0 else 0
    return after, False


class Bends(NamedTuple):
    """Hold of the bends: E, drag [N], and viscous force per slip of a step [N/m]."""

    most: Array
    drag: Array
    slow: Array


@compiled
def _bends(rig: Tendon, here: Path, dt: float, count: int) -> Bends:
    bends = Bends(np.empty(count), np.empty(count), np.empty(count))
    for k in range(count):
        arc = 0 if k < PARTS else 1 if k == PARTS else 2
        parts = 1 if arc == 1 else PARTS
        growth = rig.friction * here.wrap[arc] / parts
        mean = here.contact[arc] / parts * math.expm1(growth) / max(growth, 1e-12)
        bends.most[k] = math.exp(growth)
        bends.drag[k] = rig.drag * mean
        bends.slow[k] = rig.viscosity * mean / dt
    return bends


@compiled
def _slip(way: Ways, spring: Array, tension: Array, bends: Bends) -> Array:
    """Compute how far the bends slip away from the finger, if they slip these ways [m].

    `way` is 1 where the tension behind the bend is the higher one, and -1 before it. A
    bend shares its pieces with its neighbours alone, so that the matrix has three
    diagonals, and the middle one is the largest.
    """
    count = way.size
    slip, above = np.zeros(count), np.zeros(count)
    for k in range(count):
        if way[k] == 0:
            continue
        # The law in the tensions of the piece before and the one behind the bend.
        before, behind = 1.0, -bends.most[k]
        wanted = bends.most[k] * tension[k + 1] + bends.drag[k] - tension[k]
        if way[k] > 0:
            before, behind = -bends.most[k], 1.0
            wanted = bends.most[k] * tension[k] + bends.drag[k] - tension[k + 1]
        left = -before * spring[k]
        middle = before * spring[k] - behind * spring[k + 1] - way[k] * bends.slow[k]
        if k > 0:
            middle -= left * above[k - 1]
            wanted -= left * slip[k - 1]
        slip[k] = wanted / middle
        above[k] = behind * spring[k + 1] / middle
    for k in range(count - 2, -1, -1):
        slip[k] -= above[k] * slip[k + 1]
    return slip
