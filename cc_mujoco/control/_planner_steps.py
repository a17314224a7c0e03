"""Steps of `predictive` and `adaptive`: `_planning` on the memory of the caller.

`shape` is that of `_law_steps`, then the number of possible delays and that of the
knots of a plan. `tables` are the gains of the plans, those of the unexplained torque
and the weights of accelerations, for every delay. The memory also keeps the parameters
of the cables, because they are packed anew whenever the estimate of their friction
changes. Parameters that are given between two steps are packed in the next one, with
the friction that was learned.

For `adaptive`, `shape` continues with the number of sensors along a cable, then their
nodes, of every cable. Its `readings` end with the tensions, `parameters` with the
standard deviations of the sensors and `tables` with the share of information that fades
with a reading. The memory continues with the number of steps since the last reading,
scratch, and the friction estimate of every cable.
"""

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._layout import SCALARS, segment_angles, slips
from cc_mujoco.cable._mesh import SECTION_SIZE
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.control import _planning as planning
from cc_mujoco.control._cable_model import add_preload, pack, set_stiffness
from cc_mujoco.control._law_steps import (
    OWN_MEMORY,
    LawData,
    longest_cable,
    part,
    rows_of,
    tables_of,
    whole_part,
    whole_rows_of,
)
from cc_mujoco.control._planner_memory import STIFFNESS, Planner
from cc_mujoco.estimation import _tension_slope as tension_slope
from cc_mujoco.estimation._recursive import ESTIMATE, VARIANCE, update_estimate
from cc_mujoco.native import (
    FloatArray,
    FloatMatrix,
    IntArray,
    IntMatrix,
    compiled,
    internal,
)

_TUNING, _SPRING, CHANGED, LAW = (
    OWN_MEMORY,
    OWN_MEMORY + STIFFNESS,
    OWN_MEMORY + STIFFNESS + guard.SPRING_SIZE,
    OWN_MEMORY + STIFFNESS + guard.SPRING_SIZE + 1,
)
"""Places in the memory: the gains; the spring; 1 if parameters or path were changed
since the last step; `Planner.memory`, followed by the states of the cables."""
READING_INTERVAL, MIN_BELIEVED_FRICTION, FIRST_VARIANCE = 5, 1e-3, 0.2 * 0.2
"""Steps between two tension readings that are used; least friction coefficient that a
model has; variance of the coefficient before any reading."""
COEFFICIENT, ESTIMATE_SIZE = ESTIMATE, 4
"""Place of the coefficient in the friction estimate of a cable, and the estimate's
size; see `update_estimate`."""


class Taps(NamedTuple):
    """Tension sensors of a controller, an equal number along each cable."""

    nodes: IntMatrix  # nodes where they are (cables, sensors)
    noise: FloatMatrix  # standard deviations (cables, sensors) [N]
    fading: float  # share of the earlier information that a reading takes away


@internal
def _sensor_count(shape: IntArray) -> int:
    """Return the number of sensors along a cable."""
    place = 3 + 2 * shape[0]
    return int(shape[place]) if shape.size > place else 0


@compiled
def places(shape: IntArray) -> tuple[int, int, int]:
    """Return the indices of two parts of the memory, and its size.

    The parts are the parameters behind the gains, and the states of the cables. The
    number before the former is the last command.
    """
    cables, most, sensors = shape[0], longest_cable(shape), _sensor_count(shape)
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    kept = planner_memory.FRICTION + cables
    given = LAW + kept + delays
    first = given
    for k in range(cables):
        first += 2 + SCALARS + SECTION_SIZE * shape[1 + cables + k] + sensors
    size = first + cables * (6 * kernel.state_size(most) + kernel.parameter_size(most))
    size += kept + 4 * cables + SCALARS + delays * planner_memory.OBSERVER_SIZE
    size += 3 * (knots + 1) + (4 + planner_memory.WORK_ROWS + knots) * knots
    size += kernel.work_size(most) + 1
    if sensors > 0:
        size += 3 + most + 4 * sensors + cables * ESTIMATE_SIZE
    return int(given), int(first), int(size)


@internal
def _planner(data: LawData) -> Planner:
    """Return views of the memory and of the tables, as a `Planner`."""
    memory, shape, tables = data.memory, data.sizes, data.tables
    cables, most = shape[0], longest_cable(shape)
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    kept, plan_size = planner_memory.FRICTION + cables, delays * knots * (2 + knots)
    given, place, _ = places(shape)
    parameters = part(memory, given, place - given)
    states = rows_of(memory, place, 6 * cables, kernel.state_size(most))
    place += states.size
    prm = rows_of(memory, place, cables, kernel.parameter_size(most))
    place += prm.size
    of_cables = rows_of(memory, place, 4, cables)
    place += of_cables.size
    rotors = rows_of(memory, place, delays, planner_memory.OBSERVER_SIZE)
    place += rotors.size
    plans = rows_of(memory, place, 3, knots + 1)
    place += plans.size
    vectors = rows_of(memory, place, 4 + planner_memory.WORK_ROWS, knots)
    place += vectors.size
    matrix = rows_of(memory, place, knots, knots)
    ahead = place + matrix.size
    values = ahead + kept
    work = part(memory, values + SCALARS, kernel.work_size(most))
    end = values + SCALARS + work.size + 1
    n, proximal = whole_part(shape, 1, cables), of_cables[0]
    return Planner(
        stepper.Cables(prm, n, proximal, proximal, of_cables[1]),
        planner_memory.Tables(
            tables_of(tables, 0, delays, knots, 2 + knots),
            part(tables, plan_size, delays), part(tables, plan_size + delays, delays),
        ),
        part(memory, _TUNING, CHANGED - _TUNING),
        part(memory, law_steps.JOINT_ANGLE, 1),
        part(memory, LAW, kept), rotors, part(memory, LAW + kept, delays),
        plans[0], plans[1], plans[2],
        states[:cables], states[cables : 2 * cables],
        states[2 * cables : 3 * cables], states[3 * cables : 4 * cables],
        states[4 * cables : 5 * cables], states[5 * cables :],
        part(memory, ahead, kept), vectors[0], vectors[1], vectors[2], vectors[3],
        vectors[4:], matrix, of_cables[2:], part(memory, values, SCALARS), work,
        part(memory, end - 1, 1), parameters, end,
    )  # fmt: skip


@compiled
def store_plan(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    """Store gains, cables and standard deviations of the sensors in the memory."""
    given, _, _ = places(shape)
    memory[_TUNING:_SPRING] = parameters[:STIFFNESS]
    memory[given : given + parameters.size - STIFFNESS] = parameters[STIFFNESS:]
    memory[CHANGED] = 1.0


@internal
def step_plan(data: LawData) -> float:
    planner = _planner(data)
    if data.memory[law_steps.FIRST_STEP] != 0.0:
        planner.memory[:] = 0.0
    for k in range(data.sizes[0]):
        planner.friction[1, k] = np.exp(planner.memory[planner_memory.FRICTION + k])
    return _planned(planner, data)


@internal
def _planned(planner: Planner, data: LawData) -> float:
    """Return the motor torque of the next step [N m]; reset the memory if it is first.

    Cables are packed anew if their parameters have changed, or a factor on friction in
    row 1 of `planner.friction` by more than 1 %.
    """
    memory, shape, readings = data.memory, data.sizes, data.readings
    cables, is_fresh = planner.cables, memory[law_steps.FIRST_STEP] != 0.0
    factors, given = planner.friction[0], planner.given
    if is_fresh:
        planner.memory[:] = 0.0
        planner.applied[:] = 0.0
        factors[:] = 1.0
    has_parameters = memory[CHANGED] != 0.0
    spring = part(memory, _SPRING, guard.SPRING_SIZE)
    if has_parameters:
        spring[:] = 0.0
    place, bends, most = 0, places(shape)[2], longest_cable(shape)
    for k in range(cables.n.size):
        n, sections = cables.n[k], shape[1 + cables.n.size + k]
        values = part(given, place + 2, SCALARS)
        conduit = rows_of(given, place + 2 + SCALARS, sections, SECTION_SIZE)
        cables.proximal[k], cables.distal[k] = given[place], given[place + 1]
        # Packing a cable for every last bit would take longer than stepping it.
        has_changed = abs(planner.friction[1, k] / factors[k] - 1.0) > 0.01
        if has_changed:
            factors[k] = planner.friction[1, k]
        if has_changed or is_fresh or has_parameters:
            prm = cables.prm[k]
            pack(values, conduit, n, factors[k], False, planner.values, prm)
            if memory.size > bends and memory[bends] != 0.0:
                kernel.rebend(prm, n, part(memory, bends + 1 + k * most, n))
                kernel.expect_change(prm)
        if has_parameters:
            add_preload(values, conduit, cables.distal[k], spring)
        place += 2 + SCALARS + SECTION_SIZE * sections
    if has_parameters:
        limits = guard.limits_of(planner.tune)
        set_stiffness(cables, guard.largest_torque(limits), spring)
        memory[CHANGED] = 0.0
    if is_fresh:
        stepper.set_rest(cables, readings[0], 0.0, planner.state)
        planner.joint[0], memory[law_steps.FIRST_STEP] = 0.0, 0.0
    return planning.motor_torque(planner, readings)


@internal
def _learn_friction(
    planner: Planner,
    taps: Taps,
    readings: FloatMatrix,
    known: FloatMatrix,
    scratch: FloatArray,
) -> None:
    """Update the estimates `known` (cables, `ESTIMATE_SIZE`) by the readings of a step.

    `readings` are tensions (cables, sensors) [N], with the equations of
    `estimation._tension_slope`. `scratch` has 4 m + 2 + n numbers, of m sensors along a
    cable and n segments of the longest cable.
    """
    cables, m = planner.cables, taps.noise.shape[1]
    design, rows = rows_of(scratch, 0, m, 1), rows_of(scratch, m, m, 1)
    right, clear = part(scratch, 2 * m, m), part(scratch, 3 * m, m)
    information, target = rows_of(scratch, 4 * m, 1, 1), part(scratch, 4 * m + 1, 1)
    for k in range(cables.n.size):
        n = cables.n[k]
        angles, slip = segment_angles(cables.prm[k], n), slips(planner.state[k], n)
        sign = part(scratch, 4 * m + 2, n)
        for i in range(n):
            sign[i] = np.sign(slip[i])
        for j in range(m):
            design[j, 0] = 0.0
            for i in range(taps.nodes[k, j]):
                design[j, 0] += angles[i]
        nodes, noise = taps.nodes[k], taps.noise[k]
        equations = tension_slope.SlopeEquations(
            design, nodes, noise, rows, right, clear, information, target
        )
        believed = part(known[k], COEFFICIENT, 1)
        _, count = tension_slope.run_equations(equations, believed, readings[k], sign)
        gained, least = information[0, 0], 1.0 / FIRST_VARIANCE
        if count > 0 and gained > 0.0:
            update_estimate(known[k], least, taps.fading, 0.0, gained, target[0])


@internal
def step_sensed(data: LawData) -> float:
    memory, shape, tables = data.memory, data.sizes, data.tables
    planner, sensors = _planner(data), _sensor_count(shape)
    count, since = planner.cables.n.size, planner.end
    scratch = part(memory, since + 1, longest_cable(shape) + 4 * sensors + 2)
    place = since + 1 + scratch.size
    known = rows_of(memory, place, count, ESTIMATE_SIZE)
    is_fresh, place = memory[law_steps.FIRST_STEP] != 0.0, 0
    if is_fresh:
        memory[since] = 0.0
    for k in range(count):
        believed = planner.given[place + 2 + PLACE.friction]
        if is_fresh:
            known[k, :] = 0.0
            known[k, COEFFICIENT] = believed
            known[k, VARIANCE] = FIRST_VARIANCE
        found = known[k, COEFFICIENT]
        found = max(found, MIN_BELIEVED_FRICTION)
        planner.friction[1, k] = found / believed
        place += 2 + SCALARS + SECTION_SIZE * shape[1 + count + k]
    torque = _planned(planner, data)
    if memory[since] == 0.0:
        taps = Taps(
            whole_rows_of(shape, 4 + 2 * count, count, sensors),
            rows_of(planner.given, place, count, sensors),
            tables[tables.size - 1],
        )
        first = len(planner_memory.PLANNER_INPUTS)
        tensions = rows_of(data.readings, first, count, sensors)
        _learn_friction(planner, taps, tensions, known, scratch)
    memory[since] += 1.0
    if memory[since] == READING_INTERVAL:
        memory[since] = 0.0
    return torque
