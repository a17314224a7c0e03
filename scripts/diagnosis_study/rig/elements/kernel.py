"""One trial of a rig of finite elements: cables by implicit Euler; compiled.

Steps of 0.1 ms, half that where a pulley meets a handle, a quarter where friction falls
with speed.
"""

from __future__ import annotations

import math

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig import engine
from rig.elements.cables import Cables, start, step
from rig.elements.plant import Plant
from rig.engine import HUB, HUB_SPEED, JOINT, JOINT_SPEED, MOTOR


@compiled
def arc(p: Plant, angle: float, side: float) -> tuple[float, float]:
    """Return the length wound on the motor pulley from 0, and its slope [m/rad].

    Off its middle it is nearer on one side as it is farther on the other; oval, it is
    the same on both.
    """
    e = side * p.offcentre
    oval = 0.5 * p.offcentre
    one = angle - p.offcentre_phase
    two = 2.0 * (angle - p.oval_phase)
    length = angle + e * (math.sin(one) + math.sin(p.offcentre_phase))
    length += 0.5 * oval * (math.sin(two) + math.sin(2.0 * p.oval_phase))
    slope = 1.0 + e * math.cos(one) + oval * math.cos(two)
    return p.motor_radius * length, p.motor_radius * slope


@internal
def _through_play(p: Plant, shafts: FloatArray) -> float:
    """Return the torque of the hub on the handle: flanks that dent as they meet."""
    ahead = shafts[HUB] - shafts[JOINT]
    deep = abs(ahead) - 0.5 * p.play
    if deep <= 0.0:
        return 0.0
    side = math.copysign(1.0, ahead)
    ahead_speed = shafts[HUB_SPEED] - shafts[JOINT_SPEED]
    loss = 1.0 + p.contact_loss * side * ahead_speed
    return side * p.contact * deep**1.5 * max(loss, 0.0)


@internal
def _carried(p: Plant, angle: float, follower: float, lagging: float) -> float:
    """Return the torque of what sits on the joint pulley."""
    load = p.unbalance * math.sin(angle - p.unbalance_phase)
    load += p.band * 1.2 * math.tanh((angle - p.band_rest) / 1.2)
    load += p.felt * follower
    return load + p.putty * (angle - lagging)


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
    steps, dt = pace.steps, pace.dt
    hub = p.hub_inertia if p.play != 0.0 else 0.0
    inner = p.mass.shape[1]
    near_a = near_b = far_a = far_b = pretension
    pulley, twist = shafts[MOTOR], 0.0
    follower, lagging = 0.0, shafts[JOINT]
    work_in = work_out = 0.0
    done = 0
    teeth_0 = p.teeth * math.sin(p.teeth_order * shafts[MOTOR] - p.teeth_phase)
    for record in range(out.shape[0]):
        row = out[record]
        for _ in range(steps):
            drive, hold = engine.torques(asked, done, pace.per_command, shafts)
            done += 1
            arc_a, slope_a = arc(p, pulley, 1.0)
            arc_b, slope_b = arc(p, pulley, -1.0)
            pull = slope_a * near_a - slope_b * near_b
            load = pull
            motor, joint, speed = shafts[MOTOR], shafts[JOINT], shafts[JOINT_SPEED]
            if p.slots != 0.0:
                phase = p.slots_order * motor - p.slots_phase
                load += p.slots * (math.sin(phase) + math.sin(3.0 * phase) / 3.0)
            drive = min(max(drive, -p.amplifier), p.amplifier)
            rate = engine.turn(
                shafts, MOTOR, drive - load, p.rotor_inertia + p.drum, dt
            )
            shown = load + p.drum * rate
            old_pulley, old_hub = pulley, shafts[HUB]
            twist += dt / p.shaft_time * (pull * p.shaft - twist)
            teeth = p.teeth * math.sin(p.teeth_order * shafts[MOTOR] - p.teeth_phase)
            pulley = shafts[MOTOR] + teeth - teeth_0 - twist
            given = p.joint_radius * (far_a - far_b)
            felt = engine.turn_joint(
                shafts, given - _carried(p, old_hub, follower, lagging),
                hold - p.joint_damping * speed, _through_play(p, shafts),
                p.joint_inertia, hub, p.disc, dt,
            )  # fmt: skip
            seen = joint, felt, speed
            engine.see(now, (motor, shown), seen, (near_a, near_b), (far_a, far_b))
            # What holds between two steps belongs to both of them.
            engine.add(row, now, 0.5 / steps)
            if done > 1:
                engine.add(out[(done - 2) // steps], now, 0.5 / steps)
            angle = shafts[HUB]
            if p.felt != 0.0:
                # Follows behind a play, which is what a hysteresis of form is.
                reach = p.felt_play
                follower += angle - old_hub
                follower = min(max(follower, -reach), reach)
            if p.putty != 0.0:
                lagging += dt / p.putty_time * (angle - lagging)
            work_in += 0.5 * pull * (pulley - old_pulley)
            work_out += 0.5 * given * (angle - old_hub)
            time = done * dt
            tight = pretension
            if p.relaxing != 0.0:
                fast, slow = math.exp(-time / 0.8), math.exp(-time / 5.0)
                tight *= 1.0 - p.relaxing * (1.0 - 0.4 * fast - 0.6 * slow)
            far, old_far = p.joint_radius * angle, p.joint_radius * old_hub
            new_a, slope_a = arc(p, pulley, 1.0)
            new_b, slope_b = arc(p, pulley, -1.0)
            near_a, far_a, found_a = step(
                p, cables, 0, tight, (arc_a, new_a), (old_far, far), angle, time, dt
            )
            near_b, far_b, found_b = step(
                p, cables, 1, tight, (-arc_b, -new_b), (-old_far, -far), angle, time, dt
            )
            if not (found_a and found_b):
                return False
            pull = slope_a * near_a - slope_b * near_b
            given = p.joint_radius * (far_a - far_b)
            work_in += 0.5 * pull * (pulley - old_pulley)
            work_out += 0.5 * given * (angle - old_hub)
        rubbed = cables.work[0, 0] + cables.work[1, 0]
        damped = cables.work[0, 1] + cables.work[1, 1]
        engine.close(row, 1, (work_in, work_out, rubbed, damped))
        for c in range(2):
            for i in range(inner):
                row[13] += 0.5 * p.mass[c, i] * cables.speed[c, i] ** 2
        for e in range(inner + 1):
            row[13] += 0.5 * cables.elastic[0, e] ** 2 / p.stiffness[0, e]
            row[13] += 0.5 * cables.elastic[1, e] ** 2 / p.stiffness[1, e]
    engine.add(out[out.shape[0] - 1], now, 0.5 / steps)
    return True


def _steps(p: Plant) -> int:
    return 8 if p.striction else 4 if p.play else 2


LAW = engine.Law(arc, start, _run, _steps)
