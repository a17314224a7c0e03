"""Steps in which the end of a cable becomes taut or slack, compiled.

A cable pulls and does not push. Where an end is implicit (`_implicit_ends.py`), the
tension that Newmark's method gives is right while the cable stays taut. If slack runs
out within a step, or returns, it is not: an end that meets the cable with the speed v
sinks in by up to h v, which throws it back with up to 1.5 v. Such a step is one of the
backward Euler method instead: the end takes the tension of the place to which the step
leads,

    T = F(x + h v + h^2 a(T)).

What that gives out is no more than what is stored. With m the mass that an end
moves, V the energy of the cable, of the slope F, which grows with x, and x' = x + h v',

    m (v'^2 - v^2) / 2 + V(x') - V(x) <= -(h T)^2 / (2 m).

So the end of a cable that snaps taut comes back with less than its own speed, and what
the step cannot resolve is lost.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.plugin._evaluate import evaluate
from cc_mujoco.plugin._ffi import floats, internal, load_real, load_word
from cc_mujoco.plugin._instance_data import SEGMENTS, TIED_ENDS, new_at, parameters_at

Floats = npt.NDArray[np.float64]


@internal
def evaluate_prediction(block: int, state: int, aim: Floats, dt: float) -> bool:
    """Evaluate a cable with implicit ends from the committed state at address `state`.

    `aim` is the result of `predict_ends` (8,), `dt` the time since that state [s]. The
    parameters must be up to date.

    Returns:
        Whether the new state, in the block, is finite.
    """
    if not evaluate(block, state, aim[0], aim[1], aim[2], aim[3], dt):
        return False
    n = load_word(block + SEGMENTS)
    new = new_at(block, n)
    ahead, passes, doubt = aim[4:6].copy(), np.zeros(2), np.zeros(2)
    for end in range(2):
        if load_word(block + TIED_ENDS + 8 * end) != 0:
            continue
        before, now = _tension(state, n, end), _tension(new, n, end)
        # Tension draws the proximal end towards distal, the distal end to proximal.
        sense = 1.0 if end == 0 else -1.0
        ahead[end] += sense * aim[6 + end] * (max(now, 0.0) - max(before, 0.0))
        relaxes = sense * (ahead[end] - load_real(new + 8 * end))
        if now <= 0.0:
            doubt[end] = 1.0 if before <= 0.0 and relaxes < 0.0 else 0.0
        elif before <= 0.0:
            passes[end] = 1.0
        elif relaxes * _stiffness(block, n, end) > now:
            doubt[end] = -1.0
    if doubt[0] == 0.0 and doubt[1] == 0.0 and passes[0] == 0.0 and passes[1] == 0.0:
        return True
    if doubt[0] != 0.0 or doubt[1] != 0.0:
        # Where the step leads tells whether the end becomes taut (1) or slack (-1).
        if not evaluate(block, state, ahead[0], ahead[1], 0.0, 0.0, dt):
            return False
        for end in range(2):
            if doubt[end] != 0.0:
                taut = _tension(new, n, end) > 0.0
                passes[end] = 1.0 if taut == (doubt[end] > 0.0) else 0.0
    used = aim[:4].copy()
    for end in range(2):
        if passes[end] != 0.0:
            used[end], used[2 + end] = aim[4 + end], aim[6 + end]
    return evaluate(block, state, used[0], used[1], used[2], used[3], dt)


@internal
def _tension(state: int, n: int, end: int) -> float:
    """Return the tension at an end in the state at an address [N]."""
    return load_real(state + 8 * (kernel.STATE_HEADER + n * end))


@internal
def _stiffness(block: int, n: int, end: int) -> float:
    """Return the stiffness of the outermost node, the most that an end has [N/m]."""
    prm = floats(parameters_at(block), kernel.parameter_size(n))
    return float(kernel.node_stiffness(prm, n)[n * end])
