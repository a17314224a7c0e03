"""What C calls of `predictive`: `control.planning` on memory that the caller owns.

`shape` goes on behind that of `entries` by the number of delays that may be, and of the
knots of a plan. `tables` are the gains of the plans, then those of the unexplained
torque, for every delay. The memory also keeps the cables as they were given, because
they are packed anew whenever their friction is found to be another. Parameters that are
given between two steps are packed in the next one, with the friction that was learned.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]

from cc_mujoco.compiled import compiled, internal
from cc_mujoco.control import planning, tuning
from cc_mujoco.control.model import has_changed, pack, stiffness
from cc_mujoco.control.predictive import SEEN
from cc_mujoco.export import entries
from cc_mujoco.export.entries import at
from cc_mujoco.transmission import kernel, stepper
from cc_mujoco.transmission.packing import SCALARS

_TUNE = entries.FREE
_COUNT = len(tuning.TUNING)
_GIVEN = _TUNE + _COUNT + 1
_ARMS = _GIVEN + 1
_READ = len(SEEN)


@compiled
def places(
    cables: int, most: int, sections: int, delays: int, knots: int
) -> tuple[int, int, int, int, int, int]:
    """Where numbers stand in the memory, as `entries.places`.

    Args:
        cables: How many there are.
        most: Segments of the longest.
        sections: Of all of them.
        delays: That may be.
        knots: Of a plan.
    """
    state = kernel.state_size(most)
    kept = planning.FRICTION + cables
    given = _ARMS + 3 * cables
    scratch = given + cables * SCALARS + 2 * sections
    scratch += kept + delays * (planning.ROTOR + 1)
    packed = scratch + SCALARS + 2 * knots + kept + 3 * cables * state
    first = packed + cables * kernel.parameter_size(most)
    new = first + cables * state
    work = new + cables * state
    return scratch, packed, first, new, work, work + kernel.work_size(most)


@internal
def _places(shape: Any) -> tuple[int, int, int, int, int, int]:
    cables, longest, sections = shape[0], 0, 0
    for k in range(cables):
        longest = max(longest, shape[1 + k])
        sections += shape[1 + cables + k]
    return places(
        cables, longest, sections, shape[1 + 2 * cables], shape[2 + 2 * cables]
    )


@internal
def _pack(memory: Any, shape: Any, cable: int, factor: float) -> None:
    """Pack a cable with a multiple of the friction that was given for it."""
    cables = shape[0]
    given, longest = _ARMS + 3 * cables, 0
    for k in range(cables):
        longest = max(longest, shape[1 + k])
    for k in range(cable):
        given += SCALARS + 2 * shape[1 + cables + k]
    scratch, packed, _, _, _, _ = _places(shape)
    size = kernel.parameter_size(longest)
    pack(
        carray(at(memory, given), SCALARS),
        carray(at(memory, given + SCALARS), (shape[1 + cables + cable], 2)),
        shape[1 + cable],
        factor,
        carray(at(memory, scratch), SCALARS),
        carray(at(memory, packed + cable * size), size),
    )


def set_plan(memory: Any, shape: Any, parameters: Any, least: Any, most: Any) -> int:
    """Take the tuning and the cables.

    Returns:
        0, or 1 + the index of a parameter that cannot be; then nothing is taken.
    """
    wrong = entries.wrong_motor(
        parameters, least, most, _COUNT, tuning.RATIO, tuning.LOW, tuning.HIGH
    )
    if wrong == 0:
        wrong = entries.wrong_cables(shape, parameters, least, most, _COUNT)
    if wrong != 0:
        return wrong
    for i in range(_COUNT):
        memory[_TUNE + i] = parameters[i]
    cables = shape[0]
    first, kept = _COUNT, _ARMS + 3 * cables
    for k in range(cables):
        memory[_ARMS + k] = parameters[first]
        memory[_ARMS + cables + k] = parameters[first + 1]
        count = SCALARS + 2 * shape[1 + cables + k]
        for i in range(count):
            memory[kept + i] = parameters[first + 2 + i]
        first, kept = first + 2 + count, kept + count
    memory[_GIVEN] = 1.0
    return 0


def step_plan(memory: Any, shape: Any, tables: Any, readings: Any) -> float:
    """Motor torque of the next step [Nm], or no number where a reading is none."""
    if not entries.measured(readings, _READ):
        return np.nan
    cables, longest, sections = shape[0], 0, 0
    for k in range(cables):
        longest = max(longest, shape[1 + k])
        sections += shape[1 + cables + k]
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    scratch, packed, first, after, work, end = _places(shape)
    size, width = kernel.parameter_size(longest), kernel.state_size(longest)
    kept, states = planning.FRICTION + cables, (cables, width)
    law = _ARMS + 3 * cables + cables * SCALARS + 2 * sections
    device = planning.Device(
        carray(at(memory, law), kept),
        carray(at(memory, law + kept), (delays, planning.ROTOR)),
        carray(at(memory, law + kept + delays * planning.ROTOR), delays),
    )
    state = carray(at(memory, first), states)
    arm = carray(at(memory, _ARMS), cables)
    distal = carray(at(memory, _ARMS + cables), cables)
    n = carray(at(shape, 1), cables)
    prm = carray(at(memory, packed), (cables, size))
    model = stepper.Cables(prm, n, arm, arm, distal)
    free = scratch + SCALARS + 2 * knots + kept
    is_fresh = memory[entries.FRESH] != 0.0
    factors = carray(at(memory, _ARMS + 2 * cables), cables)
    learned = carray(at(memory, free), cables)  # until there is a plan
    if is_fresh:
        device.memory[:] = 0.0
        device.applied[:] = 0.0
        factors[:] = 1.0
    planning.learned(device.memory, learned)
    for k in range(cables):
        if has_changed(learned[k], factors[k]):
            factors[k] = learned[k]
            _pack(memory, shape, k, factors[k])
        elif is_fresh or memory[_GIVEN] != 0.0:
            _pack(memory, shape, k, factors[k])
    if memory[_GIVEN] != 0.0:
        memory[_TUNE + tuning.STIFFNESS] = stiffness(prm, distal)
        memory[_GIVEN] = 0.0
    if is_fresh:
        stepper.rest(model, readings[0], 0.0, state)
        memory[entries.JOINT], memory[entries.FRESH] = 0.0, 0.0
    room = planning.Room(
        carray(at(memory, after), states),
        carray(at(memory, free), states),
        carray(at(memory, free + cables * width), states),
        carray(at(memory, free + 2 * cables * width), states),
        carray(at(memory, scratch + SCALARS), knots),
        carray(at(memory, scratch + SCALARS + knots), knots),
        carray(at(memory, scratch + SCALARS + 2 * knots), kept),
        carray(at(memory, work), end - work),
    )
    plans = delays * knots * (2 + knots)
    told = planning.Tables(
        carray(tables, (delays, knots, 2 + knots)),
        carray(at(tables, plans), delays),
        carray(at(memory, _TUNE), _COUNT + 1),
    )
    return planning.act(
        model, state, carray(at(memory, entries.JOINT), 1), device,
        carray(readings, _READ), told, room,
    )  # fmt: skip
