"""Steps of `predictive` and `adaptive`: `_planning` on the memory of the caller.

`shape` goes on behind that of `_law_steps` by the number of delays that may be, and of
the knots of a plan. `tables` are the gains of the plans, those of the unexplained
torque and the weights of accelerations, for every delay. The memory also keeps the
cables as they were given, because they are packed anew whenever their friction is found
to be another. Parameters that are given between two steps are packed in the next one,
with the friction that was learned.

`shape` of `adaptive` goes on by the number of sensors along a cable, then their nodes,
of every cable. Its `readings` end with the tensions, `parameters` with the standard
deviations of the sensors and `tables` with the share of what is known that a reading
takes away. Behind that of `predictive` its memory keeps for how many steps no reading
was taken, the deviations, and what is known of the friction of every cable.
"""

from __future__ import annotations

from cc_mujoco.cable import _friction as friction
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import SCALARS
from cc_mujoco.control import _friction_slope as friction_slope
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.control import _planner_observer as planner_observer
from cc_mujoco.control import _planning as planning
from cc_mujoco.control._cable_model import add_preload, pack, stiffness
from cc_mujoco.control._law_steps import (
    part,
    rows_of,
    tables_of,
    whole_part,
    whole_rows_of,
)
from cc_mujoco.control._planner_memory import PLANNER_INPUTS
from cc_mujoco.estimation import _tension_slope as tension_slope
from cc_mujoco.native import (
    FloatArray,
    FloatMatrix,
    IntArray,
    compiled,
    internal,
)

_TUNING_START = law_steps.OWN_MEMORY
TUNING_SIZE = len(planner_memory.TUNING)
"""Parameters before those of the cables."""
_PARAMETERS_CHANGED = _TUNING_START + TUNING_SIZE + guard.SPRING_SIZE
_ARMS = _PARAMETERS_CHANGED + 1
INPUT_COUNT = len(PLANNER_INPUTS)
"""Numbers that are read."""


@compiled
def places(
    cables: int, most: int, sections: int, delays: int, knots: int
) -> tuple[int, int, int, int, int, int]:
    """Return the places of numbers in the memory, like `_law_steps.places`.

    `most` are the segments of the longest cable, `sections` those of all of them,
    `delays` what may be, and `knots` those of a plan.
    """
    state = kernel.state_size(most)
    kept = planner_memory.FRICTION + cables
    given = _ARMS + 3 * cables
    scratch = given + cables * SCALARS + 2 * sections
    scratch += kept + delays * (planner_memory.OBSERVER_SIZE + 1) + cables * state
    scratch += knots + 1
    packed = scratch + SCALARS + 2 * (knots + 1) + kept + 3 * cables * state
    packed += knots * (4 + knots + planner_memory.WORK_ROWS)
    first = packed + cables * kernel.parameter_size(most)
    new = first + cables * state
    work = new + cables * state
    return scratch, packed, first, new, work, work + kernel.work_size(most) + 1


@internal
def longest_cable(shape: IntArray) -> tuple[int, int]:
    """Return the segments of the longest cable, and sections of all of them."""
    cables, most, sections = shape[0], 0, 0
    for k in range(cables):
        most = max(most, shape[1 + k])
        sections += shape[1 + cables + k]
    return most, sections


@internal
def memory_places(shape: IntArray) -> tuple[int, int, int, int, int, int]:
    cables = shape[0]
    most, sections = longest_cable(shape)
    return places(cables, most, sections, shape[1 + 2 * cables], shape[2 + 2 * cables])


@internal
def friction_factor_place(shape: IntArray) -> int:
    """Return the place of the initial friction factor, until there is a plan."""
    cables = shape[0]
    kept, knots = planner_memory.FRICTION + cables, shape[2 + 2 * cables]
    return int(memory_places(shape)[0] + SCALARS + 2 * (knots + 1) + kept)


@internal
def law_place(shape: IntArray) -> int:
    """Return the place of the numbers of `_planner_memory`."""
    return int(cable_place(shape, shape[0]))


@internal
def cable_place(shape: IntArray, cable: int) -> int:
    """Return the place of the given scalars of a cable, followed by its sections."""
    cables = shape[0]
    given = _ARMS + 3 * cables
    for k in range(cable):
        given += SCALARS + 2 * shape[1 + cables + k]
    return int(given)


@internal
def _pack(memory: FloatArray, shape: IntArray, cable: int, factor: float) -> None:
    """Pack a cable with a multiple of the friction that was given for it."""
    cables, given = shape[0], cable_place(shape, cable)
    scratch, packed, _, _, _, _ = memory_places(shape)
    size = kernel.parameter_size(longest_cable(shape)[0])
    prm = part(memory, packed + cable * size, size)
    pack(
        part(memory, given, SCALARS),
        rows_of(memory, given + SCALARS, shape[1 + cables + cable], 2),
        shape[1 + cable],
        factor,
        False,
        part(memory, scratch, SCALARS),
        prm,
    )
    _bend(memory, shape, cable, prm)


@internal
def _bends_place(shape: IntArray) -> int:
    """Return the index in memory of the flag of another path, and its angles."""
    cables = shape[0]
    most, _ = longest_cable(shape)
    place = memory_places(shape)[5]
    if shape.size > 3 + 2 * cables:
        place += memory_size(cables, most, _sensor_count(shape))
    return place


@internal
def _bend(memory: FloatArray, shape: IntArray, cable: int, prm: FloatArray) -> None:
    """Give a packed cable the path of `bend`, if there is room and one was given."""
    place, most, n = _bends_place(shape), longest_cable(shape)[0], shape[1 + cable]
    if memory.size > place and memory[place] != 0.0:
        kernel.rebend(prm, n, part(memory, place + 1 + cable * most, n))
        kernel.expect_change(prm)


@compiled
def bend(memory: FloatArray, shape: IntArray, angles: FloatMatrix) -> None:
    """Give the cables other wrap angles (cables, most segments) [rad].

    The memory has room for one number and the angles behind that of the law.
    """
    place, cables = _bends_place(shape), shape[0]
    size, packed = kernel.parameter_size(angles.shape[1]), memory_places(shape)[1]
    memory[place] = 1.0
    for k in range(cables):
        for i in range(angles.shape[1]):
            memory[place + 1 + k * angles.shape[1] + i] = angles[k, i]
        if memory[law_steps.FIRST_STEP] == 0.0:
            _bend(memory, shape, k, part(memory, packed + k * size, size))


@compiled
def store_plan(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(TUNING_SIZE):
        memory[_TUNING_START + i] = parameters[i]
    cables = shape[0]
    first, kept = TUNING_SIZE, _ARMS + 3 * cables
    for k in range(cables):
        memory[_ARMS + k] = parameters[first]
        memory[_ARMS + cables + k] = parameters[first + 1]
        count = SCALARS + 2 * shape[1 + cables + k]
        for i in range(count):
            memory[kept + i] = parameters[first + 2 + i]
        first, kept = first + 2 + count, kept + count
    memory[_PARAMETERS_CHANGED] = 1.0


@internal
def step_plan(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    cables = shape[0]
    kept = part(memory, law_place(shape), planner_memory.FRICTION + cables)
    if memory[law_steps.FIRST_STEP] != 0.0:
        kept[:] = 0.0
    planner_observer.friction_factors(
        kept, part(memory, friction_factor_place(shape), cables)
    )
    return plan(memory, shape, tables, readings)


@internal
def plan(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    """Return the motor torque of the next step [N m].

    Where `friction_factor_place` says, the memory has what the friction of every cable
    is to be multiplied by.
    """
    cables = shape[0]
    most, _ = longest_cable(shape)
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    scratch, packed, first, after, work, end = memory_places(shape)
    size, width = kernel.parameter_size(most), kernel.state_size(most)
    kept = planner_memory.FRICTION + cables
    law = law_place(shape)
    device = planner_memory.PlannerMemory(
        part(memory, law, kept),
        rows_of(memory, law + kept, delays, planner_memory.OBSERVER_SIZE),
        part(memory, scratch - delays, delays),
        rows_of(memory, scratch - delays - cables * width, cables, width),
        part(memory, scratch - delays - cables * width - knots - 1, knots + 1),
    )
    state = rows_of(memory, first, cables, width)
    arm = part(memory, _ARMS, cables)
    distal = part(memory, _ARMS + cables, cables)
    n = whole_part(shape, 1, cables)
    prm = rows_of(memory, packed, cables, size)
    model = stepper.Cables(prm, n, arm, arm, distal)
    free = friction_factor_place(shape)
    is_fresh = memory[law_steps.FIRST_STEP] != 0.0
    factors = part(memory, _ARMS + 2 * cables, cables)
    found = part(memory, free, cables)
    if is_fresh:
        device.memory[:] = 0.0
        device.applied[:] = 0.0
        factors[:] = 1.0
    for k in range(cables):
        # Packing a cable for every last bit would take longer than stepping it.
        has_changed = abs(found[k] / factors[k] - 1.0) > 0.01
        if has_changed:
            factors[k] = found[k]
        if has_changed or is_fresh or memory[_PARAMETERS_CHANGED] != 0.0:
            _pack(memory, shape, k, factors[k])
    if memory[_PARAMETERS_CHANGED] != 0.0:
        spring = part(
            memory, _TUNING_START + planner_memory.STIFFNESS, guard.SPRING_SIZE
        )
        spring[:] = 0.0
        for k in range(cables):
            place, sections_of = cable_place(shape, k), shape[1 + cables + k]
            add_preload(
                part(memory, place, SCALARS),
                rows_of(memory, place + SCALARS, sections_of, 2),
                distal[k],
                spring,
            )
        spring[guard.STIFFNESS] = stiffness(prm, distal)
        memory[_PARAMETERS_CHANGED] = 0.0
    if is_fresh:
        stepper.set_rest(model, readings[0], 0.0, state)
        memory[law_steps.JOINT_ANGLE], memory[law_steps.FIRST_STEP] = 0.0, 0.0
    own = packed - knots * (4 + knots + planner_memory.WORK_ROWS)
    plan_scratch = planner_memory.PlannerWorkspace(
        rows_of(memory, after, cables, width),
        rows_of(memory, free, cables, width),
        rows_of(memory, free + cables * width, cables, width),
        rows_of(memory, free + 2 * cables * width, cables, width),
        part(memory, scratch + SCALARS, knots + 1),
        part(memory, scratch + SCALARS + knots + 1, knots + 1),
        part(memory, scratch + SCALARS + 2 * (knots + 1), kept),
        part(memory, own, knots),
        part(memory, own + knots, knots),
        part(memory, own + 2 * knots, knots),
        part(memory, own + 3 * knots, knots),
        rows_of(memory, own + 4 * knots, knots, knots),
        rows_of(memory, own + (4 + knots) * knots, planner_memory.WORK_ROWS, knots),
        part(memory, work, end - work - 1),
        part(memory, end - 1, 1),
    )
    plans = delays * knots * (2 + knots)
    plan_tables = planner_memory.Tables(
        tables_of(tables, 0, delays, knots, 2 + knots),
        part(tables, plans, delays),
        part(tables, plans + delays, delays),
        part(memory, _TUNING_START, TUNING_SIZE + guard.SPRING_SIZE),
    )
    return planning.motor_torque(
        model, state, part(memory, law_steps.JOINT_ANGLE, 1), device,
        part(readings, 0, INPUT_COUNT), plan_tables, plan_scratch,
    )  # fmt: skip


_FRICTION = friction.INDEX["friction"]


@compiled
def memory_size(cables: int, most: int, sensors: int) -> int:
    """Return how many numbers the memory has behind those of `predictive`.

    `most` are the segments of the longest cable.
    """
    return (
        1 + cables * (sensors + friction_slope.ESTIMATE_SIZE) + most + 4 * sensors + 2
    )


@internal
def _sensor_count(shape: IntArray) -> int:
    return int(shape[3 + 2 * shape[0]])


@compiled
def store_sensed(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    """Take the tuning, the cables and the deviations of the sensors."""
    _, sections = longest_cable(shape)
    first = TUNING_SIZE + shape[0] * (2 + SCALARS) + 2 * sections
    count = shape[0] * _sensor_count(shape)
    store_plan(memory, shape, parameters)
    own = memory_places(shape)[5] + 1
    for i in range(count):
        memory[own + i] = parameters[first + i]


@internal
def step_sensed(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    """Return the motor torque of the next step [N m]."""
    cables, sensors = shape[0], _sensor_count(shape)
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    longest, _ = longest_cable(shape)
    _, packed, state, _, _, own = memory_places(shape)
    kept = own + 1 + cables * sensors
    work = kept + cables * friction_slope.ESTIMATE_SIZE
    known = rows_of(memory, kept, cables, friction_slope.ESTIMATE_SIZE)
    factors = part(memory, friction_factor_place(shape), cables)
    is_fresh = memory[law_steps.FIRST_STEP] != 0.0
    if is_fresh:
        memory[own] = 0.0
    for k in range(cables):
        believed = memory[cable_place(shape, k) + _FRICTION]
        if is_fresh:
            friction_slope.reset_estimate(known[k], believed)
        factors[k] = friction_slope.friction_factor(
            known[k, friction_slope.COEFFICIENT], believed
        )
    torque = plan(memory, shape, tables, readings)
    if memory[own] == 0.0:
        friction_slope.learn(
            rows_of(memory, packed, cables, kernel.parameter_size(longest)),
            whole_part(shape, 1, cables),
            rows_of(memory, state, cables, kernel.state_size(longest)),
            friction_slope.Taps(
                whole_rows_of(shape, 4 + 2 * cables, cables, sensors),
                rows_of(memory, own + 1, cables, sensors),
                tables[delays * (knots * (2 + knots) + 2)],
            ),
            rows_of(readings, INPUT_COUNT, cables, sensors),
            known,
            friction_slope.SlopeWorkspace(
                part(memory, work, longest),
                rows_of(memory, work + longest, sensors, 1),
                tension_slope.EquationWorkspace(
                    rows_of(memory, work + longest + sensors, sensors, 1),
                    part(memory, work + longest + 2 * sensors, sensors),
                    part(memory, work + longest + 3 * sensors, sensors),
                    rows_of(memory, work + longest + 4 * sensors, 1, 1),
                    part(memory, work + longest + 4 * sensors + 1, 1),
                ),
            ),
        )
    memory[own] += 1.0
    if memory[own] == friction_slope.READING_INTERVAL:
        memory[own] = 0.0
    return torque
