"""Friction of every cable from tension sensors along it, compiled.

    found = taps(drive.sensors, drive.cables, memory=200.0)
    learn(prm, n, state, found, tensions, known, room)    # known[:, VALUE]

This is the compiled form of `estimation._tension_slope`. The estimate of a cable is the
state that `estimation._recursive.update_estimate` keeps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable._layout import segment_angles, slips
from cc_mujoco.cable._stepper import Counts
from cc_mujoco.device._drive import CableDrive
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.estimation import _recursive as recursive
from cc_mujoco.estimation import _tension_slope as tension_slope
from cc_mujoco.native import (
    FloatArray,
    FloatCube,
    FloatMatrix,
    IntMatrix,
    compiled,
)

READING_INTERVAL = 5
"""Steps between two readings that are taken."""
MIN_BELIEVED_FRICTION = 1e-3
"""Friction coefficient that is at least believed."""
INITIAL_DEVIATION = 0.2
"""Standard deviation of the friction coefficient that is believed at first."""

ESTIMATE_SIZE, COEFFICIENT = 4, recursive.ESTIMATE
"""Numbers that are known of the friction of a cable; place of its coefficient."""


class Taps(NamedTuple):
    """Tension sensors along all cables, as many along each.

    Attributes:
        nodes: (cables, sensors).
        noise: standard deviations (cables, sensors) [N].
        fading: share of what is known that a reading takes away.
    """

    nodes: IntMatrix
    noise: FloatMatrix
    fading: float


class SlopeWorkspace(NamedTuple):
    """Room to compute in; nothing is kept in it.

    Attributes:
        sign: (segments of the longest cable,).
        design: (sensors, 1).
        equations: of one parameter.
    """

    sign: FloatArray
    design: FloatMatrix
    equations: tension_slope.EquationWorkspace


def taps(
    sensors: Sequence[Sensors], cables: Sequence[CableDrive], memory: float
) -> Taps:
    """Return the sensors along the cables of a device.

    Args:
        sensors: Of every cable.
        cables: All of them.
        memory: Readings after which one has faded to 1/e.

    Raises:
        CableError: They are not as many along every cable, or cannot tell.
    """
    if len({len(own.nodes) for own in sensors}) > 1:
        raise CableError(
            "Drive.sensors must be as many along every cable, not "
            f"{', '.join(str(len(own.nodes)) for own in sensors)}."
        )
    for own, one in zip(sensors, cables, strict=True):
        tension_slope.require_bend_between(one.cable, own)
    return Taps(
        np.array([own.nodes for own in sensors], dtype=np.int64),
        np.array([own.deviation for own in sensors]),
        1.0 - math.exp(-1.0 / memory),
    )


def make_scratch(sensors: int, longest: int) -> SlopeWorkspace:
    """Return scratch memory for a number of sensors and of segments."""
    return SlopeWorkspace(
        np.empty(longest),
        np.empty((sensors, 1)),
        tension_slope.make_scratch(sensors, 1),
    )


@compiled
def reset_estimate(known: FloatArray, friction: float) -> None:
    """Write the initial estimate, before any reading (KNOWN,)."""
    known[:] = 0.0
    known[recursive.ESTIMATE] = friction
    known[recursive.VARIANCE] = INITIAL_DEVIATION * INITIAL_DEVIATION


@compiled
def friction_factor(found: float, friction: float) -> float:
    """Return the factor on a friction coefficient."""
    return max(found, MIN_BELIEVED_FRICTION) / friction


@compiled
def learn(
    prm: FloatMatrix,
    n: Counts,
    state: FloatMatrix,
    taps: Taps,
    told: FloatMatrix,
    known: FloatMatrix,
    room: SlopeWorkspace,
) -> None:
    """Take the readings of one instant of one device.

    Args:
        prm: packed parameters (cables, numbers).
        n: segments of every cable.
        state: of the model (cables, numbers).
        taps: see there.
        told: tensions (cables, sensors) [N].
        known: moved on (cables, KNOWN).
        room: scratch.
    """
    sensors = taps.noise.shape[1]
    for k in range(n.size):
        angles, slip = segment_angles(prm[k], n[k]), slips(state[k], n[k])
        sign = room.sign[: n[k]]
        for i in range(n[k]):
            sign[i] = np.sign(slip[i])
        for j in range(sensors):
            room.design[j, 0] = 0.0
            for i in range(taps.nodes[k, j]):
                room.design[j, 0] += angles[i]
        _, count = tension_slope.run_equations(
            room.design,
            taps.nodes[k],
            taps.noise[k],
            known[k, COEFFICIENT : COEFFICIENT + 1],
            told[k],
            sign,
            room.equations,
        )
        information = room.equations.information[0, 0]
        if count > 0 and information > 0.0:
            recursive.update_estimate(
                known[k],
                1.0 / (INITIAL_DEVIATION * INITIAL_DEVIATION),
                taps.fading,
                0.0,
                information,
                room.equations.target[0],
            )


@compiled
def learn_all(
    prm: FloatCube,
    n: Counts,
    states: FloatCube,
    taps: Taps,
    told: FloatCube,
    calls: NDArray[np.int64],
    known: FloatCube,
    room: SlopeWorkspace,
) -> None:
    """Take the readings of every device whose turn it is; see `learn`.

    Args:
        prm: (rows, cables, numbers).
        n: segments of every cable.
        states: (rows, cables, numbers).
        taps: of all.
        told: (rows, cables, sensors) [N].
        calls: of this function since an episode began (rows,); counted.
        known: moved on (rows, cables, KNOWN).
        room: scratch.
    """
    for row in range(calls.size):
        if calls[row] % READING_INTERVAL == 0:
            learn(prm[row], n, states[row], taps, told[row], known[row], room)
        calls[row] += 1
