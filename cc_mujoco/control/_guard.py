"""Guard of controllers with feedback, compiled: it checks sensors and releases a joint.

    own = guard.Guarded(gains, spring, memory)
    guard.admit(own, seen)  # readings, in place
    if guard.state(own, ahead, planned) != guard.FREE:
        torque = guard.let_go_torque(own, damping, ahead)
    torque = guard.bounded(own, torque)

A model may be wrong, a sensor may fail, an integral may wind up. Then the compensation
of friction drives the joint instead. Two quantities show it: the torque sensor, and the
*stretch torque*, computed from the stretch of the cables between both encoders. The
joint is released (the motor only follows it) by whichever is larger, so no single
sensor that fails is trusted.

The stretch torque is that of springs whose tension at the joint lies between the values
of a cable that slips as a whole to either side (`full_slip_balance`). It follows the
joint between these edges, as a play operator does. Ends that harden and lose work are
followed by their own law, `cable._elasticity`: a gain learned from a linear spring at a
small torque would be wrong at a large one. A bounded gain, learned from the
torque sensor, corrects a wrong stiffness. If the gain falls far below its earlier
value, it is the sensor that shows too little.

A cable may stretch otherwise than in the model. So the stretch torque contradicts a
sensor only if it has explained the torque before, or if a third quantity agrees with
it: the motor torque less that of its inertia, which reaches the joint except for the
friction of the cables. These are compared low-passed. A stretch that is not known to
explain the torque releases the joint only as far as the motor could have made that
torque. If torque is unsafe again and again, the guard stops the motor in any case.

If other motors turn the joint too, its sensor does not measure the torque of these
cables alone, so it contradicts neither stretch nor motor.

A motor that winds up slack is detected too late: when the cable gets taut, the
stiffness k of the cables at the joint stops the rotor within milliseconds, with a
torque of v sqrt(k J) beyond the measured one, at a speed v relative to the joint and an
inertia J of the rotor. So a joint is also released if that would be unsafe.
"""

from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.cable import _elasticity as elastic
from cc_mujoco.native import FloatArray, compiled, internal

NO_TORQUE_LIMIT, NO_SPEED_LIMIT, NO_POWER_LIMIT = 1e9, 1e9, 1e12
"""Safe torque [N m], speed [rad/s] and power [W] of a joint without known ones."""
MAX_ANSWER_TIME, RIDE_TIME = 1.0, 0.005
"""Longest delay from a reading to the motor's reaction that is modelled; time for which
the last good reading replaces missing ones [s].
"""
MAX_READING = 1e6
"""Largest plausible reading [rad, rad/s, N m, N]: a larger one would be learned and
never forgotten."""
RELEASE_TIME, MAX_DAMPING_SHARE = 0.03, 0.8
"""Time in which a released motor takes the speed of the joint [s]; its greatest damping
over the one at the edge of stability with its delay.
"""


_HALVINGS = 60  # halvings that locate a stretch to rounding


class _Thresholds(NamedTuple):
    """Limits of normal operation; a `share` of a torque is of the safe torque."""

    # Way from the planned to the safe torque beyond which a joint is released, and down
    # to which it stays so
    release_share: float = 0.5
    recovery_share: float = 0.25
    swing_share: float = 0.7  # such a way up to which a motor may swing on its cables
    predicted_factor: float = 2.0  # on such ways, for a torque that includes an impact
    command_margin: float = 1.25  # largest command over that of the safe torque
    jump_share: float = 0.25  # torque that the step of a spike stands for
    # periods of motion by which an angle may be ahead after lost readings
    jump_periods: float = 10.0
    still_samples: float = 5  # equal motor angles, then the torque tells its speed
    rate_filter: float = 0.2  # weight of a new rate of the measured torque
    quiet_samples: float = 10  # without new velocities after a spike of an encoder
    frozen_samples: float = 20  # equal readings from which a sensor may be frozen
    # relative change up to which torques are equal: they are divided by a lever's arm
    equal_share: float = 2e-3
    stretch_factor: float = 3.0  # stiffness over the believed one, or its inverse
    # Time [s] and periods for which a motor may stand still in all at a command above
    # `push_share` plus the measured torque against this multiple of believed friction;
    # a larger command counts up to `push_rate` times.
    push_time: float = 0.02
    push_periods: float = 6.0
    push_share: float = 0.3
    push_friction: float = 3.0
    push_rate: float = 2.0
    # Gap between sensor and stretch torque that is a fault after `gap_time` [s]: a
    # share, or less where the motor agrees with the stretch, plus a factor of the
    # larger torque, plus standard deviations of the usual gap. If the motor's torque is
    # far beyond the sensor's, the time counts up to `gap_rate` times.
    gap_share: float = 0.25
    denied_share: float = 0.15
    gap_factor: float = 0.4
    gap_sigmas: float = 3.0
    gap_time: float = 0.05
    gap_rate: float = 5.0
    # time beyond the safe torque after which the motor stops, as an unstable controller
    # causes, and time over which that is forgotten [s]
    unsafe_time: float = 0.02
    unsafe_memory: float = 1.0
    # power of the stretch torque over that from which a gain is learned, that proves a
    # gain; share of the largest proven one below which a gain has fallen
    proof: float = 5.0
    fallen_share: float = 0.85
    # times over which the motor's torque is filtered and its peak forgotten [s], and
    # least difference to what the sensor and friction explain
    motor_time: float = 0.02
    hold_time: float = 0.1
    motor_share: float = 0.1
    # friction coefficient times wrap that a motor may meet: factor on the believed one,
    # and addition
    friction_factor: float = 2.0
    more_friction: float = 0.3
    mean_time: float = 0.5  # time over which means are taken [s]
    learn_time: float = 5.0  # time over which the gain of the stretch is learned [s]
    # change of a torque, and its time [s], from which the gain is learned
    known_share: float = 0.1
    known_time: float = 0.1
    least_gain: float = 0.7  # bounds of the gain
    most_gain: float = 2.0
    # mean square of the difference between sensor and stretch torque over the sum of
    # theirs: largest one with which the stretch releases a joint, and stops the motor
    max_misfit: float = 0.2
    max_doubt: float = 0.1
    # time for which the motor has explained the sensor, from which it alone can stop
    # where the stretch explains nothing [s]
    agreed_time: float = 0.2
    # torque of sensor and command below which a single cable is slack after a time [s]
    slack_share: float = 0.1
    slack_time: float = 0.05


_SET = _Thresholds()

FREE, RELEASED, BRAKED, STOPPED, LIMP = 0.0, 1.0, 2.0, 3.0, 4.0
"""States: the law drives; the motor follows the joint; it brakes, as the joint is too
fast; it follows the joint until a reset, as torque is not measured; it has no torque
until a reset, as an angle is not measured.
"""

STIFFNESS, REST, FRICTION, TAUT, SOFT, HARDENING, LOSS, SPRING_SIZE = range(8)
"""All cables as a spring at the joint: stiffness [N m/rad], sum of their torques at
pretension [N m], largest friction coefficient times wrap. Then, 0 unless ends harden or
lose work: compliance without these ends, that of these ends at no torque [rad/(N m)],
their hardening [1/(N m)] and loss, as in `cable._elasticity`. The last is the size."""

MOTOR, MOTOR_SPEED, JOINT, JOINT_SPEED, TORQUE, DESIRED, READINGS = range(7)
"""Indices of readings, angles [rad], velocities [rad/s], torques [N m]; their count."""

(
    STATE, STARTED,
    _MISSING, _QUIET,  # samples: without all readings; until velocities are read
    COMMAND,  # last command [N m]
    _REFERENCE, _PREDICTED,  # stretch at rest [rad]; torque of the stretch [N m]
    _GAIN, _MISFIT,  # gain from sensor to stretch torque; misfit with that gain
    _MEAN, _MEAN_PREDICTED, _GAP,  # means of sensor and stretch; time of a gap [s]
    _RUSH,  # low-passed rate of the measured torque [N m/s]
    _SLACK, _PUSH,  # times [s]: no sign of a pull; motor pushed but at rest
    _GIVEN,  # low-passed motor torque at the joint without friction [N m]
    _POWER, _BOTH, _SENSED,  # sums of stretch^2, stretch sensor, sensor^2 about means
    _AGREED, _MOST,  # time the motor explained the sensor [s]; recent peak of `_GIVEN`
    _TAKEN, _TAKEN_PREDICTED,  # sensor and stretch torque, low-passed as `_GIVEN`
    _LEARNT, _UNSAFE,  # times [s]: stretch learned; torque unsafe lately
    _PROVEN,  # largest proven gain
    _HELD, _HELD_OTHER,  # `elastic.Piece.held` of each `_side` [N m]
    _GOOD,  # readings of the last step, as they were used
) = range(29)  # fmt: skip
(
    _JUMPED, _EQUAL,  # by reading: last one a spike; number of equal ones
    _AT, _AT_PREDICTED,  # by reading: sensor and stretch torque at its last change
    SEEN,  # scratch for readings
    MEMORY_SIZE,
) = range(_GOOD + READINGS, _GOOD + 7 * READINGS, READINGS)  # fmt: skip
"""Places in the memory of the guard, and its size."""


class DriveLimits(NamedTuple):
    """Ratio and period of a drive, and limits of its motor and joint."""

    ratio: float  # joint torque per motor torque without friction, signed [-]
    low: float  # least torque of the motor [N m]
    high: float  # greatest torque of the motor [N m]
    period: float  # time between two steps [s]
    one_way: float  # 1 where the cables only pull one way, else 0
    inertia: float  # of the motor [kg m^2]
    safe_torque: float  # most that the cables may put into the joint [N m]
    safe_speed: float  # speed of the joint above which the motor brakes [rad/s]
    safe_power: float  # power into the joint above which the motor brakes [W]
    answer_time: float  # time from a torque at the joint to the motor's reaction [s]
    shared: float  # 1 where the joint's sensor measures other motors' cables, too


class Guarded(NamedTuple):
    """Gains, spring and memory of the guard of one drive."""

    gains: FloatArray  # `DriveLimits` first
    spring: FloatArray  # all cables, see `STIFFNESS`, which is 0 if unknown
    memory: FloatArray  # (`MEMORY_SIZE`,), 0 at the start


RATIO, LOW, HIGH, PERIOD, LIMITS = 0, 1, 2, 3, len(DriveLimits._fields)
"""Places of the first of `DriveLimits`, and their number."""


@internal
def limits_of(gains: FloatArray) -> DriveLimits:
    """Return the first numbers of `gains` as `DriveLimits`."""
    return DriveLimits(
        gains[RATIO], gains[LOW], gains[HIGH], gains[PERIOD], gains[4], gains[5],
        gains[6], gains[7], gains[8], gains[9], gains[10],
    )  # fmt: skip


@compiled
def largest_torque(limits: DriveLimits) -> float:
    """Return the largest torque that motor and safe torque allow at the joint [N m]."""
    driven = abs(limits.ratio) * max(limits.high, -limits.low)
    return float(min(limits.safe_torque, driven, NO_TORQUE_LIMIT))


@internal
def limited(gains: FloatArray, torque: float) -> float:
    """Return a torque within the limits of the motor [N m]."""
    return float(min(max(torque, gains[LOW]), gains[HIGH]))


@internal
def _exceeds(torque: float, planned: float, safe: float, share: float) -> bool:
    """Return whether a torque is beyond a `share` of the way from planned to safe."""
    aim = min(max(planned * np.sign(torque), 0.0), safe)
    return bool(abs(torque) > aim + share * (safe - aim))


@compiled
def release_state(
    before: float, measured: float, rushing: float, planned: float, safe: float
) -> float:
    """Return 1.0 while the motor is to follow the joint, else 0.0.

    The result was `before` in the previous step. `measured` is the measured torque at
    the joint, `rushing` the `impact_torque` in addition, `planned` the desired torque
    and `safe` the largest safe one [N m].
    """
    share = _SET.release_share if before == 0.0 else _SET.recovery_share
    more = _SET.predicted_factor * share
    is_beyond = _exceeds(measured, planned, safe, share)
    is_beyond = is_beyond or _exceeds(measured + rushing, planned, safe, more)
    return 1.0 if is_beyond else 0.0


@compiled
def impact_torque(
    ahead: float, ratio: float, stiffness: float, inertia: float
) -> float:
    """Return the joint torque at which cables stop a motor that runs ahead [N m].

    `ahead` is the velocity of the motor relative to the joint [rad/s], `stiffness` that
    of all cables at the joint [N m/rad], `inertia` that of the motor [kg m^2].
    """
    return float(np.sign(ratio) * ahead * np.sqrt(stiffness * inertia))


@internal
def _side(spring: FloatArray, sides: float, held: float) -> elastic.Piece:
    """Return the cables that turn the joint one way as a piece: angle over torque.

    `sides` is the number of ways in which cables turn it, 1 or 2; `held` is that of the
    piece [N m].
    """
    return elastic.Piece(
        sides * spring[TAUT], 0.0, 1.0, 0.0, 1.0, sides * spring[SOFT],
        sides * spring[HARDENING], elastic.returned_share(spring[LOSS]), held,
    )  # fmt: skip


@internal
def _rest_stretch(spring: FloatArray, sides: float) -> float:
    """Return the stretch of the cables of a `_side` at pretension [rad]."""
    rest = spring[REST] / sides
    return float(elastic.stretch_of(_side(spring, sides, rest), rest))


@internal
def _pull(
    spring: FloatArray, sides: float, stretch: float, held: FloatArray, side: int
) -> float:
    """Return the torque of the cables of a `_side` without friction [N m].

    `stretch` is from that at pretension [rad]; `held` (2,) is that of
    each side's piece [N m], and its number `side` is updated.
    """
    if spring[SOFT] == 0.0:
        rest = spring[REST] / sides
        return float(max(rest + spring[STIFFNESS] / sides * stretch, 0.0))
    now = _side(spring, sides, held[side])
    whole = _rest_stretch(spring, sides) + stretch
    pull = max(elastic.tension_of(now, whole), 0.0)
    held[side] = elastic.held_tension(now, pull)
    return float(pull)


@compiled
def spring_edges(
    spring: FloatArray, one_way: bool, stretch: float, held: FloatArray
) -> tuple[float, float]:
    """Return the least and the greatest torque that cables with friction make [N m].

    With `one_way` the cables only pull, towards a positive torque. `stretch` is the
    motor angle over the ratio, less the joint angle and the value at rest [rad]. `held`
    (2,) is `elastic.Piece.held` of the cables either way [N m], and is updated.
    """
    friction = spring[FRICTION]
    # Joint tension over mean tension of a cable that slips towards the joint.
    low = float(friction / np.expm1(friction)) if friction > 1e-6 else 1.0
    high = low * np.exp(friction)
    one = _pull(spring, 1.0 if one_way else 2.0, stretch, held, 0)
    other = 0.0 if one_way else _pull(spring, 2.0, -stretch, held, 1)
    return low * one - high * other, high * one - low * other


@internal
def _stretch_at(
    spring: FloatArray, one_way: bool, torque: float, held: FloatArray
) -> float:
    """Return the stretch from rest [rad] at which cables make a torque [N m].

    The torque is >= 0 if `one_way`; see `spring_edges` for `held`, which is updated.
    """
    if spring[SOFT] == 0.0:
        more = torque - spring[REST] if one_way else torque
        return float(more / spring[STIFFNESS])
    if one_way:
        now = _side(spring, 1.0, held[0])
        held[0] = elastic.held_tension(now, torque)
        return float(elastic.stretch_of(now, torque) - _rest_stretch(spring, 1.0))
    high = 2.0 * (abs(torque) + spring[REST]) * (spring[TAUT] + spring[SOFT])
    low, first, last = -high, held[0], held[1]
    for _ in range(_HALVINGS):
        stretch = 0.5 * (low + high)
        held[0], held[1] = first, last
        one = _pull(spring, 2.0, stretch, held, 0)
        if one - _pull(spring, 2.0, -stretch, held, 1) < torque:
            low = stretch
        else:
            high = stretch
    return float(0.5 * (low + high))


@internal
def _predict(own: Guarded, moved: float) -> None:
    """Update the stretch torque after the joint has moved by `moved` [rad]."""
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    ratio, one_way = limits.ratio, limits.one_way != 0.0
    sign = np.sign(ratio) if one_way else 1.0
    stretch = memory[_GOOD + MOTOR] / ratio - memory[_GOOD + JOINT]
    held, moved_on = memory[_HELD : _HELD + 2], sign * (stretch - memory[_REFERENCE])
    low, high = spring_edges(spring, one_way, moved_on, held)
    slack = _SET.slack_share * limits.safe_torque
    known = max(abs(memory[_GOOD + TORQUE]), abs(memory[COMMAND] * ratio))
    if known > slack or memory[STATE] != FREE:
        memory[_SLACK] = 0.0
    memory[_SLACK] += limits.period
    is_soft = spring[SOFT] > 0.0
    most = max(spring[REST], slack) if is_soft else spring[REST]
    if one_way and memory[_SLACK] > _SET.slack_time and low > most:
        # Neither sensor nor command shows that tension: the motor has wound up slack.
        # Soft ends keep the stretch by the known torque, without which they would seem
        # to pull far less once they are hard.
        left = _stretch_at(spring, one_way, known, held) if is_soft else 0.0
        memory[_REFERENCE] = stretch - sign * left
        low, high = spring_edges(spring, one_way, left, held)
    now = sign * (memory[_PREDICTED] - 2.0 * spring[STIFFNESS] * moved)
    memory[_PREDICTED] = sign * min(max(now, low), high)


def is_heard(torque: Any) -> Any:
    """Return whether torques are plausible for a motor: at most `MAX_READING` [N m]."""
    return np.abs(torque) <= MAX_READING


@internal
def is_reading(value: float) -> bool:
    """Return whether a number is plausible as a reading: at most `MAX_READING`."""
    return bool(abs(value) <= MAX_READING)


@internal
def _start(own: Guarded, seen: FloatArray) -> bool:
    """Begin with the first complete readings; until then the motor has no torque.

    The rest position of the cables is that at which their stretch makes the measured
    torque. Return whether all readings are there.
    """
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    for i in range(READINGS):
        if not is_reading(seen[i]):
            memory[_MISSING] += 1.0
            is_short = memory[_MISSING] * limits.period <= RIDE_TIME
            memory[STATE] = BRAKED if is_short else LIMP
            seen[:] = 0.0
            return False
    memory[:SEEN] = 0.0
    for i in range(READINGS):
        memory[_GOOD + i] = seen[i]
        memory[_AT + i] = seen[TORQUE]
    memory[STARTED], memory[_GAIN] = 1.0, 1.0
    memory[_MISFIT] = -1.0  # not known yet
    memory[_PUSH] = -np.inf  # until the motor moves, as late readings begin equal
    memory[_REFERENCE] = seen[MOTOR] / limits.ratio - seen[JOINT]
    memory[_PREDICTED] = seen[TORQUE]
    if spring[STIFFNESS] > 0.0:
        held, one_way = memory[_HELD : _HELD + 2], limits.one_way != 0.0
        sign = np.sign(limits.ratio) if one_way else 1.0
        pull = max(sign * seen[TORQUE], 0.0) if one_way else seen[TORQUE]
        held[:] = spring[REST] if one_way else 0.5 * spring[REST]
        memory[_REFERENCE] -= sign * _stretch_at(spring, one_way, pull, held)
    for i in range(READINGS):
        memory[_AT_PREDICTED + i] = memory[_PREDICTED]
    memory[_MEAN], memory[_MEAN_PREDICTED] = seen[TORQUE], memory[_PREDICTED]
    return True


@internal
def stop(memory: FloatArray, state: float) -> None:
    """Set a state from which only a reset returns, unless it is worse already."""
    memory[STATE] = max(memory[STATE], state)


@internal
def _fill_missing(own: Guarded, seen: FloatArray) -> None:
    """Replace missing readings by the last good ones; stop after `RIDE_TIME`."""
    limits, memory = limits_of(own.gains), own.memory
    missing, angles = False, False
    for i in range(READINGS):
        if not is_reading(seen[i]):
            seen[i] = memory[_GOOD + i]
            missing = True
            angles |= i < TORQUE
    if not missing:
        memory[_MISSING] = 0.0
        return
    memory[_MISSING] += 1.0
    if memory[_MISSING] * limits.period > RIDE_TIME:
        stop(memory, LIMP if angles else STOPPED)


@internal
def _skip_spikes(own: Guarded, seen: FloatArray) -> None:
    """Replace a reading that jumps by its prediction; stop if an angle jumps again.

    A second jump of the torque is accepted. After a jump of an angle both speeds keep
    their last good values for `quiet_samples`.
    """
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    least = _SET.jump_share * limits.safe_torque
    turn = least / spring[STIFFNESS]
    for i in (MOTOR, JOINT, TORQUE):
        before, speed, most = memory[_GOOD + i], 0.0, 2.0 * least
        if i != TORQUE:
            speed = memory[_GOOD + i + 1] * limits.period
            most = turn * (abs(limits.ratio) if i == MOTOR else 1.0)
            most += _SET.jump_periods * abs(speed)
        if i == MOTOR and limits.inertia > 0.0:  # the command and the cables turn it
            pulled = 2.0 * command_limit(limits, spring)
            most += pulled / limits.inertia * limits.period**2
        if abs(seen[i] - before - speed) <= most:
            memory[_JUMPED + i] = 0.0
        elif memory[_JUMPED + i] == 0.0:
            memory[_JUMPED + i] = 1.0
            seen[i] = before + speed
            if i != TORQUE:
                memory[_QUIET] = _SET.quiet_samples
        elif i != TORQUE:
            stop(memory, LIMP)
    if memory[_QUIET] > 0.0:
        memory[_QUIET] -= 1.0
        seen[MOTOR_SPEED] = memory[_GOOD + MOTOR_SPEED]
        seen[JOINT_SPEED] = memory[_GOOD + JOINT_SPEED]


@internal
def _check_frozen(own: Guarded, seen: FloatArray) -> None:
    """Stop if a reading stays the same although the others show that it must change."""
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    torque, predicted = seen[TORQUE], memory[_GAIN] * memory[_PREDICTED]
    if limits.shared != 0.0:
        torque = predicted
    least = _SET.gap_share * limits.safe_torque
    for i in (MOTOR, JOINT, TORQUE):
        change, most = abs(seen[i] - memory[_GOOD + i]), 0.0
        if i == TORQUE:  # a slow torque changes by little from sample to sample
            change, most = abs(torque - memory[_AT + i]), _SET.equal_share * abs(torque)
        if change > most:
            memory[_EQUAL + i] = 0.0
            memory[_AT + i], memory[_AT_PREDICTED + i] = torque, predicted
            continue
        memory[_EQUAL + i] += 1.0
        if memory[_EQUAL + i] < _SET.frozen_samples:
            continue
        expected = predicted - memory[_AT_PREDICTED + i]
        change = torque - memory[_AT + i]
        if _explains(memory, _SET.max_doubt):
            is_far = abs(change - expected) > least + _SET.gap_factor * abs(expected)
        elif i == TORQUE:
            given = memory[_GIVEN]
            is_far = _beyond(own, given, torque, spring[FRICTION]) != 0.0
            # The torque of a slack cable stays the same, and so does its stretch.
            is_far &= abs(expected) > _SET.equal_share * limits.safe_torque
            is_far &= limits.shared == 0.0
        else:  # motor or joint stands still, if no other stiffness explains the torque
            low, high = expected / _SET.stretch_factor, expected * _SET.stretch_factor
            is_far = max(min(low, high) - change, change - max(low, high)) > least
        if is_far:
            stop(memory, STOPPED if i == TORQUE else LIMP)
    load = (abs(torque) + spring[REST]) * np.exp(_SET.push_friction * spring[FRICTION])
    load += _SET.push_share * limits.safe_torque
    pushed = abs(memory[COMMAND] * limits.ratio) / load
    if memory[_EQUAL + MOTOR] == 0.0:
        memory[_PUSH] = 0.0
    elif pushed > 1.0:
        memory[_PUSH] += limits.period * min(pushed, _SET.push_rate)
    if memory[_PUSH] > max(_SET.push_time, _SET.push_periods * limits.period):
        stop(memory, LIMP)


@internal
def _behind_friction(own: Guarded, torque: float, friction: float) -> float:
    """Return the torque at one end of slipping cables from that at the other [N m].

    `friction` is the friction coefficient times the wrap between both, negative if the
    returned torque is the smaller.
    """
    limits, spring = limits_of(own.gains), own.spring
    grown = np.exp(0.5 * friction)
    if limits.one_way != 0.0:
        sign = np.sign(limits.ratio)
        return float(sign * max(sign * torque, 0.0) * grown ** (2.0 * sign))
    one = (torque + spring[REST] * grown) / (grown + 1.0 / grown)
    other = spring[REST] - one
    if other < 0.0:
        one, other = torque * grown, 0.0
    elif one < 0.0:
        one, other = 0.0, -torque / grown
    return float(one * grown - other / grown)


@internal
def _most_friction(spring: FloatArray) -> float:
    """Return the greatest friction coefficient times wrap that a motor may meet."""
    return float(_SET.friction_factor * spring[FRICTION] + _SET.more_friction)


@internal
def _beyond(own: Guarded, given: float, torque: float, friction: float) -> float:
    """Return by how much a motor torque is outside the band that friction allows [N m].

    The band is around the joint torque `torque`, for `friction`, a coefficient times
    wrap; inside, the result is 0. `given` is the motor torque referred to the joint [N
    m].
    """
    limits = limits_of(own.gains)
    least = _SET.motor_share * limits.safe_torque
    above = given - _behind_friction(own, torque, friction) - least
    below = given - _behind_friction(own, torque, -friction) + least
    return float(max(above, 0.0) + min(below, 0.0))


@internal
def _explains(memory: FloatArray, most: float) -> bool:
    """Return whether the stretch torque fits the sensor with a misfit below `most`."""
    return bool(0.0 <= memory[_MISFIT] < most)


@internal
def _deviation(memory: FloatArray) -> float:
    """Return the RMS difference between sensor and stretch torque [N m]."""
    gain = memory[_GAIN]
    off = memory[_SENSED] + gain * (gain * memory[_POWER] - 2.0 * memory[_BOTH])
    return float(np.sqrt(max(off, 0.0) / max(memory[_LEARNT], _SET.known_time)))


@internal
def _learn(own: Guarded) -> None:
    """Learn the gain from stretch torque to sensor, and the misfit between both."""
    limits, memory = limits_of(own.gains), own.memory
    torque, predicted = memory[_GOOD + TORQUE], memory[_PREDICTED]
    share = limits.period / _SET.mean_time
    memory[_MEAN] += share * (torque - memory[_MEAN])
    memory[_MEAN_PREDICTED] += share * (predicted - memory[_MEAN_PREDICTED])
    off, expected = torque - memory[_MEAN], predicted - memory[_MEAN_PREDICTED]
    kept = 1.0 - limits.period / _SET.learn_time
    memory[_LEARNT] = kept * memory[_LEARNT] + limits.period
    memory[_POWER] = kept * memory[_POWER] + limits.period * expected * expected
    memory[_BOTH] = kept * memory[_BOTH] + limits.period * expected * off
    memory[_SENSED] = kept * memory[_SENSED] + limits.period * off * off
    known = (_SET.known_share * limits.safe_torque) ** 2 * _SET.known_time
    gain = (memory[_BOTH] + known) / (memory[_POWER] + known)
    gain = min(max(gain, _SET.least_gain), _SET.most_gain)
    memory[_GAIN] = gain
    both = memory[_SENSED] + gain * gain * memory[_POWER]
    memory[_MISFIT] = -1.0  # not known
    if both > known:
        memory[_MISFIT] = (both - 2.0 * gain * memory[_BOTH]) / (both + known)
        if memory[_POWER] > _SET.proof * known and memory[_MISFIT] < _SET.max_doubt:
            memory[_PROVEN] = max(memory[_PROVEN], gain)


@internal
def _compare(own: Guarded) -> None:
    """Stop or limp if other torques contradict the sensor; else learn the gain.

    The others are the stretch torque, times the gain, and the motor's. The guard stops
    the motor if both contradict the sensor, or the motor's alone where the stretch is
    known not to fit. It limps if the stretch alone does, which fitted before and which
    the motor does not contradict. Each takes `gap_time`, less if the gap is large.
    """
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    torque, scaled = memory[_GOOD + TORQUE], memory[_GAIN] * memory[_PREDICTED]
    gap = abs(scaled - torque) - _SET.gap_factor * max(abs(torque), abs(scaled))
    given, friction = memory[_GIVEN], _most_friction(spring)
    beyond = _beyond(own, given, torque, friction)
    late = _beyond(own, given, memory[_TAKEN], friction)
    # The low-passed torque of the motor follows a quick swing later than the sensor.
    beyond = 0.5 * (np.sign(beyond) + np.sign(late)) * min(abs(beyond), abs(late))
    agrees = beyond * (scaled - torque) > 0.0
    denied = agrees and gap > _SET.denied_share * limits.safe_torque
    if memory[_MISFIT] >= _SET.max_doubt and memory[_AGREED] > _SET.agreed_time:
        denied |= beyond != 0.0
    usual = _SET.gap_sigmas * _deviation(memory)
    doubted = gap > _SET.gap_share * limits.safe_torque + usual
    doubted &= _explains(memory, _SET.max_doubt)
    filtered = memory[_GAIN] * memory[_TAKEN_PREDICTED]
    opposed = _beyond(own, given, filtered, friction) * (scaled - torque)
    doubted &= opposed >= 0.0
    if denied or doubted:
        size = abs(beyond) / (_SET.motor_share * limits.safe_torque) if denied else 1.0
        memory[_GAP] += limits.period * min(max(size, 1.0), _SET.gap_rate)
        if memory[_GAP] > _SET.gap_time:
            stop(memory, STOPPED if denied else LIMP)
        return
    memory[_GAP] = 0.0
    if beyond == 0.0 and abs(torque) > _SET.known_share * limits.safe_torque:
        memory[_AGREED] += limits.period
    if not agrees and memory[_EQUAL + TORQUE] < _SET.still_samples:
        _learn(own)


@compiled
def admit(own: Guarded, seen: FloatArray) -> None:
    """Check the readings of a step, and replace those that are missing or spikes."""
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    if memory[STARTED] == 0.0 and not _start(own, seen):
        return
    _fill_missing(own, seen)
    is_known = spring[STIFFNESS] > 0.0 and limits.safe_torque < NO_TORQUE_LIMIT
    if is_known:
        _skip_spikes(own, seen)
        _check_frozen(own, seen)
    rate = (seen[TORQUE] - memory[_GOOD + TORQUE]) / limits.period
    memory[_RUSH] += _SET.rate_filter * (rate - memory[_RUSH])
    # The motor torque less that of its inertia, referred to the joint.
    speeding = (seen[MOTOR_SPEED] - memory[_GOOD + MOTOR_SPEED]) / limits.period
    given = limits.ratio * (memory[COMMAND] - limits.inertia * speeding)
    share = min(limits.period / _SET.motor_time, 1.0)
    memory[_GIVEN] += share * (given - memory[_GIVEN])
    kept = max(1.0 - limits.period / _SET.hold_time, 0.0)
    memory[_MOST] = max(kept * memory[_MOST], abs(memory[_GIVEN]))
    memory[_UNSAFE] *= max(1.0 - limits.period / _SET.unsafe_memory, 0.0)
    if abs(seen[TORQUE]) > limits.safe_torque:
        memory[_UNSAFE] += limits.period
        if memory[_UNSAFE] > _SET.unsafe_time:
            stop(memory, STOPPED)
    moved = seen[JOINT] - memory[_GOOD + JOINT]
    for i in range(READINGS):
        memory[_GOOD + i] = seen[i]
    if is_known:
        _predict(own, moved)
        memory[_TAKEN] += share * (seen[TORQUE] - memory[_TAKEN])
        beyond = memory[_PREDICTED] - memory[_TAKEN_PREDICTED]
        memory[_TAKEN_PREDICTED] += share * beyond
        if memory[STATE] < STOPPED and limits.shared == 0.0:
            _compare(own)


@internal
def _credible(own: Guarded) -> float:
    """Return the stretch torque, as far as fit or motor torque support it [N m]."""
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    predicted = max(memory[_GAIN], 1.0) * memory[_PREDICTED]
    if _explains(memory, _SET.max_misfit):
        # A gain below 1 may be that of the sensor, once the motor can be unsafe.
        if memory[_MOST] > limits.safe_torque:
            return float(predicted)
        gain = memory[_GAIN]
        if gain < _SET.fallen_share * memory[_PROVEN]:
            gain = memory[_PROVEN]  # the cables pull as before: it is the sensor's
        return float(gain * memory[_PREDICTED])
    friction = _most_friction(spring)
    high = _behind_friction(own, memory[_MOST], friction)
    low = _behind_friction(own, -memory[_MOST], -friction)
    return float(min(max(predicted, low), high))


@compiled
def state(own: Guarded, ahead: float, planned: float) -> float:
    """Return the state of the guard after `admit`, one of `FREE` to `LIMP`.

    The motor is faster than the joint by `ahead` [rad/s]; `planned` is the desired
    torque [N m].
    """
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    if memory[STATE] >= STOPPED:
        return float(memory[STATE])
    ratio, stiffness, safe = limits.ratio, spring[STIFFNESS], limits.safe_torque
    before = 1.0 if memory[STATE] != FREE else 0.0
    rushing = impact_torque(ahead, ratio, stiffness, limits.inertia)
    measured = memory[_GOOD + TORQUE]
    released = release_state(before, measured, rushing, planned, safe)
    if safe < NO_TORQUE_LIMIT and stiffness > 0.0:
        predicted = _credible(own)
        again = release_state(before, predicted, rushing, planned, safe)
        released = max(released, again)
        if memory[_EQUAL + MOTOR] >= _SET.still_samples:
            # The encoder may be frozen; then the torque shows that the motor runs.
            rushing = memory[_RUSH] * abs(ratio) * np.sqrt(limits.inertia / stiffness)
            again = release_state(before, measured, rushing, planned, safe)
            released = max(released, again)
    speed = memory[_GOOD + JOINT_SPEED]
    if abs(speed) > limits.safe_speed or speed * measured > limits.safe_power:
        released = BRAKED
    memory[STATE] = released
    return float(released)


@internal
def _turn_of_answer(limits: DriveLimits, spring: FloatArray) -> float:
    """Return the rotor's phase of oscillation after `answer_time` [rad]; 0: unknown."""
    if not limits.inertia * spring[STIFFNESS] > 0.0:
        return 0.0
    frequency = np.sqrt(spring[STIFFNESS] / limits.inertia) / abs(limits.ratio)
    return float(frequency * limits.answer_time)


@compiled
def damper_share(limits: DriveLimits, spring: FloatArray) -> float:
    """Return the share of a motor's damping that is still effective with its delay.

    A damper delayed by a quarter of an oscillation, pi / 2, feeds it, and a delay may
    be half as long again as modelled. So the share is 1 up to 0.5 rad and 0 from 1 rad.
    """
    turned = _turn_of_answer(limits, spring)
    return float(min(max(2.0 - 2.0 * turned, 0.0), 1.0))


@internal
def _period_share(limits: DriveLimits, spring: FloatArray) -> float:
    """Return the control period over the rotor's period of oscillation, at most 1."""
    frequency = _turn_of_answer(limits, spring) / limits.answer_time
    return float(min(limits.period * frequency / (2.0 * np.pi), 1.0))


@compiled
def let_go_torque(own: Guarded, damping: float, ahead: float) -> float:
    """Return the torque of a released motor [N m].

    It is that of a damper [N m s/rad] at the speed `ahead` relative to the joint
    [rad/s].
    """
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    if memory[STATE] == LIMP:
        return 0.0
    share = damper_share(limits, spring)
    damping *= share
    kept = 0.0
    if share < 1.0:
        # Torque that ends at once makes the motor swing by as much.
        left = 1.0 - _period_share(limits, spring)
        kept = (1.0 - share) * left * memory[COMMAND]
    if memory[STATE] == BRAKED:
        return float(kept - damping * memory[_GOOD + MOTOR_SPEED])
    return float(kept - damping * ahead)


@compiled
def command_limit(limits: DriveLimits, spring: FloatArray) -> float:
    """Return the largest command that the safe torque needs, with a margin [N m]."""
    if not limits.safe_torque < NO_TORQUE_LIMIT:
        return np.inf
    held = limits.safe_torque * np.exp(spring[FRICTION]) / abs(limits.ratio)
    return float(_SET.command_margin * held)


@internal
def _swing_bounds(
    own: Guarded, torque: float, rushing: float, most: float
) -> tuple[float, float]:
    """Return bounds of the motor torque that keep an oscillation safe [N m].

    Rotor and cables oscillate at an angular frequency w about the torque g that the
    motor holds, at the joint. The guard reacts after a time T, during which g is held.
    After a release then, the torque stays below `most` = M if g^2 |a|^2 + 2 g a b +
    |b|^2 <= M^2, where a = (1 - cos wT, sin wT), and b is the present state (torque,
    rushing) rotated by wT; `rushing` as in `release_state`.
    """
    limits, spring = limits_of(own.gains), own.spring
    turned = min(_turn_of_answer(limits, spring), np.pi)
    short = 2.0 * np.sin(0.5 * turned) ** 2  # 1 - cos
    both = 0.5 * (torque * short - rushing * np.sin(turned)) / short
    room = most**2 - torque**2 - rushing**2
    half = np.sqrt(max(both**2 + 0.5 * room / short, 0.0))
    return float(both - half), float(both + half)


@internal
def _swing_limited(own: Guarded, torque: float) -> float:
    """Return the command, limited so that the joint is safe till the motor reacts."""
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    is_quick = damper_share(limits, spring) < 1.0  # else the guard reacts in time
    is_known = limits.safe_torque < NO_TORQUE_LIMIT
    if not (is_quick and is_known) or memory[STATE] != FREE:
        return torque
    ratio, friction = limits.ratio, spring[FRICTION]
    ahead = memory[_GOOD + MOTOR_SPEED] - ratio * memory[_GOOD + JOINT_SPEED]
    rushing = impact_torque(ahead, ratio, spring[STIFFNESS], limits.inertia)
    aim = min(abs(memory[_GOOD + DESIRED]), limits.safe_torque)
    most = aim + _SET.swing_share * (limits.safe_torque - aim)
    before, step = ratio * memory[COMMAND], most * _period_share(limits, spring)
    given = max(min(ratio * torque, before + step), before - step)
    for measured in (memory[_GOOD + TORQUE], _credible(own)):
        low, high = _swing_bounds(own, measured, rushing, most)
        low += _behind_friction(own, measured, -friction) - measured
        high += _behind_friction(own, measured, friction) - measured
        given = max(min(given, max(high, 0.0)), min(low, 0.0))  # no sensor drives
    return float(given / ratio)


@compiled
def bounded(own: Guarded, torque: float) -> float:
    """Return a torque limited to a safe command, and store it as `COMMAND` [N m]."""
    limits, spring, memory = limits_of(own.gains), own.spring, own.memory
    most = command_limit(limits, spring)
    torque = _swing_limited(own, torque)
    if abs(torque) > most:
        torque = np.sign(torque) * most
    memory[COMMAND] = torque
    return float(torque)


@internal
def passed(own: Guarded, damping: float, torque: float) -> float:
    """Return a law's motor torque `torque` as the guard allows it, after `admit` [N m].

    `damping` is that of a released motor [N m s/rad].
    """
    limits, seen = limits_of(own.gains), own.memory[_GOOD : _GOOD + READINGS]
    ahead = seen[MOTOR_SPEED] - limits.ratio * seen[JOINT_SPEED]
    if state(own, ahead, seen[DESIRED]) != FREE:
        torque = let_go_torque(own, damping, ahead)
    return bounded(own, limited(own.gains, torque))
