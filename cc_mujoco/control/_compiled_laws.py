"""The laws of one control step of one device, compiled, without allocation.

    memory[:] = 0.0                                    # at the start of an episode
    torque = proportional_integral(gains, memory, desired, measured)

The controllers run them for every environment that they have; compiled for another
machine they run on their own. `gains` are numbers in the order of `GAINS`, `seen` what
is measured in the order of `LAW_INPUTS`, and `memory` what a law keeps from one step to
the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cc_mujoco._utils.compilation import FloatArray, compiled, internal
from cc_mujoco.cable._parameter import Parameter, parameter, parameters_of
from cc_mujoco.cable._stepper import Counts
from cc_mujoco.control import _compensation as compensation
from cc_mujoco.control import _guard as guard

LAW_INPUTS = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "joint_velocity_rad_s",
    "joint_torque_nm",
    "desired_torque_nm",
)
"""Columns of `device.MEASURED_COLUMNS` that the laws read."""
ANGLE, VELOCITY, JOINT_VELOCITY, TORQUE, DESIRED = range(len(LAW_INPUTS))

INTEGRAL_TORQUE, MOTOR_DIRECTION, RELEASED = range(3)
"""Columns of the memory: torque of the integral [N m]; sense in which the motor shall
turn; 1 while the guard has the motor follow the joint."""
MEMORY_SIZE = 3
"""Numbers that a law keeps."""


@dataclass(frozen=True)
class FeedbackGains:
    """Parameters of motor and feedback that a law uses."""

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
    safe_torque: float = parameter(
        unit="N m",
        bounds=(0.0, guard.NO_TORQUE_LIMIT),
        default=guard.NO_TORQUE_LIMIT,
        low_open=True,
        meaning="most that the cables may put into the joint",
    )
    inertia: float = parameter(
        unit="kg m^2",
        bounds=(0.0, 1e6),
        default=0.0,
        meaning="of the motor with its pulley; 0 is not known",
    )
    stiffness: float = parameter(
        unit="N m/rad",
        bounds=(0.0, 1e12),
        default=0.0,
        meaning="of all cables at the joint, for the guard; 0 is not known",
    )

    @property
    def packed(self) -> FloatArray:
        """The numbers as the laws have them."""
        return np.array([getattr(self, gain.name) for gain in GAINS], dtype=float)


GAINS: tuple[Parameter, ...] = parameters_of(FeedbackGains)
"""The gains, in the order in which the laws have them."""

(
    _RATIO, _LOW, _HIGH, PERIOD, _ONE_WAY, _FEED_FORWARD, _PROPORTIONAL, _INTEGRAL,
    _SETTLING, _PREVIEW, _TOLERANCE, _SAFE, _INERTIA, STIFFNESS,
) = range(len(GAINS))  # fmt: skip


@internal
def _limited(gains: FloatArray, torque: float) -> float:
    """Return a torque within the limits of the motor [N m]; no number stays none."""
    if torque < gains[_LOW]:
        return float(gains[_LOW])
    if torque > gains[_HIGH]:
        return float(gains[_HIGH])
    return float(torque)


@compiled
def feed_forward(gains: FloatArray, desired: float) -> float:
    """Return the motor torque of `FeedForward` from that at the joint [N m]."""
    return _limited(gains, desired / gains[_RATIO])


@compiled
def closed_loop_torque(
    gains: FloatArray, memory: FloatArray, feedforward: float, error: float
) -> float:
    """Return the limited motor torque of feedback around a feed-forward [N m].

    Args:
        gains: see `GAINS`.
        memory: of the law; its integral is moved on.
        feedforward: motor torque that is fed forward [N m].
        error: desired less measured joint torque [N m].
    """
    ratio = gains[_RATIO]
    following = (
        memory[INTEGRAL_TORQUE] + gains[_INTEGRAL] * gains[PERIOD] * error / ratio
    )
    if gains[_ONE_WAY] != 0.0:
        following = np.maximum(following, -np.maximum(feedforward, 0.0))
    torque = feedforward + gains[_PROPORTIONAL] * error / ratio + following
    limited = _limited(gains, torque)
    # Beyond a limit, and the error would push further.
    if not (torque - limited) * (error / ratio) > 0.0:
        memory[INTEGRAL_TORQUE] = following
    return limited


@compiled
def proportional_integral(
    gains: FloatArray, memory: FloatArray, desired: float, torque: float
) -> float:
    """Return the motor torque of `ProportionalIntegral` [N m]."""
    feedforward = 0.0
    if gains[_FEED_FORWARD] != 0.0:
        feedforward = desired / gains[_RATIO]
    return closed_loop_torque(gains, memory, feedforward, desired - torque)


@internal
def _relative_velocity(gains: FloatArray, seen: FloatArray) -> float:
    """Return the velocity of the motor relative to the joint [rad/s]."""
    return float(seen[VELOCITY] - gains[_RATIO] * seen[JOINT_VELOCITY])


@internal
def _damping_torque(gains: FloatArray, stiffness: float, seen: FloatArray) -> float:
    """Return the torque against that velocity [N m]."""
    ratio = gains[_RATIO]
    ahead = _relative_velocity(gains, seen)
    return float(gains[_SETTLING] * stiffness / (ratio * ratio) * ahead)


@internal
def _releases_joint(
    gains: FloatArray, stiffness: float, memory: FloatArray, seen: FloatArray
) -> bool:
    """Return whether the motor is to follow the joint; then the law begins anew."""
    rushing = guard.impact_torque(
        _relative_velocity(gains, seen), gains[_RATIO], stiffness, gains[_INERTIA]
    )
    memory[RELEASED] = guard.release_state(
        memory[RELEASED], seen[TORQUE], rushing, seen[DESIRED], gains[_SAFE]
    )
    if memory[RELEASED] == 0.0:
        return False
    memory[INTEGRAL_TORQUE], memory[MOTOR_DIRECTION] = 0.0, 0.0
    return True


@compiled
def guarded_torque(
    gains: FloatArray, stiffness: float, memory: FloatArray, seen: FloatArray
) -> float:
    """Return the motor torque of `proportional_integral`, guarded [N m].

    Args:
        gains: see `GAINS`.
        stiffness: of all cables at the joint; 0 is not known [N m/rad].
        memory: of the law.
        seen: what is measured.
    """
    if _releases_joint(gains, stiffness, memory, seen):
        return _limited(gains, -_damping_torque(gains, stiffness, seen))
    return proportional_integral(gains, memory, seen[DESIRED], seen[TORQUE])


@compiled
def damped_feedback(
    gains: FloatArray,
    stiffness: float,
    memory: FloatArray,
    seen: FloatArray,
    feedforward: float,
) -> float:
    """Return the motor torque of feedback with a damper, guarded [N m].

    Args:
        gains: see `GAINS`.
        stiffness: of all cables at the joint [N m/rad].
        memory: of the law.
        seen: what is measured.
        feedforward: motor torque that is fed forward [N m].
    """
    damping = _damping_torque(gains, stiffness, seen)
    if _releases_joint(gains, stiffness, memory, seen):
        return _limited(gains, -damping)
    error = seen[DESIRED] - seen[TORQUE]
    return closed_loop_torque(gains, memory, feedforward - damping, error)


@compiled
def model_based(
    gains: FloatArray,
    stiffness: float,
    prm: FloatArray,
    n: Counts,
    distal: FloatArray,
    arm: FloatArray,
    state: FloatArray,
    slip_direction: FloatArray,
    gain: FloatArray,
    disturbance: float,
    memory: FloatArray,
    seen: FloatArray,
    scratch: FloatArray,
) -> float:
    """Return the motor torque of `ModelBased` [N m], after its model was updated.

    Args:
        gains: see `GAINS`.
        stiffness: of all cables at the joint [N m/rad].
        prm: packed parameters (cables, numbers).
        n: segments of every cable.
        distal: arms at the joint [m/rad].
        arm: of every cable where the motor is (cables,) [m/rad].
        state: of the model (cables, numbers).
        slip_direction: see `CableModel` (cables,).
        gain: see `CableModel` (cables,).
        disturbance: motor torque to be added [N m].
        memory: of the law.
        seen: what is measured.
        scratch: (compensation.SCRATCH, cables).
    """
    if _releases_joint(gains, stiffness, memory, seen):
        return _limited(gains, -_damping_torque(gains, stiffness, seen))
    feedforward = compensation.dynamic(
        prm, n, arm, distal, state, slip_direction, gain, seen[JOINT_VELOCITY],
        seen[DESIRED], scratch,
    )  # fmt: skip
    feedforward = feedforward + disturbance - _damping_torque(gains, stiffness, seen)
    return closed_loop_torque(gains, memory, feedforward, seen[DESIRED] - seen[TORQUE])


@compiled
def stiction(
    gains: FloatArray,
    stiffness: float,
    prm: FloatArray,
    n: Counts,
    distal: FloatArray,
    arm: FloatArray,
    state: FloatArray,
    memory: FloatArray,
    seen: FloatArray,
    scratch: FloatArray,
) -> float:
    """Return the motor torque of `StictionCompensation` [N m]; see `model_based`.

    `state` is that of the model (cables, numbers).
    """
    if _releases_joint(gains, stiffness, memory, seen):
        return _limited(gains, -_damping_torque(gains, stiffness, seen))
    error = seen[DESIRED] - seen[TORQUE]
    motion = stiffness * gains[_PREVIEW] * seen[JOINT_VELOCITY]
    # Positive at the motor is what winds towards a positive ratio.
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
    feedforward -= _damping_torque(gains, stiffness, seen)
    # Where the sense has just turned, what is fed forward answers the error.
    return closed_loop_torque(gains, memory, feedforward, 0.0 if turned else error)
