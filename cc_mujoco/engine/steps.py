"""How long a time step the ends of the cables bear, compiled.

The force of a cable is explicit: MuJoCo knows it at the start of a step only. An end is
a spring, at its stiffest where friction holds all but the outermost part of the cable
(`kernel.end_stiffness`). The ends i of all cables of a model, of stiffness k_i and with
moments J_i on the joints, have with the inertia M of the model

    G_ij = sqrt(k_i k_j) J_i M^-1 J_j^T

whose largest eigenvalue is the square of the highest frequency w; steps below 2 / w are
stable. Instead of w the rows give a bound for every end,

    w_i^2 = sum_j |G_ij| sqrt(G_jj / G_ii),

of which the largest is no less than w, and is w where the ends move one joint each.
Under RK4 the step may be longer by up to sqrt(2).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cc_mujoco.engine import fields
from cc_mujoco.engine.block import (
    DISTAL,
    PROXIMAL,
    SEGMENTS,
    displacement,
    parameters_at,
    wound,
)
from cc_mujoco.engine.config import constant
from cc_mujoco.engine.memory import (
    Bytes,
    append,
    append_milliseconds,
    floats,
    internal,
    load_integer,
    load_real,
    load_word,
    solve_inertia,
)
from cc_mujoco.transmission import kernel

Floats = npt.NDArray[np.float64]

_ENDS = constant("its proximal end"), constant("its distal end")
_NEEDS = constant(" is stable only with a `timestep` below ")
_IS = constant(", but that is ")
_ADVICE = constant(
    "; shorten it, or give what this end moves more inertia (`armature`) or the cable "
    "fewer `segments`"
)


@internal
def limits(model: int, data: int, instance: int, out: Floats) -> None:
    """Longest stable time step of both ends of a cable (2,) [s].

    Infinite for an end that moves nothing. Needs the inertia and the actuators of the
    present position (part of `mj_fwdPosition`).
    """
    nv, count = fields.dofs(model), 2 * fields.plugins(model)
    moment, solved = np.zeros((count, nv)), np.zeros((count, nv))
    square = np.zeros(count)
    kind = fields.integer(model, fields.PLUGIN, instance)
    for other in range(count // 2):
        same = fields.integer(model, fields.PLUGIN, other) == kind
        block = fields.block(data, other) if same else 0
        if block != 0 and nv > 0:
            _ends(model, data, block, moment[2 * other : 2 * other + 2])
    for i in range(count):
        if np.any(moment[i] != 0.0):
            solve_inertia(model, data, solved[i].ctypes.data, moment[i].ctypes.data, 1)
            square[i] = max((moment[i] * solved[i]).sum(), 0.0)
    for end in range(2):
        i = 2 * instance + end
        total = 0.0
        for j in range(count if square[i] > 0.0 else 0):
            shared = abs((moment[i] * solved[j]).sum())
            total += shared * math.sqrt(square[j] / square[i])
        out[end] = 2.0 / math.sqrt(total) if total > 0.0 else math.inf


@internal
def _ends(model: int, data: int, block: int, out: Floats) -> None:
    """Moments of both ends on the degrees of freedom, times sqrt(k) (2, nv)."""
    n = load_word(block + SEGMENTS)
    prm = floats(parameters_at(block), kernel.parameter_size(n))
    for end in range(2):
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
def explain(message: Bytes, used: int, distal: bool, limit: float, step: float) -> int:
    """Add that a time step is too long for an end; times in seconds.

    Returns:
        The new length.
    """
    used = append(message, used, _ENDS[1] if distal else _ENDS[0])
    used = append(message, used, _NEEDS)
    used = append_milliseconds(message, used, limit)
    used = append(message, used, _IS)
    used = append_milliseconds(message, used, step)
    return append(message, used, _ADVICE)
