"""One trial of the rig, integrated by symplectic Euler in compiled code.

    records = integrate(plant, pretension, servo, environment, command, target, 1)

Steps of 20 us, friction tables every tick of 0.1 ms, a record every 0.2 ms.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal
from rig.cables import Cables, at_rest, start, update_friction, varies
from rig.plant import Plant
from rig.shafts import (
    HUB,
    HUB_SPEED,
    JOINT,
    JOINT_SPEED,
    MOTOR,
    MOTOR_SPEED,
    SLIP,
    step_joint,
    step_motor,
    wound,
)
from rig.waves import step_cable, stored

Array = NDArray[np.float64]

RECORD_TIME = 2e-4
"""Time between two records [s]; a record is the mean over it."""
COMMAND_TIME = 1e-3
STEPS = 5
"""Steps per tick."""
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
"""Columns of the records. The works are integrals from the start [J]: of the cables on
the motor's pulley, of the cables on the joint's pulley, of all friction, of strand
damping; the energy is that of strain and motion of both cables."""
MEANS = 9
"""So many columns are means; the others hold at the end of the record."""


@internal
def _between(path: FloatMatrix, at: int, part: float, column: int) -> float:
    return float(path[at, column] + part * (path[at + 1, column] - path[at, column]))


@internal
def pulled(
    tie: FloatArray, path: FloatMatrix, at: int, part: float, x: float, v: float
) -> float:
    """Return the torque of a spring and damper that tie a shaft to a motion."""
    pull = tie[0] * (_between(path, at, part, 0) - x)
    return float(pull + tie[1] * (_between(path, at, part, 1) - v))


def integrate(
    p: Plant,
    pretension: float,
    servo: Array,
    environment: Array,
    command: Array,
    target: Array,
    refine: int,
) -> Array:
    """Run one trial.

    Args:
        p: the plant.
        pretension: tension of both cables at rest [N].
        servo: (2,) stiffness and damping of the motor's position loop.
        environment: (2,) stiffness and damping that tie the handle to `target`.
        command: (m + 1, 2) angle and speed asked of the motor, every `COMMAND_TIME`.
        target: (m + 1, 2) the same of the environment.
        refine: 1, or a whole number by which to shorten every step.

    Returns:
        (5 m, 14) records, see `COLUMNS`.
    """
    count = (command.shape[0] - 1) * round(COMMAND_TIME / RECORD_TIME)
    out = np.zeros((count, len(COLUMNS)))
    _run(
        p, at_rest(p, pretension), np.zeros(7), pretension, servo, environment,
        command, target, refine, out,
    )  # fmt: skip
    return out


@compiled
def _run(
    p: Plant,
    cables: Cables,
    shafts: FloatArray,
    pretension: float,
    servo: FloatArray,
    environment: FloatArray,
    command: FloatMatrix,
    target: FloatMatrix,
    refine: int,
    out: FloatMatrix,
) -> None:
    ticks = 2 * refine  # per record
    dt = RECORD_TIME / (ticks * STEPS)
    per_command = round(COMMAND_TIME / dt)
    slow = varies(p)
    shafts[MOTOR] = shafts[HUB] = shafts[JOINT] = command[0, 0]
    arc_a, _ = wound(p, shafts[MOTOR], 1.0)
    arc_b, _ = wound(p, shafts[MOTOR], -1.0)
    start(p, cables, arc_a, arc_b)
    work_in = work_out = 0.0
    rest = pretension
    slid_a = slid_b = 0.0  # conduits in their clamps, towards the motor
    step = 0
    for record in range(out.shape[0]):
        row = out[record]
        for _tick in range(ticks):
            if slow:
                update_friction(p, cables, shafts[JOINT], STEPS * dt)
            if p.pretension_loss != 0.0:
                fade = math.exp(-step * dt / p.loss_time)
                rest = pretension * (1.0 - p.pretension_loss * (1.0 - fade))
            for _step in range(STEPS):
                at = step // per_command
                part = (step - at * per_command) / per_command
                step += 1
                gripped = shafts[MOTOR] - shafts[SLIP]
                arc_a, slope_a = wound(p, gripped, 1.0)
                arc_b, slope_b = wound(p, gripped, -1.0)
                speed_a = slope_a * shafts[MOTOR_SPEED]
                speed_b = slope_b * shafts[MOTOR_SPEED]
                far = p.joint_radius * shafts[HUB]
                far_speed = p.joint_radius * shafts[HUB_SPEED]
                motor, speed = shafts[MOTOR], shafts[MOTOR_SPEED]
                drive = pulled(servo, command, at, part, motor, speed)
                joint, speed = shafts[JOINT], shafts[JOINT_SPEED]
                hold = pulled(environment, target, at, part, joint, speed)
                near_a, far_a = step_cable(
                    p, cables, 0, rest, arc_a, speed_a, far + slid_a, far_speed, dt
                )
                near_b, far_b = step_cable(
                    p, cables, 1, rest, -arc_b, -speed_b, slid_b - far, -far_speed, dt
                )
                slid_a += p.clamp_creep * max(far_a - p.clamp_force, 0.0) * dt
                slid_b += p.clamp_creep * max(far_b - p.clamp_force, 0.0) * dt
                load = slope_a * near_a - slope_b * near_b
                given = p.joint_radius * (far_a - far_b)
                work_in += load * shafts[MOTOR_SPEED] * dt
                work_out += given * shafts[HUB_SPEED] * dt
                row[1] += step_motor(p, shafts, load, drive, dt)
                row[3] += step_joint(p, shafts, given, hold, dt)
                # Angles in the middle of the step, where its torques are.
                row[0] += shafts[MOTOR] - 0.5 * dt * shafts[MOTOR_SPEED]
                row[2] += shafts[JOINT] - 0.5 * dt * shafts[JOINT_SPEED]
                row[4] += shafts[JOINT_SPEED]
                row[5] += near_a
                row[6] += near_b
                row[7] += far_a
                row[8] += far_b
        for k in range(MEANS):
            row[k] /= ticks * STEPS
        row[9] = work_in
        row[10] = work_out
        row[11] = cables.work[0, 0] + cables.work[1, 0]
        row[12] = cables.work[0, 1] + cables.work[1, 1]
        gripped = shafts[MOTOR] - shafts[SLIP]
        arc_a, _ = wound(p, gripped, 1.0)
        arc_b, _ = wound(p, gripped, -1.0)
        far = p.joint_radius * shafts[HUB]
        ends = far + slid_a, slid_b - far
        row[13] = stored(p, cables, rest, (arc_a, -arc_b), ends)
