"""State of a cable, read from the kernel states of any number of simulations."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._cable import Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.native import ByteMatrix, FloatMatrix, compiled
from cc_mujoco.native import FloatArray as Floats

PATH_MEMORY = 7
"""Number of entries in a plugin's state between the kernel's state and the path's."""


@dataclass(frozen=True)
class CableReading:
    """State of one cable, or of one cable in many simulations (leading axes).

    Attributes:
        tension: tension of the nodes from proximal to distal, (..., n + 1) [N].
        slip: direction in which each segment slips, 0 where it rests, (..., n).
        tension_proximal: tension at the motor's end [N].
        tension_distal: tension at the joint's end [N].
        moving_fraction: fraction of the segments that slip.
        slack: length of cable that lies slack in the conduit [m].
        dissipated: energy lost to friction since the reset [J].
    """

    tension: Floats
    slip: NDArray[np.int8]
    tension_proximal: float | Floats
    tension_distal: float | Floats
    moving_fraction: float | Floats
    slack: float | Floats
    dissipated: float | Floats


def read_states(
    states: Floats,
    start: int,
    compliance: Floats,
    strain: float = 0.0,
    lengths: int = -1,
) -> CableReading:
    """Return the reading of one cable in simulations with `states` (k, m).

    The bits are the same for one simulation and for many. The cable's state begins at
    column `start`. A slack node has `compliance` (n + 1,) [m/N]; on an open path that
    leaves out its rope, which has `strain` per tension [1/N]. Path lengths of nodes
    begin at column `lengths`, -1 if the path is not open.
    """
    n = len(compliance) - 1
    tension = np.empty((len(states), n + 1))
    slip = np.empty((len(states), n), np.int8)
    numbers = np.empty((5, len(states)))
    _read(states, start, lengths, compliance, strain, tension, slip, numbers)
    return CableReading(tension, slip, *numbers)


@lru_cache(maxsize=256)
def guided_compliance(cable: Cable) -> Floats:
    """Return compliances of a cable's nodes, if slack, in a conduit (n + 1,) [m/N]."""
    prm, n = packed_parameters(cable), cable.segments
    return np.array([-nodes.node_stretch(prm, n, i, -1.0) for i in range(n + 1)])


def slack_compliance(
    cable: Cable, packed: Floats | None = None
) -> tuple[Floats, float]:
    """Return `compliance` and `strain` of `read_states` for a cable on an open path.

    `packed` are its packed parameters on that path, needed if it has clearance.
    """
    springs = np.zeros(cable.segments + 1)
    springs[0], springs[-1] = cable.proximal_compliance, cable.end_compliance
    if packed is not None:
        for i in range(springs.size):
            springs[i] = -nodes.given_between(packed, cable.segments, i, 0.0, -1.0)
    strain = 1.0 / cable.axial_stiffness
    if cable.bedding_strain > 0.0:
        strain += cable.bedding_strain / cable.bedding_tension
    return springs, strain


@compiled
def _read(
    states: FloatMatrix, start: int, lengths: int, compliance: Floats, strain: float,
    tension: FloatMatrix, slip: ByteMatrix, numbers: FloatMatrix,
) -> None:  # fmt: skip
    """Read a cable, with arguments of `read_states`, to the last three arguments.

    `numbers` (5, k) are the last five fields of `CableReading`.
    """
    n = slip.shape[1]
    for row in range(states.shape[0]):
        state = states[row, start:]
        node, slipped = at.tensions(state, n), at.slips(state, n)
        moving, slack = 0, 0.0
        # A separate loop without calls, so that the compiler can vectorise it.
        for i in range(n + 1):
            tension[row, i] = 0.0 if node[i] < 0.0 else node[i]
        for i in range(n + 1):
            if not node[i] >= 0.0:
                given = node[i] * compliance[i]
                if lengths >= 0:
                    length, stretched = states[row, lengths + i], 1.0 + node[i] * strain
                    slack += (length - given) / stretched - length
                else:
                    slack -= given
        for j in range(n):
            slip[row, j] = (slipped[j] > 0.0) - (slipped[j] < 0.0)
            moving += slipped[j] != 0.0
        numbers[0, row], numbers[1, row] = tension[row, 0], tension[row, n]
        numbers[2, row], numbers[3, row] = moving / n, slack
        numbers[4, row] = state[2]
