"""Laws of one control step of one device, compiled, without allocation.

    memory[:] = 0.0                                    # at the start of an episode
    torque = proportional_integral(gains, memory, desired, measured)

The controllers run them for every environment; compiled for another machine they run
alone. `gains` are numbers in the order of `GAINS`, `seen` are measurements in the order
of `LAW_INPUTS`, and `memory` is the state of a law from one step to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco.cable._parameter import Parameter, parameter, parameters_of
from cc_mujoco.cable._stepper import Counts
from cc_mujoco.control import _compensation as compensation
from cc_mujoco.control import _guard as guard
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

LAW_INPUTS = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "joint_angle_rad",
    "joint_velocity_rad_s",
    "joint_torque_nm",
    "desired_torque_nm",
)
"""Columns of `device.MEASURED_COLUMNS` that the laws read, as `guard.READINGS`."""
ANGLE, VELOCITY, JOINT_ANGLE, JOINT_VELOCITY, TORQUE, DESIRED = range(len(LAW_INPUTS))

INTEGRAL_TORQUE, MOTOR_DIRECTION, GUARD = range(3)
"""Columns of the memory: torque of the integral [N m]; direction in which the motor
shall turn; first of the numbers of the guard."""
RELEASED = GUARD + guard.STATE
"""Column of the state of the guard, 0 while the law drives."""
MEMORY_SIZE = GUARD + guard.MEMORY_SIZE
"""Size of the memory of a law."""


@dataclass(frozen=True)
class FeedbackGains:
    """Parameters of motor and feedback that a law uses; `DriveLimits` first."""

    ratio: float = parameter(
        unit="1",
        bounds=(-1e6, 1e6),
        default=1.0,
        meaning="joint torque per motor torque without friction, signed, not 0",
    )
    low: float = parameter(
        unit="N m",
        bounds=(-1e9, 1e9),
        default=-1.0,
        meaning="least torque of the motor",
    )
    high: float = parameter(
        unit="N m",
        bounds=(-1e9, 1e9),
        default=1.0,
        meaning="greatest torque of the motor, above `low`",
    )
    period: float = parameter(
        unit="s",
        bounds=(0.0, 1e3),
        default=1e-3,
        low_open=True,
        meaning="time between two steps of the controller",
    )
    one_way: float = parameter(
        unit="1",
        bounds=(0.0, 1.0),
        default=0.0,
        meaning="1 where the cables only transmit positive motor torque, else 0",
    )
    inertia: float = parameter(
        unit="kg m^2",
        bounds=(0.0, 1e6),
        default=0.0,
        meaning="of the motor with its pulley; 0 is not known",
    )
    safe_torque: float = parameter(
        unit="N m",
        bounds=(0.0, guard.NO_TORQUE_LIMIT),
        default=guard.NO_TORQUE_LIMIT,
        low_open=True,
        meaning="most that the cables may put into the joint",
    )
    safe_speed: float = parameter(
        unit="rad/s",
        bounds=(0.0, guard.NO_SPEED_LIMIT),
        default=guard.NO_SPEED_LIMIT,
        low_open=True,
        meaning="speed of the joint beyond which it is let go",
    )
    safe_power: float = parameter(
        unit="W",
        bounds=(0.0, guard.NO_POWER_LIMIT),
        default=guard.NO_POWER_LIMIT,
        low_open=True,
        meaning="power into the joint beyond which it is let go",
    )
    feed_forward: float = parameter(
        unit="1",
        bounds=(0.0, 1.0),
        default=1.0,
        meaning="1 where the desired torque is fed forward, else 0",
    )
    proportional: float = parameter(
        unit="1", bounds=(0.0, 1e6), default=1.0, meaning="K_p"
    )
    integral: float = parameter(
        unit="1/s", bounds=(0.0, 1e6), default=2.0, meaning="K_i"
    )
    settling: float = parameter(
        unit="s",
        bounds=(0.0, 10.0),
        default=0.03,
        meaning="time in which the motor settles relative to the joint; 0 is undamped",
    )
    preview: float = parameter(
        unit="s",
        bounds=(0.0, 10.0),
        default=0.02,
        meaning="time by which the motion of the joint is looked ahead",
    )
    tolerance: float = parameter(
        unit="N m",
        bounds=(0.0, 1e6),
        default=0.0,
        meaning="torque at the joint below which the sense does not turn",
    )
    stiffness: float = parameter(
        unit="N m/rad",
        bounds=(0.0, 1e12),
        default=0.0,
        meaning="of all cables at the joint, for the guard; 0 is not known",
    )
    rest_torque: float = parameter(
        unit="N m",
        bounds=(0.0, 1e9),
        default=0.0,
        meaning="torque of the pretension of all cables at the joint, for the guard",
    )
    wrap_friction: float = parameter(
        unit="1",
        bounds=(0.0, 100.0),
        default=0.0,
        meaning="friction coefficient times wrap of the cables, for the guard",
    )

    @property
    def packed(self) -> FloatArray:
        """Numbers in the order of `GAINS`."""
        return np.array(list(vars(self).values()))


GAINS: tuple[Parameter, ...] = parameters_of(FeedbackGains)
"""Gains in the order of the laws."""

_RATIO, PERIOD = guard.RATIO, guard.PERIOD
(
    _FEED_FORWARD, _PROPORTIONAL, _INTEGRAL, _SETTLING, _PREVIEW, _TOLERANCE,
    STIFFNESS, REST_TORQUE, WRAP_FRICTION,
) = range(guard.LIMITS, len(GAINS))  # fmt: skip


@compiled
def feed_forward(gains: FloatArray, desired: float) -> float:
    """Return the motor torque of `FeedForward` from that at the joint [N m]."""
    return guard.limited(gains, desired / gains[_RATIO])


@compiled
def closed_loop_torque(
    gains: FloatArray,
    memory: FloatArray,
    feedforward: float,
    error: float,
    most: float,
) -> float:
    """Return the limited motor torque of feedback around a feed-forward [N m].

    The integral in the memory is updated. `error` is the desired less the measured
    joint torque [N m], `most` the largest torque that the guard admits [N m].
    """
    ratio = gains[_RATIO]
    following = (
        memory[INTEGRAL_TORQUE] + gains[_INTEGRAL] * gains[PERIOD] * error / ratio
    )
    if guard.limits_of(gains).one_way != 0.0:
        following = max(following, -max(feedforward, 0.0))
    torque = feedforward + gains[_PROPORTIONAL] * error / ratio + following
    limited = guard.limited(gains, torque)
    if abs(limited) > most:
        limited = math.copysign(most, limited)
    # At a limit, with an error that would push beyond.
    if not (torque - limited) * (error / ratio) > 0.0:
        memory[INTEGRAL_TORQUE] = following
    return limited


@compiled
def proportional_integral(
    gains: FloatArray,
    memory: FloatArray,
    desired: float,
    torque: float,
) -> float:
    """Return the motor torque of `ProportionalIntegral`, not guarded [N m]."""
    feedforward = 0.0
    if gains[_FEED_FORWARD] != 0.0:
        feedforward = desired / gains[_RATIO]
    return closed_loop_torque(gains, memory, feedforward, desired - torque, math.inf)


@internal
def _relative_velocity(gains: FloatArray, seen: FloatArray) -> float:
    return float(seen[VELOCITY] - gains[_RATIO] * seen[JOINT_VELOCITY])


@internal
def _damping_torque(gains: FloatArray, spring: FloatArray, seen: FloatArray) -> float:
    """Return the torque against the relative velocity of the motor [N m]."""
    ratio = gains[_RATIO]
    ahead = _relative_velocity(gains, seen)
    damping = gains[_SETTLING] * spring[guard.STIFFNESS] / (ratio * ratio)
    return float(damping * ahead)


@compiled
def admit(
    gains: FloatArray, spring: FloatArray, memory: FloatArray, seen: FloatArray
) -> None:
    """Check measurements, and replace them where needed; see `guard.admit`."""
    guard.admit(guard.limits_of(gains), spring, memory[GUARD:], seen)


@internal
def _releases_joint(
    gains: FloatArray, spring: FloatArray, memory: FloatArray, seen: FloatArray
) -> bool:
    """Return whether the law must not drive the motor; then it restarts."""
    ahead = _relative_velocity(gains, seen)
    own = memory[GUARD:]
    if (
        guard.state(guard.limits_of(gains), spring, own, ahead, seen[DESIRED])
        == guard.FREE
    ):
        return False
    memory[INTEGRAL_TORQUE], memory[MOTOR_DIRECTION] = 0.0, 0.0
    return True


@internal
def _let_go(
    gains: FloatArray, spring: FloatArray, memory: FloatArray, seen: FloatArray
) -> float:
    own, ratio = memory[GUARD:], gains[_RATIO]
    damping = gains[_SETTLING] * spring[guard.STIFFNESS] / (ratio * ratio)
    ahead = _relative_velocity(gains, seen)
    torque = guard.limited(gains, guard.let_go_torque(own, damping, ahead))
    return guard.bounded(guard.limits_of(gains), spring, own, torque)


@internal
def _driven(
    gains: FloatArray,
    spring: FloatArray,
    memory: FloatArray,
    feedforward: float,
    error: float,
) -> float:
    """Return the motor torque of feedback within the limit of the guard [N m]."""
    limits = guard.limits_of(gains)
    most = guard.command_limit(limits, spring)
    torque = closed_loop_torque(gains, memory, feedforward, error, most)
    return guard.bounded(limits, spring, memory[GUARD:], torque)


@compiled
def guarded_torque(
    gains: FloatArray, spring: FloatArray, memory: FloatArray, seen: FloatArray
) -> float:
    """Return the motor torque of `proportional_integral`, guarded [N m].

    `spring` is of all cables at the joint, see `guard.STIFFNESS`; `seen` are
    measurements after `admit`.
    """
    if _releases_joint(gains, spring, memory, seen):
        return _let_go(gains, spring, memory, seen)
    feedforward = 0.0
    if gains[_FEED_FORWARD] != 0.0:
        feedforward = seen[DESIRED] / gains[_RATIO]
    error = seen[DESIRED] - seen[TORQUE]
    return _driven(gains, spring, memory, feedforward, error)


@compiled
def damped_feedback(
    gains: FloatArray,
    spring: FloatArray,
    memory: FloatArray,
    seen: FloatArray,
    feedforward: float,
) -> float:
    """Return the motor torque of feedback with a damper, guarded [N m].

    Arguments as in `guarded_torque`; `feedforward` is a motor torque [N m].
    """
    if _releases_joint(gains, spring, memory, seen):
        return _let_go(gains, spring, memory, seen)
    feedforward -= _damping_torque(gains, spring, seen)
    error = seen[DESIRED] - seen[TORQUE]
    return _driven(gains, spring, memory, feedforward, error)


@compiled
def model_based(
    gains: FloatArray,
    spring: FloatArray,
    prm: FloatMatrix,
    n: Counts,
    distal: FloatArray,
    arm: FloatArray,
    state: FloatMatrix,
    slip_direction: FloatArray,
    gain: FloatArray,
    disturbance: float,
    memory: FloatArray,
    seen: FloatArray,
    scratch: FloatMatrix,
) -> float:
    """Return the motor torque of `ModelBased` [N m], after its model was updated.

    Arguments of the cables as in `_compensation.dynamic`; `disturbance` is the motor
    torque to be added [N m].
    """
    if _releases_joint(gains, spring, memory, seen):
        return _let_go(gains, spring, memory, seen)
    feedforward = compensation.dynamic(
        prm, n, arm, distal, state, slip_direction, gain, seen[JOINT_VELOCITY],
        seen[DESIRED], scratch,
    )  # fmt: skip
    feedforward = feedforward + disturbance - _damping_torque(gains, spring, seen)
    error = seen[DESIRED] - seen[TORQUE]
    return _driven(gains, spring, memory, feedforward, error)


@compiled
def stiction(
    gains: FloatArray,
    spring: FloatArray,
    prm: FloatMatrix,
    n: Counts,
    distal: FloatArray,
    arm: FloatArray,
    state: FloatMatrix,
    memory: FloatArray,
    seen: FloatArray,
    scratch: FloatMatrix,
) -> float:
    """Return the motor torque of `StictionCompensation` [N m]; see `model_based`.

    `state` is that of the model (cables, numbers).
    """
    if _releases_joint(gains, spring, memory, seen):
        return _let_go(gains, spring, memory, seen)
    error = seen[DESIRED] - seen[TORQUE]
    motion = spring[guard.STIFFNESS] * gains[_PREVIEW] * seen[JOINT_VELOCITY]
    # Positive at the motor is winding towards a positive ratio.
    wanted = math.copysign(1.0, gains[_RATIO]) * (error + motion)
    sense = memory[MOTOR_DIRECTION]
    turns = wanted * (np.sign(wanted) if sense == 0.0 else -sense)
    turned = turns > gains[_TOLERANCE]
    if turned:
        memory[MOTOR_DIRECTION] = np.sign(wanted)
    feedforward = compensation.full_slip_torque(
        prm,
        n,
        arm,
        distal,
        state,
        memory[MOTOR_DIRECTION],
        seen[JOINT_VELOCITY],
        seen[DESIRED],
        scratch,
    )
    feedforward -= _damping_torque(gains, spring, seen)
    # Where the direction has just changed, the feed-forward corrects the error.
    return _driven(gains, spring, memory, feedforward, 0.0 if turned else error)
