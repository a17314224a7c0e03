"""Longest time step that a cable bears, compiled.

The force of a cable is explicit, as MuJoCo knows it at the start of a step only, but
for ends that `ahead.py` makes implicit. An end is a spring, at its stiffest where
friction holds all but the outermost part of the cable (`kernel.end_stiffness`). The
ends i of all cables of a model, of stiffness k_i and with moments J_i on the joints,
have with the inertia M of the model

    G_ij = sqrt(k_i k_j) J_i M^-1 J_j^T

whose largest eigenvalue is the square of the highest frequency w; steps below 2 / w are
stable. An open path has such a spring in every node of its pieces. Instead of w the
rows give a bound for every spring,

    w_i^2 = sum_j |G_ij| sqrt(G_jj / G_ii),

of which the largest is no less than w, and is w where the ends move one joint each.
Under RK4 the step may be longer by up to sqrt(2).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cc_mujoco.engine import fields, pieces
from cc_mujoco.engine.block import (
    DISTAL,
    GUIDED,
    MOUTH,
    PROXIMAL,
    ROUTE,
    SCRATCH,
    SEGMENTS,
    TIED,
    displacement,
    opens,
    parameters_at,
    shape_at,
    wound,
)
from cc_mujoco.engine.config import constant
from cc_mujoco.engine.memory import (
    Bytes,
    append,
    append_milliseconds,
    assign,
    dot,
    fill,
    floats,
    internal,
    load_integer,
    load_real,
    load_word,
    solve_inertia,
    vanishes,
)
from cc_mujoco.transmission import kernel

Floats = npt.NDArray[np.float64]

_ENDS = (
    constant("its proximal end"),
    constant("its distal end"),
    constant("its open path"),
)
_NEEDS = constant(" is stable only with a `timestep` below ")
_IS = constant(", but that is ")
_ADVICE = constant(
    "; shorten it, or give what this moves more inertia (`armature`) or the cable "
    "fewer `segments`"
)


@internal
def limits(model: int, data: int, instance: int, out: Floats) -> None:
    """Longest stable time step of a cable (3,) [s].

    That of the proximal end, the distal end and the pieces of an open path; infinite
    for what moves nothing. Needs the inertia and the actuators of the present position
    (part of `mj_fwdPosition`).
    """
    nv, count = fields.dofs(model), 0
    kind = fields.integer(model, fields.PLUGIN, instance)
    for other in range(fields.plugins(model)):
        if fields.integer(model, fields.PLUGIN, other) == kind:
            count += _rows(fields.block(data, other))
    moment, solved = np.zeros((count, nv)), np.zeros((count, nv))
    square = np.zeros(count)
    begin = end = row = 0  # of the rows of this instance
    for other in range(fields.plugins(model)):
        if fields.integer(model, fields.PLUGIN, other) == kind:
            block = fields.block(data, other)
            rows = _rows(block)
            if rows > 0 and nv > 0:
                _ends(model, data, block, moment[row : row + 2])
                _pieces(model, data, block, moment[row + 2 : row + rows])
            if other == instance:
                begin, end = row, row + rows
            row += rows
    for i in range(count):
        if not vanishes(moment[i]):
            solve_inertia(model, data, solved[i].ctypes.data, moment[i].ctypes.data, 1)
            square[i] = max(dot(moment[i], solved[i]), 0.0)
    fill(out, math.inf)
    for i in range(begin, end):
        total = 0.0
        for j in range(count if square[i] > 0.0 else 0):
            shared = abs(dot(moment[i], solved[j]))
            total += shared * math.sqrt(square[j] / square[i])
        if total > 0.0:
            near = min(i - begin, 2)
            out[near] = min(out[near], 2.0 / math.sqrt(total))


@internal
def _rows(block: int) -> int:
    """Number of springs of a cable: its ends, and the nodes of an open path."""
    if block == 0:
        return 0
    return 2 + (load_word(block + SEGMENTS) + 1 if opens(block) else 0)


@internal
def _ends(model: int, data: int, block: int, out: Floats) -> None:
    """Moments of both ends on the degrees of freedom, times sqrt(k) (2, nv)."""
    n = load_word(block + SEGMENTS)
    prm = floats(parameters_at(block), kernel.parameter_size(n))
    for end in range(2):
        if load_word(block + TIED + 8 * end) != 0:
            continue
        output = load_word(block + (DISTAL if end else PROXIMAL))
        scale = math.sqrt(kernel.end_stiffness(prm, n, end == 1))
        if end == 0:
            # The lever of a pulley that is not round differs from its gear.
            lever = wound(model, block, displacement(data, block, PROXIMAL))[1]
            scale *= abs(lever)
        start = fields.integer(data, fields.MOMENT_ROWADR, output)
        columns = load_word(data + fields.MOMENT_COLIND) + 4 * start
        values = load_word(data + fields.MOMENT) + 8 * start
        for i in range(fields.integer(data, fields.MOMENT_ROWNNZ, output)):
            out[end, load_integer(columns + 4 * i)] = scale * load_real(values + 8 * i)


@internal
def _pieces(model: int, data: int, block: int, out: Floats) -> None:
    """Moments of the nodes of an open path, times sqrt(k) (n + 1, nv)."""
    if not opens(block):
        return
    n = load_word(block + SEGMENTS)
    prm = floats(parameters_at(block), kernel.parameter_size(n))
    stiffness = kernel.node_stiffness(prm, n)
    shape = floats(shape_at(block, n, 0), pieces.shape_size(n))
    node = np.zeros(n + 1)
    tried, solved = np.empty(out.shape[1]), np.empty(out.shape[1])
    for i in range(n + 1):
        node[i] = math.sqrt(stiffness[i])
        # A piece whose points coincide has no direction yet, and opens along any.
        worst, aside = 0.0, -1
        while aside < 3 and (aside < 0 or vanishes(out[i]) or worst > 0.0):
            fill(tried, 0.0)
            pieces.pull(
                model, data, load_word(block + ROUTE), load_word(block + MOUTH), shape,
                n, load_word(block + GUIDED), node, 0.0, aside, block + SCRATCH,
                tried.ctypes.data,
            )  # fmt: skip
            solve_inertia(model, data, solved.ctypes.data, tried.ctypes.data, 1)
            square = dot(tried, solved)
            if aside < 0 or square > worst:
                assign(out[i], tried)
                worst = square if aside >= 0 else 0.0
            aside += 1
        node[i] = 0.0


@internal
def name(message: Bytes, used: int, part: int, step: float) -> int:
    """Add a part and a time step, by which a warning is known whatever the limit.

    Returns:
        The new length.
    """
    used = append(message, used, _ENDS[part])
    return append_milliseconds(message, used, step)


@internal
def explain(message: Bytes, used: int, part: int, limit: float, step: float) -> int:
    """Add that a time step is too long for a part, as in `limits`; times in seconds.

    Returns:
        The new length.
    """
    used = append(message, used, _ENDS[part])
    used = append(message, used, _NEEDS)
    used = append_milliseconds(message, used, limit)
    used = append(message, used, _IS)
    used = append_milliseconds(message, used, step)
    return append(message, used, _ADVICE)
