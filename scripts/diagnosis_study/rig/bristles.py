"""A rig of massive nodes held by bristles: two cables that cannot push.

A bristle with load N, travel x and stiffness k follows Dahl's law

    dF/dx = k (1 - sign(dx) F / F_c),   F_c = 2 tanh(mu wrap / 2) N,

with N the mean tension of both sides, which makes a sliding node obey the capstan
equation exactly. The law is stepped implicitly in travel, so no step is too long for
the bristle: no chatter, and at rest F stays as it is.

All is stepped by symplectic Euler, 20 us a step. The other variables of friction
(speed, age, place, warmth) change slowly compared with the waves in the cable; they are
updated once per tick of 0.1 ms, see `update`. Every hidden effect is off at its
default, 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig import engine, soft_anchor
from rig.nominal import Rig

STRAND_TIME = 1.5e-5  # Kelvin-Voigt damping of the strand over its stiffness [s]
TENSION = 80.0  # tension at which constants are those stated [N]
LAG = 0.02  # first-order lag of friction behind speed [s]: frictional memory
AGEING_TIME = 0.05  # [s]
AGEING_SLIP = 1e-4  # travel that renews a contact [m]
HEAT = 8.0  # work of friction that warms a cable [J]
COOLING_TIME = 12.0  # [s]
BUMP_WIDTH = 0.004  # [m]
BEDDING = 40.0  # tension over which a strand beds in [N]
FABRIC = 4  # place in `Cables.work`


class Plant(NamedTuple):
    """All constants of the equations of motion; SI and radians."""

    bench: engine.Bench
    nodes: int
    length: float
    wrap: float
    axial_stiffness: float
    friction_a: float
    friction_b: float
    line_density: float
    presliding: float = 1e-6
    """Travel over which a contact comes to sliding at nominal tension [m]."""

    # --- friction ------------------------------------------------------------
    viscous: float = 0.0  # force per speed, one cable [N s/m]
    stribeck: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    stribeck_speed: float = 0.03
    asymmetry: float = 0.0
    """Excess of friction while the joint turns positive, relative."""
    load_free: float = 0.0  # friction of the end seals of one cable [N]
    tension_power: float = 0.0  # friction coefficient falls with tension to this power
    ageing: float = 0.0
    """Growth of static friction per e-fold of contact time, relative."""
    wrap_slope: float = 0.0
    """Wrap gained per joint angle, in the third of the conduit next the joint."""
    heating: float = 0.0  # change of friction when warm, relative
    bumps: float = 0.0  # excess of friction where the liner is damaged, relative
    # Places per cable where the liner may be damaged.
    bump_places: FloatMatrix = np.zeros((2, 5))

    # --- elasticity ----------------------------------------------------------
    stiffening: float = 0.0
    """Relative change of stiffness of cable a from slack to taut; cable b a third."""
    end_compliance: float = 0.0
    """Series compliance of the anchorage of one cable [m/N], most of it distal."""
    clamp_creep: float = 0.0
    """Speed at which a conduit slides in its clamp at the joint, per tension above
    `clamp_force` [m/(N s)]."""
    clamp_force: float = 0.0
    textile: float = 0.0
    """Compliance of the slack textile between cables and joint [m/N]."""


def plant_of(rig: Rig, nodes: int = 12) -> Plant:
    """Return the plant of a rig in which nothing is hidden."""
    bench = engine.bench_of(rig, overtone=2.0, overtone_share=0.3, oval=0.25)
    own = [name for name in Plant._fields if hasattr(rig, name)]
    return Plant(bench, nodes, **{name: getattr(rig, name) for name in own})


class Cables(NamedTuple):
    """State and tables of both cables, (2, nodes) unless noted.

    Displacements are towards the motor, in the cable's own sense.
    """

    place: FloatMatrix
    speed: FloatMatrix
    force: FloatMatrix  # force of the bristles against the cable [N]
    load: FloatMatrix  # mean tension of both sides of a node [N]
    lagged: FloatMatrix  # low-pass filtered speed, on which friction depends [m/s]
    contact: FloatMatrix  # age of the contacts [s]
    ahead: FloatMatrix  # friction limit over load for motion towards the motor
    behind: FloatMatrix  # friction limit over load for motion away from the motor
    bristle: FloatMatrix  # stiffness of the bristles [N/m]
    stiffness: FloatMatrix  # stiffness of the segments (2, nodes + 1) [N/m]
    seal: FloatArray  # load-independent friction (nodes,) [N]
    work: FloatMatrix
    """Friction and damping work of each cable since the start [J], friction work stored
    as heat over `HEAT`, and friction work already converted into it [J]; from `FABRIC`
    on the state of the textile, see `soft_anchor` (2, ...)."""


def start(p: Plant, pretension: float, arcs: tuple[float, float]) -> Cables:
    """Return both cables at rest at pretension, without friction, displaced by arcs.

    `fill_tables` fills in what depends on friction.
    """
    n = p.nodes
    seal = np.zeros(n)
    seal[0] = 0.4 * p.load_free
    seal[n - 1] = 0.6 * p.load_free
    inner = p.axial_stiffness * p.nodes / p.length
    k = np.full((2, n + 1), inner)  # the end segments are half as long
    k[:, 0] = 1.0 / (0.5 / inner + 0.3 * p.end_compliance)
    k[:, n] = 1.0 / (0.5 / inner + 0.7 * p.end_compliance)
    fabric = soft_anchor.fabric(p.textile, pretension)
    cables = Cables(*(np.zeros((2, n)) for _ in Cables._fields))
    return cables._replace(
        place=np.repeat(np.array(arcs)[:, None], n, axis=1),
        load=np.full((2, n), pretension), stiffness=k, seal=seal,
        work=np.hstack([np.zeros((2, FABRIC)), fabric]),
    )  # fmt: skip


@internal
def fill_tables(p: Plant, cables: Cables) -> None:
    """Fill the tables of the friction of cables at rest."""
    _look_up(p, cables, 0.0)
    for c in range(2):
        for i in range(p.nodes):
            limit = 0.5 * (cables.ahead[c, i] + cables.behind[c, i])
            cables.bristle[c, i] = limit * TENSION / p.presliding


@internal
def _wrap(p: Plant, i: int, joint_angle: float) -> float:
    wrap = p.wrap / p.nodes
    third = p.nodes // 3
    if i >= p.nodes - third:
        bend = joint_angle + 0.2 * joint_angle * abs(joint_angle)
        wrap += p.wrap_slope * bend / third
    return max(wrap, 0.0)


@internal
def _excess(p: Plant, cables: Cables, c: int, i: int) -> float:
    """Return the friction coefficient at a node over its plain value."""
    slowness = cables.lagged[c, i] / p.stribeck_speed
    factor = 1.0 + p.stribeck * math.exp(-slowness * slowness)
    factor += p.ageing * math.log1p(cables.contact[c, i] / AGEING_TIME)
    factor *= 1.0 + p.heating * (1.0 - math.exp(-cables.work[c, 2]))
    if p.tension_power != 0.0:
        ratio = max(cables.load[c, i], 2.0) / TENSION
        factor *= ratio**-p.tension_power
    if p.bumps != 0.0:
        for k in range(p.bump_places.shape[1]):
            away = (cables.place[c, i] - p.bump_places[c, k]) / BUMP_WIDTH
            factor += p.bumps * math.exp(-away * away)
    return factor


@internal
def _look_up(p: Plant, cables: Cables, joint_angle: float) -> None:
    """Compute the friction limit over load at every node, in both directions."""
    for c in range(2):
        mu = p.friction_a if c == 0 else p.friction_b
        # The joint turning positive moves cable a ahead and cable b back. The liner of
        # b has worn less, so its friction leans less.
        lean = p.asymmetry if c == 0 else -0.6 * p.asymmetry
        for i in range(p.nodes):
            half = 0.5 * mu * _excess(p, cables, c, i) * _wrap(p, i, joint_angle)
            cables.ahead[c, i] = 2.0 * math.tanh(half * (1.0 + lean))
            cables.behind[c, i] = 2.0 * math.tanh(half * (1.0 - lean))


@internal
def update(p: Plant, cables: Cables, joint_angle: float, tick: float) -> None:
    """Update friction's speed, age, place and warmth after `tick` [s]."""
    sliding = p.stribeck != 0.0 or p.asymmetry != 0.0 or p.tension_power != 0.0
    resting = p.ageing != 0.0 or p.heating != 0.0
    if not (sliding or resting or p.wrap_slope != 0.0 or p.bumps != 0.0):
        return  # friction depends on nothing but load
    mix = tick / (LAG + tick)
    for c in range(2):
        fresh = cables.work[c, 0] - cables.work[c, 3]
        cables.work[c, 3] = cables.work[c, 0]
        cables.work[c, 2] += fresh / HEAT
        cables.work[c, 2] -= tick / COOLING_TIME * cables.work[c, 2]
        for i in range(p.nodes):
            speed = abs(cables.speed[c, i])
            cables.lagged[c, i] += mix * (speed - cables.lagged[c, i])
            age = cables.contact[c, i] + tick
            cables.contact[c, i] = age / (1.0 + speed * tick / AGEING_SLIP)
    _look_up(p, cables, joint_angle)


@internal
def _bedded(y: float, h: float, bend: float) -> float:
    """Return the relative tension of a strand at `y`, that of a linear strand."""
    x = abs(y) / bend
    log_cosh = x + math.log1p(math.exp(-2.0 * x)) - math.log(2.0)
    return y + h * bend * log_cosh


@internal
def _laid(tension: float, h: float, bend: float) -> float:
    """Return where `_bedded`, which only grows, is this tension (Newton)."""
    y = tension
    for _ in range(50):
        miss = _bedded(y, h, bend) - tension
        y -= miss / (1.0 + h * math.tanh(y / bend))
        if abs(miss) < 1e-9:
            break
    return y


@internal
def _slide(cables: Cables, c: int, j: int, load: float, travel: float) -> None:
    """Step the bristle of node j by its travel."""
    ahead = cables.ahead[c, j] * load + cables.seal[j] + 1e-12
    behind = cables.behind[c, j] * load + cables.seal[j] + 1e-12
    top = ahead if travel > 0.0 else behind
    held = min(max(cables.force[c, j], -behind), ahead)
    push = cables.bristle[c, j] * travel
    cables.force[c, j] = top * (held + push) / (top + abs(push))
    cables.load[c, j] = load
    cables.work[c, 0] += cables.force[c, j] * travel


@internal
def step(
    p: Plant,
    cables: Cables,
    c: int,
    rest: float,
    near: float,
    near_speed: float,
    far: float,
    far_speed: float,
    dt: float,
) -> tuple[float, float]:
    """Advance cable `c` by `dt` [s]; return the tensions at motor and joint [N].

    `near` and `far` are the displacements of its ends towards the motor [m], with
    speeds [m/s]; `rest` is the tension of the unstretched cable [N].
    """
    n = p.nodes
    mass = p.line_density * p.length / n
    drag = p.viscous / n
    h = p.stiffening * (1.0 if c == 0 else 0.33)
    # How stiff a strand is depends on its tension, not on how it was laid in.
    slack = rest - TENSION
    laid = _laid(slack, h, BEDDING) if h != 0.0 else 0.0
    proximal = 0.0
    before = 0.0
    for i in range(n + 1):
        here = cables.place[c, i] if i < n else far
        here_speed = cables.speed[c, i] if i < n else far_speed
        k = cables.stiffness[c, i]
        elastic = rest + k * (near - here)
        if h != 0.0:
            bedded = _bedded(laid + k * (near - here), h, BEDDING)
            elastic = TENSION + bedded
        if i == n and p.textile != 0.0:
            fabric = cables.work[c][FABRIC:]
            whole = rest / k + near - here + fabric[soft_anchor.AT_REST]
            elastic, k, given = soft_anchor.series(p.textile, fabric, k, whole)
            soft_anchor.slide(p.textile, fabric, given)
        rate = near_speed - here_speed
        tension = elastic + STRAND_TIME * k * rate
        if tension <= 0.0:
            tension = 0.0
        elif elastic > 0.0:
            cables.work[c, 1] += (tension - elastic) * rate * dt
        if i == 0:
            proximal = tension
        else:
            j = i - 1
            pull = before - tension - cables.force[c, j]
            speed = (cables.speed[c, j] + pull / mass * dt) / (1.0 + drag / mass * dt)
            cables.speed[c, j] = speed
            cables.place[c, j] += speed * dt
            cables.work[c, 0] += drag * speed * speed * dt
            _slide(cables, c, j, 0.5 * (before + tension), speed * dt)
        before = tension
        near = here
        near_speed = here_speed
    return proximal, before


@internal
def stored(
    p: Plant,
    cables: Cables,
    rest: float,
    near: tuple[float, float],
    far: tuple[float, float],
) -> float:
    """Return the elastic and kinetic energy of both cables [J], for a linear strand.

    `near` and `far` are the displacements of the ends of cables a and b [m].
    """
    n = p.nodes
    mass = p.line_density * p.length / n
    energy = 0.0
    for c in range(2):
        last = near[c]
        for i in range(n + 1):
            here = cables.place[c, i] if i < n else far[c]
            tension = rest + cables.stiffness[c, i] * (last - here)
            if tension > 0.0:
                energy += 0.5 * tension * tension / cables.stiffness[c, i]
            if i < n:
                energy += 0.5 * mass * cables.speed[c, i] ** 2
            last = here
    return energy


STEPS = 5  # steps per tick


@compiled
def _run(p: Plant, cables: Cables, run: engine.Run) -> bool:
    shafts, now, dt = run.shafts, run.now, run.dt
    fill_tables(p, cables)
    rest = run.pretension
    slid_a = slid_b = 0.0  # conduits in their clamps, towards the motor
    for k in range(run.records.shape[0] * run.steps):
        if k % STEPS == 0:
            update(p, cables, shafts[engine.JOINT], STEPS * dt)
            rest = engine.tension_at_rest(p.bench, run.pretension, k * dt)
        drive, hold = engine.torques(run, k)
        motor_speed = shafts[engine.MOTOR_SPEED]
        far = p.bench.joint_radius * shafts[engine.HUB]
        far_speed = p.bench.joint_radius * shafts[engine.HUB_SPEED]
        near, near_speed = shafts[engine.ARC_A], shafts[engine.SLOPE_A] * motor_speed
        now[engine.NEAR_A], now[engine.FAR_A] = step(
            p, cables, 0, rest, near, near_speed, far + slid_a, far_speed, dt
        )
        near, near_speed = -shafts[engine.ARC_B], -shafts[engine.SLOPE_B] * motor_speed
        now[engine.NEAR_B], now[engine.FAR_B] = step(
            p, cables, 1, rest, near, near_speed, slid_b - far, -far_speed, dt
        )
        slid_a += p.clamp_creep * max(now[engine.FAR_A] - p.clamp_force, 0.0) * dt
        slid_b += p.clamp_creep * max(now[engine.FAR_B] - p.clamp_force, 0.0) * dt
        engine.balance(p.bench, run)
        # Angles in the middle of the step, where its torques are.
        engine.turn_shafts(p.bench, run, drive, hold, 0.5)
        engine.record(run, k, 1.0)
        if (k + 1) % run.steps == 0:
            far = p.bench.joint_radius * shafts[engine.HUB]
            starts = shafts[engine.ARC_A], -shafts[engine.ARC_B]
            stops = far + slid_a, slid_b - far
            engine.close(
                run, k, cables.work[0, 0] + cables.work[1, 0],
                cables.work[0, 1] + cables.work[1, 1],
                stored(p, cables, rest, starts, stops),
            )  # fmt: skip
    return True


# Impacts and falling friction take more steps per record.
LAW = engine.Law(
    start, _run, lambda p: STEPS * (4 if p.bench.backlash or p.stribeck else 2)
)
