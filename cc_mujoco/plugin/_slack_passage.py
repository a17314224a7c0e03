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

Under RK4 each stage is evaluated first at its own displacements; an end is implicit by
what the stiffness that it met needs, from that of a cable that slips to that of an end
that friction holds. Where RK4 resolves the vibration on a cable that slips, an end that
becomes slack stays as it is, and one that becomes taut takes the tension of the middle
of what is left of the step at the stage. A motor of 2e-3 kg m^2 on an ankle of 1 kg m^2
that is thrown into slack, at 4 steps a period, then errs by 7 % of the tension
(`tests/plugin/test_implicit_ends.py`); with backward Euler in all stages by 16 %, with
explicit ends by 6 %, which give out more energy.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin._evaluate import evaluate, is_rk4
from cc_mujoco.plugin._ffi import internal
from cc_mujoco.plugin._implicit_ends import (
    held_stiffness,
    newmark_terms,
    slipping_stiffness,
)
from cc_mujoco.plugin._instance_data import Block
from cc_mujoco.plugin._mj_struct import MjModel

_WELL_RESOLVED = 5.0
"""Square of the step times the frequency of an end, of 8 at the limit of stability,
below which RK4 resolves its vibration well enough to leave it as it is."""


@internal
def evaluate_prediction(
    model: MjModel, block: Block, state: int, aim: FloatArray, dt: float
) -> bool:
    """Evaluate a cable with implicit ends from the committed state at address `state`.

    `aim` is the result of `predict_ends` (9,), `dt` the time since that state [s]. The
    parameters must be up to date. Return whether the new state is finite.
    """
    n, tried, none = block.segments, is_rk4(model), (0.0, 0.0)
    old = blocks.kernel_state(state, n)
    new = blocks.kernel_state(block + block.new_state, n)
    node_before, node = layout.tensions(old, n), layout.tensions(new, n)
    used, left, resolved = np.empty(4), np.empty(2), np.zeros(2)
    left[:] = 1.0
    if tried and not evaluate(block, state, (aim[0], aim[1]), none, dt):
        return False
    for end in range(2):
        stiffness = held_stiffness(block, end)
        if tried:
            soft = min(slipping_stiffness(block), stiffness)
            if newmark_terms(model, soft, aim[6 + end])[1] == 0.0:
                # What is left of a step at a later stage, begun from the first one.
                if state == block + block.first_stage:
                    left[end] = max(1.0 - dt / model.opt.timestep, 0.0)
                resolved[end] = 1.0 if soft * aim[6 + end] < _WELL_RESOLVED else 0.0
            # What an end met on its way, between that of a slipping cable and its own.
            gained = abs(max(node[n * end], 0.0) - max(node_before[n * end], 0.0))
            moved = abs(new[end] - old[end])
            if not gained >= stiffness * moved:
                stiffness = max(gained / moved, soft)
        alpha, beta = newmark_terms(model, stiffness, aim[6 + end])
        used[end] = aim[end] + alpha * aim[2 + end] + beta * aim[4 + end]
        used[2 + end] = aim[8] * beta * aim[6 + end]
    if not evaluate(block, state, (used[0], used[1]), (used[2], used[3]), dt):
        return False
    ahead, passes, doubt = np.empty(2), np.zeros(2), np.zeros(2)
    for end in range(2):
        share = left[end]
        ahead[end] = aim[end] + share * (aim[2 + end] + share * aim[4 + end])
        if block.tied[end] != 0 or left[end] == 0.0:
            continue
        before, now = node_before[n * end], node[n * end]
        # Tension draws the proximal end towards distal, the distal end to proximal.
        sense = 1.0 if end == 0 else -1.0
        gained = max(now, 0.0) - max(before, 0.0)
        ahead[end] += sense * aim[8] * share * share * aim[6 + end] * gained
        relaxes = sense * (ahead[end] - new[end])
        if now <= 0.0:
            doubt[end] = 1.0 if before <= 0.0 and relaxes < 0.0 else 0.0
        elif before <= 0.0:
            passes[end] = 1.0
        elif resolved[end] == 0.0:
            outermost = kernel.node_stiffness(blocks.parameters(block), n)[n * end]
            doubt[end] = -1.0 if relaxes * outermost > now else 0.0
    doubtful = doubt[0] != 0.0 or doubt[1] != 0.0
    if not doubtful and passes[0] == 0.0 and passes[1] == 0.0:
        return True
    if doubtful:
        # Where the step leads tells whether the end becomes taut (1) or slack (-1).
        if not evaluate(block, state, (ahead[0], ahead[1]), none, dt):
            return False
        for end in range(2):
            if doubt[end] != 0.0:
                taut = node[n * end] > 0.0
                passes[end] = 1.0 if taut == (doubt[end] > 0.0) else 0.0
    for end in range(2):
        if passes[end] != 0.0:
            share = left[end] if resolved[end] == 0.0 else 0.5 * left[end]
            used[end] = aim[end] + share * (aim[2 + end] + share * aim[4 + end])
            used[2 + end] = aim[8] * share * share * aim[6 + end]
    return evaluate(block, state, (used[0], used[1]), (used[2], used[3]), dt)
