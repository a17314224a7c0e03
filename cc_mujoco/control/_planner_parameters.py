"""Named parameters of the compiled functions of a planning controller.

tune = Tuning(period=1e-3, inertia=2e-4, ...).packed(stiffness)
tune[PERIOD]
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco.cable._parameter import Parameter, parameter, parameters_of
from cc_mujoco.control import _guard as guard
from cc_mujoco.native import FloatArray


@dataclass(frozen=True)
class Tuning:
    """Settings of motor, observers and plan for the compiled functions."""

    period: float = parameter(
        unit="s", bounds=(0.0, 1e3), default=1e-3, low_open=True,
        meaning="time between two steps of the controller",
    )  # fmt: skip
    inertia: float = parameter(
        unit="kg m^2", bounds=(0.0, 1e6), default=1e-4, low_open=True,
        meaning="of the motor with its pulley",
    )  # fmt: skip
    damping: float = parameter(
        unit="N m s/rad", bounds=(0.0, 1e6), default=0.0,
        meaning="of the motor's bearings",
    )  # fmt: skip
    ratio: float = parameter(
        unit="1", bounds=(-1e6, 1e6), default=1.0,
        meaning="joint torque per motor torque without friction, signed, not 0",
    )  # fmt: skip
    low: float = parameter(
        unit="N m",
        bounds=(-1e9, 1e9),
        default=-1.0,
        meaning="least torque of the motor",
    )
    high: float = parameter(
        unit="N m", bounds=(-1e9, 1e9), default=1.0,
        meaning="greatest torque of the motor, above `low`",
    )  # fmt: skip
    span: float = parameter(
        unit="s", bounds=(0.0, 10.0), default=3e-3, low_open=True,
        meaning="time between two knots of the plan",
    )  # fmt: skip
    tolerance: float = parameter(
        unit="N m", bounds=(0.0, 1e6), default=0.0,
        meaning="of the torque that a knot of the plan makes",
    )  # fmt: skip
    turning: float = parameter(
        unit="N m^2", bounds=(0.0, 1e12), default=0.0,
        meaning="mean squared error that turning the motor must save",
    )  # fmt: skip
    noise: float = parameter(
        unit="N m", bounds=(0.0, 1e6), default=0.0, low_open=True,
        meaning="measured torque that is one for sure",
    )  # fmt: skip
    belief: float = parameter(
        unit="1", bounds=(1e-3, 1.0), default=0.5,
        meaning="share of the torque sensor that is taken over in a step",
    )  # fmt: skip
    learning: float = parameter(
        unit="1/s", bounds=(0.0, 1e3), default=5.0,
        meaning="rate at which friction is learned",
    )  # fmt: skip
    zeroing: float = parameter(
        unit="1/s", bounds=(0.0, 1e3), default=2.0,
        meaning="rate at which the bias of the torque sensor is learned",
    )  # fmt: skip
    least: float = parameter(
        unit="N m", bounds=(0.0, 1e9), default=0.05, low_open=True,
        meaning="motor torque of friction below which little is learned",
    )  # fmt: skip
    spend: float = parameter(
        unit="s", bounds=(0.0, 10.0), default=0.02, low_open=True,
        meaning="time in which energy given to the joint is spent by a damper",
    )  # fmt: skip
    slow: float = parameter(
        unit="rad/s", bounds=(0.0, 1e3), default=0.1, low_open=True,
        meaning="velocity of the joint below which that takes longer",
    )  # fmt: skip
    damper: float = parameter(
        unit="N m s/rad", bounds=(0.0, 1e6), default=0.0, meaning="strongest damper"
    )
    rotor_0: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.5,
        meaning="gain of the observer of the rotor, angle",
    )  # fmt: skip
    rotor_1: float = parameter(
        unit="1", bounds=(0.0, 2.0), default=0.5, meaning="likewise, velocity"
    )
    motion_0: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.5,
        meaning="gain of the filters of joint and desired torque, value",
    )  # fmt: skip
    motion_1: float = parameter(
        unit="1", bounds=(0.0, 2.0), default=0.5, meaning="likewise, rate"
    )
    motion_2: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.1, meaning="likewise, acceleration"
    )
    forgetting: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.01,
        meaning="share of an observer's mean squared error that a step renews",
    )  # fmt: skip
    leak: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=1e-4,
        meaning="share of the account of energy that a step forgets",
    )  # fmt: skip
    yielding: float = parameter(
        unit="rad/(N m s)", bounds=(0.0, 1e9), default=0.0,
        meaning="velocity that the joint gains per torque that it lacks",
    )  # fmt: skip
    late: float = parameter(
        unit="steps", bounds=(0.0, 1e6), default=0.0,
        meaning="by how many measurements are thought to be late at first",
    )  # fmt: skip
    lag: float = parameter(
        unit="s", bounds=(0.0, 1.0), default=0.0,
        meaning="time constant of the motor's torque behind its command",
    )  # fmt: skip
    rate: float = parameter(
        unit="N m/s", bounds=(0.0, math.inf), default=math.inf, low_open=True,
        meaning="fastest change of the command; infinite where there is no limit",
    )  # fmt: skip

    bristles: float = parameter(
        unit="rad", bounds=(0.0, 10.0), default=0.2,
        meaning="motion of the joint over which friction may build up; 0 is at once",
    )  # fmt: skip
    caution: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.0,
        meaning="share of a crossing that the motor stops short of",
    )  # fmt: skip
    slack: float = parameter(
        unit="N m", bounds=(0.0, 1e6), default=0.0,
        meaning="slack at the motor of a cable whose drag pulls too much",
    )  # fmt: skip
    creep: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.02,
        meaning="share of it that the motor makes up for in a step",
    )  # fmt: skip
    safe_torque: float = parameter(
        unit="N m", bounds=(0.0, guard.NO_TORQUE_LIMIT), default=guard.NO_TORQUE_LIMIT,
        low_open=True, meaning="most that the cables may put into the joint",
    )  # fmt: skip
    safe_speed: float = parameter(
        unit="rad/s", bounds=(0.0, guard.NO_SPEED_LIMIT), default=guard.NO_SPEED_LIMIT,
        low_open=True, meaning="speed of the joint beyond which it is let go",
    )  # fmt: skip
    safe_power: float = parameter(
        unit="W", bounds=(0.0, guard.NO_POWER_LIMIT), default=guard.NO_POWER_LIMIT,
        low_open=True, meaning="power into the joint beyond which it is let go",
    )  # fmt: skip
    answer_time: float = parameter(
        unit="s", bounds=(0.0, guard.MAX_ANSWER_TIME), default=0.0,
        meaning="time from a torque at the joint to the answer of the motor; 0 is none",
    )  # fmt: skip
    shared: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.0,
        meaning="1 where other motors turn the joint, too, else 0",
    )  # fmt: skip
    one_way: float = parameter(
        unit="1", bounds=(0.0, 1.0), default=0.0,
        meaning="1 where the cables only transmit positive motor torque, else 0",
    )  # fmt: skip
    iterations: float = parameter(
        unit="1", bounds=(1.0, math.inf), default=math.inf,
        meaning="steps of the cables' model for the plans of a step; then the last "
        "plan goes on",
    )  # fmt: skip

    def packed(self, spring: FloatArray) -> FloatArray:
        """Return the numbers as the vector of the compiled functions.

        `spring` is of all cables at the joint, see `guard.STIFFNESS`.
        """
        return np.array([*(getattr(self, one.name) for one in TUNING), *spring])


TUNING: tuple[Parameter, ...] = parameters_of(Tuning)
"""Numbers of a tuning, in order; the spring of the cables is behind them."""

(
    PERIOD,
    INERTIA,
    DAMPING,
    RATIO,
    LOW,
    HIGH,
    SPAN,
    TOLERANCE,
    TURNING,
    NOISE,
    BELIEF,
    LEARNING,
    ZEROING,
    MIN_FRICTION_TORQUE,
    SPEND,
    SLOW,
    DAMPER,
    ROTOR_0,
    ROTOR_1,
    MOTION_0,
    MOTION_1,
    MOTION_2,
    FORGETTING,
    LEAK,
    YIELDING,
    LATE_FIRST,
    LAG,
    RATE,
    BRISTLES,
    CAUTION_SHARE,
    SLACK,
    CREEP,
    SAFE,
    SAFE_SPEED,
    SAFE_POWER,
    ANSWER_TIME,
    SHARED,
    ONE_WAY,
    ITERATIONS,
    STIFFNESS,
) = range(len(TUNING) + 1)
