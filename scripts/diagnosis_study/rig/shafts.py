"""Motor, joint pulley and handle; compiled.

The state of the shafts is one array, indexed by the names below.
"""

from __future__ import annotations

import math

from cc_mujoco.native import FloatArray, internal
from rig.plant import Plant

MOTOR, MOTOR_SPEED, HUB, HUB_SPEED, JOINT, JOINT_SPEED, SLIP = range(7)
"""Angles [rad] and speeds [rad/s]: motor, joint pulley (hub), handle (joint); slip of
the cables on the motor pulley [rad]."""


@internal
def wound(p: Plant, angle: float, side: float) -> tuple[float, float]:
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
def step_motor(
    p: Plant, shafts: FloatArray, load: float, drive: float, dt: float
) -> float:
    """Advance the motor by dt; the torque that its sensor shows.

    `load` is the torque of the cables on the pulley, `drive` that of the servo.
    """
    if p.grip_slip != 0.0 and abs(load) > p.grip_limit:
        excess = load - math.copysign(p.grip_limit, load)
        shafts[SLIP] += p.grip_slip * excess * dt
    cogging = 0.0
    if p.cogging != 0.0:
        phase = p.cogging_order * shafts[MOTOR] - p.cogging_phase
        cogging = p.cogging * (math.sin(phase) + 0.3 * math.sin(2.0 * phase))
    rate = (drive - load - cogging) / (p.rotor_inertia + p.motor_inertia)
    shafts[MOTOR_SPEED] += rate * dt
    shafts[MOTOR] += shafts[MOTOR_SPEED] * dt
    return load + cogging + p.motor_inertia * rate


@internal
def _taken(p: Plant, angle: float) -> float:
    """Torque that what sits on the joint pulley takes from the transmission."""
    load = p.gravity * math.sin(angle - p.gravity_phase)
    load += p.joint_stiffness * (angle - p.joint_stiffness_rest)
    if p.mesh != 0.0:
        load += p.mesh * math.sin(p.mesh_order * angle - p.mesh_phase)
    if p.stop_stiffness != 0.0 and angle > p.stop_angle:
        load += p.stop_stiffness * (angle - p.stop_angle)
    return load


@internal
def _across(p: Plant, ahead: float, ahead_speed: float) -> float:
    """Return the torque of the hub on the handle, by how far the hub is ahead."""
    over = abs(ahead) - 0.5 * p.backlash
    if over <= 0.0:
        return 0.0
    side = math.copysign(1.0, ahead)
    push = p.contact_stiffness * over + p.contact_damping * side * ahead_speed
    return side * max(push, 0.0)


@internal
def step_joint(
    p: Plant, shafts: FloatArray, given: float, hold: float, dt: float
) -> float:
    """Advance joint pulley and handle by dt; the torque that their sensor shows.

    `given` is the torque of the cables on the pulley, `hold` that of the environment
    on the handle. The sensor sits between pulley and handle: what the pulley carries
    besides (unbalance, spring, extra inertia) is on the transmission's side of it.
    """
    net = given - _taken(p, shafts[HUB])
    hold -= p.joint_damping * shafts[JOINT_SPEED]
    if p.backlash == 0.0:
        rate = (net + hold) / (p.joint_inertia + p.extra_joint_inertia)
        shafts[JOINT_SPEED] += rate * dt
        shafts[JOINT] += shafts[JOINT_SPEED] * dt
        shafts[HUB] = shafts[JOINT]
        shafts[HUB_SPEED] = shafts[JOINT_SPEED]
        return net - p.extra_joint_inertia * rate
    torque = _across(
        p, shafts[HUB] - shafts[JOINT], shafts[HUB_SPEED] - shafts[JOINT_SPEED]
    )
    hub = p.hub_inertia + p.extra_joint_inertia
    shafts[HUB_SPEED] += (net - torque) / hub * dt
    shafts[JOINT_SPEED] += (torque + hold) / (p.joint_inertia - p.hub_inertia) * dt
    shafts[HUB] += shafts[HUB_SPEED] * dt
    shafts[JOINT] += shafts[JOINT_SPEED] * dt
    return torque
