"""Memory of a planning controller for one device, its tables and its scratch.

A row of `memory` is the state of a controller for one device besides that of its
cables: the rotor as estimated by an observer, with the torque that the model does not
explain; motion of the joint and of the desired torque, per control step, by filters of
third order; the direction in which the motor turns; the low-passed torque; the delay of
the measurements in control steps; the energy of the joint beyond the desired one; bias
of the torque sensor; torque of the motor and its last command; the shift of the joint
of a single cable's model by the torque sensor so that it pulls, now and when it last
pulled no more than desired; the same of the model with bristles; the joint of that
model; mean squared errors of the torque that the model predicts, and of that with
bristles; 1 while that one is planned with; mean squared torques on the rotor that
either does not explain, the loads of both, and their observers of the rotor; torque by
which a crossing stops short; the numbers of the guard; logarithms of the factors of
friction.

The model with bristles is a second hypothesis: friction that builds up over a travel,
as it does where fibres or a liner give way, instead of at once. The value of that
travel matters little.
"""

from __future__ import annotations

from typing import NamedTuple

from cc_mujoco.control import _guard as guard
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix, internal

PLANNER_INPUTS = (
    "motor_angle_rad",
    "joint_angle_rad",
    "joint_torque_nm",
    "desired_torque_nm",
)
"""Columns of `device.MEASURED_COLUMNS` that the controller reads."""
ANGLE, VELOCITY, DISTURBANCE, LOAD = 0, 1, 2, 3
JOINT, DESIRED_TORQUE, DIRECTION, STARTED, FILTERED_TORQUE = 4, 7, 10, 11, 12
BELIEVED_DELAY, ENERGY, BIAS, MOTOR_TORQUE, COMMAND = 13, 14, 15, 16, 17
JOINT_SHIFT, TAUT_SHIFT = 18, 19
OTHER_JOINT, MODEL_ERROR, BRISTLED = 22, 23, 25
ROTOR_ERROR, MODEL_LOAD, MODEL_ROTOR, CAUTION, GUARD = 26, 28, 30, 38, 39
FRICTION = GUARD + guard.MEMORY_SIZE
RELEASED = GUARD + guard.STATE
"""Places in the memory; behind the last there is a number for every cable. Numbers of
the model with bristles are one place behind those of the model, shifts two, the
observer of the rotor `OBSERVER_SIZE`."""

OBSERVER_ERROR, OBSERVER_SIZE = 3, 4
"""Place of the mean squared error of an observer of the rotor, behind angle, velocity
and unexplained torque; size of an observer."""
WORK_ROWS = 9
"""Rows of the scratch of a plan of commands, of numbers for each knot."""


class PlannerMemory(NamedTuple):
    """Memory of a controller for one device beside its cables; see this module.

    Attributes:
        memory: (`FRICTION` + cables,).
        rotors: observers of the rotor (delays, `OBSERVER_SIZE`).
        applied: mean torques of the motor in past steps, the oldest first; the last is
            the command of the step that has just passed (delays,) [N m].
        other: states of the cables of the model with bristles (cables, numbers).
        plan: accelerations of the last whole plan, then steps since (knots + 1,).
    """

    memory: FloatArray
    rotors: FloatMatrix
    applied: FloatArray
    other: FloatMatrix
    plan: FloatArray


class Tables(NamedTuple):
    """Tables of a controller.

    Attributes:
        gains: accelerations of a plan per angle, velocity and wanted angles of the
            motor, for every delay (delays, knots, 2 + knots).
        unexplained: gain of the unexplained torque, for every delay (delays,).
        weight: of a squared acceleration to a squared angle in the cost of a plan, for
            every delay (delays,) [s^4].
        tune: see `Tuning.packed`.
    """

    gains: FloatCube
    unexplained: FloatArray
    weight: FloatArray
    tune: FloatArray


class PlannerWorkspace(NamedTuple):
    """Scratch of a plan.

    Attributes:
        new: states of the cables (cables, numbers).
        state: states of the cables (cables, numbers).
        rolled: states of the cables (cables, numbers).
        leapt: states of the cables (cables, numbers).
        push: accelerations of a plan, then its first command (knots + 1,).
        best: accelerations of the best plan, then its first command (knots + 1,).
        memory: (`FRICTION` + cables,).
        wanted: angles of the motor at the knots of a plan (knots,).
        path: angles of the motor at the knots to which a plan leads (knots,).
        load: torques of the cables at the motor there (knots,).
        holding: torques of the cables at the motor on the wanted path (knots,).
        matrix: of a plan of commands (knots, knots).
        vectors: of a plan of commands (`WORK_ROWS`, knots).
        work: `cable._layout.work_size`.
        spent: steps of the cables' model for the plans so far (1,).
    """

    new: FloatMatrix
    state: FloatMatrix
    rolled: FloatMatrix
    leapt: FloatMatrix
    push: FloatArray
    best: FloatArray
    memory: FloatArray
    wanted: FloatArray
    path: FloatArray
    load: FloatArray
    holding: FloatArray
    matrix: FloatMatrix
    vectors: FloatMatrix
    work: FloatArray
    spent: FloatArray


@internal
def copy_states(source: FloatMatrix, target: FloatMatrix) -> None:
    for k in range(source.shape[0]):
        for i in range(source.shape[1]):
            target[k, i] = source[k, i]
