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
from rig import engine
from rig.engine import HUB, HUB_SPEED, JOINT, JOINT_SPEED, MOTOR, MOTOR_SPEED, SLIP
from rig.nominal import Rig


class Plant(NamedTuple):
    """All constants of the equations of motion; SI and radians."""

    # --- the bench -----------------------------------------------------------
    nodes: int
    motor_radius: float
    joint_radius: float
    length: float
    wrap: float
    axial_stiffness: float
    friction_a: float
    friction_b: float
    line_density: float
    joint_inertia: float
    joint_damping: float
    rotor_inertia: float
    material_time: float = 1.5e-5
    """Kelvin-Voigt damping of the strand over its stiffness [s]."""
    presliding: float = 1e-6
    """Travel over which a contact comes to sliding at nominal tension [m]."""
    reference_tension: float = 80.0

    # --- friction ------------------------------------------------------------
    viscous: float = 0.0  # force per speed, one cable [N s/m]
    stribeck: float = 0.0
    """Excess of friction near rest over sliding friction, relative."""
    stribeck_speed: float = 0.03
    stribeck_lag: float = 0.02
    """First-order lag of friction behind speed [s]: frictional memory."""
    asymmetry: float = 0.0
    """Excess of friction while the joint turns positive, relative."""
    load_free: float = 0.0  # friction of the end seals of one cable [N]
    tension_power: float = 0.0  # friction coefficient falls with tension to this power
    ageing: float = 0.0
    """Growth of static friction per e-fold of contact time, relative."""
    ageing_time: float = 0.05
    ageing_slip: float = 1e-4  # travel that renews a contact [m]
    wrap_slope: float = 0.0
    """Wrap gained per joint angle, in the third of the conduit next the joint."""
    heating: float = 0.0  # change of friction when warm, relative
    heating_energy: float = 8.0
    heating_time: float = 12.0
    bumps: float = 0.0  # excess of friction where the liner is damaged, relative
    bump_width: float = 0.004
    # Places per cable where the liner may be damaged.
    bump_places: FloatMatrix = np.zeros((2, 5))

    # --- elasticity and geometry ------------------------------------------------
    pretension_loss: float = 0.0
    """Part of the pretension that is lost in the end [0..1)."""
    loss_time: float = 3.0
    stiffening: float = 0.0
    """Relative change of stiffness of cable a from slack to taut; cable b a third."""
    stiffening_tension: float = 40.0
    end_compliance: float = 0.0
    """Series compliance of the anchorage of one cable [m/N], most of it distal."""
    clamp_creep: float = 0.0
    """Speed at which a conduit slides in its clamp at the joint, per tension above
    `clamp_force` [m/(N s)]."""
    clamp_force: float = 0.0
    eccentricity: float = 0.0
    """First harmonic of the motor pulley's radius, relative; the second a quarter."""
    eccentric_phase: float = 0.0
    eccentric_phase_2: float = 0.0
    drum_growth: float = 0.0
    """Growth of the motor pulley's radius per angle that a cable is wound on, relative
    [1/rad]."""
    backlash: float = 0.0  # full gap between joint pulley and handle [rad]
    contact_stiffness: float = 2e4
    contact_damping: float = 1.5
    hub_inertia: float = 2.5e-4
    """Inertia of the joint pulley once it is a body of its own [kg m^2]."""
    grip_slip: float = 0.0
    """Slip of the cables on the motor pulley, speed per excess torque [rad/(N m s)]."""
    grip_limit: float = 4.0

    # --- loads on the shafts ----------------------------------------------------
    cogging: float = 0.0
    cogging_order: float = 14.0
    cogging_phase: float = 0.0
    motor_inertia: float = 0.0
    """Inertia between torque sensor and motor pulley [kg m^2]."""
    unbalance: float = 0.0  # unbalance of the joint pulley, m g l [N m]
    unbalance_phase: float = 0.0
    joint_stiffness: float = 0.0
    joint_stiffness_rest: float = 0.0
    extra_joint_inertia: float = 0.0
    mesh: float = 0.0  # ripple torque of a gear mesh at the joint [N m]
    mesh_order: float = 23.0
    mesh_phase: float = 0.0
    stop_stiffness: float = 0.0
    """Bumper that the joint pulley meets beyond `stop_angle` [N m/rad]."""
    stop_angle: float = 0.6


def plant_of(rig: Rig, nodes: int = 12) -> Plant:
    """Return the plant of a rig in which nothing is hidden."""
    bench = [name for name in Plant._fields if hasattr(rig, name)]
    return Plant(nodes, **{name: getattr(rig, name) for name in bench})


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
    warmth: FloatArray  # friction work stored as heat over `heating_energy`, (2,)
    ahead: FloatMatrix  # friction limit over load for motion towards the motor
    behind: FloatMatrix  # friction limit over load for motion away from the motor
    bristle: FloatMatrix  # stiffness of the bristles [N/m]
    stiffness: FloatMatrix  # stiffness of the segments (2, nodes + 1) [N/m]
    seal: FloatArray  # load-independent friction (nodes,) [N]
    work: FloatMatrix
    """Friction and damping work of each cable since the start (2, 2) [J]."""
    warmed: FloatArray  # friction work already converted into `warmth` (2,) [J]


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
    cables = Cables(*(np.zeros((2, n)) for _ in Cables._fields))
    return cables._replace(
        place=np.repeat(np.array(arcs)[:, None], n, axis=1),
        load=np.full((2, n), pretension), warmth=np.zeros(2), stiffness=k, seal=seal,
        work=np.zeros((2, 2)), warmed=np.zeros(2),
    )  # fmt: skip


@internal
def fill_tables(p: Plant, cables: Cables) -> None:
    """Fill the tables of the friction of cables at rest."""
    _look_up(p, cables, 0.0)
    for c in range(2):
        for i in range(p.nodes):
            limit = 0.5 * (cables.ahead[c, i] + cables.behind[c, i])
            cables.bristle[c, i] = limit * p.reference_tension / p.presliding


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
    factor += p.ageing * math.log1p(cables.contact[c, i] / p.ageing_time)
    factor *= 1.0 + p.heating * (1.0 - math.exp(-cables.warmth[c]))
    if p.tension_power != 0.0:
        ratio = max(cables.load[c, i], 2.0) / p.reference_tension
        factor *= ratio**-p.tension_power
    if p.bumps != 0.0:
        for k in range(p.bump_places.shape[1]):
            away = (cables.place[c, i] - p.bump_places[c, k]) / p.bump_width
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
    mix = tick / (p.stribeck_lag + tick)
    for c in range(2):
        fresh = cables.work[c, 0] - cables.warmed[c]
        cables.warmed[c] = cables.work[c, 0]
        cables.warmth[c] += fresh / p.heating_energy
        cables.warmth[c] -= tick / p.heating_time * cables.warmth[c]
        for i in range(p.nodes):
            speed = abs(cables.speed[c, i])
            cables.lagged[c, i] += mix * (speed - cables.lagged[c, i])
            age = cables.contact[c, i] + tick
            cables.contact[c, i] = age / (1.0 + speed * tick / p.ageing_slip)
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
    slack = rest - p.reference_tension
    laid = _laid(slack, h, p.stiffening_tension) if h != 0.0 else 0.0
    proximal = 0.0
    before = 0.0
    for i in range(n + 1):
        here = cables.place[c, i] if i < n else far
        here_speed = cables.speed[c, i] if i < n else far_speed
        k = cables.stiffness[c, i]
        elastic = rest + k * (near - here)
        if h != 0.0:
            bedded = _bedded(laid + k * (near - here), h, p.stiffening_tension)
            elastic = p.reference_tension + bedded
        rate = near_speed - here_speed
        tension = elastic + p.material_time * k * rate
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
def arc(p: Plant, angle: float, side: float) -> tuple[float, float]:
    """Return the arc wound onto the motor pulley from angle 0, and its slope [m/rad].

    `side` is 1 for cable a and -1 for cable b, which leaves the pulley opposite: half a
    turn on, so that odd harmonics change their sign.
    """
    if p.eccentricity == 0.0:
        slope = p.motor_radius * (1.0 + side * p.drum_growth * angle)
        return 0.5 * (p.motor_radius + slope) * angle, slope
    e = p.eccentricity
    odd = side * e
    one = angle - p.eccentric_phase
    two = 2.0 * (angle - p.eccentric_phase_2)
    first = math.sin(one) + math.sin(p.eccentric_phase)
    second = math.sin(two) + math.sin(2.0 * p.eccentric_phase_2)
    arc = angle + odd * first + 0.125 * e * second
    slope = 1.0 + odd * math.cos(one) + 0.25 * e * math.cos(two)
    return p.motor_radius * arc, p.motor_radius * slope


@internal
def _taken(p: Plant, angle: float) -> float:
    """Return the torque that what sits on the joint pulley takes."""
    load = p.unbalance * math.sin(angle - p.unbalance_phase)
    load += p.joint_stiffness * (angle - p.joint_stiffness_rest)
    if p.mesh != 0.0:
        load += p.mesh * math.sin(p.mesh_order * angle - p.mesh_phase)
    if p.stop_stiffness != 0.0 and angle > p.stop_angle:
        load += p.stop_stiffness * (angle - p.stop_angle)
    return load


@internal
def _turn_motor(
    p: Plant, shafts: FloatArray, load: float, drive: float, dt: float
) -> float:
    """Advance the motor by dt; return the torque that its sensor shows.

    `load` is the torque of the cables on the pulley, `drive` that of the servo.
    """
    if p.grip_slip != 0.0 and abs(load) > p.grip_limit:
        excess = load - math.copysign(p.grip_limit, load)
        shafts[SLIP] += p.grip_slip * excess * dt
    cogging = 0.0
    if p.cogging != 0.0:
        phase = p.cogging_order * shafts[MOTOR] - p.cogging_phase
        cogging = p.cogging * (math.sin(phase) + 0.3 * math.sin(2.0 * phase))
    inertia = p.rotor_inertia + p.motor_inertia
    rate = engine.turn(shafts, MOTOR, drive - load - cogging, inertia, dt)
    return load + cogging + p.motor_inertia * rate


@compiled
def _run(p: Plant, cables: Cables, run: engine.Run) -> bool:
    shafts, now, out = run.shafts, run.now, run.records
    dt = run.dt
    hub = p.hub_inertia if p.backlash != 0.0 else 0.0
    fill_tables(p, cables)
    work_in = work_out = 0.0
    rest = run.pretension
    slid_a = slid_b = 0.0  # conduits in their clamps, towards the motor
    done = 0
    for record in range(out.shape[0]):
        row = out[record]
        for _tick in range(run.steps // STEPS):
            update(p, cables, shafts[JOINT], STEPS * dt)
            if p.pretension_loss != 0.0:
                fade = math.exp(-done * dt / p.loss_time)
                rest = run.pretension * (1.0 - p.pretension_loss * (1.0 - fade))
            for _step in range(STEPS):
                drive, hold = engine.torques(run, done)
                done += 1
                gripped = shafts[MOTOR] - shafts[SLIP]
                arc_a, slope_a = arc(p, gripped, 1.0)
                arc_b, slope_b = arc(p, gripped, -1.0)
                speed_a = slope_a * shafts[MOTOR_SPEED]
                speed_b = slope_b * shafts[MOTOR_SPEED]
                far = p.joint_radius * shafts[HUB]
                far_speed = p.joint_radius * shafts[HUB_SPEED]
                near_a, far_a = step(
                    p, cables, 0, rest, arc_a, speed_a, far + slid_a, far_speed, dt
                )
                near_b, far_b = step(
                    p, cables, 1, rest, -arc_b, -speed_b, slid_b - far, -far_speed, dt
                )
                slid_a += p.clamp_creep * max(far_a - p.clamp_force, 0.0) * dt
                slid_b += p.clamp_creep * max(far_b - p.clamp_force, 0.0) * dt
                load = slope_a * near_a - slope_b * near_b
                given = p.joint_radius * (far_a - far_b)
                work_in += load * shafts[MOTOR_SPEED] * dt
                work_out += given * shafts[HUB_SPEED] * dt
                shown = _turn_motor(p, shafts, load, drive, dt)
                across = engine.through_play(
                    shafts, p.backlash, p.contact_stiffness, p.contact_damping
                )
                felt = engine.turn_joint(
                    shafts, given - _taken(p, shafts[HUB]),
                    hold - p.joint_damping * shafts[JOINT_SPEED], across,
                    p.joint_inertia, hub, p.extra_joint_inertia, dt,
                )  # fmt: skip
                # Angles in the middle of the step, where its torques are.
                motor = shafts[MOTOR] - 0.5 * dt * shafts[MOTOR_SPEED]
                joint = shafts[JOINT] - 0.5 * dt * shafts[JOINT_SPEED]
                seen = joint, felt, shafts[JOINT_SPEED]
                engine.see(now, (motor, shown), seen, (near_a, near_b), (far_a, far_b))
                engine.add(row, now, 1.0)
        rubbed = cables.work[0, 0] + cables.work[1, 0]
        damped = cables.work[0, 1] + cables.work[1, 1]
        engine.close(row, run.steps, (work_in, work_out, rubbed, damped))
        gripped = shafts[MOTOR] - shafts[SLIP]
        near = arc(p, gripped, 1.0)[0], -arc(p, gripped, -1.0)[0]
        far = p.joint_radius * shafts[HUB]
        row[13] = stored(p, cables, rest, near, (far + slid_a, slid_b - far))
    return True


# Impacts and falling friction take more steps per record.
LAW = engine.Law(
    arc, start, _run, lambda p: 4 * STEPS if p.backlash or p.stribeck else 2 * STEPS
)
