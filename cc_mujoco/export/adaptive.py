"""Functions of `adaptive` for C: `predictive`, with friction from tension sensors.

`shape` goes on behind that of `predictive` by the number of sensors along a cable, then
their nodes, of every cable. `readings` end with the tensions, `parameters` with the
standard deviations of the sensors and `tables` with the share of what is known that a
reading takes away. Behind that of `predictive` the memory keeps for how many steps no
reading was taken, the deviations, and what is known of the friction of every cable.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]

from cc_mujoco.compiled import compiled, internal
from cc_mujoco.control import slopes
from cc_mujoco.estimation import slope
from cc_mujoco.export import entries, predictive
from cc_mujoco.export.entries import at
from cc_mujoco.transmission import friction, kernel
from cc_mujoco.transmission.packing import SCALARS

_FRICTION = friction.INDEX["friction"]


@compiled
def room(cables: int, most: int, sensors: int) -> int:
    """Return how many numbers the memory has behind those of `predictive`.

    Args:
        cables: How many there are.
        most: Segments of the longest.
        sensors: Along a cable.
    """
    return 1 + cables * (sensors + slopes.KNOWN) + most + 4 * sensors + 2


@internal
def _deviations(shape: Any) -> int:
    """Place of the first deviation among the parameters."""
    _, sections = predictive.longest(shape)
    return int(predictive.COUNT + shape[0] * (2 + SCALARS) + 2 * sections)


@internal
def _sensors(shape: Any) -> int:
    """Return the number of sensors along a cable."""
    return int(shape[3 + 2 * shape[0]])


def set_sensed(memory: Any, shape: Any, parameters: Any, least: Any, most: Any) -> int:
    """Take the tuning, the cables and the deviations of the sensors.

    Returns:
        0, or 1 + the index of a parameter that cannot be; then nothing is taken.
    """
    first, count = _deviations(shape), shape[0] * _sensors(shape)
    wrong = predictive.wrong_plan(shape, parameters, least, most)
    if wrong == 0:
        wrong = entries.admitted(first, first + count, parameters, least, most)
    if wrong != 0:
        return wrong
    predictive.take_plan(memory, shape, parameters)
    own = predictive.placed(shape)[5] + 1
    for i in range(count):
        memory[own + i] = parameters[first + i]
    return 0


def step_sensed(memory: Any, shape: Any, tables: Any, readings: Any) -> float:
    """Motor torque of the next step [Nm], or no number where a reading cannot be."""
    cables, sensors = shape[0], _sensors(shape)
    if not entries.measured(readings, predictive.READ + cables * sensors):
        return np.nan
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    longest, _ = predictive.longest(shape)
    _, packed, state, _, _, own = predictive.placed(shape)
    kept = own + 1 + cables * sensors
    work = kept + cables * slopes.KNOWN
    known = carray(at(memory, kept), (cables, slopes.KNOWN))
    factors = carray(at(memory, predictive.learned(shape)), cables)
    is_fresh = memory[entries.FRESH] != 0.0
    if is_fresh:
        memory[own] = 0.0
    for k in range(cables):
        believed = memory[predictive.given_cable(shape, k) + _FRICTION]
        if is_fresh:
            slopes.start(known[k], believed)
        factors[k] = slopes.believed(known[k, slopes.VALUE], believed)
    torque = predictive.plan(memory, shape, tables, readings)
    if memory[own] == 0.0:
        slopes.learn(
            carray(at(memory, packed), (cables, kernel.parameter_size(longest))),
            carray(at(shape, 1), cables),
            carray(at(memory, state), (cables, kernel.state_size(longest))),
            slopes.Taps(
                carray(at(shape, 4 + 2 * cables), (cables, sensors)),
                carray(at(memory, own + 1), (cables, sensors)),
                tables[delays * (knots * (2 + knots) + 2)],
            ),
            carray(at(readings, predictive.READ), (cables, sensors)),
            known,
            slopes.SlopeWorkspace(
                carray(at(memory, work), longest),
                carray(at(memory, work + longest), (sensors, 1)),
                slope.EquationWorkspace(
                    carray(at(memory, work + longest + sensors), (sensors, 1)),
                    carray(at(memory, work + longest + 2 * sensors), sensors),
                    carray(at(memory, work + longest + 3 * sensors), sensors),
                    carray(at(memory, work + longest + 4 * sensors), (1, 1)),
                    carray(at(memory, work + longest + 4 * sensors + 1), 1),
                ),
            ),
        )
    memory[own] += 1.0
    if memory[own] == slopes.EVERY:
        memory[own] = 0.0
    return torque
