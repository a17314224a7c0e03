"""A rig with guides: two cables without mass, which are springs between guides.

Every instant is an equilibrium. A guide holds the cable by three contacts of different
stiffness that stick until they slide (a generalised Maxwell-slip element: Iwan,
J. Appl. Mech. 33, 1966); what they hold together makes the capstan equation exact,

    F_c = 2 tanh(mu bend / 2) N,

with N the mean tension of both sides. The equilibrium is found by Newton's method on a
tridiagonal system, at once for all guides, every 0.2 ms. Every hidden effect is off at
its default, 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, compiled, internal
from rig import engine, soft_anchor
from rig.engine import copy, row_of, solve, total
from rig.nominal import Rig

GUIDES = 36  # guide rings per cable, which bend it between straight pieces


TENSION = 80.0  # tension at which constants are those stated [N]
SEATING = 25.0  # tension that takes a cable half across a gap [N]
BONDING_SLIP = 1e-4  # travel that breaks a bond [m]
ANCHOR_TIME = 2e-3  # damping of the anchorage over its stiffness [s]


class Plant(NamedTuple):
    """All constants of the equations; SI and radians, arrays are (2, ...) by cable."""

    bench: engine.Bench
    bend: FloatMatrix  # bend at every guide (2, guides) [rad]
    piece: FloatMatrix  # stiffness of every piece (2, guides + 1) [N/m]
    piece_share: FloatMatrix
    """Length of every piece over that of the cable (2, guides + 1)."""
    friction: FloatArray  # coefficient of friction (2,)
    yield_travel: float = 5e-7  # travel of a contact up to sliding [m]

    # --- friction ------------------------------------------------------------
    dashpot: float = 0.0
    """Force per speed, one cable [N s/m]; guides near the motor have more of it."""
    stick_excess: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    stick_speed: float = 0.03
    lean: float = 0.0  # excess of friction while cable a goes to the motor, relative
    wiper: float = 0.0  # load-independent friction of the wipers of one cable [N]
    adhesion: float = 0.0
    """Relative loss of the friction coefficient from low to high tension."""
    bonding: float = 0.0  # growth of friction in a long rest, relative
    bonding_time: float = 0.4
    flexing: float = 0.0
    """Wrap gained per joint angle at the joint's end of the conduit."""
    running_in: float = 0.0  # change of friction over long travel, relative
    running_travel: float = 1.0

    # --- elasticity ----------------------------------------------------------
    sag: float = 0.0  # stretch of a cable from slack to taut [m]
    anchor: float = 0.0  # compliance of the anchorage at the joint, one cable [m/N]
    textile: float = 0.0  # compliance of slack textile between cables and joint [m/N]
    gap: float = 0.0  # room of the cables across their rings [m]
    # Relative wrap that the middle bends lose per mean tension over the reference
    opening: float = 0.0

    # --- what no library should know ----------------------------------------------
    notches: float = 0.0  # force of a notched ring near the middle of cable a [N]
    notch_pitch: float = 6e-3
    rubbing: float = 0.0
    """Friction of a cable by the other's tension over the reference, relative."""
    snapping: float = 0.0
    """Length that the conduit of cable a gives when it snaps over [m]."""
    snap_tension: float = 100.0


def plant_of(rig: Rig) -> Plant:
    """Return the plant of a rig without a hidden effect.

    Bends and pieces are sampled from the rig's seed; their sums are the rig's.
    """
    random = np.random.default_rng([rig.seed, 0x6D1])

    def drawn(count: int, whole: float) -> FloatArray:
        parts = 1.0 + 0.15 * random.uniform(-1.0, 1.0, (2, count))
        return np.asarray(whole * parts / parts.sum(axis=1, keepdims=True))

    # The first and the last guide are half a piece from the ends.
    length = drawn(GUIDES + 1, rig.length)
    length[:, [0, -1]] *= 0.5
    length *= rig.length / length.sum(axis=1, keepdims=True)
    bench = engine.bench_of(
        rig, hardening=0.1, creeping=True,
        contact_stiffness=2e3, contact_damping=0.5,
    )  # fmt: skip
    return Plant(
        bench, drawn(GUIDES, rig.wrap), rig.axial_stiffness / length,
        length / rig.length, np.array([rig.friction_a, rig.friction_b]),
    )  # fmt: skip


SHARES = np.array([0.5, 0.3, 0.2])  # share of each contact in the friction of a guide
SOFT = np.array([0.5, 1.0, 2.0])
"""Travel of each contact up to sliding, over `Plant.yield_travel`."""
_ENOUGH = 1e-6
_ITERATIONS = 60
_SOFTEST, _HARDEST = 1.0, 1e12
"""Bounds of the damper in pseudo-transient continuation [N/m]."""


class Cables(NamedTuple):
    """State of both cables; displacements are towards the motor [m]."""

    place: FloatMatrix  # displacement of the cable at its guides (2, guides) [m]
    stuck: FloatCube  # anchor point of every contact (2, guides, contacts) [m]
    speed: FloatMatrix  # low-pass filtered speed at the guides (2, guides) [m/s]
    rest: FloatMatrix  # growth of the bonds, 0 to 1 (2, guides)
    travel: FloatArray  # mean travel of the cable since the start (2,) [m]
    tension: FloatMatrix  # tension of every piece (2, guides + 1) [N]
    stretch: FloatMatrix  # state of what holds the ends, see `soft_anchor` (2, ...) [m]
    snapped: FloatArray  # 1 where the conduit has given way, else 0 (2,)
    work: FloatArray  # work of friction and dampers (2,) [J]
    room: FloatMatrix  # work space (10, guides + 1), see `engine.Row`


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, displaced by `arcs` [m]."""
    guides = p.bend.shape[1]
    place = np.repeat(np.array(arcs)[:, None], guides, axis=1)
    stuck = np.repeat(place[:, :, None], SHARES.size, axis=2)
    stretch = soft_anchor.fabric(p.textile, pretension)
    stretch[:, soft_anchor.NOW] += pretension * p.anchor
    return Cables(
        place, stuck, np.zeros((2, guides)), np.zeros((2, guides)), np.zeros(2),
        np.full((2, guides + 1), pretension), stretch,
        np.zeros(2), np.zeros(2), np.zeros((10, guides + 1)),
    )  # fmt: skip


@internal
def pull(stiffness: float, stretch: float, sag: float) -> tuple[float, float]:
    """Return the tension of a piece [N] and its slope [N/m]; never negative."""
    if sag == 0.0:
        return (stiffness * stretch, stiffness) if stretch > 0.0 else (0.0, 0.0)
    root = math.sqrt(stretch * stretch + sag * sag)
    tension = 0.5 * stiffness * (stretch + root)
    return tension, 0.5 * stiffness * (1.0 + stretch / root)


@internal
def pull_across(stiffness: float, stretch: float, room: float) -> tuple[float, float]:
    """Return `pull` of a piece that also crosses a gap, shorter by up to `room` [m].

    The stretch is tension / stiffness + room tension / (tension + `SEATING`).
    """
    if stretch <= 0.0:
        return 0.0, 0.0
    linear = SEATING + stiffness * (room - stretch)
    root = math.sqrt(linear * linear + 4.0 * stiffness * stretch * SEATING)
    tension = 0.5 * (root - linear)
    give = room * SEATING / (tension + SEATING) ** 2
    return tension, 1.0 / (1.0 / stiffness + give)


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
    if p.opening != 0.0 and guides // 3 <= i < guides - guides // 3:
        mean = total(cables.tension[c]) / (guides + 1)
        bend *= 1.0 - p.opening * (mean / TENSION - 1.0)
    dry = 0.5 * p.wiper if i == 1 or i == guides - 2 else 0.0
    return 2.0 * math.tanh(0.5 * p.friction[c] * factor * max(bend, 0.0)), dry


@internal
def _balance(
    p: Plant,
    cables: Cables,
    c: int,
    place: FloatArray,
    ends: tuple[float, float, float],
    dt: float,
) -> tuple[float, float]:
    """Fill the terms; return the largest residual [N] and the anchorage's stretch [m].

    `ends` are the tension at rest and the displacements of both ends.
    """
    guides = p.bend.shape[1]
    tight, near, far = ends
    row, tension = row_of(cables.room), cables.tension[c]
    slope, left, force = row.slope, row.left, row.force
    other = total(cables.tension[1 - c]) / (guides + 1)
    anchor = p.anchor
    stretched = cables.stretch[c, soft_anchor.NOW]
    for i in range(guides + 1):
        ahead = near if i == 0 else place[i - 1]
        behind = far if i == guides else place[i]
        k = p.piece[c, i]
        sag = p.sag * p.piece_share[c, i]
        rest = tight / k - 0.25 * sag * sag * k / tight
        if i == guides and anchor != 0.0:
            # A spring with a damper in it, in series with the last piece.
            given = dt / (dt + ANCHOR_TIME)
            k_anchor = 1.0 / (anchor * given)
            start_ = cables.stretch[c, soft_anchor.NOW] * (1.0 - given)
            x = ahead - behind + rest + tight * anchor - start_
            k = k * k_anchor / (k + k_anchor)
            tension[i], slope[i] = pull(k, x, sag)
            stretched = start_ + tension[i] / k_anchor
        elif i == guides and p.textile != 0.0:
            fabric = cables.stretch[c]
            x = ahead - behind + rest + fabric[soft_anchor.AT_REST]
            tension[i], slope[i], stretched = soft_anchor.series(
                p.textile, fabric, k, x
            )
        elif p.gap != 0.0:
            room = 0.5 * p.bend[c, i] if i < guides else 0.0
            room = p.gap * (room + (0.5 * p.bend[c, i - 1] if i > 0 else 0.0))
            x = ahead - behind + rest + room * tight / (tight + SEATING)
            tension[i], slope[i] = pull_across(k, x, room)
        else:
            tension[i], slope[i] = pull(k, ahead - behind + rest, sag)
    worst = 0.0
    for i in range(guides):
        load = 0.5 * (tension[i] + tension[i + 1])
        grip = row.held[i]
        if p.adhesion != 0.0:
            light = TENSION / (TENSION + load)
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
        force[i] = bound * share + damper * (place[i] - row.old[i])
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
    p: Plant, cables: Cables, c: int, ends: tuple[float, float, float], dt: float
) -> float:
    """Find the equilibrium where Newton's method fails; return the anchorage's stretch.

    Where pieces are slack, friction alone holds a guide and a step of Newton's method
    is unreliable. The guides creep from their previous places instead, against a damper
    that is raised until the residual decreases
    (pseudo-transient continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35,
    1998).
    """
    place, row = cables.place[c], row_of(cables.room)
    left = row.left
    copy(row.old, place)
    damper = _SOFTEST
    worst, stretched = _balance(p, cables, c, place, ends, dt)
    for _ in range(2000):  # creeps
        if worst < _ENOUGH * TENSION or damper > _HARDEST:
            break
        size = _squares(left)
        copy(place, row.other)
        for i in range(place.size):
            row.mid[i] += damper
        solve(row.low, row.mid, row.high, left)
        for i in range(place.size):
            place[i] += left[i]
        worst, stretched = _balance(p, cables, c, place, ends, dt)
        if _squares(left) < size:
            damper = max(0.2 * damper, _SOFTEST)
            continue
        damper *= 5.0
        copy(row.other, place)
        worst, stretched = _balance(p, cables, c, place, ends, dt)
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

    `tight` is the tension at rest [N]; `near` and `far` are the displacements of the
    ends at motor and joint [m].
    """
    guides = p.bend.shape[1]
    place, tension = cables.place[c], cables.tension[c]
    row = row_of(cables.room)
    copy(place, row.old)
    for i in range(guides):
        row.held[i], row.dry[i] = _held(p, cables, c, i, joint)
    if p.snapping != 0.0 and c == 0:
        if tension[guides // 2] > p.snap_tension:
            cables.snapped[c] = 1.0
        elif tension[guides // 2] < 0.8 * p.snap_tension:
            cables.snapped[c] = 0.0
        near -= p.snapping * cables.snapped[c]
    ends = (tight, near, far)
    smallest, worst, stretched = 1e300, 0.0, 0.0
    for turn in range(_ITERATIONS):
        worst, stretched = _balance(p, cables, c, place, ends, dt)
        if worst < _ENOUGH * TENSION:
            break
        solve(row.low, row.mid, row.high, row.left)
        # Shorter steps where contacts go over from one side to the other for ever.
        part = 1.0 if worst < smallest or turn < 8 else 0.5
        smallest = min(smallest, worst)
        for i in range(guides):
            place[i] += part * row.left[i]
    if not worst < 1e-3 * TENSION:  # it has failed
        stretched = _crept(p, cables, c, ends, dt)
    if p.anchor != 0.0:
        cables.stretch[c, soft_anchor.NOW] = stretched
    if p.textile != 0.0:
        soft_anchor.slide(p.textile, cables.stretch[c], stretched)
    way = 0.0
    mix = dt / (0.01 + dt)
    for i in range(guides):
        for k_ in range(SHARES.size):
            reach = SOFT[k_] * p.yield_travel
            off = place[i] - cables.stuck[c, i, k_]
            cables.stuck[c, i, k_] += off - min(max(off, -reach), reach)
        moved = place[i] - row.old[i]
        cables.work[c] += row.force[i] * moved
        way += abs(moved) / guides
        cables.speed[c, i] += mix * (moved / dt - cables.speed[c, i])
        grown = cables.rest[c, i] + (1.0 - cables.rest[c, i]) * dt / p.bonding_time
        cables.rest[c, i] = grown / (1.0 + abs(moved) / BONDING_SLIP)
    cables.travel[c] += way
    return tension[0], tension[guides]


@internal
def _squares(values: FloatArray) -> float:
    whole = 0.0
    for i in range(values.size):
        whole += values[i] * values[i]
    return whole


@internal
def _step(
    p: Plant, cables: Cables, run: engine.Run, drive: float, hold: float, time: float
) -> None:
    """Turn the shafts and bring the cables to the equilibrium at `time` [s]."""
    shafts, now = run.shafts, run.now
    # Angles where the torques of the step are: at its beginning.
    engine.turn_shafts(p.bench, run, drive, hold, 1.0)
    tight = engine.tension_at_rest(p.bench, run.pretension, time)
    angle, near, other = shafts[engine.HUB], shafts[engine.ARC_A], -shafts[engine.ARC_B]
    far = p.bench.joint_radius * angle
    now[engine.NEAR_A], now[engine.FAR_A] = settle(
        p, cables, 0, tight, near, far, angle, run.dt
    )
    now[engine.NEAR_B], now[engine.FAR_B] = settle(
        p, cables, 1, tight, other, -far, angle, run.dt
    )
    engine.balance(p.bench, run)


@compiled
def _run(p: Plant, cables: Cables, run: engine.Run) -> bool:
    for step in range(run.records.shape[0] * run.steps):
        drive, hold = engine.torques(run, step)
        _step(p, cables, run, drive, hold, (step + 1) * run.dt)
        engine.record(run, step, 1.0)
        if (step + 1) % run.steps == 0:
            stored = 0.0
            for c in range(2):
                for i in range(cables.tension.shape[1]):
                    stored += 0.5 * cables.tension[c, i] ** 2 / p.piece[c, i]
            rubbed = cables.work[0] + cables.work[1]
            engine.close(run, step, rubbed, 0.0, stored)
    return True


LAW = engine.Law(start, _run, lambda _p: 1)


@compiled
def advance(
    p: Plant,
    cables: Cables,
    run: engine.Run,
    torque: float,
    hand: FloatArray,
    begin: float,
    steps: int,
) -> None:
    """Advance from a time [s] by some steps and a torque of the motor [N m].

    The hand has stiffness, damping, and an angle and a speed that it asks for.
    """
    shafts = run.shafts
    for k in range(steps):
        hold = hand[0] * (hand[2] - shafts[engine.JOINT])
        hold += hand[1] * (hand[3] - shafts[engine.JOINT_SPEED])
        _step(p, cables, run, torque, hold, begin + (k + 1) * run.dt)
