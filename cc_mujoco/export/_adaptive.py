"""Functions of `adaptive` for C: `predictive`, with friction from tension sensors.

`shape` goes on behind that of `predictive` by the number of sensors along a cable, then
their nodes, of every cable. `readings` end with the tensions, `parameters` with the
standard deviations of the sensors and `tables` with the share of what is known that a
reading takes away. Behind that of `predictive` the memory keeps for how many steps no
reading was taken, the deviations, and what is known of the friction of every cable.
"""

from __future__ import annotations

from cc_mujoco.cable import _friction as friction
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._layout import SCALARS
from cc_mujoco.control import _friction_slope as friction_slope
from cc_mujoco.estimation import _tension_slope as tension_slope
from cc_mujoco.export import _entry_points as entry_points
from cc_mujoco.export import _predictive as predictive
from cc_mujoco.export._entry_points import part, rows_of, whole_part, whole_rows_of
from cc_mujoco.native import FloatArray, IntArray, compiled, internal

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
def _deviations_place(shape: IntArray) -> int:
    """Return the place of the first deviation among the parameters."""
    _, sections = predictive.longest_cable(shape)
    return int(predictive.TUNING_SIZE + shape[0] * (2 + SCALARS) + 2 * sections)


@internal
def _sensor_count(shape: IntArray) -> int:
    return int(shape[3 + 2 * shape[0]])


def wrong_sensed(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible parameter, 0 if there is none."""
    first, count = _deviations_place(shape), shape[0] * _sensor_count(shape)
    wrong = predictive.wrong_plan(shape, parameters, least, most)
    if wrong != 0:
        return wrong
    return entry_points.first_out_of_range(
        first, first + count, parameters, least, most
    )


def store_sensed(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    """Take the tuning, the cables and the deviations of the sensors."""
    first, count = _deviations_place(shape), shape[0] * _sensor_count(shape)
    predictive.store_plan(memory, shape, parameters)
    own = predictive.memory_places(shape)[5] + 1
    for i in range(count):
        memory[own + i] = parameters[first + i]


def step_sensed(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    """Return the motor torque of the next step [N m]."""
    cables, sensors = shape[0], _sensor_count(shape)
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    longest, _ = predictive.longest_cable(shape)
    _, packed, state, _, _, own = predictive.memory_places(shape)
    kept = own + 1 + cables * sensors
    work = kept + cables * friction_slope.ESTIMATE_SIZE
    known = rows_of(memory, kept, cables, friction_slope.ESTIMATE_SIZE)
    factors = part(memory, predictive.friction_factor_place(shape), cables)
    is_fresh = memory[entry_points.FIRST_STEP] != 0.0
    if is_fresh:
        memory[own] = 0.0
    for k in range(cables):
        believed = memory[predictive.cable_place(shape, k) + _FRICTION]
        if is_fresh:
            friction_slope.reset_estimate(known[k], believed)
        factors[k] = friction_slope.friction_factor(
            known[k, friction_slope.COEFFICIENT], believed
        )
    torque = predictive.plan(memory, shape, tables, readings)
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
            rows_of(readings, predictive.INPUT_COUNT, cables, sensors),
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
