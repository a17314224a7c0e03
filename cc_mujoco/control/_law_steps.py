"""Steps of laws as compiled functions, on the memory of the caller.

    wrong(shape, parameters, least, most)           # 0, or 1 + what is wrong
    store(memory, shape, parameters)
    torque = step(memory, shape, tables, readings)

Each is of one axis. Compiled episodes and exported C run them.

`shape` says how many cables there are, then the segments of each, then the sections of
each. `tables` are numbers of the controller that no parameter changes. `parameters` are
the gains; then, of every cable, its arms at motor and joint, its scalars and its
sections. Memory is numbers only; `places` says what stands where.
"""

from __future__ import annotations

from typing import NamedTuple

from cc_mujoco.cable import _friction as friction
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import SCALARS
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import add_preload, follow, motor_torque, stiffness
from cc_mujoco.control._compensation import SCRATCH_ROWS
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

FIRST_STEP, JOINT_ANGLE, SPRING = 0, 1, 2
"""Places in the memory: whether no step was taken yet, angle of the joint since the
start as the model finds it [rad], all cables as a spring there (`guard.STIFFNESS`)."""
OWN_MEMORY = SPRING + guard.SPRING_SIZE
"""Numbers before those that are a controller's own."""
LAST_COMMAND = OWN_MEMORY + compiled_laws.GUARD + guard.COMMAND
"""Place of the last torque of a controller that does not plan."""
GAIN_COUNT, _N_INPUTS = len(compiled_laws.GAINS), len(compiled_laws.LAW_INPUTS)
GAINS = OWN_MEMORY + compiled_laws.MEMORY_SIZE
CABLES = GAINS + GAIN_COUNT
_CABLE_ROWS = 5  # proximal and distal arm, arm now, direction of slip, gain

MODEL, STICTION, DISTURBANCE = range(3)
"""Kinds of laws with a model."""
_KNOWN, _TORQUE, LACK_SIZE = range(3)
"""Places in the memory of the torque that the model lacks, and its size: whether a
torque was applied; the disturbance [N m]."""
_FRICTION = friction.INDEX["friction"]
_STATIC = friction.INDEX["static_friction"]
_PRETENSION = friction.INDEX["pretension"]
_EXPONENT = friction.INDEX["tension_exponent"]


class ModelMemory(NamedTuple):
    """Parts of the memory of a law with a model; see `CableModel`."""

    cables: stepper.Cables
    arm: FloatArray
    direction: FloatArray
    gain: FloatArray
    scratch: FloatMatrix
    """See `_compensation.SCRATCH_ROWS`."""
    state: FloatMatrix
    new: FloatMatrix
    work: FloatArray
    end: int
    """Place of the first number behind."""


@reinterpret_part
def part(numbers: FloatArray, first: int, count: int) -> FloatArray:
    return numbers[first : first + count]


@reinterpret_part
def rows_of(numbers: FloatArray, first: int, rows: int, columns: int) -> FloatMatrix:
    """Return a part of a memory as a matrix."""
    return numbers[first : first + rows * columns].reshape(rows, columns)


@reinterpret_part
def tables_of(
    numbers: FloatArray, first: int, tables: int, rows: int, columns: int
) -> FloatCube:
    """Return a part of a memory as several matrices."""
    whole = numbers[first : first + tables * rows * columns]
    return whole.reshape(tables, rows, columns)


@reinterpret_part
def whole_part(numbers: IntArray, first: int, count: int) -> IntArray:
    return numbers[first : first + count]


@reinterpret_part
def whole_rows_of(numbers: IntArray, first: int, rows: int, columns: int) -> IntMatrix:
    return numbers[first : first + rows * columns].reshape(rows, columns)


@compiled
def places(cables: int, most: int) -> tuple[int, int, int, int, int, int]:
    """Return the places of numbers in the memory, given the most segments of a cable.

    First numbers of what the laws need to compute with, of the packed parameters, the
    states, the states after a step, the scratch; and how many numbers there are.
    """
    scratch = CABLES + _CABLE_ROWS * cables
    packed = scratch + SCRATCH_ROWS * cables
    state = packed + cables * kernel.parameter_size(most)
    new = state + cables * kernel.state_size(most)
    work = new + cables * kernel.state_size(most)
    return scratch, packed, state, new, work, work + kernel.work_size(most)


@internal
def first_out_of_range(
    first: int, end: int, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of a parameter out of its range, 0 if there is none."""
    for i in range(first, end):
        if not least[i] <= parameters[i] <= most[i]:
            return i + 1
    return 0


@internal
def wrong_motor(
    parameters: FloatArray,
    least: FloatArray,
    most: FloatArray,
    count: int,
    ratio: int,
    low: int,
    high: int,
) -> int:
    """Return 1 + the index of an impossible motor parameter, 0 if there is none.

    There are `count` of a controller; those of its cables are behind. `ratio`, `low`
    and `high` are the places of the ratio, the least and the greatest torque.
    """
    wrong = first_out_of_range(0, count, parameters, least, most)
    if wrong != 0:
        return wrong
    if parameters[ratio] == 0.0:
        return ratio + 1
    if not parameters[low] < parameters[high]:
        return high + 1
    return 0


@internal
def _consistent(values: FloatArray) -> int:
    """Return 1 + the index of a cable's contradictory scalar, 0 if there is none."""
    if 0.0 < values[_STATIC] < values[_FRICTION]:
        return _STATIC + 1
    if values[_EXPONENT] != 0.0 and values[_PRETENSION] == 0.0:
        return _EXPONENT + 1
    return 0


@internal
def wrong_cables(
    shape: IntArray,
    parameters: FloatArray,
    least: FloatArray,
    most: FloatArray,
    first: int,
) -> int:
    """Return 1 + the index of an impossible cable parameter, 0 if there is none.

    Those of the cables begin at `first`.
    """
    cables, count = shape[0], first
    for k in range(cables):
        count += 2 + SCALARS + 2 * shape[1 + cables + k]
    wrong = first_out_of_range(first, count, parameters, least, most)
    if wrong != 0:
        return wrong
    for k in range(cables):
        if parameters[first] == 0.0 or parameters[first + 1] == 0.0:
            return first + (1 if parameters[first] == 0.0 else 2)
        wrong = _consistent(part(parameters, first + 2, SCALARS))
        if wrong != 0:
            return first + 2 + wrong
        first += 2 + SCALARS + 2 * shape[1 + cables + k]
    return 0


@internal
def _store_parameters(memory: FloatArray, parameters: FloatArray) -> None:
    for i in range(GAIN_COUNT):
        memory[GAINS + i] = parameters[i]


def wrong_gains(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible gain, 0 if there is none."""
    return wrong_motor(
        parameters, least, most, GAIN_COUNT, guard.RATIO, guard.LOW, guard.HIGH
    )


@compiled
def store_gains(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    _store_parameters(memory, parameters)
    memory[SPRING + guard.STIFFNESS] = parameters[compiled_laws.STIFFNESS]
    memory[SPRING + guard.REST] = parameters[compiled_laws.REST_TORQUE]
    memory[SPRING + guard.FRICTION] = parameters[compiled_laws.WRAP_FRICTION]


def wrong_model(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible gain or cable, 0 if there is none."""
    wrong = wrong_motor(
        parameters, least, most, GAIN_COUNT, guard.RATIO, guard.LOW, guard.HIGH
    )
    if wrong != 0:
        return wrong
    return wrong_cables(shape, parameters, least, most, GAIN_COUNT)


@compiled
def store_model(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    """Take the gains of a controller with a model, and its cables."""
    cables, longest = shape[0], 0
    for k in range(cables):
        longest = max(longest, shape[1 + k])
    _store_parameters(memory, parameters)
    _, packed, _, _, _, _ = places(cables, longest)
    size = kernel.parameter_size(longest)
    first = GAIN_COUNT
    spring = part(memory, SPRING, guard.SPRING_SIZE)
    spring[:] = 0.0
    for k in range(cables):
        memory[CABLES + k] = parameters[first]
        memory[CABLES + cables + k] = parameters[first + 1]
        sections = shape[1 + cables + k]
        values = part(parameters, first + 2, SCALARS)
        bends = rows_of(parameters, first + 2 + SCALARS, sections, 2)
        kernel.pack(
            values,
            bends,
            shape[1 + k],
            part(memory, packed + k * size, size),
        )
        add_preload(values, bends, parameters[first + 1], spring)
        first += 2 + SCALARS + 2 * sections
    spring[guard.STIFFNESS] = stiffness(
        rows_of(memory, packed, cables, size),
        part(memory, CABLES + cables, cables),
    )


@internal
def impossible(readings: FloatArray, count: int, guarded: IntArray) -> int:
    """Return 1 + the place of a reading that no sensor can mean, 0 if there is none.

    `guarded` is 1 for every reading of all axes where the guard of its axis looks at
    it.
    """
    for i in range(count):
        if guarded[i] == 0 and not guard.is_reading(readings[i]):
            return i + 1
    return 0


@internal
def admitted(memory: FloatArray, readings: FloatArray) -> FloatArray:
    """Return what is measured as the guard lets it through; begin where that is due."""
    law = part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE)
    if memory[FIRST_STEP] != 0.0:
        law[:] = 0.0
    seen = law[compiled_laws.GUARD + guard.SEEN :]
    for i in range(_N_INPUTS):
        seen[i] = readings[i]
    gains = part(memory, GAINS, GAIN_COUNT)
    spring = part(memory, SPRING, guard.SPRING_SIZE)
    compiled_laws.admit(gains, spring, law, seen)
    return seen


@internal
def step_proportional_integral(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    seen = admitted(memory, readings)
    memory[FIRST_STEP] = 0.0
    law = part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE)
    gains = part(memory, GAINS, GAIN_COUNT)
    spring = part(memory, SPRING, guard.SPRING_SIZE)
    return compiled_laws.guarded_torque(gains, spring, law, seen)


@internal
def model_memory(memory: FloatArray, shape: IntArray) -> ModelMemory:
    """Return the parts of the memory of a law with a model."""
    count, longest = shape[0], 0
    for k in range(count):
        longest = max(longest, shape[1 + k])
    scratch, packed, first, after, work, end = places(count, longest)
    width = kernel.state_size(longest)
    proximal = part(memory, CABLES, count)
    prm = rows_of(memory, packed, count, kernel.parameter_size(longest))
    n, distal = whole_part(shape, 1, count), part(memory, CABLES + count, count)
    return ModelMemory(
        stepper.Cables(prm, n, proximal, proximal, distal),
        part(memory, CABLES + 2 * count, count),
        part(memory, CABLES + 3 * count, count),
        part(memory, CABLES + 4 * count, count),
        rows_of(memory, scratch, SCRATCH_ROWS, count),
        rows_of(memory, first, count, width),
        rows_of(memory, after, count, width),
        part(memory, work, end - work),
        end,
    )


@compiled
def follow_model(memory: FloatArray, shape: IntArray, readings: FloatArray) -> None:
    """Have the guard check what is measured, and the model of the cables follow it."""
    seen = admitted(memory, readings)
    own = model_memory(memory, shape)
    if memory[FIRST_STEP] != 0.0:
        stepper.set_rest(own.cables, seen[compiled_laws.ANGLE], 0.0, own.state)
        own.direction[:] = 0.0
        own.gain[:] = 1.0
        for i in range(own.end, memory.size):
            memory[i] = 0.0
        memory[JOINT_ANGLE], memory[FIRST_STEP] = 0.0, 0.0
    memory[JOINT_ANGLE] = follow(
        own.cables,
        own.state,
        seen[compiled_laws.ANGLE],
        seen[compiled_laws.TORQUE],
        memory[JOINT_ANGLE],
        own.direction,
        own.gain,
        own.arm,
        memory[GAINS + compiled_laws.PERIOD],
        own.new,
        own.work,
    )


@internal
def model_torque(
    memory: FloatArray, shape: IntArray, tables: FloatArray, kind: int
) -> float:
    """Return the motor torque of a kind of law, after `follow_model` [N m]."""
    own = model_memory(memory, shape)
    law = part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE)
    seen = law[compiled_laws.GUARD + guard.SEEN :]
    gains = part(memory, GAINS, GAIN_COUNT)
    spring = part(memory, SPRING, guard.SPRING_SIZE)
    cables, lack = own.cables, 0.0
    if kind == STICTION:
        return compiled_laws.stiction(
            gains, spring, cables.prm, cables.n, cables.distal, own.arm, own.state, law,
            seen, own.scratch,
        )  # fmt: skip
    if kind == DISTURBANCE:
        load = motor_torque(cables.n, own.arm, own.state)
        lack = _learn_lack(tables[0], load, law, part(memory, own.end, LACK_SIZE))
    return compiled_laws.model_based(
        gains, spring, cables.prm, cables.n, cables.distal, own.arm, own.state,
        own.direction, own.gain, lack, law, seen, own.scratch,
    )  # fmt: skip


@internal
def _learn_lack(
    share: float, load: float, memory: FloatArray, lack: FloatArray
) -> float:
    """Return the motor torque that the model lacks, with that of the last step [N m].

    `share` is the weight of the new value, `load` the motor torque that the model
    explains [N m]; `lack` (`LACK_SIZE`,), 0 at the start, is updated.
    """
    if memory[compiled_laws.RELEASED] != 0.0:
        lack[:] = 0.0
    unexplained = 0.0
    if lack[_KNOWN] != 0.0:
        unexplained = memory[compiled_laws.GUARD + guard.COMMAND] - load
    lack[_KNOWN] = 1.0
    lack[_TORQUE] += share * (unexplained - lack[_TORQUE])
    return float(lack[_TORQUE])


@internal
def step_model_based(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    follow_model(memory, shape, readings)
    return model_torque(memory, shape, tables, MODEL)


@internal
def step_stiction(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    follow_model(memory, shape, readings)
    return model_torque(memory, shape, tables, STICTION)


@internal
def step_disturbance(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    follow_model(memory, shape, readings)
    return model_torque(memory, shape, tables, DISTURBANCE)


def wrong_limits(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible limit, 0 if there is none."""
    return wrong_motor(
        parameters, least, most, guard.LIMITS, guard.RATIO, guard.LOW, guard.HIGH
    )


@compiled
def store_limits(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(guard.LIMITS):
        memory[OWN_MEMORY + i] = parameters[i]


@internal
def step_forward(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    memory[FIRST_STEP] = 0.0
    gains = part(memory, OWN_MEMORY, guard.LIMITS)
    return compiled_laws.feed_forward(gains, readings[0])


@internal
def step_tuned(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    seen = admitted(memory, readings)
    signals = part(memory, CABLES, compiled_laws.SIGNAL_SIZE)
    if memory[FIRST_STEP] != 0.0:
        signals[:] = 0.0
        memory[FIRST_STEP] = 0.0
    return compiled_laws.tuned_torque(
        part(memory, GAINS, GAIN_COUNT),
        part(memory, SPRING, guard.SPRING_SIZE),
        rows_of(tables, 4, shape[0], shape[1]),
        part(tables, 0, 4),
        part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE),
        signals,
        seen,
    )


@internal
def begun(
    memory: FloatArray,
    tables: FloatArray,
    gains: int,
    size: int,
    first: int,
    readings: FloatArray,
) -> FloatArray:
    """Complete the gains, begin where that is due; return a copy of what is measured.

    `tables` begin with the `gains` behind `DriveLimits`. In the memory the `size`
    numbers of the law are behind the gains, `first` of them the guard.
    """
    for i in range(guard.LIMITS, gains):
        memory[OWN_MEMORY + i] = tables[i - guard.LIMITS]
    law = part(memory, OWN_MEMORY + gains, size)
    if memory[FIRST_STEP] != 0.0:
        law[:] = 0.0
        memory[FIRST_STEP] = 0.0
    seen = law[first + guard.SEEN : first + guard.SEEN + guard.READINGS]
    for i in range(guard.READINGS):
        seen[i] = readings[i]
    return seen


@internal
def step_inverse(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    gains, size = compiled_laws.INVERSE_GAINS, compiled_laws.INVERSE_SIZE
    seen = begun(memory, tables, gains, size, compiled_laws.INVERSE_GUARD, readings)
    spring = gains - guard.LIMITS
    return compiled_laws.inverse_torque(
        part(memory, OWN_MEMORY, gains),
        part(tables, spring, guard.SPRING_SIZE),
        rows_of(tables, spring + guard.SPRING_SIZE, shape[0], shape[1]),
        part(memory, OWN_MEMORY + gains, size),
        seen,
    )


@internal
def step_gaussian(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    gains, size, states = compiled_laws.GAUSSIAN_GAINS, shape[0], compiled_laws.STATES
    seen = begun(memory, tables, gains, size, compiled_laws.GAUSSIAN_GUARD, readings)
    spring = gains - guard.LIMITS
    model = spring + guard.SPRING_SIZE
    read = model + states * (states + 1)
    return compiled_laws.gaussian_torque(
        part(memory, OWN_MEMORY, gains),
        part(tables, spring, guard.SPRING_SIZE),
        compiled_laws.Design(
            rows_of(tables, model, states, states + 1),
            rows_of(tables, read, 2, states),
            rows_of(tables, read + 2 * states, states, 2),
            part(tables, read + 4 * states, 2),
        ),
        part(memory, OWN_MEMORY + gains, size),
        seen,
        rows_of(memory, OWN_MEMORY + gains + size, 2, states),
    )
