r"""Slope of the logarithm of tension along the moving parts of a cable.

Where neighbouring segments slip in one direction s, (2.6) says
:math:`d \ln T / dx = s \mu / R`: the logarithm of tension is linear in every parameter
:math:`\theta` in which :math:`\mu/R` is. A reading :math:`y_j = T_j + v_j` gives

.. math::
    \ln y_j + \tfrac12 (\sigma_j/T_j)^2 = c + s\,a_j^T \theta + v_j/T_j,

with the design row :math:`a_j` of its sensor and one unknown level c for every moving
part; the second term corrects, to second order, the bias of the logarithm by noise.
Equations are weighted by :math:`(T_j/\sigma_j)^2`, and c is removed with their weighted
mean. In weights and correction, T is not the reading but the profile that is fitted to
all readings with the present :math:`\theta`: else readings that happen to be high would
have more weight.

A change of direction lies inside a segment, which has neither sign: the two segments
next to it are left out. (In the first and the last segment directions do not show it.
The estimated friction is then too small, by some tenths of a percent in the wrist
scene, which the deviation does not include.) A sensor whose tension is below four times
its noise is left out too.
"""

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._kernel import segment_angles
from cc_mujoco.cable._parameter import Term
from cc_mujoco.device._sensors import Sensors
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, IntArray, compiled, internal


@compiled
def next_run(sign: FloatArray, at: int) -> tuple[int, int, int]:
    """Return first and last node of the run of equal slip at segment `at`, and its end.

    The end is the index of the next run's first segment. The first node is not before
    the last if no segment slips clear of a change of direction.
    """
    end = at + 1
    while end < sign.size and sign[end] == sign[at]:
        end += 1
    if sign[at] == 0.0:
        return at, at, end
    begin = at + 1 if at > 0 and sign[at - 1] == -sign[at] else at
    last = end - 1 if end < sign.size and sign[end] == -sign[at] else end
    return begin, last, end


class SlopeEquations(NamedTuple):
    """Sensors along a cable, and the equations of their readings at one instant."""

    design: (
        FloatMatrix  # of every sensor, d ln T by each parameter, all slip distal (m, p)
    )
    nodes: IntArray  # (m,)
    noise: FloatArray  # standard deviations (m,) [N]
    rows: FloatMatrix  # scratch: rows of one moving part (m, p)
    right: FloatArray  # scratch: its right sides (m,)
    clear: FloatArray  # scratch: its tensions over their noise (m,)
    information: FloatMatrix  # out, of all equations, noise 1, (p, p)
    target: FloatArray  # out (p,)


@compiled
def run_equations(
    equations: SlopeEquations, value: FloatArray, reading: FloatArray, sign: FloatArray
) -> tuple[float, int]:
    """Compute the information of the readings of one instant, with levels eliminated.

    `value` (p,) are the present parameters, `reading` (m,) the tensions of the sensors
    [N], `sign` (n,) the slip of the segments, -1, 0 or 1. Fill `information` and
    `target` of `equations`; return the sum of squares of all right sides, and the
    number of independent equations.
    """
    _, _, _, rows, right, _, information, target = equations
    information[:] = 0.0
    target[:] = 0.0
    power, count, at = 0.0, 0, 0
    while at < sign.size:
        first, last, end = next_run(sign, at)
        if first < last:
            left = _part_equations(equations, first, last, sign[at], value, reading)
            for i in range(left):
                power += right[i] ** 2
                for j in range(value.size):
                    target[j] += rows[i, j] * right[i]
                    for k in range(value.size):
                        information[j, k] += rows[i, j] * rows[i, k]
            count += max(left - 1, 0)
        at = end
    return power, count


@internal
def _part_equations(
    equations: SlopeEquations,
    first: int,
    last: int,
    sign: float,
    value: FloatArray,
    reading: FloatArray,
) -> int:
    """Write the equations of one moving part; return their number."""
    design, nodes, noise, rows, right, clear, _, _ = equations
    count, most = 0, -np.inf
    for j in range(nodes.size):  # logarithm of the profile, for a start
        if first <= nodes[j] <= last:
            right[j] = 0.0
            for k in range(value.size):
                right[j] += sign * design[j, k] * value[k]
            most = max(most, right[j])
            count += 1
    if count < 2:
        return 0
    weighted, squares = 0.0, 0.0
    for j in range(nodes.size):
        if first <= nodes[j] <= last:
            clear[j] = np.exp(right[j] - most) / noise[j]
            weighted += clear[j] * (reading[j] / noise[j])
            squares += clear[j] ** 2
    level, left, total = weighted / squares, 0, 0.0
    for j in range(nodes.size):
        if first <= nodes[j] <= last:
            size = level * clear[j]  # T over its noise
            # A tension below 4 standard deviations of its sensor says nothing, nor does
            # the logarithm of a reading below 5 % of the fitted tension.
            if size >= 4.0 and reading[j] > 0.05 * size * noise[j]:
                clear[left] = size
                right[left] = np.log(reading[j]) + 0.5 / size**2
                for k in range(value.size):
                    rows[left, k] = sign * design[j, k]
                total += size**2
                left += 1
    if left < 2:
        return 0
    for k in range(value.size):
        mean = 0.0
        for i in range(left):
            mean += clear[i] ** 2 * rows[i, k]
        for i in range(left):
            rows[i, k] = clear[i] * (rows[i, k] - mean / total)
    mean = 0.0
    for i in range(left):
        mean += clear[i] ** 2 * right[i]
    for i in range(left):
        right[i] = clear[i] * (right[i] - mean / total)
    return left


def require_slope(cable: Cable) -> None:
    """Refuse a cable in whose moving parts d ln T / dx can differ from s mu/R.

    Friction may change with time if it does so equally along the whole cable.
    """
    cable.require_terms(
        has_slope, "the slope of the logarithm of tension is not that of friction then"
    )


def wrap_angles(cable: Cable) -> FloatArray:
    """Return the wrap angle from the proximal end to every node (n + 1,) [rad]."""
    angles = segment_angles(packed_parameters(cable), cable.segments)
    return np.concatenate([[0.0], np.cumsum(angles)])


def require_bend_between(cable: Cable, sensors: Sensors) -> None:
    """Refuse sensors with no bend between them, which cannot measure friction."""
    if len(set(sensors.nodes)) < 2:
        raise CableError(
            f"sensors are at nodes {list(sensors.nodes)}; a slope takes at least two "
            "different ones"
        )
    if np.ptp(wrap_angles(cable)[sensors.on(cable)]) == 0.0:
        raise CableError(
            "the conduit is straight between the sensors; friction shows only where it "
            "bends"
        )


def has_slope(term: Term) -> bool:
    """Return whether d ln T / dx remains s mu/R with this friction term on."""
    if term.acts_on == "coefficient":
        return set(term.depends_on) <= {"time"}
    return term.acts_on != "drag"
