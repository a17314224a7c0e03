"""One trial of a rig of massive nodes, all of it by symplectic Euler.

Steps of 20 us, friction tables every tick of 0.1 ms, a record every 0.2 ms.
"""

from __future__ import annotations

import math

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig import engine
from rig.bristles.cables import Cables, fill_tables, start, step, stored, update
from rig.bristles.plant import Plant
from rig.engine import HUB, HUB_SPEED, JOINT, JOINT_SPEED, MOTOR, MOTOR_SPEED, SLIP

STEPS = 5
"""Steps per tick."""


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
def _run(
    p: Plant,
    cables: Cables,
    shafts: FloatArray,
    now: FloatArray,
    pretension: float,
    asked: engine.Asked,
    pace: engine.Pace,
    out: FloatMatrix,
) -> bool:
    dt = pace.dt
    hub = p.hub_inertia if p.backlash != 0.0 else 0.0
    fill_tables(p, cables)
    work_in = work_out = 0.0
    rest = pretension
    slid_a = slid_b = 0.0  # conduits in their clamps, towards the motor
    done = 0
    for record in range(out.shape[0]):
        row = out[record]
        for _tick in range(pace.steps // STEPS):
            update(p, cables, shafts[JOINT], STEPS * dt)
            if p.pretension_loss != 0.0:
                fade = math.exp(-done * dt / p.loss_time)
                rest = pretension * (1.0 - p.pretension_loss * (1.0 - fade))
            for _step in range(STEPS):
                drive, hold = engine.torques(asked, done, pace.per_command, shafts)
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
        engine.close(row, pace.steps, (work_in, work_out, rubbed, damped))
        gripped = shafts[MOTOR] - shafts[SLIP]
        near = arc(p, gripped, 1.0)[0], -arc(p, gripped, -1.0)[0]
        far = p.joint_radius * shafts[HUB]
        row[13] = stored(p, cables, rest, near, (far + slid_a, slid_b - far))
    return True


def _steps(p: Plant) -> int:
    """Return the steps per record: more for impacts or falling friction."""
    return 4 * STEPS if p.backlash or p.stribeck else 2 * STEPS


LAW = engine.Law(arc, start, _run, _steps)
