"""Laws of one control step of one axis, compiled, on the memory of the caller.

    wrong_parameters(shape, parameters, least, most, gains)   # 0 if all are possible
    store(memory, shape, parameters)
    torque = step(LawData(memory, shape, tables, readings))

Compiled episodes and exported C run them; nothing allocates.

`shape` has the number of cables, then the number of segments of each, then the number
of sections of each. `tables` are numbers of the controller that no parameter changes.
`parameters` are the gains; then, of every cable, its arms at motor and joint, its
scalars and its sections. Memory is numbers only.
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._layout import SCALARS
from cc_mujoco.cable._mesh import SECTION_SIZE
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.control import _cable_model as cable_model
from cc_mujoco.control import _compensation as compensation
from cc_mujoco.control import _guard as guard
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.native import (
    FloatArray,
    FloatCube,
    FloatMatrix,
    IntArray,
    IntMatrix,
    compiled,
    internal,
)
from cc_mujoco.native._functions import reinterpret_part

LAW_INPUTS = MEASURED_COLUMNS[: guard.READINGS]
"""Columns that the laws read, in the order of `guard.READINGS`."""


def gains_of(law: str) -> tuple[Parameter, ...]:
    """Return the gains of `gains.csv` for `all` laws, then of `feedback` or `plan`.

    The first are the fields of `DriveLimits`; a second row of a gain replaces its first
    one. A bound in capitals is a constant of `_guard`.
    """
    with Path(__file__).with_name("gains.csv").open(encoding="utf-8") as file:
        own = (row for row in csv.DictReader(file) if row["law"] in ("all", law))
        rows = {row["name"]: row for row in own}
    return tuple(
        Parameter(
            row["name"],
            row["unit"],
            row["meaning"],
            float(row["low"]),
            float(getattr(guard, row["high"], row["high"])),
            low_open=row["bound"] == "above",
        )
        for row in rows.values()
    )


LIMITS, FEEDBACK = gains_of("all"), gains_of("feedback")
"""Gains of a law without and with feedback, in order."""

_FEED_FORWARD, _PROPORTIONAL, _INTEGRAL, _SETTLING, _PREVIEW, _TOLERANCE, STIFFNESS = (
    range(guard.LIMITS, len(FEEDBACK) - guard.SPRING_SIZE + 1)
)
"""Indices of the gains of feedback after `DriveLimits`; the cables' spring is last."""
SPRING_GAINS = tuple(one.name for one in FEEDBACK[STIFFNESS:])
"""Names of the gains that are the spring's numbers, in order."""

FIRST_STEP, JOINT_ANGLE, SPRING, OWN_MEMORY = 0, 1, 2, 2 + guard.SPRING_SIZE
"""Places in the memory: 1 until the first step is taken; joint angle of the model since
the start [rad]; all cables as a spring at the joint, see `guard.STIFFNESS`; the first
number of the controller's own."""
INTEGRAL_TORQUE, MOTOR_DIRECTION, GUARD = range(3)
"""Places from `OWN_MEMORY` on, of a law with feedback: torque of the integral [N m];
direction in which the motor shall turn; first number of the guard."""
LAST_COMMAND, GAINS, CABLES = (
    OWN_MEMORY + GUARD + guard.COMMAND,
    OWN_MEMORY + GUARD + guard.MEMORY_SIZE,
    OWN_MEMORY + GUARD + guard.MEMORY_SIZE + len(FEEDBACK),
)
"""Places in the memory of a controller that does not plan: its last torque; its gains;
`_CABLE_ROWS` rows with a number for each cable, if it has a model."""
_CABLE_ROWS = 5 + compensation.SCRATCH_ROWS
"""Rows of arms at motor and joint; then those of `compensation.Model`: present arm,
direction, gain and scratch."""

MODEL, STICTION, DISTURBANCE = range(3)
"""Laws with a model: `ModelBased`, `StictionCompensation`, `DisturbanceObserver`."""
_KNOWN, _TORQUE, LACK_SIZE = range(3)
"""Places in the memory of `_learn_lack`, and its size: 1 once a torque was applied; the
disturbance [N m]."""


class LawData(NamedTuple):
    """Data of a step of an axis's law; the module docstring defines their contents."""

    memory: FloatArray
    sizes: IntArray  # `shape`
    tables: FloatArray
    readings: FloatArray


@reinterpret_part
def part(numbers: FloatArray, first: int, count: int) -> FloatArray:
    return numbers[first : first + count]


@reinterpret_part
def rows_of(numbers: FloatArray, first: int, rows: int, columns: int) -> FloatMatrix:
    """Return `numbers` from index `first` on as a matrix, without a copy."""
    return numbers[first : first + rows * columns].reshape(rows, columns)


@reinterpret_part
def tables_of(
    numbers: FloatArray, first: int, tables: int, rows: int, columns: int
) -> FloatCube:
    """Return `numbers` from index `first` on as several matrices, without a copy."""
    whole = numbers[first : first + tables * rows * columns]
    return whole.reshape(tables, rows, columns)


@reinterpret_part
def whole_part(numbers: IntArray, first: int, count: int) -> IntArray:
    return numbers[first : first + count]


@reinterpret_part
def whole_rows_of(numbers: IntArray, first: int, rows: int, columns: int) -> IntMatrix:
    return numbers[first : first + rows * columns].reshape(rows, columns)


@internal
def longest_cable(shape: IntArray) -> int:
    """Return the largest number of segments of a cable."""
    longest = 0
    for k in range(shape[0]):
        longest = max(longest, shape[1 + k])
    return longest


@compiled
def places(shape: IntArray) -> tuple[int, int]:
    """Return where the cables' states begin in a model law's memory, and its end."""
    cables, most = shape[0], longest_cable(shape)
    of_cable = _CABLE_ROWS + kernel.parameter_size(most)
    states = CABLES + cables * of_cable
    end = states + 2 * cables * kernel.state_size(most) + kernel.work_size(most)
    return int(states), int(end)


@internal
def model_memory(memory: FloatArray, shape: IntArray) -> compensation.Model:
    """Return views of the memory of a law with a model, as a `Model`."""
    count, longest = shape[0], longest_cable(shape)
    of_cables = rows_of(memory, CABLES, _CABLE_ROWS, count)
    place, end = places(shape)
    states = rows_of(memory, place, 2 * count, kernel.state_size(longest))
    packed, work = CABLES + of_cables.size, place + states.size
    prm = rows_of(memory, packed, count, kernel.parameter_size(longest))
    n, proximal = whole_part(shape, 1, count), of_cables[0]
    return compensation.Model(
        stepper.Cables(prm, n, proximal, proximal, of_cables[1]),
        states[:count], of_cables[2], of_cables[3], of_cables[4], of_cables[5:],
        states[count:], part(memory, work, end - work),
    )  # fmt: skip


@internal
def _first_out_of_range(
    first: int, end: int, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of a parameter in [first, end) out of range; 0 for none."""
    for i in range(first, end):
        if not least[i] <= parameters[i] <= most[i]:
            return i + 1
    return 0


def wrong_parameters(
    shape: IntArray,
    parameters: FloatArray,
    least: FloatArray,
    most: FloatArray,
    gains: int,
) -> int:
    """Return 1 + the index of an impossible parameter, 0 if there is none.

    The first `gains` numbers are those of the controller, `DriveLimits` first. After
    them are those of its cables, if it has a model, and then any others. `least` and
    `most` are bounds of all.
    """
    wrong = _first_out_of_range(0, gains, parameters, least, most)
    if wrong != 0:
        return wrong
    if parameters[guard.RATIO] == 0.0:
        return guard.RATIO + 1
    if not parameters[guard.LOW] < parameters[guard.HIGH]:
        return guard.HIGH + 1
    if parameters.size == gains:
        return 0
    cables, first, end = shape[0], gains, gains
    for k in range(cables):
        end += 2 + SCALARS + SECTION_SIZE * shape[1 + cables + k]
    wrong = _first_out_of_range(first, end, parameters, least, most)
    if wrong != 0:
        return wrong
    for k in range(cables):
        if parameters[first] == 0.0 or parameters[first + 1] == 0.0:
            return first + (1 if parameters[first] == 0.0 else 2)
        values = part(parameters, first + 2, SCALARS)
        if 0.0 < values[PLACE.static_friction] < values[PLACE.friction]:
            return first + 3 + int(PLACE.static_friction)
        if values[PLACE.tension_exponent] != 0.0 and values[PLACE.pretension] == 0.0:
            return first + 3 + int(PLACE.tension_exponent)
        first += 2 + SCALARS + SECTION_SIZE * shape[1 + cables + k]
    return _first_out_of_range(end, parameters.size, parameters, least, most)


@compiled
def store_limits(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    memory[OWN_MEMORY : OWN_MEMORY + guard.LIMITS] = parameters[: guard.LIMITS]


@compiled
def store_gains(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    memory[GAINS:CABLES] = parameters[: CABLES - GAINS]
    memory[SPRING:OWN_MEMORY] = parameters[STIFFNESS : STIFFNESS + guard.SPRING_SIZE]


@compiled
def store_model(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    """Store gains and cables of a controller with a model in its memory."""
    store_gains(memory, shape, parameters)
    cables, first = model_memory(memory, shape).cables, CABLES - GAINS
    spring = part(memory, SPRING, guard.SPRING_SIZE)
    spring[:] = 0.0
    for k in range(shape[0]):
        cables.proximal[k], cables.distal[k] = parameters[first], parameters[first + 1]
        sections = shape[1 + shape[0] + k]
        values = part(parameters, first + 2, SCALARS)
        bends = rows_of(parameters, first + 2 + SCALARS, sections, SECTION_SIZE)
        kernel.pack(values, bends, cables.n[k], cables.prm[k])
        cable_model.add_preload(values, bends, cables.distal[k], spring)
        first += 2 + SCALARS + SECTION_SIZE * sections
    limits = guard.limits_of(part(memory, GAINS, CABLES - GAINS))
    cable_model.set_stiffness(cables, guard.largest_torque(limits), spring)


@internal
def impossible(readings: FloatArray, count: int, guarded: IntArray) -> int:
    """Return 1 + the index of an unguarded reading out of range, 0 if there is none."""
    for i in range(count):
        if guarded[i] == 0 and not guard.is_reading(readings[i]):
            return i + 1
    return 0


class Law(NamedTuple):
    """Gains, spring, memory and measurements of a law with feedback."""

    gains: FloatArray  # in the order of `FEEDBACK`, or of another law's own
    spring: FloatArray  # all cables at the joint, see `guard.STIFFNESS`
    memory: FloatArray  # state from one step to the next, 0 at the start
    seen: FloatArray  # measurements as `LAW_INPUTS`, which a law may change


@internal
def _law_of(memory: FloatArray) -> Law:
    numbers = part(memory, OWN_MEMORY, GAINS - OWN_MEMORY)
    return Law(
        part(memory, GAINS, CABLES - GAINS),
        part(memory, SPRING, guard.SPRING_SIZE),
        numbers,
        numbers[GUARD + guard.SEEN :],
    )


@internal
def _watched(law: Law) -> guard.Guarded:
    return guard.Guarded(law.gains, law.spring, law.memory[GUARD:])


@compiled
def admit(law: Law) -> None:
    """Check measurements, and replace them where needed; see `guard.admit`."""
    guard.admit(_watched(law), law.seen)


@internal
def _admitted(data: LawData) -> Law:
    """Return the law with readings checked by its guard; reset it at a first step."""
    law = _law_of(data.memory)
    if data.memory[FIRST_STEP] != 0.0:
        law.memory[:] = 0.0
    law.seen[: guard.READINGS] = data.readings[: guard.READINGS]
    admit(law)
    return law


@internal
def _guarded(law: Law, feedforward: float, error: float, damped: bool) -> float:
    """Return the motor torque of feedback around a feed-forward, guarded [N m].

    `error` is the desired less the measured joint torque [N m]; its integral is in the
    memory, and restarts while the guard does not let the law drive. If `damped`, a
    damper of the motor relative to the joint is added to the feed-forward.
    """
    gains, spring, memory, seen = law
    own, ratio = _watched(law), gains[guard.RATIO]
    ahead = seen[guard.MOTOR_SPEED] - ratio * seen[guard.JOINT_SPEED]
    damping = gains[_SETTLING] * spring[guard.STIFFNESS] / (ratio * ratio)
    if damped:
        feedforward -= damping * ahead
    if guard.state(own, ahead, seen[guard.DESIRED]) != guard.FREE:
        memory[INTEGRAL_TORQUE], memory[MOTOR_DIRECTION] = 0.0, 0.0
        torque = guard.let_go_torque(own, damping, ahead)
        return guard.bounded(own, guard.limited(gains, torque))
    step = gains[_INTEGRAL] * gains[guard.PERIOD] * error / ratio
    following = memory[INTEGRAL_TORQUE] + step
    limits = guard.limits_of(gains)
    if limits.one_way != 0.0:
        following = max(following, -max(feedforward, 0.0))
    torque = feedforward + gains[_PROPORTIONAL] * error / ratio + following
    limited, most = guard.limited(gains, torque), guard.command_limit(limits, spring)
    if abs(limited) > most:
        limited = math.copysign(most, limited)
    # At a limit, with an error that would push beyond.
    if not (torque - limited) * (error / ratio) > 0.0:
        memory[INTEGRAL_TORQUE] = following
    return guard.bounded(own, limited)


@internal
def step_forward(data: LawData) -> float:
    data.memory[FIRST_STEP] = 0.0
    gains = part(data.memory, OWN_MEMORY, guard.LIMITS)
    return guard.limited(gains, data.readings[0] / gains[guard.RATIO])


@compiled
def proportional_integral(law: Law) -> float:
    """Return the motor torque of `ProportionalIntegral`, after `admit` [N m]."""
    desired, feedforward = law.seen[guard.DESIRED], 0.0
    if law.gains[_FEED_FORWARD] != 0.0:
        feedforward = desired / law.gains[guard.RATIO]
    return _guarded(law, feedforward, desired - law.seen[guard.TORQUE], False)


@internal
def step_proportional_integral(data: LawData) -> float:
    law = _admitted(data)
    data.memory[FIRST_STEP] = 0.0
    return proportional_integral(law)


@compiled
def follow_model(data: LawData) -> None:
    """Let the guard check the measurements, and step the cables' model by them."""
    memory, seen = data.memory, _admitted(data).seen
    own = model_memory(memory, data.sizes)
    if memory[FIRST_STEP] != 0.0:
        stepper.set_rest(own.cables, seen[guard.MOTOR], 0.0, own.state)
        own.direction[:] = 0.0
        own.gain[:] = 1.0
        for i in range(places(data.sizes)[1], memory.size):
            memory[i] = 0.0
        memory[JOINT_ANGLE], memory[FIRST_STEP] = 0.0, 0.0
    memory[JOINT_ANGLE] = cable_model.follow(
        own, seen[guard.MOTOR], seen[guard.TORQUE], memory[JOINT_ANGLE],
        memory[GAINS + guard.PERIOD],
    )  # fmt: skip


@internal
def model_torque(data: LawData, kind: int) -> float:
    """Return the torque of the law `kind`, as `MODEL`, after `follow_model` [N m]."""
    own, law = model_memory(data.memory, data.sizes), _law_of(data.memory)
    if kind == STICTION:
        return _stiction(law, own)
    lacking = 0.0
    if kind == DISTURBANCE:
        known = part(data.memory, places(data.sizes)[1], LACK_SIZE)
        lacking = _learn_lack(
            data.tables[0], cable_model.motor_torque(own), law.memory, known
        )
    velocity, desired = law.seen[guard.JOINT_SPEED], law.seen[guard.DESIRED]
    feedforward = compensation.dynamic(own, velocity, desired) + lacking
    return _guarded(law, feedforward, desired - law.seen[guard.TORQUE], True)


@internal
def _stiction(law: Law, model: compensation.Model) -> float:
    """Return the motor torque of `StictionCompensation` [N m]."""
    gains, memory, seen = law.gains, law.memory, law.seen
    speed, error = seen[guard.JOINT_SPEED], seen[guard.DESIRED] - seen[guard.TORQUE]
    motion = law.spring[guard.STIFFNESS] * gains[_PREVIEW] * speed
    # Positive at the motor is winding towards a positive ratio.
    wanted = math.copysign(1.0, gains[guard.RATIO]) * (error + motion)
    sense = memory[MOTOR_DIRECTION]
    turns = wanted * (np.sign(wanted) if sense == 0.0 else -sense)
    turned = turns > gains[_TOLERANCE]
    if turned:
        memory[MOTOR_DIRECTION] = np.sign(wanted)
    feedforward = compensation.full_slip_torque(
        model, memory[MOTOR_DIRECTION], speed, seen[guard.DESIRED]
    )
    # Where the direction has just changed, the feed-forward corrects the error.
    return _guarded(law, feedforward, 0.0 if turned else error, True)


@internal
def _learn_lack(
    share: float, load: float, memory: FloatArray, lack: FloatArray
) -> float:
    """Return the low-passed motor torque that the model does not explain [N m].

    `share` is the weight of the new value, `load` the motor torque that the model
    explains [N m]; `lack` (`LACK_SIZE`,), 0 at the start, is updated.
    """
    if memory[GUARD + guard.STATE] != guard.FREE:
        lack[:] = 0.0
    unexplained = 0.0
    if lack[_KNOWN] != 0.0:
        unexplained = memory[GUARD + guard.COMMAND] - load
    lack[_KNOWN] = 1.0
    lack[_TORQUE] += share * (unexplained - lack[_TORQUE])
    return float(lack[_TORQUE])


@internal
def step_model_based(data: LawData) -> float:
    follow_model(data)
    return model_torque(data, MODEL)


@internal
def step_stiction(data: LawData) -> float:
    follow_model(data)
    return model_torque(data, STICTION)


@internal
def step_disturbance(data: LawData) -> float:
    follow_model(data)
    return model_torque(data, DISTURBANCE)


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

    It follows from second differences, which motion hardly changes; `signals` has the
    places from `_KNOWN_SIGNALS` on and is updated.
    """
    change = torque - signals[_LAST_TORQUE]
    power = (change - signals[_LAST_CHANGE]) ** 2 / 6.0
    signals[_LAST_TORQUE], signals[_LAST_CHANGE] = torque, change
    share = min(period / 0.5, 1.0)  # it is measured over half a second
    signals[_NOISE_POWER] += share * (power - signals[_NOISE_POWER])
    return float(np.sqrt(signals[_NOISE_POWER]))


@internal
def step_tuned(data: LawData) -> float:
    """Return the motor torque of `TunedFeedback` [N m].

    The tables are the share of friction that is fed forward, the speed of slip [rad/s],
    the dead zone in standard deviations, the standard deviation of the torque sensor [N
    m], and `cable_table`.
    """
    law, tables = _admitted(data), data.tables
    signals = part(data.memory, CABLES, SIGNAL_SIZE)
    if data.memory[FIRST_STEP] != 0.0:
        signals[:] = 0.0
        data.memory[FIRST_STEP] = 0.0
    seen, desired, period = law.seen, law.seen[guard.DESIRED], law.gains[guard.PERIOD]
    ahead = guard.limited(law.gains, desired / law.gains[guard.RATIO])
    if signals[_KNOWN_SIGNALS] == 0.0:
        signals[_KNOWN_SIGNALS], signals[_LAST_DESIRED] = 1.0, desired
        signals[_LAST_TORQUE] = seen[guard.TORQUE]
    if tables[0] > 0.0:
        rate = (desired - signals[_LAST_DESIRED]) / period
        signals[_LAST_DESIRED] = desired
        signals[_DESIRED_RATE] += 0.2 * (rate - signals[_DESIRED_RATE])  # low-passed
        stretching = signals[_DESIRED_RATE] / law.spring[guard.STIFFNESS]
        # The smooth sense in which the motor has to turn.
        sense = np.tanh((seen[guard.JOINT_SPEED] + stretching) / tables[1])
        cables = rows_of(tables, 4, data.sizes[0], data.sizes[1])
        ahead = cable_model.full_slip_balance(cables, tables[0] * sense, desired)[0]
    off = seen[guard.TORQUE] - desired
    noise = _noise(period, signals, seen[guard.TORQUE])
    width = tables[2] * max(noise, tables[3]) - 0.5 * abs(desired)
    if width > 0.0:
        off = np.sign(off) * max(abs(off) - width, 0.0)
        seen[guard.TORQUE] = desired + off
    return _guarded(law, ahead, desired - seen[guard.TORQUE], True)


@internal
def begun(data: LawData, gains: int, size: int, first: int) -> Law:
    """Return a law with a copy of the measurements, its memory reset at a first step.

    `gains` is the number of its gains. The tables begin with those after `DriveLimits`,
    then have the spring of the cables. In the memory `size` numbers of the law follow
    the gains; the guard is the `first` of them and those behind it.
    """
    memory = data.memory
    spring = part(data.tables, gains - guard.LIMITS, guard.SPRING_SIZE)
    behind = part(memory, OWN_MEMORY + guard.LIMITS, gains - guard.LIMITS)
    behind[:] = data.tables[: gains - guard.LIMITS]
    numbers = part(memory, OWN_MEMORY + gains, size)
    if memory[FIRST_STEP] != 0.0:
        numbers[:] = 0.0
        memory[FIRST_STEP] = 0.0
    seen = part(numbers, first + guard.SEEN, guard.READINGS)
    seen[:] = data.readings[: guard.READINGS]
    return Law(part(memory, OWN_MEMORY, gains), spring, numbers, seen)


class InverseGains(NamedTuple):
    """Gains of `BacklashInverse` after `DriveLimits`."""

    late: float  # time from a torque at the joint to the motor's reaction to it [s]
    position: float  # motor torque per error of the motor's angle [N m/rad]
    damping: float  # motor torque per error of its velocity [N m s/rad]
    integral: float  # rate at which the torque error shifts the wanted angle [1/s]
    band: float  # motion up to which the direction does not reverse [rad]
    release: float  # damping of a released motor [N m s/rad]


_INVERSE_STARTED, _MOTOR_0, _JOINT_0, _SENSE, _EXTREME, _ANGLE_OFFSET, INVERSE_GUARD = (
    range(7)
)
"""Places in the law's memory: 1 once started; angles of motor and joint at the start
[rad]; direction of motion; wanted angle farthest in it, and the integral's shift of
the stretch [rad]; the guard."""
BAND_SIGMAS = 0.34  # `InverseGains.band` times stiffness over the sensor's noise


@compiled
def _turn(memory: FloatArray, wanted: float, band: float) -> float:
    """Return the direction in which an angle `wanted` moves [rad]: 1, -1, 0 at first.

    Motion up to `band` [rad] does not change it.
    """
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
def step_inverse(data: LawData) -> float:
    """Return the motor torque of `BacklashInverse` [N m].

    The tables are those of `begun`, then those of `cable_table`.
    """
    count, tables = len(InverseGains._fields), data.tables
    size, end = INVERSE_GUARD + guard.MEMORY_SIZE, guard.LIMITS + count
    gains, spring, memory, seen = begun(data, end, size, INVERSE_GUARD)
    tuned = InverseGains(
        tables[0], tables[1], tables[2], tables[3], tables[4], tables[5]
    )
    stiffness = spring[guard.STIFFNESS]
    first = count + guard.SPRING_SIZE
    cables = rows_of(tables, first, data.sizes[0], data.sizes[1])
    own = guard.Guarded(gains, spring, memory[INVERSE_GUARD:])
    limits, ratio = guard.limits_of(gains), gains[guard.RATIO]
    guard.admit(own, seen)
    desired, speed = seen[guard.DESIRED], seen[guard.JOINT_SPEED]
    if memory[_INVERSE_STARTED] == 0.0:
        memory[_INVERSE_STARTED], memory[_MOTOR_0] = 1.0, seen[guard.MOTOR]
        memory[_JOINT_0] = seen[guard.JOINT]
        memory[_EXTREME] = desired / stiffness
    ahead = seen[guard.MOTOR_SPEED] - ratio * speed
    if guard.state(own, ahead, desired) != guard.FREE:
        memory[_ANGLE_OFFSET] = 0.0
        torque = guard.let_go_torque(own, tuned.release, ahead)
        return guard.bounded(own, guard.limited(gains, torque))
    joint = seen[guard.JOINT] - memory[_JOINT_0] + tuned.late * speed
    motor = seen[guard.MOTOR] - memory[_MOTOR_0] + tuned.late * seen[guard.MOTOR_SPEED]
    sense = _turn(memory, joint + desired / stiffness, tuned.band)
    balance, stretch = cable_model.full_slip_balance(cables, sense, desired)
    relative = ratio * (stretch + memory[_ANGLE_OFFSET])
    error = (desired - seen[guard.TORQUE]) / stiffness
    torque = balance + tuned.position * (relative + ratio * joint - motor)
    torque += tuned.damping * (ratio * speed - seen[guard.MOTOR_SPEED])
    limited = guard.bounded(own, guard.limited(gains, torque))
    if not (torque - limited) * error * ratio > 0.0:
        memory[_ANGLE_OFFSET] += tuned.integral * limits.period * error
    if limits.one_way != 0.0:
        # A torque that no paying out ends would pay out without an end: the integral
        # pays out no more than the stretch.
        least = -abs(stretch) - BAND_SIGMAS * tuned.band
        memory[_ANGLE_OFFSET] = max(memory[_ANGLE_OFFSET], least)
    return float(limited)


STRETCH, SPEED, LOAD, LACK, STATES = range(5)
"""States of the linear model: motor angle less ratio times joint angle [rad]; its rate;
torques on the motor and at the joint that it does not explain [N m]. Their number."""


class GaussianGains(NamedTuple):
    """Gains of `LinearQuadraticGaussian` after `DriveLimits`."""

    release: float  # damping of a released motor [N m s/rad]
    slip: float  # least change of the stretch's innovation by a slipped encoder [rad]


_GAUSSIAN_STARTED, _STRETCH_OFFSET, _INNOVATION, GAUSSIAN_GUARD = range(4)
HEADER = GAUSSIAN_GUARD + guard.MEMORY_SIZE
"""Places in the law's memory: 1 once started; stretch that counts as 0 and its last
innovation [rad]; the guard. Behind `HEADER` numbers follow the state and the torques
whose effect is not yet measured."""


class Design(NamedTuple):
    """Linear model of `LinearQuadraticGaussian`, gains of observer and regulator."""

    model: FloatMatrix  # state after a step, from state and torque (4, 5)
    read: FloatMatrix  # stretch and torque of the joint, from the state (2, 4)
    kalman: FloatMatrix  # gains of the observer (4, 2)
    regulator: FloatArray  # gains of stretch and its rate (2,)


@compiled
def _advance(
    model: FloatMatrix, state: FloatArray, torque: float, new: FloatArray
) -> None:
    """Advance the state of the linear model by a step with a motor torque [N m]."""
    for i in range(STATES):
        new[i] = model[i, STATES] * torque
        for j in range(STATES):
            new[i] += model[i, j] * state[j]
    state[:] = new


@internal
def step_gaussian(data: LawData) -> float:
    """Return the motor torque of `LinearQuadraticGaussian` [N m].

    The tables are those of `begun`, then those of `Design`. The memory has `HEADER`
    numbers, the `STATES`, the torques whose effect is not yet measured, and scratch.
    """
    size, tables = data.sizes[0], data.tables
    count = len(GaussianGains._fields)
    end, place = guard.LIMITS + count, count + guard.SPRING_SIZE
    gains, spring, memory, seen = begun(data, end, size, GAUSSIAN_GUARD)
    tuned, rigidity = GaussianGains(tables[0], tables[1]), spring[guard.STIFFNESS]
    model = rows_of(tables, place, STATES, STATES + 1)
    place += model.size
    read = rows_of(tables, place, 2, STATES)
    kalman = rows_of(tables, place + 2 * STATES, STATES, 2)
    regulator = part(tables, place + 4 * STATES, 2)
    scratch = rows_of(data.memory, OWN_MEMORY + end + size, 2, STATES)
    limits = guard.limits_of(gains)
    own = guard.Guarded(gains, spring, memory[GAUSSIAN_GUARD:HEADER])
    ratio, ahead, new = limits.ratio, scratch[0], scratch[1]
    guard.admit(own, seen)
    state = memory[HEADER : HEADER + STATES]
    applied = memory[HEADER + STATES :]
    stretch = seen[guard.MOTOR] - ratio * seen[guard.JOINT]
    if memory[_GAUSSIAN_STARTED] == 0.0:
        memory[_GAUSSIAN_STARTED], memory[_STRETCH_OFFSET] = 1.0, stretch
    _advance(model, state, applied[0], new)
    off_0 = stretch - memory[_STRETCH_OFFSET] - state[STRETCH]
    if abs(off_0 - memory[_INNOVATION]) > tuned.slip:
        # No motion does that in a step: the encoder has slipped, the cable has not.
        memory[_STRETCH_OFFSET] += off_0 - memory[_INNOVATION]
        off_0 = memory[_INNOVATION]
    memory[_INNOVATION] = off_0
    off_1 = seen[guard.TORQUE]
    for j in range(STATES):
        off_1 -= read[1, j] * state[j]
    for i in range(STATES):
        state[i] += kalman[i, 0] * off_0 + kalman[i, 1] * off_1
        ahead[i] = state[i]
    for i in range(1, applied.size):
        _advance(model, ahead, applied[i], new)
    wanted = (seen[guard.DESIRED] - ahead[LACK]) * ratio / rigidity
    if limits.one_way != 0.0:
        # A single cable cannot push, so a slack one need not be paid out further.
        least = -abs(seen[guard.DESIRED]) * abs(ratio) / rigidity
        wanted = max(wanted, least)
    hold = rigidity / ratio**2 * wanted - ahead[LOAD]
    off = regulator[0] * (ahead[STRETCH] - wanted) + regulator[1] * ahead[SPEED]
    torque = guard.passed(own, tuned.release, hold - off)
    applied[: applied.size - 1] = applied[1:]
    applied[applied.size - 1] = torque
    return float(torque)
