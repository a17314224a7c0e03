"""Memory, gains, tables and scratch of a planning controller for one device.

    planner.tune[PERIOD], planner.memory[ENERGY]

`memory` is the state of a controller for one device besides that of its cables. The
model with bristles is a second hypothesis: friction that builds up over a travel, as it
does where fibres or a liner give way, instead of at once. The value of that travel
matters little.
"""

from typing import NamedTuple

from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._law_steps import LAW_INPUTS, gains_of
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix

PLANNER_INPUTS = (LAW_INPUTS[0], LAW_INPUTS[2], *LAW_INPUTS[4:])
"""Columns that the controller reads: angles of motor and joint, torques."""
ANGLE, VELOCITY, DISTURBANCE, LOAD = 0, 1, 2, 3
"""Places in the memory, by an observer of the rotor: angle [rad], velocity [rad/s],
torque that the model does not explain; torque of the cables on it [N m]."""
JOINT, DESIRED_TORQUE, DIRECTION, STARTED, FILTERED_TORQUE = 4, 7, 10, 11, 12
"""Joint angle [rad] and desired torque [N m], each with its first and second difference
by control step; direction of the motor; 1 after the start; low-passed joint torque."""
BELIEVED_DELAY, ENERGY, BIAS, MOTOR_TORQUE, COMMAND = 13, 14, 15, 16, 17
"""Delay of the measurements [control steps]; energy that the joint got beyond the
desired one [J]; bias of the torque sensor, torque of the motor, its command [N m]."""
JOINT_SHIFT, TAUT_SHIFT, OTHER_JOINT, MODEL_ERROR, BRISTLED = 18, 19, 22, 23, 25
"""Shift of a single cable's joint in the model by the torque sensor, now and when the
cable last pulled no more than desired [rad]; joint of the model with bristles [rad];
mean squared error of the joint torque; 1 while plans use the model with bristles."""
ROTOR_ERROR, MODEL_LOAD, MODEL_ROTOR, CAUTION, GUARD = 26, 28, 30, 38, 39
"""Mean squared torque on the rotor that the model does not explain; its load and its
observer of the rotor; torque by which a crossing stops short [N m]; the guard."""
FRICTION = GUARD + guard.MEMORY_SIZE
"""Logarithms of the factors on friction, one for each cable. Numbers of the model with
bristles are one place after those of the model, shifts two, the observer of the rotor
`OBSERVER_SIZE`."""

OBSERVER_ERROR, OBSERVER_SIZE, WORK_ROWS = 3, 4, 9
"""Place of the mean squared error of an observer, after its angle, velocity and
unexplained torque; size of an observer; vectors in the scratch of command plans."""


TUNING = gains_of("plan")
"""Gains of a planning controller, in order; the spring of the cables follows."""
RATIO, LOW, HIGH, PERIOD, INERTIA = 0, 1, 2, 3, 5
(
    DAMPING, SPAN, TOLERANCE, TURNING, NOISE, BELIEF, LEARNING, ZEROING,
    MIN_FRICTION_TORQUE, SPEND, SLOW, DAMPER, ROTOR_0, ROTOR_1, MOTION_0, MOTION_1,
    MOTION_2, FORGETTING, LEAK, YIELDING, LATE_FIRST, LAG, RATE, BRISTLES,
    CAUTION_SHARE, SLACK, CREEP, ITERATIONS, STIFFNESS,
) = range(guard.LIMITS, len(TUNING) + 1)  # fmt: skip
"""Places of the gains; the first are those of `DriveLimits`."""


class Tables(NamedTuple):
    """Gains and weights of plans, for every delay of the measurements."""

    # Accelerations of a plan per angle, velocity and wanted angles of the motor.
    gains: FloatCube  # (delays, knots, 2 + knots)
    unexplained: FloatArray  # observer gain of the unexplained torque (delays,)
    weight: FloatArray  # of a squared acceleration to a squared angle (delays,) [s^4]


class Planner(NamedTuple):
    """All numbers of a planning controller for one device: memory, tables and scratch.

    States of the cables are (cables, numbers).
    """

    cables: stepper.Cables  # the model; with bristles while these are in use
    tables: Tables
    tune: FloatArray  # `TUNING`, then all cables as a spring, see `guard.STIFFNESS`
    joint: FloatArray  # the model's joint at the time of the measurements (1,) [rad]
    memory: FloatArray  # places from `ANGLE` to `FRICTION` (`FRICTION` + cables,)
    rotors: FloatMatrix  # observers of the rotor (delays, `OBSERVER_SIZE`)
    # Mean torques of the motor in past steps, the oldest first; the last is the command
    # of the step that has just passed.
    applied: FloatArray  # (delays,) [N m]
    # Accelerations [rad/s^2] of the last whole plan and control steps since; those of a
    # plan and its first command [N m]; the same of the best plan (knots + 1,).
    plan: FloatArray
    push: FloatArray
    best: FloatArray
    state: FloatMatrix  # states of the cables at the time of the measurements
    other: FloatMatrix  # `state` of the model with bristles
    present: FloatMatrix  # scratch: states now, as predicted
    rolled: FloatMatrix  # scratch: states along a plan
    leapt: FloatMatrix  # scratch of `rollout.MotorSearch`
    new: FloatMatrix  # scratch: states after a step
    ahead: FloatArray  # scratch: the memory as it is predicted to be now
    # Scratch (knots,): wanted angles of the motor, and those of the plan [rad]; torques
    # of the cables at the motor on the path of the plan and on the wanted one [N m].
    wanted: FloatArray
    path: FloatArray
    load: FloatArray
    holding: FloatArray
    # Scratch of `optimise_commands`, (`WORK_ROWS`, knots) and (knots, knots)
    vectors: FloatMatrix
    matrix: FloatMatrix
    friction: FloatMatrix  # factors on friction, as packed and as learned (2, cables)
    values: FloatArray  # scratch: scalars of a cable (`SCALARS`,)
    work: FloatArray  # scratch of `cable._layout.work_size`
    spent: FloatArray  # steps of the cables' model for the plans so far (1,)
    given: FloatArray  # parameters behind the gains, see `_law_steps`
    end: int  # index behind the planner in the memory of the controller
