"""Equations of motion of the rig, integrated in compiled code.

Each cable is a chain of massive nodes between visco-elastic segments that carry no
compression; a bristle at each node resists its travel. Symplectic Euler throughout.

A bristle with load N, travel x and stiffness k follows Dahl's law

    dF/dx = k (1 - sign(dx) F / F_c),   F_c = 2 tanh(mu wrap / 2) N,

with N the mean tension of both sides, which makes a sliding node obey the capstan
equation exactly. The law is stepped implicitly in travel, so no step is too long for
the bristle: no chatter, and at rest F stays as it is.

What friction depends on apart from the load (speed, age, place, warmth) is slow beside
the waves in the cable and is looked up once per tick of 0.1 ms.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hidden_rig.plant import Plant

Array = NDArray[np.float64]

RECORD_TIME = 2e-4
"""Time between two records [s]; a record is the mean over it."""
COMMAND_TIME = 1e-3
COLUMNS = (
    "motor_angle",
    "motor_torque",
    "joint_angle",
    "joint_torque",
    "joint_speed",
    "tension_a_proximal",
    "tension_b_proximal",
    "tension_a_distal",
    "tension_b_distal",
    "work_in",
    "work_out",
    "work_friction",
    "work_damping",
    "energy_stored",
)
"""Columns of the records. The works are integrals from the start, in joules: of the
motor's pulley, of the joint's pulley, of bristles, of strand damping; the energy is
that of strain and motion of both cables at the end of the record."""

_njit = njit(cache=True, nogil=True, error_model="numpy")


@_njit
def _loses_or_varies(p):
    """Whether friction depends on anything but load."""
    return (
        p.stribeck != 0.0
        or p.asymmetry != 0.0
        or p.tension_power != 0.0
        or p.ageing != 0.0
        or p.wrap_slope != 0.0
        or p.heating != 0.0
        or p.bumps != 0.0
    )


@_njit
def _wrap(p, i, joint_angle):
    """Wrap angle at node i; a limb bends the last third of the conduit."""
    wrap = p.wrap / p.nodes
    third = p.nodes // 3
    if i >= p.nodes - third:
        bend = joint_angle + 0.2 * joint_angle * abs(joint_angle)
        wrap += p.wrap_slope * bend / third
    return max(wrap, 0.0)


@_njit
def _excess(p, c, i, place, speed, contact_time, tension, warmth):
    """Friction coefficient at a node over its plain value."""
    factor = 1.0 + p.stribeck * math.exp(-((speed / p.stribeck_speed) ** 2))
    factor += p.ageing * math.log1p(contact_time / p.ageing_time)
    factor *= 1.0 + p.heating * (1.0 - math.exp(-warmth))
    if p.tension_power != 0.0:
        ratio = max(tension, 2.0) / p.reference_tension
        factor *= ratio**p.tension_power
    if p.bumps != 0.0:
        for k in range(p.bump_places.shape[1]):
            away = (place - p.bump_places[c, k]) / p.bump_width
            factor += p.bumps * math.exp(-away * away)
    return factor


@_njit
def _limits(
    p, u, lagged, contact, mean_tension, warmth, joint_angle, positive, negative
):
    """Friction limit over load at every node, either way."""
    for c in range(2):
        mu = p.friction_a if c == 0 else p.friction_b
        side = 1.0 if c == 0 else -1.0
        # The b-cable's liner has worn less, so its friction leans less.
        lean = side * p.asymmetry * (1.0 if c == 0 else 0.6)
        for i in range(p.nodes):
            excess = _excess(
                p,
                c,
                i,
                u[c, i],
                lagged[c, i],
                contact[c, i],
                mean_tension[c, i],
                warmth[c],
            )
            half = 0.5 * mu * excess * _wrap(p, i, joint_angle)
            positive[c, i] = 2.0 * math.tanh(half * (1.0 + lean))
            negative[c, i] = 2.0 * math.tanh(half * (1.0 - lean))


@_njit
def _radius(p, angle):
    """Arc wound from angle 0 and its slope, for the motor pulley."""
    if p.eccentricity == 0.0:
        return p.motor_radius * angle, p.motor_radius
    one = angle - p.eccentric_phase
    two = 2.0 * (angle - p.eccentric_phase_2)
    first = math.sin(one) - math.sin(-p.eccentric_phase)
    second = math.sin(two) - math.sin(-2.0 * p.eccentric_phase_2)
    e = p.eccentricity
    arc = angle + e * first + 0.125 * e * second
    return p.motor_radius * arc, p.motor_radius * (
        1.0 + e * math.cos(one) + 0.25 * e * math.cos(two)
    )


@_njit
def _contact(p, gap_angle, gap_speed):
    """Torque of the hub on the handle across their backlash."""
    over = abs(gap_angle) - 0.5 * p.backlash
    if over <= 0.0:
        return 0.0
    side = 1.0 if gap_angle > 0.0 else -1.0
    push = p.contact_stiffness * over + p.contact_damping * side * gap_speed
    return side * max(push, 0.0)


@_njit
def _hub_load(p, angle):
    """Torque that what sits on the joint pulley takes from the transmission."""
    load = p.gravity * math.sin(angle - p.gravity_phase)
    load += p.joint_stiffness * (angle - p.joint_stiffness_rest)
    if p.mesh != 0.0:
        load += p.mesh * math.sin(p.mesh_order * angle - p.mesh_phase)
    if p.stop_stiffness != 0.0 and angle > p.stop_angle:
        load += p.stop_stiffness * (angle - p.stop_angle)
    return load


@_njit
def _stiffnesses(p, c):
    """Stiffness of each segment of a cable; the end ones are half as long."""
    inner = p.axial_stiffness * p.nodes / p.length
    k = np.full(p.nodes + 1, inner)
    k[0] = 1.0 / (0.5 / inner + 0.3 * p.end_compliance)
    k[p.nodes] = 1.0 / (0.5 / inner + 0.7 * p.end_compliance)
    return k


@_njit
def _elastic(k, stretch, h, bend):
    """Tension over pretension of a strand that stiffens as it beds in."""
    if h == 0.0:
        return k * stretch
    x = abs(k * stretch) / bend
    log_cosh = x + math.log1p(math.exp(-2.0 * x)) - math.log(2.0)
    return k * stretch + h * bend * log_cosh


@_njit
def integrate(p, pretension, servo, environment, command, target, refine):
    """Run one trial.

    Args:
        p: the `Plant`.
        pretension: tension of both cables at rest [N].
        servo: (2,) stiffness and damping of the motor's position loop.
        environment: (2,) stiffness and damping that tie the handle to `target`.
        command: (m, 2) angle and speed asked of the motor, every `COMMAND_TIME`.
        target: (m, 2) the same of the environment.
        refine: 1, or a whole number by which to shorten every step.

    Returns:
        (5 m, 14) records, see `COLUMNS`.
    """
    n = p.nodes
    steps = 5  # per tick
    ticks = 2 * refine  # per record
    dt = RECORD_TIME / (ticks * steps)
    count = (command.shape[0] - 1) * round(COMMAND_TIME / RECORD_TIME)
    out = np.zeros((count, len(COLUMNS)))
    mass = p.line_density * p.length / n
    k = np.empty((2, n + 1))
    k[0] = _stiffnesses(p, 0)
    k[1] = _stiffnesses(p, 1)
    damping = p.material_time * k
    seal = np.zeros(n)
    seal[0] = 0.4 * p.load_free
    seal[n - 1] = 0.6 * p.load_free
    drag = p.viscous / n / mass * dt
    varies = _loses_or_varies(p)

    motor, joint = command[0, 0], command[0, 0]
    hub, motor_speed, joint_speed, hub_speed, slip = joint, 0.0, 0.0, 0.0, 0.0
    arc, slope = _radius(p, motor)
    u = np.empty((2, n))
    u[0] = arc
    u[1] = -arc
    v = np.zeros((2, n))
    lagged = np.zeros((2, n))
    contact = np.zeros((2, n))
    force = np.zeros((2, n))
    mean_tension = np.full((2, n), pretension)
    warmth = np.zeros(2)
    worked = np.zeros(2)
    positive = np.empty((2, n))
    negative = np.empty((2, n))
    _limits(p, u, lagged, contact, mean_tension, warmth, 0.0, positive, negative)
    bristle = 0.5 * (positive + negative) * p.reference_tension / p.presliding
    work_in, work_out, work_damping = 0.0, 0.0, 0.0
    proximal = np.full(2, pretension)
    distal = np.full(2, pretension)
    step = 0
    per_command = round(COMMAND_TIME / dt)

    for record in range(count):
        total = np.zeros(9)
        energy = 0.0
        for _tick in range(ticks):
            if varies:
                tick = steps * dt
                mix = tick / (p.stribeck_lag + tick)
                for c in range(2):
                    warmth[c] += worked[c] / p.heating_energy
                    warmth[c] -= tick / p.heating_time * warmth[c]
                    worked[c] = 0.0
                    for i in range(n):
                        speed = abs(v[c, i])
                        lagged[c, i] += mix * (speed - lagged[c, i])
                        age = contact[c, i] + tick
                        contact[c, i] = age / (1.0 + speed * tick / p.ageing_slip)
                _limits(
                    p,
                    u,
                    lagged,
                    contact,
                    mean_tension,
                    warmth,
                    joint,
                    positive,
                    negative,
                )
            rest = pretension
            if p.pretension_loss != 0.0:
                fade = math.exp(-step * dt / p.loss_time)
                rest *= 1.0 - p.pretension_loss * (1.0 - fade)
            for _step in range(steps):
                at = step // per_command
                part = (step - at * per_command) / per_command
                wanted = command[at, 0] + part * (command[at + 1, 0] - command[at, 0])
                wanted_speed = command[at, 1] + part * (
                    command[at + 1, 1] - command[at, 1]
                )
                goal = target[at, 0] + part * (target[at + 1, 0] - target[at, 0])
                goal_speed = target[at, 1] + part * (target[at + 1, 1] - target[at, 1])
                step += 1
                arc, slope = _radius(p, motor - slip)
                energy = 0.0
                for c in range(2):
                    side = 1.0 if c == 0 else -1.0
                    bend = p.stiffening_tension
                    h = p.stiffening * (1.0 if c == 0 else 0.33)
                    near = side * arc
                    near_speed = side * slope * motor_speed
                    far = side * p.joint_radius * hub
                    far_speed = side * p.joint_radius * hub_speed
                    before = 0.0
                    for i in range(n + 1):
                        here = u[c, i] if i < n else far
                        here_speed = v[c, i] if i < n else far_speed
                        stretch = near - here
                        rate = near_speed - here_speed
                        elastic = rest + _elastic(k[c, i], stretch, h, bend)
                        loss = damping[c, i] * rate
                        tension = elastic + loss
                        if tension <= 0.0:
                            tension = 0.0
                            loss = -elastic
                        if elastic > 0.0:
                            energy += 0.5 * elastic * elastic / k[c, i]
                        work_damping += loss * rate * dt if elastic > 0.0 else 0.0
                        if i == 0:
                            proximal[c] = tension
                        else:
                            j = i - 1
                            load = 0.5 * (before + tension)
                            mean_tension[c, j] = load
                            pull = before - tension - force[c, j]
                            speed = (v[c, j] + pull / mass * dt) / (1.0 + drag)
                            v[c, j] = speed
                            travel = speed * dt
                            u[c, j] += travel
                            ahead = positive[c, j] * load + seal[j] + 1e-12
                            behind = negative[c, j] * load + seal[j] + 1e-12
                            top = ahead if speed > 0.0 else behind
                            old = min(max(force[c, j], -behind), ahead)
                            stiff = bristle[c, j] * travel
                            new = top * (old + stiff) / (top + abs(stiff))
                            force[c, j] = new
                            worked[c] += new * travel
                            out[record, 11] += new * travel
                            out[record, 11] += p.viscous / n * speed * travel
                            energy += 0.5 * mass * speed * speed
                        before = tension
                        near = here
                        near_speed = here_speed
                    distal[c] = before

                load = slope * (proximal[0] - proximal[1])
                if p.grip_limit != 0.0 and abs(load) > p.grip_limit:
                    excess = abs(load) - p.grip_limit
                    sign = 1.0 if load > 0.0 else -1.0
                    slip += sign * excess / p.grip_viscosity * dt
                cogging = 0.0
                if p.cogging != 0.0:
                    phase = p.cogging_order * motor - p.cogging_phase
                    cogging = p.cogging * (math.sin(phase) + 0.3 * math.sin(2 * phase))
                drive = servo[0] * (wanted - motor)
                drive += servo[1] * (wanted_speed - motor_speed)
                motor_rate = (drive - load - cogging) / (
                    p.rotor_inertia + p.motor_inertia
                )
                work_in += load * motor_speed * dt
                motor_speed += motor_rate * dt
                motor += motor_speed * dt
                motor_torque = load + cogging + p.motor_inertia * motor_rate

                given = p.joint_radius * (distal[0] - distal[1])
                work_out += given * hub_speed * dt
                hold = environment[0] * (goal - joint)
                hold += environment[1] * (goal_speed - joint_speed)
                hold -= p.joint_damping * joint_speed
                taken = _hub_load(p, hub)
                if p.backlash == 0.0:
                    rate = (given + hold - taken) / (
                        p.joint_inertia + p.extra_joint_inertia
                    )
                    joint_torque = given - taken - p.extra_joint_inertia * rate
                    joint_speed += rate * dt
                    joint += joint_speed * dt
                    hub = joint
                    hub_speed = joint_speed
                else:
                    joint_torque = _contact(p, hub - joint, hub_speed - joint_speed)
                    hub_mass = p.hub_inertia + p.extra_joint_inertia
                    hub_speed += (given - taken - joint_torque) / hub_mass * dt
                    handle = p.joint_inertia - p.hub_inertia
                    joint_speed += (joint_torque + hold) / handle * dt
                    hub += hub_speed * dt
                    joint += joint_speed * dt
                total[0] += motor - 0.5 * dt * motor_speed
                total[1] += motor_torque
                total[2] += joint - 0.5 * dt * joint_speed
                total[3] += joint_torque
                total[4] += joint_speed
                total[5] += proximal[0]
                total[6] += proximal[1]
                total[7] += distal[0]
                total[8] += distal[1]
        for i in range(9):
            out[record, i] = total[i] / (ticks * steps)
        out[record, 9] = work_in
        out[record, 10] = work_out
        out[record, 12] = work_damping
        out[record, 13] = energy
        if record > 0:
            out[record, 11] += out[record - 1, 11]
    return out
