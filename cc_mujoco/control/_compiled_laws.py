"""Laws of one control step of one device, compiled, without allocation.

law.memory[:] = 0.0                                # at the start of an episode
admit(law)
torque = proportional_integral(law)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.cable._parameter import Parameter, parameter, parameters_of
from cc_mujoco.control import _compensation as compensation
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import full_slip_balance
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

LAW_INPUTS = MEASURED_COLUMNS[: guard.READINGS]  # columns that the laws read
ANGLE, VELOCITY, JOINT_ANGLE, JOINT_VELOCITY, TORQUE, DESIRED = range(len(LAW_INPUTS))

INTEGRAL_TORQUE, MOTOR_DIRECTION, GUARD = range(3)
"""Columns of the memory: torque of the integral [N m]; direction in which the motor
shall turn; first of the numbers of the guard."""
RELEASED = GUARD + guard.STATE
"""Column of the state of the guard, 0 while the law drives."""
MEMORY_SIZE = GUARD + guard.MEMORY_SIZE  # size of the memory of a law


def gain(
    unit: str, low: float, high: float, default: float, meaning: str, **more: Any
) -> float:
    """Define a gain by its unit, bounds, default and meaning; see `parameter`."""
    return parameter(
        unit=unit, bounds=(low, high), default=default, meaning=meaning, **more
    )


@dataclass(frozen=True)
class DriveGains:
    """Parameters of motor and joint that every law begins with, as `DriveLimits`."""

    ratio: float = gain(
        "1", -1e6, 1e6, 1.0,
        "joint torque per motor torque without friction, signed, not 0",
    )  # fmt: skip
    low: float = gain("N m", -1e9, 1e9, -1.0, "least torque of the motor")
    high: float = gain(
        "N m", -1e9, 1e9, 1.0, "greatest torque of the motor, above `low`"
    )
    period: float = gain(
        "s", 0.0, 1e3, 1e-3, "time between two steps of the controller", low_open=True
    )
    one_way: float = gain(
        "1", 0.0, 1.0, 0.0,
        "1 where the cables only transmit positive motor torque, else 0",
    )  # fmt: skip
    inertia: float = gain(
        "kg m^2", 0.0, 1e6, 0.0, "of the motor with its pulley; 0 is not known"
    )
    safe_torque: float = gain(
        "N m", 0.0, guard.NO_TORQUE_LIMIT, guard.NO_TORQUE_LIMIT,
        "most that the cables may put into the joint", low_open=True,
    )  # fmt: skip
    safe_speed: float = gain(
        "rad/s", 0.0, guard.NO_SPEED_LIMIT, guard.NO_SPEED_LIMIT,
        "speed of the joint beyond which it is let go", low_open=True,
    )  # fmt: skip
    safe_power: float = gain(
        "W", 0.0, guard.NO_POWER_LIMIT, guard.NO_POWER_LIMIT,
        "power into the joint beyond which it is let go", low_open=True,
    )  # fmt: skip
    answer_time: float = gain(
        "s", 0.0, guard.MAX_ANSWER_TIME, 0.0,
        "time from a torque at the joint to the answer of the motor; 0 is none",
    )  # fmt: skip
    shared: float = gain(
        "1", 0.0, 1.0, 0.0, "1 where other motors turn the joint, too, else 0"
    )


@dataclass(frozen=True)
class FeedbackGains(DriveGains):
    """Parameters of a law with feedback."""

    feed_forward: float = gain(
        "1", 0.0, 1.0, 1.0, "1 where the desired torque is fed forward, else 0"
    )
    proportional: float = gain("1", 0.0, 1e6, 1.0, "K_p")
    integral: float = gain("1/s", 0.0, 1e6, 2.0, "K_i")
    settling: float = gain(
        "s", 0.0, 10.0, 0.03,
        "time in which the motor settles relative to the joint; 0 is undamped",
    )  # fmt: skip
    preview: float = gain(
        "s", 0.0, 10.0, 0.02, "time by which the motion of the joint is looked ahead"
    )
    tolerance: float = gain(
        "N m", 0.0, 1e6, 0.0, "torque at the joint below which the sense does not turn"
    )
    stiffness: float = gain(
        "N m/rad", 0.0, 1e12, 0.0,
        "of all cables at the joint, for the guard; 0 is not known",
    )  # fmt: skip
    rest_torque: float = gain(
        "N m", 0.0, 1e9, 0.0,
        "torque of the pretension of all cables at the joint, for the guard",
    )  # fmt: skip
    wrap_friction: float = gain(
        "1", 0.0, 100.0, 0.0,
        "friction coefficient times wrap of the cables, for the guard",
    )  # fmt: skip


LIMITS: tuple[Parameter, ...] = parameters_of(DriveGains)
GAINS: tuple[Parameter, ...] = parameters_of(FeedbackGains)
"""Gains of a law without and with feedback, in order."""

_RATIO, PERIOD = guard.RATIO, guard.PERIOD
_FEED_FORWARD, _PROPORTIONAL, _INTEGRAL, _SETTLING, _PREVIEW, _TOLERANCE, STIFFNESS = (
    range(guard.LIMITS, len(GAINS) - guard.SPRING_SIZE + 1)
)
"""Their places behind `DriveLimits`; the spring of the cables is last."""


class Law(NamedTuple):
    """Numbers of a law with feedback, of one device."""

    gains: FloatArray  # in the order of `GAINS`, or of another law's own
    spring: FloatArray  # all cables at the joint, see `guard.STIFFNESS`
    memory: FloatArray  # state from one step to the next, 0 at the start
    seen: FloatArray  # measurements as `LAW_INPUTS`, which a law may change


@internal
def _watched(law: Law) -> guard.Guarded:
    return guard.Guarded(law.gains, law.spring, law.memory[GUARD:])


@compiled
def admit(law: Law) -> None:
    """Check measurements, and replace them where needed; see `guard.admit`."""
    guard.admit(_watched(law), law.seen)


@internal
def _damping(law: Law) -> float:
    ratio = law.gains[_RATIO]
    damping = law.gains[_SETTLING] * law.spring[guard.STIFFNESS] / (ratio * ratio)
    return float(damping)


@internal
def _relative_velocity(law: Law) -> float:
    return float(law.seen[VELOCITY] - law.gains[_RATIO] * law.seen[JOINT_VELOCITY])


@internal
def _guarded(law: Law, feedforward: float, error: float) -> float:
    """Return the motor torque of feedback around a feed-forward, guarded [N m].

    The integral in the memory is updated. `error` is the desired less the measured
    joint torque [N m]. While the guard does not let the law drive, it restarts.
    """
    gains, spring, memory, seen = law
    own, ratio, ahead = _watched(law), gains[_RATIO], _relative_velocity(law)
    if guard.state(own, ahead, seen[DESIRED]) != guard.FREE:
        memory[INTEGRAL_TORQUE], memory[MOTOR_DIRECTION] = 0.0, 0.0
        torque = guard.let_go_torque(own, _damping(law), ahead)
        return guard.bounded(own, guard.limited(gains, torque))
    following = (
        memory[INTEGRAL_TORQUE] + gains[_INTEGRAL] * gains[PERIOD] * error / ratio
    )
    if guard.limits_of(gains).one_way != 0.0:
        following = max(following, -max(feedforward, 0.0))
    torque = feedforward + gains[_PROPORTIONAL] * error / ratio + following
    limited = guard.limited(gains, torque)
    most = guard.command_limit(guard.limits_of(gains), spring)
    if abs(limited) > most:
        limited = math.copysign(most, limited)
    # At a limit, with an error that would push beyond.
    if not (torque - limited) * (error / ratio) > 0.0:
        memory[INTEGRAL_TORQUE] = following
    return guard.bounded(own, limited)


@compiled
def proportional_integral(law: Law) -> float:
    """Return the motor torque of `ProportionalIntegral`, after `admit` [N m]."""
    feedforward = 0.0
    if law.gains[_FEED_FORWARD] != 0.0:
        feedforward = law.seen[DESIRED] / law.gains[_RATIO]
    return _guarded(law, feedforward, law.seen[DESIRED] - law.seen[TORQUE])


@internal
def damped_feedback(law: Law, feedforward: float, error: float) -> float:
    """Return the torque of `_guarded`, with a damper added to the feed-forward."""
    feedforward -= _damping(law) * _relative_velocity(law)
    return _guarded(law, feedforward, error)


@internal
def model_based(law: Law, model: compensation.Model, disturbance: float) -> float:
    """Return the motor torque of `ModelBased` [N m], after its model was updated.

    `disturbance` is the motor torque to be added [N m].
    """
    velocity, desired = law.seen[JOINT_VELOCITY], law.seen[DESIRED]
    feedforward = compensation.dynamic(model, velocity, desired) + disturbance
    return damped_feedback(law, feedforward, desired - law.seen[TORQUE])


@internal
def stiction(law: Law, model: compensation.Model) -> float:
    """Return the motor torque of `StictionCompensation` [N m]; see `model_based`."""
    gains, memory, seen = law.gains, law.memory, law.seen
    error = seen[DESIRED] - seen[TORQUE]
    motion = law.spring[guard.STIFFNESS] * gains[_PREVIEW] * seen[JOINT_VELOCITY]
    # Positive at the motor is winding towards a positive ratio.
    wanted = math.copysign(1.0, gains[_RATIO]) * (error + motion)
    sense = memory[MOTOR_DIRECTION]
    turns = wanted * (np.sign(wanted) if sense == 0.0 else -sense)
    turned = turns > gains[_TOLERANCE]
    if turned:
        memory[MOTOR_DIRECTION] = np.sign(wanted)
    feedforward = compensation.full_slip_torque(
        model, memory[MOTOR_DIRECTION], seen[JOINT_VELOCITY], seen[DESIRED]
    )
    # Where the direction has just changed, the feed-forward corrects the error.
    return damped_feedback(law, feedforward, 0.0 if turned else error)


(
    _KNOWN_SIGNALS, _LAST_DESIRED, _DESIRED_RATE, _LAST_TORQUE, _LAST_CHANGE,
    _NOISE_POWER, SIGNAL_SIZE,
) = range(7)  # fmt: skip
"""Places in the memory of the signals of `TunedFeedback`, and its size: desired torque
and its filtered rate; measured torque, its change in the last step, and the power of
its noise."""


@internal
def _noise(period: float, signals: FloatArray, torque: float) -> float:
    """Return the standard deviation of the noise of the torque sensor [N m].

    It is that of second differences: no motion bends a torque within three samples.
    """
    change = torque - signals[_LAST_TORQUE]
    power = (change - signals[_LAST_CHANGE]) ** 2 / 6.0
    signals[_LAST_TORQUE], signals[_LAST_CHANGE] = torque, change
    share = min(period / 0.5, 1.0)  # it is measured over half a second
    signals[_NOISE_POWER] += share * (power - signals[_NOISE_POWER])
    return float(np.sqrt(signals[_NOISE_POWER]))


@internal
def tuned_torque(
    law: Law, cables: FloatMatrix, settings: FloatArray, signals: FloatArray
) -> float:
    """Return the motor torque of `TunedFeedback` [N m], after `admit`.

    For the cables see `cable_table`. Settings are the share of friction that is fed
    forward, the speed of slip [rad/s], the dead zone in deviations, and the deviation
    of the torque sensor [N m]; `signals` (`SIGNAL_SIZE`,) are 0 at the start. The
    measured torque is changed.
    """
    seen, desired = law.seen, law.seen[DESIRED]
    ahead = guard.limited(law.gains, desired / law.gains[_RATIO])
    if signals[_KNOWN_SIGNALS] == 0.0:
        signals[_KNOWN_SIGNALS], signals[_LAST_DESIRED] = 1.0, desired
        signals[_LAST_TORQUE] = seen[TORQUE]
    if settings[0] > 0.0:
        rate = (desired - signals[_LAST_DESIRED]) / law.gains[PERIOD]
        signals[_LAST_DESIRED] = desired
        signals[_DESIRED_RATE] += 0.2 * (rate - signals[_DESIRED_RATE])  # low-passed
        stretching = signals[_DESIRED_RATE] / law.spring[guard.STIFFNESS]
        # The smooth sense in which the motor has to turn.
        sense = np.tanh((seen[JOINT_VELOCITY] + stretching) / settings[1])
        ahead = full_slip_balance(cables, settings[0] * sense, desired)[0]
    off = seen[TORQUE] - desired
    noise = _noise(law.gains[PERIOD], signals, seen[TORQUE])
    width = settings[2] * max(noise, settings[3]) - 0.5 * abs(desired)
    if width > 0.0:
        off = np.sign(off) * max(abs(off) - width, 0.0)
        seen[TORQUE] = desired + off
    return damped_feedback(law, ahead, seen[DESIRED] - seen[TORQUE])


BAND_SIGMAS = 0.34  # motion that is none, in standard deviations of the torque sensor


class InverseGains(NamedTuple):
    """Gains of `BacklashInverse` behind `DriveLimits`."""

    late: float  # time from a torque at the joint to the answer of the motor [s]
    position: float  # [N m/rad]
    damping: float  # [N m s/rad]
    integral: float  # [1/s]
    stiffness: float  # stiffness of all cables at the joint [N m/rad]
    band: float  # motion of the joint that is none [rad]
    release: float  # damping of a motor that is let go [N m s/rad]


(
    _LATE, _POSITION, _INVERSE_DAMPING, _INVERSE_INTEGRAL, _INVERSE_STIFFNESS, _BAND,
    _INVERSE_RELEASE, INVERSE_GAINS,
) = range(guard.LIMITS, guard.LIMITS + len(InverseGains._fields) + 1)  # fmt: skip
_INVERSE_STARTED, _MOTOR_0, _JOINT_0, _SENSE, _EXTREME, _ANGLE_OFFSET, INVERSE_GUARD = (
    range(7)
)
INVERSE_SIZE = INVERSE_GUARD + guard.MEMORY_SIZE  # size of the memory of the law


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
def inverse_torque(law: Law, cables: FloatMatrix) -> float:
    """Return the motor torque of `BacklashInverse` [N m]; see `cable_table`."""
    gains, spring, memory, seen = law
    limits = guard.limits_of(gains)
    own = guard.Guarded(gains, spring, memory[INVERSE_GUARD:])
    ratio, stiffness = limits.ratio, gains[_INVERSE_STIFFNESS]
    guard.admit(own, seen)
    if memory[_INVERSE_STARTED] == 0.0:
        memory[_INVERSE_STARTED], memory[_MOTOR_0] = 1.0, seen[ANGLE]
        memory[_JOINT_0] = seen[JOINT_ANGLE]
        memory[_EXTREME] = seen[DESIRED] / stiffness
    ahead = seen[VELOCITY] - ratio * seen[JOINT_VELOCITY]
    if guard.state(own, ahead, seen[DESIRED]) != guard.FREE:
        memory[_ANGLE_OFFSET] = 0.0
        torque = guard.let_go_torque(own, gains[_INVERSE_RELEASE], ahead)
        return guard.bounded(own, guard.limited(gains, torque))
    joint = seen[JOINT_ANGLE] - memory[_JOINT_0] + gains[_LATE] * seen[JOINT_VELOCITY]
    motor = seen[ANGLE] - memory[_MOTOR_0] + gains[_LATE] * seen[VELOCITY]
    sense = _turn(memory, joint + seen[DESIRED] / stiffness, gains[_BAND])
    balance, stretch = full_slip_balance(cables, sense, seen[DESIRED])
    relative = ratio * (stretch + memory[_ANGLE_OFFSET])
    error = (seen[DESIRED] - seen[TORQUE]) / stiffness
    torque = balance + gains[_POSITION] * (relative + ratio * joint - motor)
    torque += gains[_INVERSE_DAMPING] * (ratio * seen[JOINT_VELOCITY] - seen[VELOCITY])
    limited = guard.bounded(own, guard.limited(gains, torque))
    if not (torque - limited) * error * ratio > 0.0:
        memory[_ANGLE_OFFSET] += gains[_INVERSE_INTEGRAL] * limits.period * error
    if limits.one_way != 0.0:
        # A torque that no paying out ends would pay out without an end: the integral
        # pays out no more than the stretch.
        least = -abs(stretch) - BAND_SIGMAS * gains[_BAND]
        memory[_ANGLE_OFFSET] = max(memory[_ANGLE_OFFSET], least)
    return float(limited)


STATES = 4
STRETCH, SPEED, LOAD, LACK = range(STATES)
"""Motor angle less ratio times joint angle; its rate; torque on the motor and torque at
the joint that the linear model lacks."""


class GaussianGains(NamedTuple):
    """Gains of `LinearQuadraticGaussian` behind `DriveLimits`."""

    rigidity: float  # stiffness of all cables at the joint [N m/rad]
    release: float  # damping of a motor that is let go [N m s/rad]
    slip: float  # change of the stretch's innovation where an encoder slipped [rad]


_RIGIDITY, _GAUSSIAN_RELEASE, _SLIP, GAUSSIAN_GAINS = range(
    guard.LIMITS, guard.LIMITS + len(GaussianGains._fields) + 1
)
_GAUSSIAN_STARTED, _STRETCH_OFFSET, _INNOVATION, GAUSSIAN_GUARD = range(4)
HEADER = GAUSSIAN_GUARD + guard.MEMORY_SIZE
"""Numbers of the memory before the state and the torques on their way."""


class Design(NamedTuple):
    """Model and gains of observer and regulator."""

    model: FloatMatrix  # state after a step, from state and torque (4, 5)
    read: FloatMatrix  # stretch and torque of the joint, from the state (2, 4)
    kalman: FloatMatrix  # gains of the observer (4, 2)
    regulator: FloatArray  # gains of stretch and its rate (2,)


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
def gaussian_torque(law: Law, design: Design, scratch: FloatMatrix) -> float:
    """Return the motor torque of `LinearQuadraticGaussian` [N m].

    The memory has `HEADER` numbers, `STATES` and the torques on their way; the scratch
    is (2, `STATES`).
    """
    gains, spring, memory, seen = law
    limits = guard.limits_of(gains)
    own = guard.Guarded(gains, spring, memory[GAUSSIAN_GUARD:HEADER])
    model, read, kalman, regulator = design
    ratio, ahead, new = limits.ratio, scratch[0], scratch[1]
    guard.admit(own, seen)
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
    wanted = (seen[DESIRED] - ahead[LACK]) * ratio / gains[_RIGIDITY]
    if limits.one_way != 0.0:
        # A single cable cannot push, and what hangs need not hang further.
        least = -abs(seen[DESIRED]) * abs(ratio) / gains[_RIGIDITY]
        wanted = max(wanted, least)
    hold = gains[_RIGIDITY] / ratio**2 * wanted - ahead[LOAD]
    off = regulator[0] * (ahead[STRETCH] - wanted) + regulator[1] * ahead[SPEED]
    torque = guard.passed(own, gains[_GAUSSIAN_RELEASE], hold - off)
    for i in range(applied.size - 1):
        applied[i] = applied[i + 1]
    applied[applied.size - 1] = torque
    return float(torque)
