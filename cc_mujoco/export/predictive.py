"""Functions of `predictive` for C: `control.planning` on the caller's memory.

`shape` goes on behind that of `entries` by the number of delays that may be, and of the
knots of a plan. `tables` are the gains of the plans, those of the unexplained torque
and the weights of accelerations, for every delay. The memory also keeps the cables as
they were given, because they are packed anew whenever their friction is found to be
another. Parameters that are given between two steps are packed in the next one, with
the friction that was learned.
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
COUNT = len(tuning.TUNING)
"""Parameters before those of the cables."""
_GIVEN = _TUNE + COUNT + 1
_ARMS = _GIVEN + 1
READ = len(SEEN)
"""Numbers that are read."""


@compiled
def places(
    cables: int, most: int, sections: int, delays: int, knots: int
) -> tuple[int, int, int, int, int, int]:
    """Return the places of numbers in the memory, as `entries.places`.

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
    packed = scratch + SCALARS + 2 * (knots + 1) + kept + 3 * cables * state
    packed += knots * (4 + knots + planning.VECTORS)
    first = packed + cables * kernel.parameter_size(most)
    new = first + cables * state
    work = new + cables * state
    return scratch, packed, first, new, work, work + kernel.work_size(most)


@internal
def longest(shape: Any) -> tuple[int, int]:
    """Segments of the longest cable, and sections of all of them."""
    cables, most, sections = shape[0], 0, 0
    for k in range(cables):
        most = max(most, shape[1 + k])
        sections += shape[1 + cables + k]
    return most, sections


@internal
def placed(shape: Any) -> tuple[int, int, int, int, int, int]:
    """Return the places of numbers in the memory; see `places`."""
    cables = shape[0]
    most, sections = longest(shape)
    return places(cables, most, sections, shape[1 + 2 * cables], shape[2 + 2 * cables])


@internal
def learned(shape: Any) -> int:
    """Place of what friction is to be multiplied by, until there is a plan."""
    cables = shape[0]
    kept, knots = planning.FRICTION + cables, shape[2 + 2 * cables]
    return int(placed(shape)[0] + SCALARS + 2 * (knots + 1) + kept)


@internal
def given_cable(shape: Any, cable: int) -> int:
    """Place of the scalars of a cable as they were given; its sections are behind."""
    cables = shape[0]
    given = _ARMS + 3 * cables
    for k in range(cable):
        given += SCALARS + 2 * shape[1 + cables + k]
    return int(given)


@internal
def _pack(memory: Any, shape: Any, cable: int, factor: float) -> None:
    """Pack a cable with a multiple of the friction that was given for it."""
    cables, given = shape[0], given_cable(shape, cable)
    scratch, packed, _, _, _, _ = placed(shape)
    size = kernel.parameter_size(longest(shape)[0])
    pack(
        carray(at(memory, given), SCALARS),
        carray(at(memory, given + SCALARS), (shape[1 + cables + cable], 2)),
        shape[1 + cable],
        factor,
        carray(at(memory, scratch), SCALARS),
        carray(at(memory, packed + cable * size), size),
    )


@internal
def wrong_plan(shape: Any, parameters: Any, least: Any, most: Any) -> int:
    """1 + the index of a parameter that cannot be; 0 if there is none."""
    wrong = entries.wrong_motor(
        parameters, least, most, COUNT, tuning.RATIO, tuning.LOW, tuning.HIGH
    )
    if wrong != 0:
        return wrong
    return entries.wrong_cables(shape, parameters, least, most, COUNT)


def set_plan(memory: Any, shape: Any, parameters: Any, least: Any, most: Any) -> int:
    """Take the tuning and the cables.

    Returns:
        0, or 1 + the index of a parameter that cannot be; then nothing is taken.
    """
    wrong = wrong_plan(shape, parameters, least, most)
    if wrong == 0:
        take_plan(memory, shape, parameters)
    return wrong


@internal
def take_plan(memory: Any, shape: Any, parameters: Any) -> None:
    """Take parameters that can be."""
    for i in range(COUNT):
        memory[_TUNE + i] = parameters[i]
    cables = shape[0]
    first, kept = COUNT, _ARMS + 3 * cables
    for k in range(cables):
        memory[_ARMS + k] = parameters[first]
        memory[_ARMS + cables + k] = parameters[first + 1]
        count = SCALARS + 2 * shape[1 + cables + k]
        for i in range(count):
            memory[kept + i] = parameters[first + 2 + i]
        first, kept = first + 2 + count, kept + count
    memory[_GIVEN] = 1.0


def step_plan(memory: Any, shape: Any, tables: Any, readings: Any) -> float:
    """Motor torque of the next step [Nm], or no number where a reading cannot be."""
    if not entries.measured(readings, READ):
        return np.nan
    cables = shape[0]
    _, sections = longest(shape)
    law = _ARMS + 3 * cables + cables * SCALARS + 2 * sections
    kept = carray(at(memory, law), planning.FRICTION + cables)
    if memory[entries.FRESH] != 0.0:
        kept[:] = 0.0
    planning.learned(kept, carray(at(memory, learned(shape)), cables))
    return plan(memory, shape, tables, readings)


@internal
def plan(memory: Any, shape: Any, tables: Any, readings: Any) -> float:
    """Motor torque of the next step [Nm].

    Where `learned` says, the memory has what the friction of every cable is to be
    multiplied by.
    """
    cables = shape[0]
    most, sections = longest(shape)
    delays, knots = shape[1 + 2 * cables], shape[2 + 2 * cables]
    scratch, packed, first, after, work, end = placed(shape)
    size, width = kernel.parameter_size(most), kernel.state_size(most)
    kept, states = planning.FRICTION + cables, (cables, width)
    law = _ARMS + 3 * cables + cables * SCALARS + 2 * sections
    device = planning.PlannerMemory(
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
    free = learned(shape)
    is_fresh = memory[entries.FRESH] != 0.0
    factors = carray(at(memory, _ARMS + 2 * cables), cables)
    found = carray(at(memory, free), cables)
    if is_fresh:
        device.memory[:] = 0.0
        device.applied[:] = 0.0
        factors[:] = 1.0
    for k in range(cables):
        if has_changed(found[k], factors[k]):
            factors[k] = found[k]
            _pack(memory, shape, k, factors[k])
        elif is_fresh or memory[_GIVEN] != 0.0:
            _pack(memory, shape, k, factors[k])
    if memory[_GIVEN] != 0.0:
        memory[_TUNE + tuning.STIFFNESS] = stiffness(prm, distal)
        memory[_GIVEN] = 0.0
    if is_fresh:
        stepper.rest(model, readings[0], 0.0, state)
        memory[entries.JOINT], memory[entries.FRESH] = 0.0, 0.0
    own = packed - knots * (4 + knots + planning.VECTORS)
    room = planning.PlannerWorkspace(
        carray(at(memory, after), states),
        carray(at(memory, free), states),
        carray(at(memory, free + cables * width), states),
        carray(at(memory, free + 2 * cables * width), states),
        carray(at(memory, scratch + SCALARS), knots + 1),
        carray(at(memory, scratch + SCALARS + knots + 1), knots + 1),
        carray(at(memory, scratch + SCALARS + 2 * (knots + 1)), kept),
        carray(at(memory, own), knots),
        carray(at(memory, own + knots), knots),
        carray(at(memory, own + 2 * knots), knots),
        carray(at(memory, own + 3 * knots), knots),
        carray(at(memory, own + 4 * knots), (knots, knots)),
        carray(at(memory, own + (4 + knots) * knots), (planning.VECTORS, knots)),
        carray(at(memory, work), end - work),
    )
    plans = delays * knots * (2 + knots)
    told = planning.Tables(
        carray(tables, (delays, knots, 2 + knots)),
        carray(at(tables, plans), delays),
        carray(at(tables, plans + delays), delays),
        carray(at(memory, _TUNE), COUNT + 1),
    )
    return planning.act(
        model, state, carray(at(memory, entries.JOINT), 1), device,
        carray(readings, READ), told, room,
    )  # fmt: skip
