"""One trial of a rig of finite elements: shafts by symplectic Euler, cables implicit.

Takes what `rig.kernel.integrate` takes and gives records as that does, in the same
columns; steps of 0.1 ms,
half that where a pulley meets a handle, a quarter where friction falls with speed.
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig.elements.cables import Cables, start, step
from rig.elements.plant import Array, Plant
from rig.kernel import COLUMNS, COMMAND_TIME, MEANS, RECORD_TIME, pulled

STEPS = 2
"""Per record."""
HALVED = 3
"""Times that the steps of a trial are halved in which the nodes are not found."""


def integrate(
    p: Plant,
    pretension: float,
    servo: Array,
    environment: Array,
    command: Array,
    target: Array,
    refine: int = 1,
) -> Array:
    """Run one trial; see `rig.kernel.integrate`.

    Raises:
        ValueError: The nodes of a step are not found, however short.
    """
    motor = command[0, 0]
    arcs = arc(p, motor, 1.0)[0], -arc(p, motor, -1.0)[0]
    refine *= 4 if p.striction else 2 if p.play else 1
    count = (command.shape[0] - 1) * round(COMMAND_TIME / RECORD_TIME)
    for _ in range(HALVED + 1):
        cables, now = start(p, pretension, arcs), np.zeros(MEANS)
        out = np.zeros((count, len(COLUMNS)))
        if _run(
            p, cables, pretension, servo, environment, command, target, refine, now, out
        ):
            return out
        refine *= 2
    raise ValueError("the nodes of a cable are not found; shorten the step")


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
def _flanks(p: Plant, ahead: float, ahead_speed: float) -> float:
    """Return the torque of the hub on the handle: flanks that dent as they meet."""
    deep = abs(ahead) - 0.5 * p.play
    if deep <= 0.0:
        return 0.0
    side = math.copysign(1.0, ahead)
    loss = 1.0 + p.contact_loss * side * ahead_speed
    return side * p.contact * deep**1.5 * max(loss, 0.0)


@internal
def _carried(p: Plant, angle: float, follower: float, lagging: float) -> float:
    """Return the torque of what sits on the joint pulley."""
    load = p.weight * math.sin(angle - p.weight_phase)
    load += p.band * 1.2 * math.tanh((angle - p.band_rest) / 1.2)
    load += p.felt * follower
    return load + p.putty * (angle - lagging)


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
    now: FloatArray,
    out: FloatMatrix,
) -> bool:
    """Fill the records; return whether the nodes of every step were found."""
    steps = STEPS * refine
    dt = RECORD_TIME / steps
    per_command = round(COMMAND_TIME / dt)
    inner = p.mass.shape[1]
    motor, joint, hub = command[0, 0], command[0, 0], command[0, 0]
    motor_speed = joint_speed = hub_speed = 0.0
    pulley, twist = motor, 0.0
    follower, lagging = 0.0, joint
    work_in = work_out = 0.0
    near_a = near_b = far_a = far_b = pretension
    done = 0
    teeth_0 = p.teeth * math.sin(p.teeth_order * motor - p.teeth_phase)
    for record in range(out.shape[0]):
        row = out[record]
        for _ in range(steps):
            at = done // per_command
            part = (done - at * per_command) / per_command
            done += 1
            arc_a, slope_a = arc(p, pulley, 1.0)
            arc_b, slope_b = arc(p, pulley, -1.0)
            cable_load = slope_a * near_a - slope_b * near_b
            load = cable_load
            if p.slots != 0.0:
                phase = p.slots_order * motor - p.slots_phase
                load += p.slots * (math.sin(phase) + math.sin(3.0 * phase) / 3.0)
            drive = pulled(servo, command, at, part, motor, motor_speed)
            drive = min(max(drive, -p.amplifier), p.amplifier)
            rate = (drive - load) / (p.rotor_inertia + p.drum)
            shown = load + p.drum * rate
            now[0], now[1], now[2], now[4] = motor, shown, joint, joint_speed
            now[5], now[6], now[7], now[8] = near_a, near_b, far_a, far_b
            motor_speed += rate * dt
            motor += motor_speed * dt
            old_pulley = pulley
            twist += dt / p.shaft_time * (cable_load * p.shaft - twist)
            teeth = p.teeth * math.sin(p.teeth_order * motor - p.teeth_phase)
            pulley = motor + teeth - teeth_0 - twist
            given = p.joint_radius * (far_a - far_b)
            taken = _carried(p, hub, follower, lagging)
            hold = pulled(environment, target, at, part, joint, joint_speed)
            hold -= p.joint_damping * joint_speed
            old_hub = hub
            if p.play == 0.0:
                rate = (given - taken + hold) / (p.joint_inertia + p.disc)
                felt = given - taken - p.disc * rate
                joint_speed += rate * dt
                joint += joint_speed * dt
                hub, hub_speed = joint, joint_speed
            else:
                felt = _flanks(p, hub - joint, hub_speed - joint_speed)
                hub_speed += (given - taken - felt) / (p.hub_inertia + p.disc) * dt
                joint_speed += (felt + hold) / (p.joint_inertia - p.hub_inertia) * dt
                hub += hub_speed * dt
                joint += joint_speed * dt
            now[3] = felt
            # What holds between two steps belongs to both of them.
            _add(row, now, 0.5 / steps)
            if done > 1:
                _add(out[(done - 2) // steps], now, 0.5 / steps)
            if p.felt != 0.0:
                # Follows behind a play, which is what a hysteresis of form is.
                reach = p.felt_play
                follower += hub - old_hub
                follower = min(max(follower, -reach), reach)
            if p.putty != 0.0:
                lagging += dt / p.putty_time * (hub - lagging)
            work_in += 0.5 * cable_load * (pulley - old_pulley)
            work_out += 0.5 * given * (hub - old_hub)
            time = done * dt
            tight = pretension
            if p.relaxing != 0.0:
                fast, slow = math.exp(-time / 0.8), math.exp(-time / 5.0)
                tight *= 1.0 - p.relaxing * (1.0 - 0.4 * fast - 0.6 * slow)
            far, old_far = p.joint_radius * hub, p.joint_radius * old_hub
            new_a, slope_a = arc(p, pulley, 1.0)
            new_b, slope_b = arc(p, pulley, -1.0)
            near_a, far_a, found_a = step(
                p, cables, 0, tight, (arc_a, new_a), (old_far, far), hub, time, dt
            )
            near_b, far_b, found_b = step(
                p, cables, 1, tight, (-arc_b, -new_b), (-old_far, -far), hub, time, dt
            )
            if not (found_a and found_b):
                return False
            cable_load = slope_a * near_a - slope_b * near_b
            work_in += 0.5 * cable_load * (pulley - old_pulley)
            work_out += 0.5 * p.joint_radius * (far_a - far_b) * (hub - old_hub)
        row[9] = work_in
        row[10] = work_out
        row[11] = cables.work[0, 0] + cables.work[1, 0]
        row[12] = cables.work[0, 1] + cables.work[1, 1]
        for c in range(2):
            for i in range(inner):
                row[13] += 0.5 * p.mass[c, i] * cables.speed[c, i] ** 2
        for e in range(inner + 1):
            row[13] += 0.5 * cables.elastic[0, e] ** 2 / p.stiffness[0, e]
            row[13] += 0.5 * cables.elastic[1, e] ** 2 / p.stiffness[1, e]
    _add(out[out.shape[0] - 1], now, 0.5 / steps)
    return True


@internal
def _add(row: FloatArray, now: FloatArray, share: float) -> None:
    """Add a share of the state between two steps to the means of a record."""
    for k in range(MEANS):
        row[k] += share * now[k]
