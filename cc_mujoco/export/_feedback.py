"""Functions for C of laws without a model of the cables, and the numbers they rest on.

What rests on rotor, cables and delay stands in `tables`; no parameter changes it.
"""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np

from cc_mujoco.control import (
    BacklashInverse,
    FeedForward,
    LinearQuadraticGaussian,
    ProportionalIntegral,
    TunedFeedback,
)
from cc_mujoco.control import _backlash_inverse as backlash_inverse
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _gaussian as gaussian
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _tuned_feedback as tuned_feedback
from cc_mujoco.export import _entry_points as entry_points
from cc_mujoco.export._entry_points import CABLES, FIRST_STEP, OWN_MEMORY, part, rows_of
from cc_mujoco.native import FloatArray, IntArray, internal


class LawTables(NamedTuple):
    """Numbers of a law besides its parameters and those of its cables.

    Attributes:
        shape: whole numbers, see `_entry_points`; of a law without a model.
        numbers: those that no parameter changes.
        memory_size: numbers in the memory; of a law with a model those of its own.
        given: places of the last torque in the memory, of a law without a model.
    """

    shape: tuple[int, ...] = ()
    numbers: tuple[float, ...] = ()
    memory_size: int = 0
    given: tuple[int, ...] = ()


NO_TABLES = LawTables()


def forward_tables(law: FeedForward) -> LawTables:
    """Return the numbers of `none`."""
    return LawTables(memory_size=OWN_MEMORY + guard.LIMITS)


def feedback_tables(law: ProportionalIntegral) -> LawTables:
    """Return the numbers of `pi` and `feedback`."""
    return LawTables(memory_size=CABLES, given=(entry_points.LAST_COMMAND,))


def tuned_tables(law: TunedFeedback) -> LawTables:
    """Return the numbers of `pi_tuned` and `pi_feed_forward`."""
    cables = law.cables[0]
    return LawTables(
        cables.shape,
        (*law.settings, *cables.ravel().tolist()),
        CABLES + tuned_feedback.SIGNAL_SIZE,
        (entry_points.LAST_COMMAND,),
    )


def inverse_tables(law: BacklashInverse) -> LawTables:
    """Return the numbers of `inverse`."""
    cables = law.cables[0]
    numbers = law.gains[guard.LIMITS :], law.springs[0], cables.ravel()
    first = OWN_MEMORY + backlash_inverse.GAINS
    return LawTables(
        cables.shape,
        tuple(np.concatenate(numbers).tolist()),
        first + backlash_inverse.MEMORY_SIZE,
        (first + backlash_inverse.LAST_COMMAND,),
    )


def gaussian_tables(law: LinearQuadraticGaussian) -> LawTables:
    """Return the numbers of `lqg`."""
    numbers = law.gains[guard.LIMITS :], law.springs[0], *map(np.ravel, law.design)
    first, size = OWN_MEMORY + gaussian.GAINS, law.memory_size
    return LawTables(
        (size,),
        tuple(map(float, chain(*numbers))),
        first + size + 2 * gaussian.STATES,
        (first + size - 1, first + gaussian.LAST_COMMAND),
    )


def wrong_limits(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible limit, 0 if there is none."""
    return entry_points.wrong_motor(
        parameters, least, most, guard.LIMITS, guard.RATIO, guard.LOW, guard.HIGH
    )


def store_limits(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(guard.LIMITS):
        memory[OWN_MEMORY + i] = parameters[i]


def step_forward(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    memory[FIRST_STEP] = 0.0
    gains = part(memory, OWN_MEMORY, guard.LIMITS)
    return compiled_laws.feed_forward(gains, readings[0])


def step_tuned(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    seen = entry_points.admitted(memory, readings)
    signals = part(memory, CABLES, tuned_feedback.SIGNAL_SIZE)
    if memory[FIRST_STEP] != 0.0:
        signals[:] = 0.0
        memory[FIRST_STEP] = 0.0
    return tuned_feedback.tuned_torque(
        part(memory, entry_points.GAINS, entry_points.GAIN_COUNT),
        part(memory, entry_points.SPRING, guard.SPRING_SIZE),
        rows_of(tables, 4, shape[0], shape[1]),
        part(tables, 0, 4),
        part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE),
        signals,
        seen,
    )


@internal
def _begun(
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


def step_inverse(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    gains, size = backlash_inverse.GAINS, backlash_inverse.MEMORY_SIZE
    seen = _begun(memory, tables, gains, size, backlash_inverse.GUARD, readings)
    spring = gains - guard.LIMITS
    return backlash_inverse.motor_torque(
        part(memory, OWN_MEMORY, gains),
        part(tables, spring, guard.SPRING_SIZE),
        rows_of(tables, spring + guard.SPRING_SIZE, shape[0], shape[1]),
        part(memory, OWN_MEMORY + gains, size),
        seen,
    )


def step_gaussian(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    gains, size, states = gaussian.GAINS, shape[0], gaussian.STATES
    seen = _begun(memory, tables, gains, size, gaussian.GUARD, readings)
    spring = gains - guard.LIMITS
    model = spring + guard.SPRING_SIZE
    read = model + states * (states + 1)
    return gaussian.motor_torque(
        part(memory, OWN_MEMORY, gains),
        part(tables, spring, guard.SPRING_SIZE),
        gaussian.Design(
            rows_of(tables, model, states, states + 1),
            rows_of(tables, read, 2, states),
            rows_of(tables, read + 2 * states, states, 2),
            part(tables, read + 4 * states, 2),
        ),
        part(memory, OWN_MEMORY + gains, size),
        seen,
        rows_of(memory, OWN_MEMORY + gains + size, 2, states),
    )
