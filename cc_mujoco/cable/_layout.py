"""Layout of the numbers of a cable: packed parameters and state, and views of both.

    prm = np.empty(parameter_size(n))
    segment_angles(prm, n)[3]          # wrap angle of a segment [rad]
    tensions(state, n)[0]              # of the proximal end [N]

Both vectors have a header of single numbers, then rows of one number per node or
segment. Every offset derives from the rows before it; nothing else counts them.

State vector:

    0, 1               displacement of the proximal and the distal end [m]
    2                  energy dissipated so far [J]
    3                  stretch of the cable, negative where it is slack [m]; 0 where its
                       path may lengthen, so that the ends do not determine it
    4                  time since the start [s], while a term depends on the state
    5                  travel of the distal end since the start [m], likewise
    6                  heat of friction in the conduit [J], while friction depends on it
    7, 8               T_held of hysteretic springs at both ends [N], see `_elasticity`
    9 : 10 + n         tension of node i [N]; negative where slack
    then n each        slip of segment j since it last stuck or turned [m], 0 = at rest
                       remembered slip speed of segment j [m/s]
                       friction of segment j that its bristles hold [N]
                       stretch of these bristles [m]
                       age of the contacts of segment j, see `_friction.age_after_step`
    10 + 6 n :         rope on the drum of either end, see `_drum.py`; 0 where the path
                       cannot lengthen, but for the wrap angle of the rest pose [rad],
                       times `clearance_factors`, where they count, see `rest_wrap`
"""

from typing import NamedTuple

from cc_mujoco.cable._cable import PARAMETERS
from cc_mujoco.native import FloatArray, compiled, internal

SCALARS = len(PARAMETERS)
"""Number of scalar parameters, with which packed parameters begin."""
(
    BENDS_CHANGE, STATE_DEPENDENT, CONSTANT_COULOMB, LENGTH, GUIDED, PATH_LENGTHENS,
    YIELD_PROXIMAL, YIELD_DISTAL, CURVED, HELD_PROXIMAL, HELD_DISTAL, RATIO_PROXIMAL,
    RATIO_DISTAL,
) = range(SCALARS, SCALARS + 13)  # fmt: skip
"""Indices of the entries behind the scalar parameters.

1 if bends may change; 1 for `is_state_dependent` and for `is_constant_coulomb` of
`_friction.py`; length of the cable [m]; number of segments inside a conduit; 1 if the
path may lengthen; compliance of the supports of the ends in the next step [m/N]; result
of `_nodes.curvature`; entries 7 and 8 of the state before the step [N]; stretched over
unstretched length of the rope at either end, 1 where the path cannot lengthen.
"""
_ROWS_START = SCALARS + 13

STATE_HEADER = 9
"""Number of entries of a state before the tensions."""
TIME, TRAVEL, HEAT, HELD_TENSIONS = 4, 5, 6, 7
_SEGMENT_STATE = 5
DRUM_LAYERS = 6
"""Largest number of layers of different strain on a drum."""
_DRUM_SIZE = 2 + 2 * DRUM_LAYERS
_SOLVER_WORK = 11  # numbers of scratch per node for `march` and `sweep`
(
    SHIFT, SLIPPED, GROWTH, GROWTH_PROXIMAL, HOLD_DISTAL, HOLD_PROXIMAL, DRAG,
    VISCOSITY, SPRING, HELD, SPEED,
) = range(11)  # fmt: skip
"""Rows of scratch behind that of the solvers, one number per segment, see `row`."""
RELEASED_ENERGY = SPRING
_STEP_WORK = 11
# Rows of scratch behind these, one number per node, see `node_row`.
_NODE_WORK = 4


@compiled
def state_size(n: int) -> int:
    return STATE_HEADER + 1 + (1 + _SEGMENT_STATE) * n + 2 * _DRUM_SIZE


@internal
def rest_wrap(n: int) -> int:
    """Return the state's index of `_nodes.wrap_with_play` in the rest pose [rad].

    The entry is negative until the bends of a model's pose `qpos0` are measured.
    """
    return STATE_HEADER + 1 + (1 + _SEGMENT_STATE) * n


@compiled
def parameter_size(n: int) -> int:
    return _ROWS_START + 14 * n + 4


@compiled
def scalars(prm: FloatArray) -> FloatArray:
    """Return the scalar parameters in the order of `PARAMETERS`."""
    return prm[:SCALARS]


@compiled
def segment_angles(prm: FloatArray, n: int) -> FloatArray:
    """Wrap angle of every segment (n,) [rad]."""
    return prm[_ROWS_START : _ROWS_START + n]


@compiled
def constant_growth(prm: FloatArray, n: int) -> FloatArray:
    """Return the tension ratio E of slip by segment (n,), if friction is constant."""
    return prm[_ROWS_START + n : _ROWS_START + 2 * n]


@compiled
def constant_hold(prm: FloatArray, n: int) -> FloatArray:
    """Return the tension ratio H at rest by segment (n,), if friction is constant."""
    return prm[_ROWS_START + 2 * n : _ROWS_START + 3 * n]


@compiled
def constant_drag(prm: FloatArray, n: int) -> FloatArray:
    """Return the drag B by segment (n,) [N], if friction is constant."""
    return prm[_ROWS_START + 3 * n : _ROWS_START + 4 * n]


@compiled
def node_compliance(prm: FloatArray, n: int) -> FloatArray:
    """Return the compliance of every node (n + 1,) [m/N]."""
    return prm[_ROWS_START + 4 * n : _ROWS_START + 5 * n + 1]


@compiled
def node_stiffness(prm: FloatArray, n: int) -> FloatArray:
    """Return the stiffness of every node (n + 1,) [N/m]."""
    return prm[_ROWS_START + 5 * n + 1 : _ROWS_START + 6 * n + 2]


@compiled
def node_length(prm: FloatArray, n: int) -> FloatArray:
    """Return the length of cable that every node represents (n + 1,) [m].

    Where the path may lengthen, it is EA times the compliance of the node's cable.
    """
    return prm[_ROWS_START + 6 * n + 2 : _ROWS_START + 7 * n + 3]


@compiled
def contact_length(prm: FloatArray, n: int) -> FloatArray:
    """Return the length over which every segment rubs (n,) [m]."""
    return prm[_ROWS_START + 7 * n + 3 : _ROWS_START + 8 * n + 3]


@compiled
def lengthening(prm: FloatArray, n: int) -> FloatArray:
    """Return the stretch that its path adds to every node next step (n + 1,) [m]."""
    return prm[_ROWS_START + 8 * n + 3 : _ROWS_START + 9 * n + 4]


@compiled
def half_compliance(prm: FloatArray, n: int) -> FloatArray:
    """Return the compliance of half of every segment's contact length (n,) [m/N]."""
    return prm[_ROWS_START + 9 * n + 4 : _ROWS_START + 10 * n + 4]


@internal
def total(values: FloatArray) -> float:
    whole = 0.0
    for i in range(values.size):
        whole += values[i]
    return whole


@compiled
def carried_path(prm: FloatArray, n: int) -> FloatArray:
    """Return the path length that moves across every segment in a step (n,) [m]."""
    return prm[_ROWS_START + 10 * n + 4 : _ROWS_START + 11 * n + 4]


@compiled
def carried_cable(prm: FloatArray, n: int) -> FloatArray:
    """Return the unstretched cable that the path carries along with it (n,) [m]."""
    return prm[_ROWS_START + 11 * n + 4 : _ROWS_START + 12 * n + 4]


@compiled
def clearance_factors(prm: FloatArray, n: int) -> FloatArray:
    """Return the factor of every segment on the cable's `clearance` (n,)."""
    return prm[_ROWS_START + 12 * n + 4 : _ROWS_START + 13 * n + 4]


@compiled
def seating_factors(prm: FloatArray, n: int) -> FloatArray:
    """Return the factor of every segment on the cable's `seating_tension` (n,)."""
    return prm[_ROWS_START + 13 * n + 4 : _ROWS_START + 14 * n + 4]


@compiled
def tensions(state: FloatArray, n: int) -> FloatArray:
    """Return the tension of every node (n + 1,) [N]; negative where slack."""
    return state[STATE_HEADER : STATE_HEADER + n + 1]


@internal
def _segment_row(state: FloatArray, n: int, row: int) -> FloatArray:
    start = STATE_HEADER + 1 + (1 + row) * n
    return state[start : start + n]


@compiled
def slips(state: FloatArray, n: int) -> FloatArray:
    """Return the slip of every segment since it last stuck or turned (n,) [m]."""
    return _segment_row(state, n, 0)


@compiled
def slip_speeds(state: FloatArray, n: int) -> FloatArray:
    """Return the remembered slip speed of every segment (n,) [m/s]."""
    return _segment_row(state, n, 1)


@compiled
def bristle_forces(state: FloatArray, n: int) -> FloatArray:
    """Return the friction of every segment that its bristles hold (n,) [N]."""
    return _segment_row(state, n, 2)


@compiled
def bristle_stretches(state: FloatArray, n: int) -> FloatArray:
    """Stretch of the bristles of every segment (n,) [m]."""
    return _segment_row(state, n, 3)


@compiled
def contact_ages(state: FloatArray, n: int) -> FloatArray:
    """Return the contact age of every segment (n,), see `_friction.age_after_step`."""
    return _segment_row(state, n, 4)


@compiled
def drum(state: FloatArray, n: int, end: int) -> FloatArray:
    """Return the memory of the drum at an end (0, 1), see `_drum.py`."""
    start = STATE_HEADER + 1 + (1 + _SEGMENT_STATE) * n + _DRUM_SIZE * end
    return state[start : start + _DRUM_SIZE]


@compiled
def work_size(n: int) -> int:
    return (_SOLVER_WORK + _NODE_WORK) * (n + 1) + _STEP_WORK * n


@internal
def row(work: FloatArray, n: int, i: int) -> FloatArray:
    """Return row i of the scratch with one number per segment (n,)."""
    start = _SOLVER_WORK * (n + 1) + i * n
    return work[start : start + n]


@internal
def node_row(work: FloatArray, n: int, i: int) -> FloatArray:
    """Return row i of the scratch with one number per node (n + 1,)."""
    start = _SOLVER_WORK * (n + 1) + _STEP_WORK * n + i * (n + 1)
    return work[start : start + n + 1]


class Step(NamedTuple):
    """States, scratch and prescribed ends of one step of a cable."""

    state: FloatArray  # state before the step
    new_state: FloatArray  # state after it, the result
    work: FloatArray  # scratch of `work_size`
    dt: float  # time step [s]
    proximal: float  # displacement [m] or tension [N] of that end after the step
    distal: float  # the same of the distal end
