"""Two cables as chains of elements with mass, by implicit Euler; compiled.

A node is held by a contact that gives elastically up to `ELASTIC` of what makes it
slide and yields gradually from there on (an elastoplastic friction model: Dupont,
Hayward, Armstrong, Altpeter, IEEE Trans. Autom. Control 47(5), 2002; here with a law of
yielding that can be integrated),

    dz/dx = 1                          below  e = ELASTIC d,
    dz/dx = (d - |z|) / (d - e)        beyond, where it goes on,

    F = mu bend N z / d, N the mean tension of both sides. All nodes of a step are found
at once by Newton's method on a tridiagonal system.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig.elements.plant import Plant
from rig.engine import copy, total

ELASTIC = 0.6
_ENOUGH = 1e-7
_ITERATIONS = 60
_HALVINGS = 8
"""Largest number of times that a step is halved when Newton's method fails."""
_LAG = 4e-3
"""Time constant of the filtered speed on which friction depends [s]."""


class _Row(NamedTuple):
    """Terms of the balance of the nodes.

    Attributes:
        slope: derivative of the tension by the stretch (elements,) [N/m].
        left: residual force (elements - 1,) [N].
        low: negative derivative of `left` by the previous node's place [N/m].
        mid: negative derivative by the node's own place [N/m].
        high: negative derivative by the next node's place [N/m].
        force: force of friction and grease [N].
        z: deflection of the contacts [m].
        old: place a step ago [m].
        held: friction over load.
        dry: load-independent friction [N].
    """

    slope: FloatArray
    left: FloatArray
    low: FloatArray
    mid: FloatArray
    high: FloatArray
    force: FloatArray
    z: FloatArray
    old: FloatArray
    held: FloatArray
    dry: FloatArray


class Cables(NamedTuple):
    """State of both cables; displacements are towards the motor [m].

    Attributes:
        place: displacement of the inner nodes (2, elements - 1) [m].
        speed: velocity of the inner nodes [m/s].
        slow: low-pass filtered velocity, on which friction depends [m/s].
        deflection: deflection of every contact (2, elements - 1) [m].
        age: age of every contact [s].
        tension: tension of every element (2, elements) [N].
        elastic: the same without damping [N].
        ferrule: elongation of the fastening at the motor (2,) [m].
        work: work of friction and of damping, by cable (2, 2) [J].
        room: work space (10, elements), see `_row`.
    """

    place: FloatMatrix
    speed: FloatMatrix
    slow: FloatMatrix
    deflection: FloatMatrix
    age: FloatMatrix
    tension: FloatMatrix
    elastic: FloatMatrix
    ferrule: FloatArray
    work: FloatMatrix
    room: FloatMatrix


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, displaced by `arcs` [m]."""
    inner = p.mass.shape[1]
    zero = np.zeros((2, inner))
    return Cables(
        np.repeat(np.array(arcs)[:, None], inner, axis=1),
        zero.copy(),
        zero.copy(),
        zero.copy(),
        zero.copy(),
        np.full((2, inner + 1), pretension),
        np.full((2, inner + 1), pretension),
        np.array([pretension * p.ferrule, 0.0]),
        np.zeros((2, 2)),
        np.zeros((10, inner + 1)),
    )


@compiled
def deflected(z: float, moved: float, slides: float) -> tuple[float, float]:
    """Return the deflection of a contact after a move, and its derivative by the move.

    Args:
        z: deflection before [m].
        moved: displacement of the cable [m].
        slides: deflection at which it slides [m].
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
    """Return an element's tension and its slope by the stretch beyond pretension."""
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
    row = _row(cables.room)
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
    before: tuple[float, float],
    ends: tuple[float, float, float],
    dt: float,
) -> float:
    """Fill the row for the places and return the largest residual force [N].

    `before` are the displacements of both ends a step ago, `ends` the tension at rest
    and the displacements of both ends now.
    """
    place, row = cables.place[c], _row(cables.room)
    inner = place.size
    tension = cables.tension[c]
    old, held, dry = row.old, row.held, row.dry
    old_near, old_far = before
    tight, near, far = ends
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
            mix = dt / (dt + p.ferrule_time)
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
        rub = p.strand_time * k / dt
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
            over = load / p.reference_tension - 1.0
            factor = max(1.0 - p.polish * over, 0.2)
            grip *= factor
            grip_slope *= factor
        slides = p.yielding[c, min(i, p.yielding.shape[1] - 1)]
        moved = place[i] - old[i]
        z, yields = deflected(cables.deflection[c, i], moved, slides)
        row.z[i] = z
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
    """Advance a cable by dt; return the tensions of its ends [N] and whether it can.

    It cannot where the nodes of a step are not found, however often it is halved.

    Args:
        p: the plant.
        cables: their state, which moves on.
        c: index of the cable.
        tight: tension at rest [N].
        near: displacement of its end at the motor before and after [m].
        far: displacement of its end at the joint before and after [m].
        joint: angle of the joint [rad].
        time: time since the start [s].
        dt: duration of the step [s].
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
        if halved > _HALVINGS:
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
    place, row = cables.place[c], _row(cables.room)
    inner, old = place.size, row.old
    copy(place, old)
    before, after = (ends[0], ends[2]), (tight, ends[1], ends[3])
    _coefficients(p, cables, c, joint, time)
    for i in range(inner):
        place[i] += dt * cables.speed[c, i]
    enough = _ENOUGH * p.reference_tension
    worst = _balance(p, cables, c, before, after, dt)
    part, turn = 1.0, 0
    while not worst <= enough:
        turn += 1
        if turn > _ITERATIONS:
            copy(old, place)
            return False
        _solved(row.low, row.mid, row.high, row.left)
        for i in range(inner):
            place[i] += part * row.left[i]
        now = _balance(p, cables, c, before, after, dt)
        # Shorter steps where contacts go over from one side to the other for ever.
        if turn > 6:
            part = 0.5 if now > 0.7 * worst else min(1.0, 1.5 * part)
        worst = now
    mix = dt / (_LAG + dt)
    for i in range(inner):
        moved = place[i] - old[i]
        cables.speed[c, i] = moved / dt
        cables.slow[c, i] += mix * (moved / dt - cables.slow[c, i])
        cables.deflection[c, i] = row.z[i]
        grown = cables.age[c, i] + dt
        cables.age[c, i] = grown / (1.0 + abs(moved) / p.creep_slip)
        cables.work[c, 0] += row.force[i] * moved
    tension = cables.tension[c]
    for e in range(inner + 1):
        ahead = ends[1] - ends[0] if e == 0 else place[e - 1] - old[e - 1]
        behind = ends[3] - ends[2] if e == inner else place[e] - old[e]
        cables.work[c, 1] += (tension[e] - cables.elastic[c, e]) * (ahead - behind)
    if p.ferrule != 0.0 and c == 0:
        given = dt / (dt + p.ferrule_time)
        longer = p.ferrule * cables.elastic[c, 0] - cables.ferrule[c]
        cables.ferrule[c] += given * longer
    return True


@internal
def _row(room: FloatMatrix) -> _Row:
    n = room.shape[1] - 1
    return _Row(
        room[0], room[1, :n], room[2, :n], room[3, :n], room[4, :n], room[5, :n],
        room[6, :n], room[7, :n], room[8, :n], room[9, :n],
    )  # fmt: skip


@internal
def _solved(
    low: FloatArray, mid: FloatArray, high: FloatArray, left: FloatArray
) -> None:
    """Solve a tridiagonal system in place of its right side, from the far end."""
    n = mid.size
    for i in range(n - 2, -1, -1):
        part = high[i] / mid[i + 1]
        mid[i] -= part * low[i + 1]
        left[i] -= part * left[i + 1]
    left[0] /= mid[0]
    for i in range(1, n):
        left[i] = (left[i] - low[i] * left[i - 1]) / mid[i]
