"""Memory of a planning controller for one device, its tuning, tables and scratch.

    planner.tune[PERIOD], planner.memory[ENERGY]

A row of `memory` is the state of a controller for one device besides that of its
cables: angle, velocity and unexplained torque of the rotor by an observer, and the load
on it; motion of the joint and of the desired torque, per control step, by filters of
third order; the direction in which the motor turns; 1 after the start; the low-passed
torque; the delay of the measurements in control steps; the energy that the joint got
beyond the desired one; bias of the torque sensor; torque of the motor and its last
command; the shift by which the torque sensor moves the joint of a single cable's model
so that it pulls, now and when the cable last pulled no more than desired; the same of
the model with bristles; the joint of that model; mean squared errors of the torque that
the model predicts, and of that with bristles; 1 while plans use the latter; mean
squared torques on the rotor that either model does not explain, the loads of both, and
their observers of the rotor; torque by which a crossing stops short; the numbers of the
guard; logarithms of the factors of friction.

The model with bristles is a second hypothesis: friction that builds up over a travel,
as it does where fibres or a liner give way, instead of at once. The value of that
travel matters little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._parameter import parameters_of
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._law_steps import LAW_INPUTS, DriveGains, gain
from cc_mujoco.native import FloatArray, FloatCube, FloatMatrix

PLANNER_INPUTS = (LAW_INPUTS[0], LAW_INPUTS[2], *LAW_INPUTS[4:])
"""Columns that the controller reads: angles of motor and joint, torques."""
ANGLE, VELOCITY, DISTURBANCE, LOAD = 0, 1, 2, 3
JOINT, DESIRED_TORQUE, DIRECTION, STARTED, FILTERED_TORQUE = 4, 7, 10, 11, 12
BELIEVED_DELAY, ENERGY, BIAS, MOTOR_TORQUE, COMMAND = 13, 14, 15, 16, 17
JOINT_SHIFT, TAUT_SHIFT, OTHER_JOINT, MODEL_ERROR, BRISTLED = 18, 19, 22, 23, 25
ROTOR_ERROR, MODEL_LOAD, MODEL_ROTOR, CAUTION, GUARD = 26, 28, 30, 38, 39
FRICTION = GUARD + guard.MEMORY_SIZE
"""Places in the memory; after the last there is a number for every cable. Numbers of
the model with bristles are one place after those of the model, shifts two, the observer
of the rotor `OBSERVER_SIZE`."""

OBSERVER_ERROR, OBSERVER_SIZE, WORK_ROWS = 3, 4, 9
"""Place of an observer's mean squared error, after angle, velocity and unexplained
torque of the rotor; size of an observer; number of vectors in a plan of commands."""


@dataclass(frozen=True)
class Tuning(DriveGains):
    """Settings of motor, observers and plan for the compiled functions."""

    inertia: float = gain(
        "kg m^2", 0.0, 1e6, 1e-4, "of the motor with its pulley", low_open=True
    )
    damping: float = gain("N m s/rad", 0.0, 1e6, 0.0, "of the motor's bearings")
    span: float = gain(
        "s", 0.0, 10.0, 3e-3, "time between two knots of the plan", low_open=True
    )
    tolerance: float = gain(
        "N m", 0.0, 1e6, 0.0, "of the torque that a knot of the plan makes"
    )
    turning: float = gain(
        "N m^2", 0.0, 1e12, 0.0, "mean squared error that turning the motor must save"
    )
    noise: float = gain(
        "N m", 0.0, 1e6, 0.0, "measured torque that is one for sure", low_open=True
    )
    belief: float = gain(
        "1", 1e-3, 1.0, 0.5, "share of the torque sensor that is taken over in a step"
    )
    learning: float = gain("1/s", 0.0, 1e3, 5.0, "rate at which friction is learned")
    zeroing: float = gain(
        "1/s", 0.0, 1e3, 2.0, "rate at which the bias of the torque sensor is learned"
    )
    least: float = gain(
        "N m", 0.0, 1e9, 0.05,
        "motor torque of friction below which little is learned", low_open=True,
    )  # fmt: skip
    spend: float = gain(
        "s", 0.0, 10.0, 0.02,
        "time in which energy given to the joint is spent by a damper", low_open=True,
    )  # fmt: skip
    slow: float = gain(
        "rad/s", 0.0, 1e3, 0.1,
        "velocity of the joint below which that takes longer", low_open=True,
    )  # fmt: skip
    damper: float = gain("N m s/rad", 0.0, 1e6, 0.0, "strongest damper")
    rotor_0: float = gain(
        "1", 0.0, 1.0, 0.5, "gain of the observer of the rotor, angle"
    )
    rotor_1: float = gain("1", 0.0, 2.0, 0.5, "likewise, velocity")
    motion_0: float = gain(
        "1", 0.0, 1.0, 0.5, "gain of the filters of joint and desired torque, value"
    )
    motion_1: float = gain("1", 0.0, 2.0, 0.5, "likewise, rate")
    motion_2: float = gain("1", 0.0, 1.0, 0.1, "likewise, acceleration")
    forgetting: float = gain(
        "1", 0.0, 1.0, 0.01,
        "share of an observer's mean squared error that a step renews",
    )  # fmt: skip
    leak: float = gain(
        "1", 0.0, 1.0, 1e-4, "share of the account of energy that a step forgets"
    )
    yielding: float = gain(
        "rad/(N m s)", 0.0, 1e9, 0.0,
        "velocity that the joint gains per torque that it lacks",
    )  # fmt: skip
    late: float = gain(
        "steps", 0.0, 1e6, 0.0,
        "by how many measurements are thought to be late at first",
    )  # fmt: skip
    lag: float = gain(
        "s", 0.0, 1.0, 0.0, "time constant of the motor's torque behind its command"
    )
    rate: float = gain(
        "N m/s", 0.0, math.inf, math.inf,
        "fastest change of the command; infinite where there is no limit",
        low_open=True,
    )  # fmt: skip
    bristles: float = gain(
        "rad", 0.0, 10.0, 0.2,
        "motion of the joint over which friction may build up; 0 is at once",
    )  # fmt: skip
    caution: float = gain(
        "1", 0.0, 1.0, 0.0, "share of a crossing that the motor stops short of"
    )
    slack: float = gain(
        "N m", 0.0, 1e6, 0.0, "slack at the motor of a cable whose drag pulls too much"
    )
    creep: float = gain(
        "1", 0.0, 1.0, 0.02, "share of it that the motor makes up for in a step"
    )
    iterations: float = gain(
        "1", 1.0, math.inf, math.inf,
        "steps of the cables' model for the plans of a step; then the last plan goes "
        "on",
    )  # fmt: skip


TUNING = parameters_of(Tuning)
"""Numbers of a tuning, in order; the spring of the cables follows."""
RATIO, LOW, HIGH, PERIOD, INERTIA = 0, 1, 2, 3, 5
(
    DAMPING, SPAN, TOLERANCE, TURNING, NOISE, BELIEF, LEARNING, ZEROING,
    MIN_FRICTION_TORQUE, SPEND, SLOW, DAMPER, ROTOR_0, ROTOR_1, MOTION_0, MOTION_1,
    MOTION_2, FORGETTING, LEAK, YIELDING, LATE_FIRST, LAG, RATE, BRISTLES,
    CAUTION_SHARE, SLACK, CREEP, ITERATIONS, STIFFNESS,
) = range(guard.LIMITS, len(TUNING) + 1)  # fmt: skip
"""Places of the numbers of a tuning; the first are those of `DriveGains`."""


class Tables(NamedTuple):
    """Gains and weights of plans, for every delay."""

    # Accelerations of a plan per angle, velocity and wanted angles of the motor.
    gains: FloatCube  # (delays, knots, 2 + knots)
    unexplained: FloatArray  # gain of the unexplained torque (delays,)
    weight: FloatArray  # of a squared acceleration to a squared angle (delays,) [s^4]


class Planner(NamedTuple):
    """All numbers of a planning controller for one device: memory, tables and scratch.

    States of the cables are (cables, numbers).
    """

    cables: stepper.Cables  # the model; with bristles while these are in use
    tables: Tables
    tune: FloatArray  # `Tuning`, then all cables as a spring, see `guard.STIFFNESS`
    joint: FloatArray  # angle of the model's joint when it was measured (1,) [rad]
    memory: FloatArray  # see this module (`FRICTION` + cables,)
    rotors: FloatMatrix  # observers of the rotor (delays, `OBSERVER_SIZE`)
    # Mean torques of the motor in past steps, the oldest first; the last is the command
    # of the step that has just passed.
    applied: FloatArray  # (delays,) [N m]
    plan: FloatArray  # accelerations of the last whole plan, steps since (knots + 1,)
    push: FloatArray  # accelerations of a plan, its first command (knots + 1,)
    best: FloatArray  # likewise, of the best plan
    state: FloatMatrix  # states of the cables when they were measured
    other: FloatMatrix  # likewise, of the model with bristles
    present: FloatMatrix  # scratch: states now, as predicted
    rolled: FloatMatrix  # states along a plan
    leapt: FloatMatrix  # see `rollout.MotorSearch`
    new: FloatMatrix  # states after a step
    ahead: FloatArray  # scratch: the memory as it is predicted to be now
    wanted: FloatArray  # scratch: angles of the motor at the knots of a plan (knots,)
    path: FloatArray  # angles of the motor to which the plan leads (knots,)
    load: FloatArray  # torques of the cables at the motor there (knots,)
    holding: FloatArray  # torques of the cables on the wanted path (knots,)
    vectors: FloatMatrix  # vectors of a plan of commands (`WORK_ROWS`, knots)
    matrix: FloatMatrix  # its matrix (knots, knots)
    friction: FloatMatrix  # factors of friction, as packed and as found (2, cables)
    values: FloatArray  # scratch: scalars of a cable (`SCALARS`,)
    work: FloatArray  # scratch of `cable._layout.work_size`
    spent: FloatArray  # steps of the cables' model for the plans so far (1,)
    given: FloatArray  # parameters behind those of the tuning, see `_law_steps`
    end: int  # place behind all of them in the memory of the controller
