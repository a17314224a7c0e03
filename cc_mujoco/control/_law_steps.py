"""Steps of laws as compiled functions, on the memory of the caller.

    wrong_parameters(shape, parameters, least, most, gains)   # 0, or 1 + its index
    store(memory, shape, parameters)
    torque = step(LawData(memory, shape, tables, readings))

Each is of one axis. Compiled episodes and exported C run them.

`shape` says how many cables there are, then the segments of each, then the sections of
each. `tables` are numbers of the controller that no parameter changes. `parameters` are
the gains; then, of every cable, its arms at motor and joint, its scalars and its
sections. Memory is numbers only.
"""

from __future__ import annotations

from typing import NamedTuple

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._layout import SCALARS
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import add_preload, follow, stiffness
from cc_mujoco.control._cable_model import motor_torque as cable_torque
from cc_mujoco.control._compensation import SCRATCH_ROWS, Model
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
GAIN_COUNT = len(compiled_laws.GAINS)
GAINS = OWN_MEMORY + compiled_laws.MEMORY_SIZE
CABLES = GAINS + GAIN_COUNT
_CABLE_ROWS = 5  # proximal and distal arm, arm now, direction of slip, gain

MODEL, STICTION, DISTURBANCE = range(3)
"""Kinds of laws with a model."""
_KNOWN, _TORQUE, LACK_SIZE = range(3)
"""Places in the memory of the torque that the model lacks, and its size: whether a
torque was applied; the disturbance [N m]."""


class LawData(NamedTuple):
    """Numbers that a law of one axis works on; `sizes` are its shape, see above."""

    memory: FloatArray
    sizes: IntArray
    tables: FloatArray
    readings: FloatArray


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


@internal
def longest_cable(shape: IntArray) -> int:
    """Return the segments of the longest cable."""
    longest = 0
    for k in range(shape[0]):
        longest = max(longest, shape[1 + k])
    return longest


@compiled
def places(shape: IntArray) -> tuple[int, int]:
    """Return the places of the states of a model's cables, and behind the model."""
    cables, most = shape[0], longest_cable(shape)
    of_cable = _CABLE_ROWS + SCRATCH_ROWS + kernel.parameter_size(most)
    states = CABLES + cables * of_cable
    end = states + 2 * cables * kernel.state_size(most) + kernel.work_size(most)
    return int(states), int(end)


@internal
def model_memory(memory: FloatArray, shape: IntArray) -> Model:
    """Return the parts of the memory of a law with a model."""
    count, longest = shape[0], longest_cable(shape)
    of_cables = rows_of(memory, CABLES, _CABLE_ROWS + SCRATCH_ROWS, count)
    place, end = places(shape)
    states = rows_of(memory, place, 2 * count, kernel.state_size(longest))
    packed, work = CABLES + of_cables.size, place + states.size
    prm = rows_of(memory, packed, count, kernel.parameter_size(longest))
    n, proximal = whole_part(shape, 1, count), of_cables[0]
    return Model(
        stepper.Cables(prm, n, proximal, proximal, of_cables[1]),
        states[:count], of_cables[2], of_cables[3], of_cables[4],
        of_cables[_CABLE_ROWS:], states[count:], part(memory, work, end - work),
    )  # fmt: skip


@internal
def _first_out_of_range(
    first: int, end: int, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of a parameter out of its range, 0 if there is none."""
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

    `gains` numbers are of the controller, `DriveLimits` first. Behind them are those of
    its cables, where it has a model, and then any others.
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
        end += 2 + SCALARS + 2 * shape[1 + cables + k]
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
        first += 2 + SCALARS + 2 * shape[1 + cables + k]
    return _first_out_of_range(end, parameters.size, parameters, least, most)


@compiled
def store_limits(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(guard.LIMITS):
        memory[OWN_MEMORY + i] = parameters[i]


@compiled
def store_gains(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(GAIN_COUNT):
        memory[GAINS + i] = parameters[i]
    for i in range(guard.SPRING_SIZE):
        memory[SPRING + i] = parameters[compiled_laws.STIFFNESS + i]


@compiled
def store_model(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    """Take the gains of a controller with a model, and its cables."""
    store_gains(memory, shape, parameters)
    cables, first = model_memory(memory, shape).cables, GAIN_COUNT
    spring = part(memory, SPRING, guard.SPRING_SIZE)
    spring[:] = 0.0
    for k in range(shape[0]):
        cables.proximal[k], cables.distal[k] = parameters[first], parameters[first + 1]
        sections = shape[1 + shape[0] + k]
        values = part(parameters, first + 2, SCALARS)
        bends = rows_of(parameters, first + 2 + SCALARS, sections, 2)
        kernel.pack(values, bends, cables.n[k], cables.prm[k])
        add_preload(values, bends, cables.distal[k], spring)
        first += 2 + SCALARS + 2 * sections
    spring[guard.STIFFNESS] = stiffness(cables.prm, cables.distal)


@internal
def impossible(readings: FloatArray, count: int, guarded: IntArray) -> int:
    """Return 1 + the place of a reading outside any sensor's range, 0 if there is none.

    `guarded` is 1 for every reading of all axes where the guard of its axis looks at
    it.
    """
    for i in range(count):
        if guarded[i] == 0 and not guard.is_reading(readings[i]):
            return i + 1
    return 0


@internal
def _law_of(memory: FloatArray) -> compiled_laws.Law:
    numbers = part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE)
    return compiled_laws.Law(
        part(memory, GAINS, GAIN_COUNT),
        part(memory, SPRING, guard.SPRING_SIZE),
        numbers,
        numbers[compiled_laws.GUARD + guard.SEEN :],
    )


@internal
def _admitted(data: LawData) -> compiled_laws.Law:
    """Return a law and what its guard lets through; begin where that is due."""
    law = _law_of(data.memory)
    if data.memory[FIRST_STEP] != 0.0:
        law.memory[:] = 0.0
    for i in range(guard.READINGS):
        law.seen[i] = data.readings[i]
    compiled_laws.admit(law)
    return law


@internal
def step_proportional_integral(data: LawData) -> float:
    law = _admitted(data)
    data.memory[FIRST_STEP] = 0.0
    return compiled_laws.proportional_integral(law)


@compiled
def follow_model(data: LawData) -> None:
    """Have the guard check the measurements, and the cables' model follow them."""
    memory, seen = data.memory, _admitted(data).seen
    own = model_memory(memory, data.sizes)
    if memory[FIRST_STEP] != 0.0:
        stepper.set_rest(own.cables, seen[compiled_laws.ANGLE], 0.0, own.state)
        own.direction[:] = 0.0
        own.gain[:] = 1.0
        for i in range(places(data.sizes)[1], memory.size):
            memory[i] = 0.0
        memory[JOINT_ANGLE], memory[FIRST_STEP] = 0.0, 0.0
    memory[JOINT_ANGLE] = follow(
        own, seen[compiled_laws.ANGLE], seen[compiled_laws.TORQUE],
        memory[JOINT_ANGLE], memory[GAINS + compiled_laws.PERIOD],
    )  # fmt: skip


@internal
def model_torque(data: LawData, kind: int) -> float:
    """Return the motor torque of a kind of law, after `follow_model` [N m]."""
    own, law = model_memory(data.memory, data.sizes), _law_of(data.memory)
    if kind == STICTION:
        return compiled_laws.stiction(law, own)
    lacking = 0.0
    if kind == DISTURBANCE:
        known = part(data.memory, places(data.sizes)[1], LACK_SIZE)
        lacking = _learn_lack(data.tables[0], cable_torque(own), law.memory, known)
    return compiled_laws.model_based(law, own, lacking)


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


@internal
def step_forward(data: LawData) -> float:
    data.memory[FIRST_STEP] = 0.0
    gains = part(data.memory, OWN_MEMORY, guard.LIMITS)
    return guard.limited(gains, data.readings[0] / gains[guard.RATIO])


@internal
def step_tuned(data: LawData) -> float:
    law, tables = _admitted(data), data.tables
    signals = part(data.memory, CABLES, compiled_laws.SIGNAL_SIZE)
    if data.memory[FIRST_STEP] != 0.0:
        signals[:] = 0.0
        data.memory[FIRST_STEP] = 0.0
    cables = rows_of(tables, 4, data.sizes[0], data.sizes[1])
    return compiled_laws.tuned_torque(law, cables, part(tables, 0, 4), signals)


@internal
def begun(data: LawData, gains: int, size: int, first: int) -> compiled_laws.Law:
    """Return a law with a copy of the measurements; begin an episode where due.

    The tables begin with the `gains` behind `DriveLimits` and the spring of the cables.
    In the memory the `size` numbers of the law are behind the gains, `first` of them
    the guard.
    """
    memory = data.memory
    for i in range(guard.LIMITS, gains):
        memory[OWN_MEMORY + i] = data.tables[i - guard.LIMITS]
    numbers = part(memory, OWN_MEMORY + gains, size)
    if memory[FIRST_STEP] != 0.0:
        numbers[:] = 0.0
        memory[FIRST_STEP] = 0.0
    seen = part(numbers, first + guard.SEEN, guard.READINGS)
    for i in range(guard.READINGS):
        seen[i] = data.readings[i]
    spring = part(data.tables, gains - guard.LIMITS, guard.SPRING_SIZE)
    return compiled_laws.Law(part(memory, OWN_MEMORY, gains), spring, numbers, seen)


@internal
def step_inverse(data: LawData) -> float:
    gains, size = compiled_laws.INVERSE_GAINS, compiled_laws.INVERSE_SIZE
    law = begun(data, gains, size, compiled_laws.INVERSE_GUARD)
    first = gains - guard.LIMITS + guard.SPRING_SIZE
    cables = rows_of(data.tables, first, data.sizes[0], data.sizes[1])
    return compiled_laws.inverse_torque(law, cables)


@internal
def step_gaussian(data: LawData) -> float:
    gains, size, states = (
        compiled_laws.GAUSSIAN_GAINS, data.sizes[0], compiled_laws.STATES
    )  # fmt: skip
    law, tables = begun(data, gains, size, compiled_laws.GAUSSIAN_GUARD), data.tables
    model = gains - guard.LIMITS + guard.SPRING_SIZE
    read = model + states * (states + 1)
    design = compiled_laws.Design(
        rows_of(tables, model, states, states + 1),
        rows_of(tables, read, 2, states),
        rows_of(tables, read + 2 * states, states, 2),
        part(tables, read + 4 * states, 2),
    )
    scratch = rows_of(data.memory, OWN_MEMORY + gains + size, 2, states)
    return compiled_laws.gaussian_torque(law, design, scratch)
