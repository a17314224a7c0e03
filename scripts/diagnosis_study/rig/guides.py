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
from rig import engine
from rig.engine import (
    HUB,
    HUB_SPEED,
    JOINT,
    JOINT_SPEED,
    MOTOR,
    MOTOR_SPEED,
    copy,
    total,
)
from rig.nominal import Rig

GUIDES = 36  # guide rings per cable, which bend it between straight pieces


class Plant(NamedTuple):
    """All constants of the equations; SI and radians, arrays are (2, ...) by cable."""

    # --- the bench -----------------------------------------------------------
    motor_radius: float
    joint_radius: float
    bend: FloatMatrix  # bend at every guide (2, guides) [rad]
    piece: FloatMatrix  # stiffness of every piece (2, guides + 1) [N/m]
    piece_share: FloatMatrix
    """Length of every piece over that of the cable (2, guides + 1)."""
    friction: FloatArray  # coefficient of friction (2,)
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    yield_travel: float = 5e-7  # travel of a contact up to sliding [m]
    reference_tension: float = 80.0

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
    bonding_slip: float = 1e-4
    flexing: float = 0.0
    """Wrap gained per joint angle at the joint's end of the conduit."""
    running_in: float = 0.0  # change of friction over long travel, relative
    running_travel: float = 1.0

    # --- elasticity and geometry ------------------------------------------------
    settling: float = 0.0  # fraction of the pretension that is lost eventually
    settling_time: float = 0.3
    sag: float = 0.0  # stretch of a cable from slack to taut [m]
    anchor: float = 0.0  # compliance of the anchorage at the joint, one cable [m/N]
    anchor_time: float = 2e-3  # damping of the anchorage over its stiffness [s]
    offcentre: float = 0.0  # distance of the motor pulley's axis from its middle [m]
    offcentre_phase: float = 0.0
    play: float = 0.0  # full gap between joint pulley and handle [rad]
    stop_stiffness: float = 2e3
    stop_damping: float = 0.5
    hub_inertia: float = 2.5e-4

    # --- loads on the shafts ----------------------------------------------------
    detent: float = 0.0  # torque of the motor's poles, a wave of parabolas [N m]
    detent_order: float = 14.0
    detent_phase: float = 0.0
    gear_inertia: float = 0.0  # inertia between torque sensor and motor pulley [kg m^2]
    unbalance: float = 0.0  # unbalance of the joint pulley, m g l [N m]
    unbalance_phase: float = 0.0
    strap: float = 0.0
    """Stiffness of a strap over the joint pulley [N m/rad], rising with its stretch."""
    strap_rest: float = 0.0
    bearing: float = 0.0  # friction of the joint pulley's bearing [N m]
    flywheel: float = 0.0  # extra inertia of the joint pulley [kg m^2]

    # --- what no library should know ----------------------------------------------
    notches: float = 0.0  # force of a notched ring near the middle of cable a [N]
    notch_pitch: float = 6e-3
    rubbing: float = 0.0
    """Friction of a cable by the other's tension over the reference, relative."""
    snapping: float = 0.0
    """Length that the conduit of cable a gives when it snaps over [m]."""
    snap_tension: float = 100.0
    catch: float = 0.0
    """Largest torque of a ball that the joint pulley catches at one angle [N m]."""
    catch_angle: float = 0.0
    catch_width: float = 0.08


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
    return Plant(
        rig.motor_radius, rig.joint_radius, drawn(GUIDES, rig.wrap),
        rig.axial_stiffness / length, length / rig.length,
        np.array([rig.friction_a, rig.friction_b]), rig.joint_inertia,
        rig.joint_damping, rig.rotor_inertia,
    )  # fmt: skip


SHARES = np.array([0.5, 0.3, 0.2])  # share of each contact in the friction of a guide
SOFT = np.array([0.5, 1.0, 2.0])
"""Travel of each contact up to sliding, over `Plant.yield_travel`."""
_ENOUGH = 1e-6
_ITERATIONS = 60
_SOFTEST, _HARDEST = 1.0, 1e12
"""Bounds of the damper in pseudo-transient continuation [N/m]."""


class _Row(NamedTuple):
    """Terms of a guide's balance, arrays of (guides,) but for the first."""

    slope: FloatArray  # derivative of the tension by the stretch (guides + 1) [N/m]
    left: FloatArray  # residual force [N]
    low: FloatArray  # negative derivative of `left` by the previous guide's place [N/m]
    mid: FloatArray  # negative derivative by the guide's own place [N/m]
    high: FloatArray  # negative derivative by the next guide's place [N/m]
    force: FloatArray  # force of friction and dampers [N]
    before: FloatArray  # place a step ago [m]
    kept: FloatArray  # place before a step of the search [m]
    grips: FloatArray  # friction over load
    dry: FloatArray  # load-independent friction [N]


class Cables(NamedTuple):
    """State of both cables; displacements are towards the motor [m]."""

    place: FloatMatrix  # displacement of the cable at its guides (2, guides) [m]
    stuck: FloatCube  # anchor point of every contact (2, guides, contacts) [m]
    speed: FloatMatrix  # low-pass filtered speed at the guides (2, guides) [m/s]
    rest: FloatMatrix  # growth of the bonds, 0 to 1 (2, guides)
    travel: FloatArray  # mean travel of the cable since the start (2,) [m]
    tension: FloatMatrix  # tension of every piece (2, guides + 1) [N]
    stretch: FloatArray  # elongation of the anchorage at the joint (2,) [m]
    snapped: FloatArray  # 1 where the conduit has given way, else 0 (2,)
    work: FloatArray  # work of friction and dampers (2,) [J]
    row: _Row  # work space


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, displaced by `arcs` [m]."""
    guides = p.bend.shape[1]
    place = np.repeat(np.array(arcs)[:, None], guides, axis=1)
    stuck = np.repeat(place[:, :, None], SHARES.size, axis=2)
    return Cables(
        place, stuck, np.zeros((2, guides)), np.zeros((2, guides)), np.zeros(2),
        np.full((2, guides + 1), pretension), np.full(2, pretension * p.anchor),
        np.zeros(2), np.zeros(2), _Row(np.zeros(guides + 1), *np.zeros((9, guides))),
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


@internal
def _balance(
    p: Plant,
    cables: Cables,
    c: int,
    place: FloatArray,
    ends: tuple[float, float, float],
    dt: float,
) -> tuple[float, float]:
    """Fill the row; return the largest residual [N] and the anchorage's stretch [m].

    `ends` are the tension at rest and the displacements of both ends.
    """
    guides = p.bend.shape[1]
    tight, near, far = ends
    row, tension = cables.row, cables.tension[c]
    slope, left, force = row.slope, row.left, row.force
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
    p: Plant, cables: Cables, c: int, ends: tuple[float, float, float], dt: float
) -> float:
    """Find the equilibrium where Newton's method fails; return the anchorage's stretch.

    Where pieces are slack, friction alone holds a guide and a step of Newton's method
    is unreliable. The guides creep from their previous places instead, against a damper
    that is raised until the residual decreases
    (pseudo-transient continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35,
    1998).
    """
    place, row = cables.place[c], cables.row
    left = row.left
    copy(row.before, place)
    damper = _SOFTEST
    worst, stretched = _balance(p, cables, c, place, ends, dt)
    for _ in range(2000):  # creeps
        if worst < _ENOUGH * p.reference_tension or damper > _HARDEST:
            break
        size = _squares(left)
        copy(place, row.kept)
        for i in range(place.size):
            row.mid[i] += damper
        _solved(row.low, row.mid, row.high, left)
        for i in range(place.size):
            place[i] += left[i]
        worst, stretched = _balance(p, cables, c, place, ends, dt)
        if _squares(left) < size:
            damper = max(0.2 * damper, _SOFTEST)
            continue
        damper *= 5.0
        copy(row.kept, place)
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
    row = cables.row
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
        worst, stretched = _balance(p, cables, c, place, ends, dt)
        if worst < _ENOUGH * p.reference_tension:
            break
        _solved(row.low, row.mid, row.high, row.left)
        # Shorter steps where contacts go over from one side to the other for ever.
        part = 1.0 if worst < smallest or turn < 8 else 0.5
        smallest = min(smallest, worst)
        for i in range(guides):
            place[i] += part * row.left[i]
    if not worst < 1e-3 * p.reference_tension:  # it has failed
        stretched = _crept(p, cables, c, ends, dt)
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


@compiled
def arc(p: Plant, angle: float, side: float) -> tuple[float, float]:
    """Return the length [m] wound on the motor pulley, and its slope [m/rad], by angle.

    An eccentric pulley changes the lengths on its two sides oppositely.
    """
    e = side * p.offcentre
    length = p.motor_radius * angle
    length += e * (math.sin(angle - p.offcentre_phase) + math.sin(p.offcentre_phase))
    return length, p.motor_radius + e * math.cos(angle - p.offcentre_phase)


@internal
def _wave(phase: float) -> float:
    part = (phase / math.pi) % 2.0
    return (
        4.0 * part * (1.0 - part) if part < 1.0 else -4.0 * (part - 1.0) * (2.0 - part)
    )


@internal
def _taken(p: Plant, angle: float, speed: float) -> float:
    """Return the torque that what sits on the joint pulley takes."""
    load = p.unbalance * math.sin(angle - p.unbalance_phase)
    off = angle - p.strap_rest
    load += p.strap * off * (1.0 + 0.1 * off * off)
    load += p.bearing * math.tanh(speed / 0.01)
    near = (angle - p.catch_angle) / p.catch_width
    return load + p.catch * near * math.exp(0.5 * (1.0 - near * near))


@compiled
def _run(p: Plant, cables: Cables, run: engine.Run) -> bool:
    shafts, now, out = run.shafts, run.now, run.records
    dt = run.dt
    hub = p.hub_inertia if p.play != 0.0 else 0.0
    near_a = near_b = far_a = far_b = run.pretension
    work_in = work_out = 0.0
    step = 0
    for record in range(out.shape[0]):
        row = out[record]
        for _ in range(run.steps):
            drive, hold = engine.torques(run, step)
            step += 1
            motor = shafts[MOTOR]
            slope_a, slope_b = arc(p, motor, 1.0)[1], arc(p, motor, -1.0)[1]
            pull = slope_a * near_a - slope_b * near_b
            load = pull + p.detent * _wave(p.detent_order * motor - p.detent_phase)
            inertia = p.rotor_inertia + p.gear_inertia
            rate = engine.turn(shafts, MOTOR, drive - load, inertia, dt)
            shown = load + p.gear_inertia * rate
            moved = shafts[MOTOR_SPEED] * dt
            given = p.joint_radius * (far_a - far_b)
            across = engine.through_play(
                shafts, p.play, p.stop_stiffness, p.stop_damping
            )
            felt = engine.turn_joint(
                shafts, given - _taken(p, shafts[HUB], shafts[HUB_SPEED]),
                hold - p.joint_damping * shafts[JOINT_SPEED], across,
                p.joint_inertia, hub, p.flywheel, dt,
            )  # fmt: skip
            work_in += 0.5 * pull * moved
            work_out += 0.5 * given * shafts[HUB_SPEED] * dt
            tight = run.pretension
            if p.settling != 0.0:
                late = math.log1p(step * dt / p.settling_time)
                tight *= 1.0 - p.settling * late / math.log1p(8.0 / p.settling_time)
            angle, motor = shafts[HUB], shafts[MOTOR]
            far = p.joint_radius * angle
            arc_a, slope_a = arc(p, motor, 1.0)
            arc_b, slope_b = arc(p, motor, -1.0)
            near_a, far_a = settle(p, cables, 0, tight, arc_a, far, angle, dt)
            near_b, far_b = settle(p, cables, 1, tight, -arc_b, -far, angle, dt)
            pull = slope_a * near_a - slope_b * near_b
            given = p.joint_radius * (far_a - far_b)
            work_in += 0.5 * pull * moved
            work_out += 0.5 * given * shafts[HUB_SPEED] * dt
            # Angles where the torques of the step are: at its beginning.
            speed = shafts[JOINT_SPEED]
            seen = shafts[JOINT] - speed * dt, felt, speed
            engine.see(
                now, (motor - moved, shown), seen, (near_a, near_b), (far_a, far_b)
            )
            engine.add(row, now, 1.0)
        rubbed = cables.work[0] + cables.work[1]
        engine.close(row, run.steps, (work_in, work_out, rubbed, 0.0))
        for c in range(2):
            for i in range(cables.tension.shape[1]):
                row[13] += 0.5 * cables.tension[c, i] ** 2 / p.piece[c, i]
    return True


LAW = engine.Law(arc, start, _run, lambda _p: 1)


@compiled
def advance(
    p: Plant,
    cables: Cables,
    pretension: float,
    state: FloatArray,
    ends: FloatArray,
    torque: float,
    hand: FloatArray,
    steps: int,
    dt: float,
) -> None:
    """Advance by some steps of dt [s], by a torque of the motor from outside [N m].

    Loads on the shafts, play, an axis off the middle and a pretension that settles are
    left out. The state is angle and speed of the motor and of the joint; `ends` are the
    tensions at motor and joint of both cables, `pretension` that at rest [N]; the hand
    has stiffness, damping, and an angle and a speed that it asks for.
    """
    for _ in range(steps):
        load = p.motor_radius * (ends[0] - ends[1])
        engine.turn(state, 0, torque - load, p.rotor_inertia + p.gear_inertia, dt)
        given = p.joint_radius * (ends[2] - ends[3])
        hold = hand[0] * (hand[2] - state[2]) + hand[1] * (hand[3] - state[3])
        hold -= p.joint_damping * state[3]
        engine.turn(state, 2, given + hold, p.joint_inertia + p.flywheel, dt)
        near, far = p.motor_radius * state[0], p.joint_radius * state[2]
        ends[0], ends[2] = settle(p, cables, 0, pretension, near, far, state[2], dt)
        ends[1], ends[3] = settle(p, cables, 1, pretension, -near, -far, state[2], dt)
