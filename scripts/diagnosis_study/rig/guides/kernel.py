"""One trial of a rig with guides: cables in equilibrium, steps of 0.2 ms; compiled."""

from __future__ import annotations

import math

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig import engine
from rig.engine import HUB, HUB_SPEED, JOINT, JOINT_SPEED, MOTOR, MOTOR_SPEED
from rig.guides.cables import Cables, settle, start
from rig.guides.plant import Plant


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
def _taken(p: Plant, angle: float, speed: float) -> float:
    """Return the torque that what sits on the joint pulley takes."""
    load = p.unbalance * math.sin(angle - p.unbalance_phase)
    off = angle - p.strap_rest
    load += p.strap * off * (1.0 + 0.1 * off * off)
    load += p.bearing * math.tanh(speed / 0.01)
    near = (angle - p.catch_angle) / p.catch_width
    return load + p.catch * near * math.exp(0.5 * (1.0 - near * near))


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
    hub = p.hub_inertia if p.play != 0.0 else 0.0
    near_a = near_b = far_a = far_b = pretension
    work_in = work_out = 0.0
    step = 0
    for record in range(out.shape[0]):
        row = out[record]
        for _ in range(pace.steps):
            drive, hold = engine.torques(asked, step, pace.per_command, shafts)
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
            tight = pretension
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
        engine.close(
            row, pace.steps, (work_in, work_out, cables.work[0] + cables.work[1], 0.0)
        )
        for c in range(2):
            for i in range(cables.tension.shape[1]):
                row[13] += 0.5 * cables.tension[c, i] ** 2 / p.piece[c, i]
    return True


def _steps(_p: Plant) -> int:
    return 1


LAW = engine.Law(arc, start, _run, _steps)


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
    """Advance by some steps, by a torque from outside.

    Args:
        p: The plant; loads on the shafts, play, an axis off the middle and a
            pretension that settles are left out.
        cables: Their state, which moves on.
        pretension: Tension at rest [N].
        state: Angle and speed of the motor, of the joint; which move on.
        ends: Tensions at the motor and at the joint, of both cables [N].
        torque: Of the motor [N m].
        hand: Stiffness, damping, angle and speed that it asks for.
        steps: How many.
        dt: Of each [s].
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
