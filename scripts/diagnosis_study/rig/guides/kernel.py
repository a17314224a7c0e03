"""One trial of a rig with guides: shafts by symplectic Euler, cables in equilibrium.

Takes what `rig.kernel.integrate` takes and gives records as that does, in the same
columns; steps of 0.2 ms.
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig.guides.cables import Cables, settle, start
from rig.guides.plant import Array, Plant
from rig.kernel import COLUMNS, COMMAND_TIME, MEANS, RECORD_TIME, pulled

STEPS = 1
"""Per record."""


def integrate(
    p: Plant,
    pretension: float,
    servo: Array,
    environment: Array,
    command: Array,
    target: Array,
    refine: int = 1,
) -> Array:
    """Run one trial; see `rig.kernel.integrate`."""
    motor = command[0, 0]
    arcs = arc(p, motor, 1.0)[0], -arc(p, motor, -1.0)[0]
    cables = start(p, pretension, arcs)
    count = (command.shape[0] - 1) * round(COMMAND_TIME / RECORD_TIME)
    out = np.zeros((count, len(COLUMNS)))
    _run(p, cables, pretension, servo, environment, command, target, refine, out)
    return out


@compiled
def arc(p: Plant, angle: float, side: float) -> tuple[float, float]:
    """Return the length wound on the motor pulley from 0, and its slope [m/rad].

    The axis is off the middle: the tangent is nearer or farther as the middle goes
    round, on one side as it is not on the other.
    """
    e = side * p.offcentre
    length = p.motor_radius * angle
    length += e * (math.sin(angle - p.offcentre_phase) + math.sin(p.offcentre_phase))
    return length, p.motor_radius + e * math.cos(angle - p.offcentre_phase)


@internal
def _wave(phase: float) -> float:
    """Return a wave of alternating parabolas of height 1."""
    part = (phase / math.pi) % 2.0
    return (
        4.0 * part * (1.0 - part) if part < 1.0 else -4.0 * (part - 1.0) * (2.0 - part)
    )


@internal
def _across(p: Plant, ahead: float, ahead_speed: float) -> float:
    """Return the torque of the hub on the handle through the play, by its lead."""
    over = abs(ahead) - 0.5 * p.play
    if over <= 0.0:
        return 0.0
    side = math.copysign(1.0, ahead)
    return side * max(
        p.stop_stiffness * over + p.stop_damping * side * ahead_speed, 0.0
    )


@compiled
def _run(
    p: Plant,
    cables: Cables,
    pretension: float,
    servo: FloatArray,
    environment: FloatArray,
    command: FloatMatrix,
    target: FloatMatrix,
    refine: int,
    out: FloatMatrix,
) -> None:
    steps = STEPS * refine
    dt = RECORD_TIME / steps
    per_command = round(COMMAND_TIME / dt)
    motor, joint, hub = command[0, 0], command[0, 0], command[0, 0]
    motor_speed = joint_speed = hub_speed = 0.0
    work_in = work_out = 0.0
    near_a = near_b = far_a = far_b = pretension
    step = 0
    for record in range(out.shape[0]):
        row = out[record]
        for _ in range(steps):
            at = step // per_command
            part = (step - at * per_command) / per_command
            step += 1
            slope_a, slope_b = arc(p, motor, 1.0)[1], arc(p, motor, -1.0)[1]
            load = slope_a * near_a - slope_b * near_b
            load += p.detent * _wave(p.detent_order * motor - p.detent_phase)
            drive = pulled(servo, command, at, part, motor, motor_speed)
            rate = (drive - load) / (p.rotor_inertia + p.gear_inertia)
            shown = load + p.gear_inertia * rate
            motor_speed += rate * dt
            moved = motor_speed * dt
            motor += moved
            given = p.joint_radius * (far_a - far_b)
            taken = p.unbalance * math.sin(hub - p.unbalance_phase)
            off = hub - p.strap_rest
            taken += p.strap * off * (1.0 + 0.1 * off * off)
            taken += p.bearing * math.tanh(hub_speed / 0.01)
            near = (hub - p.catch_angle) / p.catch_width
            taken += p.catch * near * math.exp(0.5 * (1.0 - near * near))
            hold = pulled(environment, target, at, part, joint, joint_speed)
            hold -= p.joint_damping * joint_speed
            if p.play == 0.0:
                rate = (given - taken + hold) / (p.joint_inertia + p.flywheel)
                felt = given - taken - p.flywheel * rate
                joint_speed += rate * dt
                joint += joint_speed * dt
                hub, hub_speed = joint, joint_speed
            else:
                felt = _across(p, hub - joint, hub_speed - joint_speed)
                hub_speed += (given - taken - felt) / (p.hub_inertia + p.flywheel) * dt
                joint_speed += (felt + hold) / (p.joint_inertia - p.hub_inertia) * dt
                hub += hub_speed * dt
                joint += joint_speed * dt
            work_in += 0.5 * (slope_a * near_a - slope_b * near_b) * moved
            work_out += 0.5 * given * hub_speed * dt
            tight = pretension
            if p.settling != 0.0:
                late = math.log1p(step * dt / p.settling_time)
                tight *= 1.0 - p.settling * late / math.log1p(8.0 / p.settling_time)
            far = p.joint_radius * hub
            arc_a, arc_b = arc(p, motor, 1.0)[0], arc(p, motor, -1.0)[0]
            near_a, far_a = settle(p, cables, 0, tight, arc_a, far, hub, dt)
            near_b, far_b = settle(p, cables, 1, tight, -arc_b, -far, hub, dt)
            slope_a, slope_b = arc(p, motor, 1.0)[1], arc(p, motor, -1.0)[1]
            work_in += 0.5 * (slope_a * near_a - slope_b * near_b) * moved
            work_out += 0.5 * p.joint_radius * (far_a - far_b) * hub_speed * dt
            # Angles where the torques of the step are: at its beginning.
            row[0] += motor - moved
            row[1] += shown
            row[2] += joint - joint_speed * dt
            row[3] += felt
            row[4] += joint_speed
            row[5] += near_a
            row[6] += near_b
            row[7] += far_a
            row[8] += far_b
        for k in range(MEANS):
            row[k] /= steps
        row[9] = work_in
        row[10] = work_out
        row[11] = cables.work[0] + cables.work[1]
        for c in range(2):
            for i in range(cables.tension.shape[1]):
                row[13] += 0.5 * cables.tension[c, i] ** 2 / p.piece[c, i]
