"""Laws of one control step of one device, compiled, without allocation.

    memory[:] = 0.0                                    # at the start of an episode
    admit(gains, spring, memory, seen)
    torque = guarded_torque(gains, spring, memory, seen)

`gains` are numbers in the order of `GAINS`, `seen` are measurements in the order
of `LAW_INPUTS`, and `memory` is the state of a law from one step to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cc_mujoco.cable._parameter import Parameter, parameter, parameters_of
from cc_mujoco.cable._stepper import Counts
from cc_mujoco.control import _compensation as compensation
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import full_slip_balance
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
    answer_time: float = parameter(
        unit="s",
        bounds=(0.0, guard.MAX_ANSWER_TIME),
        default=0.0,
        meaning="time from a torque at the joint to the answer of the motor; 0 is none",
    )
    shared: float = parameter(
        unit="1",
        bounds=(0.0, 1.0),
        default=0.0,
        meaning="1 where other motors turn the joint, too, else 0",
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
    limits = guard.limits_of(gains)
    torque = guard.let_go_torque(limits, spring, own, damping, ahead)
    return guard.bounded(limits, spring, own, guard.limited(gains, torque))


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


_RATE_FILTER = 0.2
"""Share of a new value in the filtered rate of the desired torque."""
_NOISE_TIME = 0.5
"""Time over which the noise of the torque sensor is measured [s]."""
(
    _KNOWN_SIGNALS, _LAST_DESIRED, _DESIRED_RATE, _LAST_TORQUE, _LAST_CHANGE,
    _NOISE_POWER, SIGNAL_SIZE,
) = range(7)  # fmt: skip
"""Places in the memory of the signals of `TunedFeedback`, and its size: desired torque
and its filtered rate; measured torque, its change in the last step, and the power of
its noise."""


@compiled
def _sense_of_slip(
    gains: FloatArray,
    memory: FloatArray,
    seen: FloatArray,
    stiffness: float,
    slip_speed: float,
) -> float:
    """Return the smooth sense in which the motor has to turn, -1 to 1."""
    desired = seen[DESIRED]
    rate = (desired - memory[_LAST_DESIRED]) / gains[PERIOD]
    memory[_LAST_DESIRED] = desired
    memory[_DESIRED_RATE] += _RATE_FILTER * (rate - memory[_DESIRED_RATE])
    speed = seen[JOINT_VELOCITY] + memory[_DESIRED_RATE] / stiffness
    return float(np.tanh(speed / slip_speed))


@compiled
def _noise(gains: FloatArray, memory: FloatArray, torque: float) -> float:
    """Return the standard deviation of the noise of the torque sensor [N m].

    It is that of second differences: no motion bends a torque within three samples.
    """
    change = torque - memory[_LAST_TORQUE]
    power = (change - memory[_LAST_CHANGE]) ** 2 / 6.0
    memory[_LAST_TORQUE], memory[_LAST_CHANGE] = torque, change
    share = min(gains[PERIOD] / _NOISE_TIME, 1.0)
    memory[_NOISE_POWER] += share * (power - memory[_NOISE_POWER])
    return float(np.sqrt(memory[_NOISE_POWER]))


@internal
def tuned_torque(
    gains: FloatArray,
    spring: FloatArray,
    cables: FloatMatrix,
    settings: FloatArray,
    memory: FloatArray,
    signals: FloatArray,
    seen: FloatArray,
) -> float:
    """Return the motor torque of `TunedFeedback` [N m].

    Args:
        gains: see `GAINS`.
        spring: see `guard.STIFFNESS`.
        cables: see `cable_table`.
        settings: share of friction that is fed forward, speed of slip [rad/s], dead
            zone in deviations, deviation of the torque sensor [N m].
        memory: of the law.
        signals: (`SIGNAL_SIZE`,), 0 at the start.
        seen: what is measured, after `admit`; changed.
    """
    desired = seen[DESIRED]
    ahead = feed_forward(gains, desired)
    if signals[_KNOWN_SIGNALS] == 0.0:
        signals[_KNOWN_SIGNALS], signals[_LAST_DESIRED] = 1.0, desired
        signals[_LAST_TORQUE] = seen[TORQUE]
    friction_share, slip_speed = settings[0], settings[1]
    if friction_share > 0.0:
        stiffness = spring[guard.STIFFNESS]
        sense = friction_share * _sense_of_slip(
            gains, signals, seen, stiffness, slip_speed
        )
        ahead = full_slip_balance(cables, sense, desired)[0]
    off = seen[TORQUE] - desired
    noise = _noise(gains, signals, seen[TORQUE])
    width = settings[2] * max(noise, settings[3]) - 0.5 * abs(desired)
    if width > 0.0:
        off = np.sign(off) * max(abs(off) - width, 0.0)
        seen[TORQUE] = desired + off
    return damped_feedback(gains, spring, memory, seen, ahead)


BAND_SIGMAS = 0.34
"""Motion that is none, in standard deviations of the torque sensor."""
_SLACK_SHARE = 1.0
"""Most that the integral pays out of a single cable, over its stretch."""


class InverseGains(NamedTuple):
    """Gains of `BacklashInverse` behind `DriveLimits`."""

    late: float
    """Time from a torque at the joint to the answer of the motor [s]."""
    position: float
    """[N m/rad]."""
    damping: float
    """[N m s/rad]."""
    integral: float
    """[1/s]."""
    stiffness: float
    """Stiffness of all cables at the joint [N m/rad]."""
    band: float
    """Motion of the joint that is none [rad]."""
    release: float
    """Damping of a motor that is let go [N m s/rad]."""


(
    _LATE, _POSITION, _INVERSE_DAMPING, _INVERSE_INTEGRAL, _INVERSE_STIFFNESS, _BAND,
    _INVERSE_RELEASE, INVERSE_GAINS,
) = range(guard.LIMITS, guard.LIMITS + len(InverseGains._fields) + 1)  # fmt: skip
_INVERSE_STARTED, _MOTOR_0, _JOINT_0, _SENSE, _EXTREME, _ANGLE_OFFSET, INVERSE_GUARD = (
    range(7)
)
INVERSE_SIZE = INVERSE_GUARD + guard.MEMORY_SIZE
"""Size of the memory of the law."""


@compiled
def _turn(memory: FloatArray, wanted: float, band: float) -> float:
    """Return the sense in which an angle moves, which noise does not turn."""
    sense = memory[_SENSE]
    if sense == 0.0:
        if abs(wanted - memory[_EXTREME]) > band:
            memory[_SENSE] = np.sign(wanted - memory[_EXTREME])
            memory[_EXTREME] = wanted
    elif sense * (wanted - memory[_EXTREME]) > 0.0:
        memory[_EXTREME] = wanted
    elif sense * (wanted - memory[_EXTREME]) < -band:
        memory[_SENSE], memory[_EXTREME] = -sense, wanted
    return float(memory[_SENSE])


@internal
def inverse_torque(
    gains: FloatArray,
    spring: FloatArray,
    cables: FloatMatrix,
    memory: FloatArray,
    seen: FloatArray,
) -> float:
    """Return the torque of the motor of one device [N m].

    Args:
        gains: see `InverseGains`.
        spring: see `guard.STIFFNESS`.
        cables: see `cable_table`.
        memory: (`INVERSE_SIZE`,), 0 at the start.
        seen: in the order of `LAW_INPUTS`; changed.
    """
    limits, own = guard.limits_of(gains), memory[INVERSE_GUARD:]
    ratio, stiffness = limits.ratio, gains[_INVERSE_STIFFNESS]
    guard.admit(limits, spring, own, seen)
    if memory[_INVERSE_STARTED] == 0.0:
        memory[_INVERSE_STARTED], memory[_MOTOR_0] = 1.0, seen[ANGLE]
        memory[_JOINT_0] = seen[JOINT_ANGLE]
        memory[_EXTREME] = seen[DESIRED] / stiffness
    ahead = seen[VELOCITY] - ratio * seen[JOINT_VELOCITY]
    if guard.state(limits, spring, own, ahead, seen[DESIRED]) != guard.FREE:
        memory[_ANGLE_OFFSET] = 0.0
        torque = guard.let_go_torque(
            limits, spring, own, gains[_INVERSE_RELEASE], ahead
        )
        return guard.bounded(limits, spring, own, guard.limited(gains, torque))
    joint = seen[JOINT_ANGLE] - memory[_JOINT_0] + gains[_LATE] * seen[JOINT_VELOCITY]
    motor = seen[ANGLE] - memory[_MOTOR_0] + gains[_LATE] * seen[VELOCITY]
    sense = _turn(memory, joint + seen[DESIRED] / stiffness, gains[_BAND])
    balance, stretch = full_slip_balance(cables, sense, seen[DESIRED])
    relative = ratio * (stretch + memory[_ANGLE_OFFSET])
    error = (seen[DESIRED] - seen[TORQUE]) / stiffness
    torque = balance + gains[_POSITION] * (relative + ratio * joint - motor)
    torque += gains[_INVERSE_DAMPING] * (ratio * seen[JOINT_VELOCITY] - seen[VELOCITY])
    limited = guard.bounded(limits, spring, own, guard.limited(gains, torque))
    if not (torque - limited) * error * ratio > 0.0:
        memory[_ANGLE_OFFSET] += gains[_INVERSE_INTEGRAL] * limits.period * error
    if limits.one_way != 0.0:
        # A torque that no paying out ends would pay out without an end.
        least = -_SLACK_SHARE * abs(stretch) - BAND_SIGMAS * gains[_BAND]
        memory[_ANGLE_OFFSET] = max(memory[_ANGLE_OFFSET], least)
    return float(limited)


STATES = 4
STRETCH, SPEED, LOAD, LACK = range(STATES)
"""Motor angle less ratio times joint angle; its rate; torque on the motor and torque at
the joint that the linear model lacks."""


class GaussianGains(NamedTuple):
    """Gains of `LinearQuadraticGaussian` behind `DriveLimits`."""

    rigidity: float
    """Stiffness of all cables at the joint [N m/rad]."""
    release: float
    """Damping of a motor that is let go [N m s/rad]."""
    slip: float
    """Change of the innovation of the stretch from which an encoder has slipped [rad].
    """


_RIGIDITY, _GAUSSIAN_RELEASE, _SLIP, GAUSSIAN_GAINS = range(
    guard.LIMITS, guard.LIMITS + len(GaussianGains._fields) + 1
)
_GAUSSIAN_STARTED, _STRETCH_OFFSET, _INNOVATION, GAUSSIAN_GUARD = range(4)
HEADER = GAUSSIAN_GUARD + guard.MEMORY_SIZE
"""Numbers of the memory before the state and the torques on their way."""


class Design(NamedTuple):
    """Model and gains of observer and regulator.

    Attributes:
        model: state after a step, from state and torque (4, 5).
        read: stretch and torque of the joint, from the state (2, 4).
        kalman: gains of the observer (4, 2).
        regulator: of stretch and its rate (2,).
    """

    model: FloatMatrix
    read: FloatMatrix
    kalman: FloatMatrix
    regulator: FloatArray


@compiled
def _advance(
    model: FloatMatrix, state: FloatArray, torque: float, new: FloatArray
) -> None:
    """Advance the state by a step with a torque of the motor."""
    for i in range(STATES):
        new[i] = model[i, STATES] * torque
        for j in range(STATES):
            new[i] += model[i, j] * state[j]
    for i in range(STATES):
        state[i] = new[i]


@internal
def gaussian_torque(
    gains: FloatArray,
    spring: FloatArray,
    design: Design,
    memory: FloatArray,
    seen: FloatArray,
    scratch: FloatMatrix,
) -> float:
    """Return the torque of the motor of one device [N m].

    Args:
        gains: see `GaussianGains`.
        spring: see `guard.STIFFNESS`.
        design: of the law.
        memory: `HEADER`, `STATES` and the torques on their way; 0 at the start.
        seen: in the order of `LAW_INPUTS`; changed.
        scratch: (2, `STATES`).
    """
    limits, own = guard.limits_of(gains), memory[GAUSSIAN_GUARD:HEADER]
    model, read, kalman = design.model, design.read, design.kalman
    ratio, ahead, new = limits.ratio, scratch[0], scratch[1]
    guard.admit(limits, spring, own, seen)
    state = memory[HEADER : HEADER + STATES]
    applied = memory[HEADER + STATES :]
    stretch = seen[ANGLE] - ratio * seen[JOINT_ANGLE]
    if memory[_GAUSSIAN_STARTED] == 0.0:
        memory[_GAUSSIAN_STARTED], memory[_STRETCH_OFFSET] = 1.0, stretch
    _advance(model, state, applied[0], new)
    off_0 = stretch - memory[_STRETCH_OFFSET] - state[STRETCH]
    if abs(off_0 - memory[_INNOVATION]) > gains[_SLIP]:
        # No motion does that in a step: the encoder has slipped, the cable has not.
        memory[_STRETCH_OFFSET] += off_0 - memory[_INNOVATION]
        off_0 = memory[_INNOVATION]
    memory[_INNOVATION] = off_0
    off_1 = seen[TORQUE]
    for j in range(STATES):
        off_1 -= read[1, j] * state[j]
    for i in range(STATES):
        state[i] += kalman[i, 0] * off_0 + kalman[i, 1] * off_1
        ahead[i] = state[i]
    for i in range(1, applied.size):
        _advance(model, ahead, applied[i], new)
    torque = _regulated(gains, design.regulator, ahead, seen[DESIRED])
    torque = guard.passed(gains, spring, own, gains[_GAUSSIAN_RELEASE], torque)
    for i in range(applied.size - 1):
        applied[i] = applied[i + 1]
    applied[applied.size - 1] = torque
    return float(torque)


@compiled
def _regulated(
    gains: FloatArray, regulator: FloatArray, state: FloatArray, desired: float
) -> float:
    """Return the torque of the regulator [N m]."""
    ratio = gains[guard.RATIO]
    wanted = (desired - state[LACK]) * ratio / gains[_RIGIDITY]
    if guard.limits_of(gains).one_way != 0.0:
        # A single cable cannot push, and what hangs need not hang further.
        least = -abs(desired) * abs(ratio) / gains[_RIGIDITY]
        wanted = max(wanted, least)
    hold = gains[_RIGIDITY] / ratio**2 * wanted - state[LOAD]
    off = regulator[0] * (state[STRETCH] - wanted) + regulator[1] * state[SPEED]
    return float(hold - off)
