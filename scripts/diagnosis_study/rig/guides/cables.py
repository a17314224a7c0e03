"""Two cables without mass: springs between guides that hold by friction; compiled.

Every instant is an equilibrium. A guide holds the cable by three contacts of different
stiffness that stick until they slide (a generalised Maxwell-slip element: Iwan,
J. Appl. Mech. 33, 1966); what they hold together makes the capstan equation exact,

    F_c = 2 tanh(mu bend / 2) N,

with N the mean tension of both sides. The equilibrium is found by Newton's method on a
tridiagonal system, at once for all guides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, compiled, internal
from rig.engine import copy, total
from rig.guides.plant import Plant

SHARES = np.array([0.5, 0.3, 0.2])
"""Share of each contact in the friction of a guide."""
SOFT = np.array([0.5, 1.0, 2.0])
"""Travel of each contact up to sliding, over `Plant.yield_travel`."""
_ENOUGH = 1e-6
_ITERATIONS = 60
_BEARABLE = 1e-3
"""Residual over the reference tension above which Newton's method has failed."""
_CREEPS = 2000
_SOFTEST, _HARDEST = 1.0, 1e12
"""Bounds of the damper in pseudo-transient continuation [N/m]."""


class Cables(NamedTuple):
    """State of both cables; displacements are towards the motor [m].

    Attributes:
        place: displacement of the cable at its guides (2, guides) [m].
        stuck: anchor point of every contact (2, guides, contacts) [m].
        speed: low-pass filtered speed at the guides (2, guides) [m/s].
        rest: growth of the bonds, 0 to 1 (2, guides).
        travel: mean travel of the cable since the start (2,) [m].
        tension: tension of every piece (2, guides + 1) [N].
        stretch: elongation of the anchorage at the joint (2,) [m].
        snapped: 1 where the conduit has given way, else 0 (2,).
        work: work of friction and dampers (2,) [J].
        room: work space (10, guides + 1).
    """

    place: FloatMatrix
    stuck: FloatCube
    speed: FloatMatrix
    rest: FloatMatrix
    travel: FloatArray
    tension: FloatMatrix
    stretch: FloatArray
    snapped: FloatArray
    work: FloatArray
    room: FloatMatrix


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, displaced by `arcs` [m]."""
    guides = p.bend.shape[1]
    place = np.repeat(np.array(arcs)[:, None], guides, axis=1)
    stuck = np.repeat(place[:, :, None], SHARES.size, axis=2)
    return Cables(
        place,
        stuck,
        np.zeros((2, guides)),
        np.zeros((2, guides)),
        np.zeros(2),
        np.full((2, guides + 1), pretension),
        np.full(2, pretension * p.anchor),
        np.zeros(2),
        np.zeros(2),
        np.zeros((10, guides + 1)),
    )


@internal
def pull(stiffness: float, stretch: float, sag: float) -> tuple[float, float]:
    """Return the tension of a piece and its slope by the stretch; never negative."""
    if sag == 0.0:
        return (stiffness * stretch, stiffness) if stretch > 0.0 else (0.0, 0.0)
    root = math.sqrt(stretch * stretch + sag * sag)
    tension = 0.5 * stiffness * (stretch + root)
    return tension, 0.5 * stiffness * (1.0 + stretch / root)


@internal
def _held(
    p: Plant, cables: Cables, c: int, i: int, joint: float
) -> tuple[float, float]:
    """Return friction over load at a guide, and its load-independent friction [N]."""
    guides = p.bend.shape[1]
    speed = cables.speed[c, i]
    factor = 1.0 + p.stick_excess / (1.0 + (speed / p.stick_speed) ** 2)
    factor *= 1.0 + p.bonding * cables.rest[c, i]
    factor *= 1.0 + p.running_in * (
        1.0 - math.exp(-cables.travel[c] / p.running_travel)
    )
    lean = p.lean if c == 0 else -0.6 * p.lean
    factor *= 1.0 + lean * math.tanh(speed / 2e-3)
    bend = p.bend[c, i]
    if p.flexing != 0.0 and i >= guides - guides // 3:
        bend += p.flexing * math.sin(joint) / (guides // 3)
    dry = 0.5 * p.wiper if i == 1 or i == guides - 2 else 0.0
    return 2.0 * math.tanh(0.5 * p.friction[c] * factor * max(bend, 0.0)), dry


class _Row(NamedTuple):
    """Terms of a guide's balance, arrays of (guides,) but for the first two.

    Attributes:
        tension: tension of every piece (guides + 1) [N].
        slope: derivative of the tension by the stretch (guides + 1) [N/m].
        left: residual force [N].
        low: negative derivative of `left` by the previous guide's place [N/m].
        mid: negative derivative by the guide's own place [N/m].
        high: negative derivative by the next guide's place [N/m].
        force: force of friction and dampers [N].
        before: place a step ago [m].
        kept: place before a step of the search [m].
        grips: friction over load.
        dry: load-independent friction [N].
    """

    tension: FloatArray
    slope: FloatArray
    left: FloatArray
    low: FloatArray
    mid: FloatArray
    high: FloatArray
    force: FloatArray
    before: FloatArray
    kept: FloatArray
    grips: FloatArray
    dry: FloatArray


@internal
def _balance(
    p: Plant,
    cables: Cables,
    c: int,
    place: FloatArray,
    ends: tuple[float, float, float],
    dt: float,
    row: _Row,
) -> tuple[float, float]:
    """Fill the row; return the largest residual [N] and the anchorage's stretch [m].

    `ends` are the tension at rest and the displacements of both ends.
    """
    guides = p.bend.shape[1]
    tight, near, far = ends
    tension, slope, left, force = row.tension, row.slope, row.left, row.force
    other = total(cables.tension[1 - c]) / (guides + 1)
    anchor = p.anchor
    stretched = cables.stretch[c]
    for i in range(guides + 1):
        ahead = near if i == 0 else place[i - 1]
        behind = far if i == guides else place[i]
        k = p.piece[c, i]
        sag = p.sag * p.piece_share[c, i]
        rest = tight / k - 0.25 * sag * sag * k / tight
        if i == guides and anchor != 0.0:
            # A spring with a damper in it, in series with the last piece.
            given = dt / (dt + p.anchor_time)
            k_anchor = 1.0 / (anchor * given)
            start_ = cables.stretch[c] * (1.0 - given)
            x = ahead - behind + rest + tight * anchor - start_
            k = k * k_anchor / (k + k_anchor)
            tension[i], slope[i] = pull(k, x, sag)
            stretched = start_ + tension[i] / k_anchor
        else:
            tension[i], slope[i] = pull(k, ahead - behind + rest, sag)
    worst = 0.0
    for i in range(guides):
        load = 0.5 * (tension[i] + tension[i + 1])
        grip = row.grips[i]
        if p.adhesion != 0.0:
            light = p.reference_tension / (p.reference_tension + load)
            grip *= 1.0 + p.adhesion * (2.0 * light - 1.0)
        extra = p.rubbing * p.bend[c, i] * other / p.bend.shape[1]
        bound = grip * load + row.dry[i] + extra
        share, stiff = 0.0, 0.0
        for k_ in range(SHARES.size):
            reach = SOFT[k_] * p.yield_travel
            off = (place[i] - cables.stuck[c, i, k_]) / reach
            share += SHARES[k_] * min(max(off, -1.0), 1.0)
            if -1.0 < off < 1.0:
                stiff += SHARES[k_] / reach
        damper = p.dashpot * 2.0 * (guides - i) / (guides * (guides + 1.0)) / dt
        force[i] = bound * share + damper * (place[i] - row.before[i])
        mid = bound * stiff + damper
        if p.notches != 0.0 and c == 0 and i == guides // 2:
            phase = 2.0 * math.pi / p.notch_pitch
            force[i] += p.notches * math.sin(phase * place[i])
            mid += max(p.notches * phase * math.cos(phase * place[i]), 0.0)
        # Towards the motor pulls the piece before, back the one behind.
        left[i] = tension[i] - tension[i + 1] - force[i]
        half_load = 0.5 * grip * share
        row.low[i] = -slope[i] + half_load * slope[i]
        row.high[i] = -slope[i + 1] - half_load * slope[i + 1]
        mid += slope[i] + slope[i + 1] + half_load * (slope[i + 1] - slope[i])
        row.mid[i] = mid + 1e-3
        worst = max(worst, abs(left[i]))
    return worst, stretched


@internal
def _crept(
    p: Plant,
    cables: Cables,
    c: int,
    ends: tuple[float, float, float],
    dt: float,
    row: _Row,
) -> float:
    """Find the equilibrium where Newton's method fails; return the anchorage's stretch.

    Where pieces are slack, friction alone holds a guide and a step of Newton's method
    is unreliable. The guides creep from their previous places instead, against a damper
    that is raised until the residual decreases
    (pseudo-transient continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35,
    1998).
    """
    place, left = cables.place[c], row.left
    copy(row.before, place)
    damper = _SOFTEST
    worst, stretched = _balance(p, cables, c, place, ends, dt, row)
    for _ in range(_CREEPS):
        if worst < _ENOUGH * p.reference_tension or damper > _HARDEST:
            break
        size = _squares(left)
        copy(place, row.kept)
        for i in range(place.size):
            row.mid[i] += damper
        _solved(row.low, row.mid, row.high, left)
        for i in range(place.size):
            place[i] += left[i]
        worst, stretched = _balance(p, cables, c, place, ends, dt, row)
        if _squares(left) < size:
            damper = max(0.2 * damper, _SOFTEST)
            continue
        damper *= 5.0
        copy(row.kept, place)
        worst, stretched = _balance(p, cables, c, place, ends, dt, row)
    return stretched


@compiled
def settle(
    p: Plant,
    cables: Cables,
    c: int,
    tight: float,
    near: float,
    far: float,
    joint: float,
    dt: float,
) -> tuple[float, float]:
    """Bring a cable to equilibrium at a step's end; return its end tensions [N].

    Args:
        p: the plant.
        cables: their state, which moves on.
        c: index of the cable.
        tight: tension at rest [N].
        near: displacement of its end at the motor [m].
        far: displacement of its end at the joint [m].
        joint: angle of the joint [rad].
        dt: duration of the step [s].
    """
    guides = p.bend.shape[1]
    place, tension = cables.place[c], cables.tension[c]
    row = _row(tension, cables.room)
    copy(place, row.before)
    for i in range(guides):
        row.grips[i], row.dry[i] = _held(p, cables, c, i, joint)
    if p.snapping != 0.0 and c == 0:
        if tension[guides // 2] > p.snap_tension:
            cables.snapped[c] = 1.0
        elif tension[guides // 2] < 0.8 * p.snap_tension:
            cables.snapped[c] = 0.0
        near -= p.snapping * cables.snapped[c]
    ends = (tight, near, far)
    smallest, worst, stretched = 1e300, 0.0, 0.0
    for turn in range(_ITERATIONS):
        worst, stretched = _balance(p, cables, c, place, ends, dt, row)
        if worst < _ENOUGH * p.reference_tension:
            break
        _solved(row.low, row.mid, row.high, row.left)
        # Shorter steps where contacts go over from one side to the other for ever.
        part = 1.0 if worst < smallest or turn < 8 else 0.5
        smallest = min(smallest, worst)
        for i in range(guides):
            place[i] += part * row.left[i]
    if not worst < _BEARABLE * p.reference_tension:
        stretched = _crept(p, cables, c, ends, dt, row)
    if p.anchor != 0.0:
        cables.stretch[c] = stretched
    way = 0.0
    mix = dt / (0.01 + dt)
    for i in range(guides):
        for k_ in range(SHARES.size):
            reach = SOFT[k_] * p.yield_travel
            off = place[i] - cables.stuck[c, i, k_]
            cables.stuck[c, i, k_] += off - min(max(off, -reach), reach)
        moved = place[i] - row.before[i]
        cables.work[c] += row.force[i] * moved
        way += abs(moved) / guides
        cables.speed[c, i] += mix * (moved / dt - cables.speed[c, i])
        grown = cables.rest[c, i] + (1.0 - cables.rest[c, i]) * dt / p.bonding_time
        cables.rest[c, i] = grown / (1.0 + abs(moved) / p.bonding_slip)
    cables.travel[c] += way
    return tension[0], tension[guides]


@internal
def _row(tension: FloatArray, room: FloatMatrix) -> _Row:
    n = room.shape[1] - 1
    return _Row(
        tension, room[0], room[1, :n], room[2, :n], room[3, :n], room[4, :n],
        room[5, :n], room[6, :n], room[7, :n], room[8, :n], room[9, :n],
    )  # fmt: skip


@internal
def _squares(values: FloatArray) -> float:
    whole = 0.0
    for i in range(values.size):
        whole += values[i] * values[i]
    return whole


@internal
def _solved(
    low: FloatArray, mid: FloatArray, high: FloatArray, left: FloatArray
) -> None:
    """Solve a tridiagonal system in place of its right side (Thomas)."""
    n = mid.size
    for i in range(1, n):
        part = low[i] / mid[i - 1]
        mid[i] -= part * high[i - 1]
        left[i] -= part * left[i - 1]
    left[n - 1] /= mid[n - 1]
    for i in range(n - 2, -1, -1):
        left[i] = (left[i] - high[i] * left[i + 1]) / mid[i]
