"""A tendon over posts in one plane, by closed forms: a rig that shares no code.

It runs from a winch over a post, through an eye and over the knuckle of a finger, as in
the scene `finger`. Each straight piece, and each part of an arc, holds an unstretched
length m of tendon along its length l, and has the tension EA (l / m - 1). Tendon on the
knuckle moves with it.
At a bend the tendon rubs as on a capstan,

    T_high = T_low E + (f l + c l v) (E - 1) / ln E,   E = exp(mu wrap),

with a drag f and a viscosity c per length l of contact. The bends that slip, and their
directions, are searched from those of the step before: the bend with the largest error
is changed until none has one. The winch winds tendon as stretched as it is, and
releases the last wound first; the first is at the pretension.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, IntArray, compiled, internal
from rig.engine import copy

EXIT, EYE = (-0.068, -0.04), (-0.025, 0.015)
POST, POST_RADIUS = (-0.06, 0.0), 0.008
KNUCKLE_RADIUS, WINCH_RADIUS = 0.012, 0.008
INSERTION, HALF_FLEXED = (0.03, 0.008), 0.75
PARTS = 8  # number of parts of every arc
PIECES = 2 * PARTS + 2
BENDS = PIECES - 1


class Tendon(NamedTuple):
    """Composition of the rig, and the effects it hides; SI."""

    friction: float = 0.22  # coefficient of friction mu
    stiffness: float = 1850.0  # axial stiffness EA [N]
    pretension: float = 5.3  # tension at rest with the finger half flexed [N]
    drag: float = 0.0  # drag f per length of contact [N/m]
    viscosity: float = 0.0  # viscosity c per length of contact [N s/m^2]
    compliance: float = 0.0  # compliance of the fastening at the finger [m/N]


class Path(NamedTuple):
    """Lengths of the four pieces [m], and wrap [rad] and contact [m] of the bends."""

    pieces: FloatArray
    wrap: FloatArray
    contact: FloatArray


class _Winch(NamedTuple):
    """Layers that a winch wound since the start, one for every sample (samples,)."""

    # of the winch that a layer covers [m], 0 where it was given out again
    surface: FloatArray
    amount: FloatArray  # unstretched length of the layer [m]


class _Room(NamedTuple):
    """Work space: arrays of the pieces (PIECES,) or the bends (BENDS,)."""

    # lengths of straight pieces and parts of arcs before the step [m]
    before: FloatArray
    length: FloatArray  # the same after it, winch to finger [m]
    held: FloatArray  # unstretched lengths before they slip [m]
    tension: FloatArray  # tensions of the pieces [N]
    soft: FloatArray  # slope of the length by the tension [m/N]
    near: FloatArray  # tensions before anything slips, by straight lines [N]
    after: FloatArray  # tensions once all has slipped that does, by straight lines [N]
    edges: FloatArray  # ends of the pieces along the path (PIECES + 1,) [m]
    whole: FloatArray  # unstretched length up to each of them (PIECES + 1,) [m]
    most: FloatArray  # ratio E of the tensions of a bend that slips
    drag: FloatArray  # drag of each bend [N]
    slow: FloatArray  # viscous force per slip of a step [N/m]
    slip: FloatArray  # slip away from the finger [m]
    above: FloatArray  # what is left of the matrix above its diagonal


def path(flexed: float) -> Path:
    """Return the path where the finger is flexed by an angle from half flexed [rad]."""
    here = _no_path()
    _lay(flexed, here)
    return here


def _no_path() -> Path:
    return Path(np.zeros(4), np.zeros(3), np.zeros(3))


@compiled
def _lay(flexed: float, here: Path) -> None:
    """Fill in the path where the finger is flexed by an angle."""
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
    here.pieces[0], here.pieces[1] = first, second
    here.pieces[2], here.pieces[3] = third, fourth
    here.wrap[0], here.wrap[1] = _turn(up, over), abs(_turn(over, down))
    here.wrap[2] = _turn(down, along)
    here.contact[0], here.contact[1] = POST_RADIUS * here.wrap[0], 0.0
    here.contact[2] = KNUCKLE_RADIUS * here.wrap[2]


@internal
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


@internal
def _turn(before: float, after: float) -> float:
    """Return the angle by which the path turns clockwise [rad]."""
    turn = before - after
    return turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)


def played(
    rig: Tendon, dt: float, motor: FloatArray, joint: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the torques of motor and joint along a motion from rest [N m].

    `motor` is the angle of the winch, positive where it winds, `joint` that of the
    finger, positive where the tendon pulls it [rad].
    """
    sizes = [PIECES] * 7 + [PIECES + 1] * 2 + [BENDS] * 5
    room = _Room(*map(np.zeros, sizes))
    winch = _Winch(np.zeros(motor.size), np.zeros(motor.size))
    way, ends = np.zeros(BENDS, dtype=np.int64), np.empty((2, motor.size))
    reached, fits = _run(
        Tendon(*map(float, rig)), dt, motor, joint, _no_path(), way, winch, room, ends
    )
    if reached < motor.size:
        if fits:
            raise ValueError(f"the tendon goes slack at sample {reached}; pull more")
        raise ValueError("no state of the tendon fits; take smaller steps")
    return WINCH_RADIUS * ends[0], KNUCKLE_RADIUS * ends[1]


@compiled
def _run(
    rig: Tendon,
    dt: float,
    motor: FloatArray,
    joint: FloatArray,
    here: Path,
    way: IntArray,
    winch: _Winch,
    room: _Room,
    ends: FloatMatrix,
) -> tuple[int, bool]:
    """Fill in end tensions; return the first sample not reached and if a state fits."""
    length, tension, held = room.length, room.tension, room.held
    _lay(-joint[0], here)
    _fill_lengths(here, length)
    tension[:] = rig.pretension
    for k in range(motor.size):
        if k > 0:
            _lay(-joint[k], here)
            for i in range(PIECES):
                held[i] = length[i] / (1.0 + tension[i] / rig.stiffness)
            copy(length, room.before)
            _fill_lengths(here, length)
            _carry(room)
            held[0] -= _wind(rig, k, motor[k] - motor[k - 1], tension[0], winch)
            if not _step(rig, here, dt, way, room):
                return k, False
        for i in range(PIECES):
            if not tension[i] > 0.0:
                return k, True
        ends[0, k], ends[1, k] = tension[0], tension[PIECES - 1]
    return motor.size, True


@internal
def _wind(rig: Tendon, k: int, turned: float, tension: float, winch: _Winch) -> float:
    """Turn the winch by an angle at sample k; return the unstretched length it winds.

    It is negative where the winch gives out.
    """
    if turned >= 0.0:
        winch.surface[k] = WINCH_RADIUS * turned
        winch.amount[k] = winch.surface[k] / (1.0 + tension / rig.stiffness)
        return winch.amount[k]
    left, given = -WINCH_RADIUS * turned, 0.0
    for i in range(k - 1, -1, -1):
        if left > 0.0 and winch.surface[i] > 0.0:
            part = min(left, winch.surface[i])
            amount = winch.amount[i] * (part / winch.surface[i])
            winch.surface[i] -= part
            winch.amount[i] -= amount
            given += amount
            left -= part
    return -given - left / (1.0 + rig.pretension / rig.stiffness)


@internal
def _fill_lengths(here: Path, length: FloatArray) -> None:
    """Fill in lengths of straight pieces and parts of arcs, winch to finger [m]."""
    post, knuckle = here.contact[0] / PARTS, here.contact[2] / PARTS
    length[1:PARTS] = post
    length[PARTS + 2 : 2 * PARTS + 1] = knuckle
    length[0] = here.pieces[0] + 0.5 * post
    length[PARTS] = here.pieces[1] + 0.5 * post
    length[PARTS + 1] = here.pieces[2] + 0.5 * knuckle
    length[PIECES - 1] = here.pieces[3] + 0.5 * knuckle


@internal
def _carry(room: _Room) -> None:
    """Carry the unstretched lengths to another path without slip.

    The parts move over a tendon that sticks.
    """
    held, edges, whole = room.held, room.edges, room.whole
    edges[0] = whole[0] = 0.0
    for i in range(PIECES):
        edges[i + 1] = edges[i] + room.before[i]
        whole[i + 1] = whole[i] + held[i]
    moved, last, at = 0.0, 0.0, 0
    for i in range(1, PIECES + 1):
        reached = whole[PIECES]
        if i < PIECES:
            moved += room.length[i - 1] - room.before[i - 1]
            x = edges[i] + moved
            while at < PIECES - 1 and edges[at + 1] <= x:
                at += 1
            while at > 0 and edges[at] > x:
                at -= 1
            if x <= 0.0:
                reached = 0.0
            elif x < edges[PIECES]:
                slope = (whole[at + 1] - whole[at]) / (edges[at + 1] - edges[at])
                reached = slope * (x - edges[at]) + whole[at]
        held[i - 1] = reached - last
        last = reached


@internal
def _step(rig: Tendon, here: Path, dt: float, way: IntArray, room: _Room) -> bool:
    """Move the tensions to where all has slipped that does; return if a state fits.

    `way`, the directions of slip, is brought up to date. Straight lines near the
    tensions before the step give the slip, the law then the tensions.
    """
    length, tension, soft = room.length, room.tension, room.soft
    for i in range(PIECES):
        ratio = 1.0 + tension[i] / rig.stiffness
        soft[i] = length[i] / (rig.stiffness * ratio**2)
        if i == PIECES - 1:
            soft[i] += rig.compliance
        room.near[i] = tension[i] + (length[i] / ratio - room.held[i]) / soft[i]
    _hold(rig, here, dt, room)
    fits = _settle(way, room)
    for i in range(PIECES):
        ratio = 1.0 + tension[i] / rig.stiffness
        left = length[i] / ratio - (room.after[i] - tension[i]) * soft[i]
        tension[i] = rig.stiffness * (length[i] / left - 1.0)
    # The spring at the finger is drawn by the last piece, whose line is right enough.
    if rig.compliance > 0.0:
        tension[PIECES - 1] = room.after[PIECES - 1]
    return fits


@internal
def _settle(way: IntArray, room: _Room) -> bool:
    """Find the tensions once all has slipped that does; return if a state fits."""
    tension, after, slip = room.near, room.after, room.slip
    for _ in range(200):
        _slide(way, room)
        copy(tension, after)
        for k in range(BENDS):
            after[k] += 1.0 / room.soft[k] * slip[k]
        for k in range(BENDS):
            after[k + 1] -= 1.0 / room.soft[k + 1] * slip[k]
        worst, error, turned = -1, 1e-10, 0
        for k in range(BENDS):
            near, far = after[k], after[k + 1]
            # Beyond what friction holds, towards the finger and away from it.
            onward = (far - room.most[k] * near - room.drag[k]) / (near + far)
            back = (near - room.most[k] * far - room.drag[k]) / (near + far)
            wrong = 0.0
            if way[k] == 0:
                wrong = max(onward, back)
            elif way[k] * slip[k] < 0.0:
                wrong = abs(slip[k]) * (1.0 / room.soft[0]) / tension[0]
            if wrong > error:
                worst, error, turned = k, wrong, 1 if onward > back else -1
        if worst < 0:
            return True
        way[worst] = turned if way[worst] == 0 else 0
    return False


@internal
def _hold(rig: Tendon, here: Path, dt: float, room: _Room) -> None:
    """Fill in what the bends hold."""
    for k in range(BENDS):
        arc = 0 if k < PARTS else 1 if k == PARTS else 2
        parts = 1 if arc == 1 else PARTS
        growth = rig.friction * here.wrap[arc] / parts
        mean = here.contact[arc] / parts * math.expm1(growth) / max(growth, 1e-12)
        room.most[k] = math.exp(growth)
        room.drag[k] = rig.drag * mean
        room.slow[k] = rig.viscosity * mean / dt


@internal
def _slide(way: IntArray, room: _Room) -> None:
    """Compute how far the bends slip away from the finger, if they slip these ways [m].

    `way` is 1 where the tension behind the bend is the higher one, and -1 before it. A
    bend shares its pieces with its neighbours alone, so that the matrix has three
    diagonals, and the middle one is the largest.
    """
    tension, slip, above = room.near, room.slip, room.above
    slip[:] = 0.0
    above[:] = 0.0
    for k in range(BENDS):
        if way[k] == 0:
            continue
        # The law in the tensions of the piece before and the one behind the bend.
        before, behind = 1.0, -room.most[k]
        wanted = room.most[k] * tension[k + 1] + room.drag[k] - tension[k]
        if way[k] > 0:
            before, behind = -room.most[k], 1.0
            wanted = room.most[k] * tension[k] + room.drag[k] - tension[k + 1]
        spring, next_spring = 1.0 / room.soft[k], 1.0 / room.soft[k + 1]
        left = -before * spring
        middle = before * spring - behind * next_spring - way[k] * room.slow[k]
        if k > 0:
            middle -= left * above[k - 1]
            wanted -= left * slip[k - 1]
        slip[k] = wanted / middle
        above[k] = behind * next_spring / middle
    for k in range(BENDS - 2, -1, -1):
        slip[k] -= above[k] * slip[k + 1]
