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

Array = NDArray[np.float64]
Ways = NDArray[np.int64]
EXIT, EYE = (-0.068, -0.04), (-0.025, 0.015)
POST, POST_RADIUS = (-0.06, 0.0), 0.008
KNUCKLE_RADIUS, WINCH_RADIUS = 0.012, 0.008
INSERTION, HALF_FLEXED = (0.03, 0.008), 0.75
PARTS = 8
"""Of every arc."""


class Tendon(NamedTuple):
    """What the rig is made of, and what it hides; SI.

    Attributes:
        friction: mu.
        stiffness: EA [N].
        pretension: at rest, the finger half flexed [N].
        drag: f [N/m].
        viscosity: c [N s/m^2].
        compliance: of what holds the tendon at the finger [m/N].
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


def path(flexed: float) -> Path:
    """The path where the finger is flexed by an angle from half flexed [rad]."""
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


def _tangent(
    point: tuple[float, float], centre: tuple[float, float], radius: float, side: float
) -> tuple[float, float]:
    """Direction [rad] and length [m] from a point to where its tangent touches."""
    x, z = centre[0] - point[0], centre[1] - point[1]
    away = math.hypot(x, z)
    return (
        math.atan2(z, x) + side * math.asin(radius / away),
        math.sqrt(away**2 - radius**2),
    )


def _turn(before: float, after: float) -> float:
    """Angle by which the path turns clockwise [rad]."""
    return math.remainder(before - after, 2.0 * math.pi)


def played(rig: Tendon, dt: float, motor: Array, joint: Array) -> tuple[Array, Array]:
    """Torques of motor and joint along a motion, from rest at its first sample [Nm].

    Args:
        rig: the tendon.
        dt: time between samples [s].
        motor: angle of the winch, positive where it winds [rad].
        joint: angle of the finger, positive where the tendon pulls it [rad].
    """
    length = _lengths(path(-joint[0]))
    tension = np.full(length.size, rig.pretension)
    strained = 1.0 + rig.pretension / rig.stiffness
    way = np.zeros(length.size - 1, dtype=np.int64)
    torques = np.empty((2, motor.size))
    for k in range(motor.size):
        if k:
            here, held = path(-joint[k]), length / (1.0 + tension / rig.stiffness)
            turned = KNUCKLE_RADIUS * (joint[k] - joint[k - 1])
            now = _lengths(here)
            held = _carried(held, length, now, turned)
            held[0] -= WINCH_RADIUS * (motor[k] - motor[k - 1]) / strained
            tension, way = _stepped(rig, here, now, held, tension, dt, way)
            length = now
        if not tension.min() > 0.0:
            raise ValueError(f"the tendon goes slack at sample {k}; pull more")
        torques[:, k] = WINCH_RADIUS * tension[0], KNUCKLE_RADIUS * tension[-1]
    return torques[0], torques[1]


def _lengths(here: Path) -> Array:
    """Of straight pieces and parts of arcs, from winch to finger [m]."""
    first, second, third, fourth = here.pieces
    post, knuckle = here.contact[0] / PARTS, here.contact[2] / PARTS
    inner = [post] * (PARTS - 1), [knuckle] * (PARTS - 1)
    length = np.array([first, *inner[0], second, third, *inner[1], fourth])
    for place, part in ((0, post), (PARTS, post), (PARTS + 1, knuckle), (-1, knuckle)):
        length[place] += 0.5 * part
    return length


def _carried(held: Array, before: Array, now: Array, turned: float) -> Array:
    """Unstretched lengths along another path, if nothing slips [m].

    The parts move over a tendon that is stuck, of which the last piece gains what the
    knuckle takes away, `turned`.
    """
    gained = np.zeros(held.size)
    gained[-1] = -turned
    edges = np.concatenate([[0.0], np.cumsum(before)])
    places = edges[1:-1] - np.cumsum(gained - (now - before))[:-1]
    whole = np.concatenate([[0.0], np.cumsum(held)])
    inside = np.interp(places, edges, whole)
    return np.diff(np.concatenate([[0.0], inside, whole[-1:]]))


def _stepped(
    rig: Tendon,
    here: Path,
    length: Array,
    held: Array,
    tension: Array,
    dt: float,
    way: Ways,
) -> tuple[Array, Ways]:
    """Tensions once all has slipped that does, and which way it did.

    `held` is the unstretched length before it slips [m]. Straight lines near the
    tensions before the step tell the slip, the law then the tensions.
    """
    ratio = 1.0 + tension / rig.stiffness
    soft = length / (rig.stiffness * ratio**2)
    soft[-1] += rig.compliance
    near = tension + (length / ratio - held) / soft
    after, way = _settled(rig, here, 1.0 / soft, near, dt, way)
    left = length / ratio - (after - tension) * soft
    found = rig.stiffness * (length / left - 1.0)
    # The spring at the finger is drawn by the last piece, whose line is right enough.
    if rig.compliance > 0.0:
        found[-1] = after[-1]
    return found, way


def _settled(
    rig: Tendon, here: Path, spring: Array, tension: Array, dt: float, way: Ways
) -> tuple[Array, Ways]:
    """Tensions once all has slipped that does, and which way it did."""
    counts = (PARTS, 1, PARTS)
    wrap, contact = (
        np.repeat(whole / counts, counts) for whole in (here.wrap, here.contact)
    )
    growth = rig.friction * wrap
    mean = contact * np.expm1(growth) / np.maximum(growth, 1e-12)
    bends = Bends(np.exp(growth), rig.drag * mean, rig.viscosity * mean / dt)
    way = way.copy()
    for _ in range(200):
        slip = _slip(way, spring, tension, bends)
        after = tension.copy()
        after[:-1] += spring[:-1] * slip
        after[1:] -= spring[1:] * slip
        near, far = after[:-1], after[1:]
        # Beyond what friction holds, towards the finger and away from it.
        onward = (far - bends.most * near - bends.drag) / (near + far)
        back = (near - bends.most * far - bends.drag) / (near + far)
        over = np.where(way == 0, np.maximum(onward, back), 0.0)
        wrong = np.where(way * slip < 0.0, np.abs(slip) * spring[0] / tension[0], over)
        worst = int(np.argmax(wrong))
        if wrong[worst] <= 1e-10:
            return after, way
        turned = 1 if onward[worst] > back[worst] else -1
        way[worst] = turned if way[worst] == 0 else 0
    raise ValueError("no state of the tendon fits; take smaller steps")


class Bends(NamedTuple):
    """What the bends hold: E, drag [N], and viscous force per slip of a step [N/m]."""

    most: Array
    drag: Array
    slow: Array


def _slip(way: Ways, spring: Array, tension: Array, bends: Bends) -> Array:
    """How far the bends slip, away from the finger [m], if they slip these ways.

    `way` is 1 where the tension behind the bend is the higher one, and -1 before it.
    """
    count = way.size
    matrix, wanted = np.eye(count), np.zeros(count)
    for k in np.flatnonzero(way):
        side = way[k]
        low, high = (k, k + 1) if side > 0 else (k + 1, k)
        row = np.zeros(count)
        for piece, share in ((high, 1.0), (low, -bends.most[k])):
            if piece < count:
                row[piece] += share * spring[piece]
            if piece > 0:
                row[piece - 1] -= share * spring[piece]
        row[k] -= side * bends.slow[k]
        matrix[k] = row
        wanted[k] = bends.most[k] * tension[low] + bends.drag[k] - tension[high]
    found: Array = np.linalg.solve(matrix, wanted)
    return found
