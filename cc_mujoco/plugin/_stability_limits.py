"""Longest stable time step of a cable, compiled.

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

import math

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._evaluate import packed_block_of
from cc_mujoco.plugin._ffi import MjData, MjModel
from cc_mujoco.plugin._implicit_ends import add_moment
from cc_mujoco.plugin._instance_data import Block
from cc_mujoco.plugin._path import OpenPath


@internal
def stable_timesteps(
    model: MjModel, data: MjData, instance: int, out: FloatArray
) -> None:
    """Compute the longest stable time steps of a cable, out (3,) [s].

    They are those of the proximal end, the distal end and the pieces of an open path;
    infinite for a part that moves nothing. The inertia and the actuators must have been
    evaluated at the present position (part of `mj_fwdPosition`).
    """
    count, kind = 0, model.plugin[instance]
    for other in range(model.nplugin):
        count += _spring_count(packed_block_of(model, data, other, kind))
    ffi.mark_stack(data)
    moment = ffi.borrow_rows(data, count, model.nv)
    begin = end = row = 0  # of the rows of this instance
    for other in range(model.nplugin):
        block = packed_block_of(model, data, other, kind)
        rows = _spring_count(block)
        if rows > 0 and model.nv > 0:
            _end_moments(model, data, block, moment[row : row + 2])
            if blocks.is_open(block):
                led, own = blocks.path_of(block, 0), moment[row + 2 : row + rows]
                stiffness = kernel.node_stiffness(blocks.parameters(block), led.n)
                node_moments(model, data, led, stiffness, own)
        if other == instance:
            begin, end = row, row + rows
        row += rows
    out[:] = math.inf
    limit = ffi.borrow_floats(data, end - begin)
    spring_timesteps(model, data, moment, begin, limit)
    for i in range(limit.size):
        near = min(i, 2)
        out[near] = min(out[near], limit[i])
    ffi.free_stack(data)


@internal
def spring_timesteps(
    model: MjModel, data: MjData, moment: ffi.FloatMatrix, begin: int, out: FloatArray
) -> None:
    """Compute the longest stable time steps [s] of springs that act together.

    A row of `moment` (k, nv) has the moments of one spring on the joints, times the
    root of its stiffness. `out` gets the limits of the springs from `begin` on.
    """
    ffi.mark_stack(data)
    solved = ffi.borrow_rows(data, moment.shape[0], moment.shape[1])
    square = ffi.borrow_floats(data, moment.shape[0])
    for i in range(square.size):
        square[i] = 0.0
        if not ffi.is_zero(moment[i]):
            ffi.solve_inertia(
                model, data, solved[i].ctypes.data, moment[i].ctypes.data, 1
            )
            square[i] = max(ffi.dot(moment[i], solved[i]), 0.0)
    out[:] = math.inf
    for i in range(begin, begin + out.size):
        total = 0.0
        for j in range(square.size if square[i] > 0.0 else 0):
            shared = abs(ffi.dot(moment[i], solved[j]))
            total += shared * math.sqrt(square[j] / square[i])
        if total > 0.0:
            out[i - begin] = 2.0 / math.sqrt(total)
    ffi.free_stack(data)


@internal
def _spring_count(block: Block) -> int:
    if block == 0:
        return 0
    return 2 + (block.segments + 1 if blocks.is_open(block) else 0)


@internal
def _end_moments(
    model: MjModel, data: MjData, block: Block, out: ffi.FloatMatrix
) -> None:
    n, prm = block.segments, blocks.parameters(block)
    for end in range(2):
        if block.tied[end] != 0:
            continue
        scale = math.sqrt(kernel.end_stiffness(prm, n, end == 1))
        if end == 0:
            # The lever of a pulley that is not round differs from its gear.
            scale *= abs(blocks.winding(model, data, block)[1])
        add_moment(data, block.outputs[end], scale, out[end])


@internal
def node_moments(
    model: MjModel, data: MjData, led: OpenPath, stiffness: FloatArray,
    out: ffi.FloatMatrix,
) -> None:  # fmt: skip
    """Write the `moment` of `spring_timesteps` for an open path's nodes to `out`."""
    ffi.mark_stack(data)
    node = ffi.borrow_floats(data, led.n + 1)
    tried = ffi.borrow_floats(data, out.shape[1])
    solved = ffi.borrow_floats(data, out.shape[1])
    own = tried.ctypes.data
    node[:] = 0.0
    for i in range(led.n + 1):
        node[i] = math.sqrt(stiffness[i])
        # A piece whose points coincide has no direction yet, and opens along any.
        worst, aside = 0.0, -1
        while aside < 3 and (aside < 0 or ffi.is_zero(out[i]) or worst > 0.0):
            tried[:] = 0.0
            path.apply_pulls(model, data, led, node, 0.0, aside, own)
            ffi.solve_inertia(model, data, solved.ctypes.data, own, 1)
            square = ffi.dot(tried, solved)
            if aside < 0 or square > worst:
                out[i, :] = tried
                worst = square if aside >= 0 else 0.0
            aside += 1
        node[i] = 0.0
    ffi.free_stack(data)


@internal
def warn_long_step(
    message: ffi.Message, model: MjModel, part: int, limit: float
) -> None:
    """Warn, once for a time step, that it exceeds the `limit` of end or path [s]."""
    parts = "its proximal end", "its distal end", "its open path"
    step = model.opt.timestep
    ffi.append(message, parts[part])
    start = message.used
    ffi.append_thousandths(message, step, " ms")
    if ffi.warned_once(message):
        return
    message.used = start
    ffi.append(message, " is stable only with a `timestep` below ")
    ffi.append_thousandths(message, limit, " ms, but that is ")
    rest: ffi.Bytes = (
        " ms; shorten it, or give what this moves more inertia (`armature`) or the "
        "cable fewer `segments`"
    )
    ffi.append_thousandths(message, step, rest)
    ffi.warn(message)
