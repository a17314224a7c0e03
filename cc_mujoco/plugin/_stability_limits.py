"""Longest time step that a cable bears, compiled.

The force of a cable is explicit, because MuJoCo knows it only at the start of a step,
except at ends that `_implicit_ends.py` makes implicit. An end is a spring. It is
stiffest where friction holds all but the outermost part of the cable
(`cable._nodes.end_stiffness`). The ends i of all cables of a model, of stiffness k_i
and with moments J_i on the joints, have with the inertia M of the model

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

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin._config import constant
from cc_mujoco.plugin._evaluate import packed_block
from cc_mujoco.plugin._ffi import (
    Bytes,
    FloatMatrix,
    append,
    append_milliseconds,
    assign,
    borrow_floats,
    borrow_rows,
    dot,
    fill,
    floats,
    free_stack,
    internal,
    is_zero,
    load_integer,
    load_real,
    load_word,
    mark_stack,
    solve_inertia,
)

Floats = npt.NDArray[np.float64]

_PART_NAMES = (
    constant("its proximal end"),
    constant("its distal end"),
    constant("its open path"),
)
_STABLE_BELOW = constant(" is stable only with a `timestep` below ")
_ACTUAL_STEP = constant(", but that is ")
_ADVICE = constant(
    "; shorten it, or give what this moves more inertia (`armature`) or the cable "
    "fewer `segments`"
)


@internal
def stable_timesteps(model: int, data: int, instance: int, out: Floats) -> None:
    """Compute the longest stable time steps of a cable (3,) [s].

    That of the proximal end, the distal end and the pieces of an open path; infinite
    for what moves nothing. Needs the inertia and the actuators of the present position
    (part of `mj_fwdPosition`).
    """
    nv, count = mj_struct.dofs(model), 0
    kind = mj_struct.integer(model, mj_struct.PLUGIN, instance)
    for other in range(mj_struct.plugins(model)):
        if mj_struct.integer(model, mj_struct.PLUGIN, other) == kind:
            count += _spring_count(packed_block(model, data, other))
    mark_stack(data)
    moment = borrow_rows(data, count, nv)
    begin = end = row = 0  # of the rows of this instance
    for other in range(mj_struct.plugins(model)):
        if mj_struct.integer(model, mj_struct.PLUGIN, other) == kind:
            block = packed_block(model, data, other)
            rows = _spring_count(block)
            if rows > 0 and nv > 0:
                _end_moments(model, data, block, moment[row : row + 2])
                _piece_moments(model, data, block, moment[row + 2 : row + rows])
            if other == instance:
                begin, end = row, row + rows
            row += rows
    fill(out, math.inf)
    limit = borrow_floats(data, end - begin)
    spring_timesteps(model, data, moment, begin, limit)
    for i in range(limit.size):
        near = min(i, 2)
        out[near] = min(out[near], limit[i])
    free_stack(data)


@internal
def spring_timesteps(
    model: int, data: int, moment: FloatMatrix, begin: int, out: Floats
) -> None:
    """Compute the longest stable time steps [s] of springs that act together.

    `moment` has their moments on the joints, times the root of their stiffness (k, nv).
    The limits are those of the springs from `begin` on, as many as `out` takes.
    """
    mark_stack(data)
    solved = borrow_rows(data, moment.shape[0], moment.shape[1])
    square = borrow_floats(data, moment.shape[0])
    for i in range(square.size):
        square[i] = 0.0
        if not is_zero(moment[i]):
            solve_inertia(model, data, solved[i].ctypes.data, moment[i].ctypes.data, 1)
            square[i] = max(dot(moment[i], solved[i]), 0.0)
    fill(out, math.inf)
    for i in range(begin, begin + out.size):
        total = 0.0
        for j in range(square.size if square[i] > 0.0 else 0):
            shared = abs(dot(moment[i], solved[j]))
            total += shared * math.sqrt(square[j] / square[i])
        if total > 0.0:
            out[i - begin] = 2.0 / math.sqrt(total)
    free_stack(data)


@internal
def _spring_count(block: int) -> int:
    """Return the number of springs of a cable: its ends and its open path's nodes."""
    if block == 0:
        return 0
    return 2 + (load_word(block + blocks.SEGMENTS) + 1 if blocks.is_open(block) else 0)


@internal
def _end_moments(model: int, data: int, block: int, out: FloatMatrix) -> None:
    """Compute the moments of both ends on the joints, times sqrt(k) (2, nv)."""
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    for end in range(2):
        if load_word(block + blocks.TIED_ENDS + 8 * end) != 0:
            continue
        output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
        scale = math.sqrt(kernel.end_stiffness(prm, n, end == 1))
        if end == 0:
            # The lever of a pulley that is not round differs from its gear.
            lever = blocks.proximal_winding(
                model, block, blocks.displacement(data, block, blocks.PROXIMAL)
            )[1]
            scale *= abs(lever)
        start = mj_struct.integer(data, mj_struct.MOMENT_ROWADR, output)
        columns = load_word(data + mj_struct.MOMENT_COLIND) + 4 * start
        values = load_word(data + mj_struct.ACTUATOR_MOMENT) + 8 * start
        for i in range(mj_struct.integer(data, mj_struct.MOMENT_ROWNNZ, output)):
            out[end, load_integer(columns + 4 * i)] = scale * load_real(values + 8 * i)


@internal
def _piece_moments(model: int, data: int, block: int, out: FloatMatrix) -> None:
    """Compute the moments of an open path's nodes, times sqrt(k) (n + 1, nv)."""
    if not blocks.is_open(block):
        return
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    shape = floats(blocks.shape_at(block, n, 0), open_path.shape_size(n))
    tendon, mouth = load_word(block + blocks.ROUTE), load_word(block + blocks.MOUTH)
    node_moments(
        model, data, tendon, mouth, shape, n, load_word(block + blocks.GUIDED),
        kernel.node_stiffness(prm, n), block + blocks.SCRATCH, out,
    )  # fmt: skip


@internal
def node_moments(
    model: int,
    data: int,
    tendon: int,
    mouth: int,
    shape: Floats,
    n: int,
    guided: int,
    stiffness: Floats,
    scratch: int,
    out: FloatMatrix,
) -> None:
    """Compute the moments of an open path's nodes, times sqrt(stiffness) (n + 1, nv).

    Other arguments are those of `open_path.apply_pulls`; `out` is 0 before.
    """
    mark_stack(data)
    node = borrow_floats(data, n + 1)
    tried = borrow_floats(data, out.shape[1])
    solved = borrow_floats(data, out.shape[1])
    fill(node, 0.0)
    for i in range(n + 1):
        node[i] = math.sqrt(stiffness[i])
        # A piece whose points coincide has no direction yet, and opens along any.
        worst, aside = 0.0, -1
        while aside < 3 and (aside < 0 or is_zero(out[i]) or worst > 0.0):
            fill(tried, 0.0)
            open_path.apply_pulls(
                model, data, tendon, mouth, shape, n, guided, node, 0.0, aside,
                scratch, tried.ctypes.data,
            )  # fmt: skip
            solve_inertia(model, data, solved.ctypes.data, tried.ctypes.data, 1)
            square = dot(tried, solved)
            if aside < 0 or square > worst:
                assign(out[i], tried)
                worst = square if aside >= 0 else 0.0
            aside += 1
        node[i] = 0.0
    free_stack(data)


@internal
def append_part(message: Bytes, used: int, part: int, step: float) -> int:
    """Add a part and a time step, by which a warning is known whatever the limit.

    Returns:
        The new length.
    """
    used = append(message, used, _PART_NAMES[part])
    return append_milliseconds(message, used, step)


@internal
def append_limit(
    message: Bytes, used: int, part: int, limit: float, step: float
) -> int:
    """Append the message that a time step [s] is too long for a part.

    Returns:
        The new length.
    """
    used = append(message, used, _PART_NAMES[part])
    used = append(message, used, _STABLE_BELOW)
    used = append_milliseconds(message, used, limit)
    used = append(message, used, _ACTUAL_STEP)
    used = append_milliseconds(message, used, step)
    return append(message, used, _ADVICE)
