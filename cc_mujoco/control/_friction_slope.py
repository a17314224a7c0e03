"""Friction of every cable from tension sensors along it, compiled.

    learn(cables, state, taps, tensions, known, scratch)    # known[:, COEFFICIENT]

This is the compiled form of `estimation._tension_slope`. The estimate of a cable is the
state that `estimation._recursive.update_estimate` keeps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable._layout import segment_angles, slips
from cc_mujoco.cable._stepper import Cables
from cc_mujoco.control._law_steps import part, rows_of
from cc_mujoco.estimation import _recursive as recursive
from cc_mujoco.estimation import _tension_slope as tension_slope
from cc_mujoco.native import FloatArray, FloatMatrix, IntMatrix, internal

READING_INTERVAL, MIN_BELIEVED_FRICTION, FIRST_VARIANCE = 5, 1e-3, 0.2 * 0.2
"""Steps between two readings that are used; least friction coefficient that is assumed;
variance of the coefficient before any reading."""
ESTIMATE_SIZE, COEFFICIENT, VARIANCE = 4, recursive.ESTIMATE, recursive.VARIANCE
"""Size of the estimate of the friction of a cable; places of coefficient, variance."""


class Taps(NamedTuple):
    """Tension sensors along all cables, as many along each."""

    nodes: IntMatrix  # (cables, sensors)
    noise: FloatMatrix  # standard deviations (cables, sensors) [N]
    fading: float  # share of the information that fades with each reading


@internal
def learn(
    cables: Cables,
    state: FloatMatrix,
    taps: Taps,
    readings: FloatMatrix,
    known: FloatMatrix,
    scratch: FloatArray,
) -> None:
    """Update the estimates `known` (cables, `ESTIMATE_SIZE`) by the readings of a step.

    The state is that of the model (cables, numbers); `readings` are tensions (cables,
    sensors) [N]; the scratch has 4 sensors + 2 numbers and the segments of the longest
    cable.
    """
    m = taps.noise.shape[1]
    design, rows = rows_of(scratch, 0, m, 1), rows_of(scratch, m, m, 1)
    right, clear = part(scratch, 2 * m, m), part(scratch, 3 * m, m)
    information, target = rows_of(scratch, 4 * m, 1, 1), part(scratch, 4 * m + 1, 1)
    for k in range(cables.n.size):
        n = cables.n[k]
        angles, slip = segment_angles(cables.prm[k], n), slips(state[k], n)
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
        believed = known[k, COEFFICIENT : COEFFICIENT + 1]
        _, count = tension_slope.run_equations(equations, believed, readings[k], sign)
        gained, least = information[0, 0], 1.0 / FIRST_VARIANCE
        if count > 0 and gained > 0.0:
            recursive.update_estimate(
                known[k], least, taps.fading, 0.0, gained, target[0]
            )
