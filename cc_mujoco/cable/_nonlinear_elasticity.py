"""Step of a cable whose stiffness depends on tension: iterate with secants, compiled.

Both solvers of a step are for linear springs. Here each stiffness is the secant between
the tensions before and after the step, found by iteration: for the march from the
compliance between two tensions, for the graph, which may pass through slack, from the
stretch.
"""

from cc_mujoco.cable import _elasticity as elastic
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._fronts import CoulombChain, march
from cc_mujoco.cable._layout import Step
from cc_mujoco.native import FloatArray, internal

LINEARIZATION_TOLERANCE = 1e-5
"""Error of a tension over the largest one up to which secants have converged."""
# Rows of scratch: secant of every node, compliance of half of every segment.
_LINE_ROW, _HALF_ROW = 1, 2


@internal
def tangent_stiffness(
    prm: FloatArray, n: int, tension: FloatArray, work: FloatArray
) -> FloatArray:
    """Return the tangent stiffness of the nodes (n + 1,) [N/m], a view of `work`."""
    stiffness = at.node_row(work, n, _LINE_ROW)
    for i in range(n + 1):
        stiffness[i] = at.node_stiffness(prm, n)[i]
        if nodes.is_curved_node(prm, n, i):
            own = nodes.node_piece(prm, n, i)
            stiffness[i] = 1.0 / elastic.compliance_at(own, tension[i])
    return stiffness


@internal
def march_linearized(prm: FloatArray, n: int, step: Step, chain: CoulombChain) -> bool:
    """Solve one step by rounds of `_fronts.march`; return whether they converged."""
    proximal, distal = step.proximal - step.state[0], step.distal - step.state[1]
    work, node = step.work, at.tensions(step.new_state, n)
    tension, growth, drag = chain.tension, chain.growth, chain.drag
    compliance, half = at.node_row(work, n, _LINE_ROW), at.node_row(work, n, _HALF_ROW)
    line = CoulombChain(
        tension, compliance, half, growth, chain.hold, chain.slips, drag
    )
    for i in range(n + 1):
        compliance[i] = at.node_compliance(prm, n)[i]
        if nodes.is_curved_node(prm, n, i):
            own = nodes.node_piece(prm, n, i)
            compliance[i] = elastic.compliance_at(own, tension[i])
    if proximal * distal < 0.0:
        for j in range(n):
            mean = 0.5 * (tension[j] + tension[j + 1])
            half[j] = elastic.compliance_at(nodes.half_piece(prm, n, j), mean)
    for _ in range(8):  # rounds
        shift = at.row(work, n, at.SHIFT)
        if not march(n, line, proximal, distal, shift, node, work):
            return False
        largest = 0.0
        for i in range(n + 1):
            largest = max(largest, node[i])
        settled = True
        for i in range(n + 1):
            if node[i] == tension[i] or not nodes.is_curved_node(prm, n, i):
                continue
            own = nodes.node_piece(prm, n, i)
            right = elastic.compliance_between(own, tension[i], node[i])
            off = (right - compliance[i]) * (node[i] - tension[i])
            if abs(off) > LINEARIZATION_TOLERANCE * largest * right:
                settled = False
            compliance[i] = right
        if settled:
            return True
    return False


@internal
def relinearize(
    prm: FloatArray, n: int, step: Step, tension: FloatArray, proximal_held: bool,
    distal_held: bool,
) -> bool:  # fmt: skip
    """Set the stiffness of nodes to the secants; return whether they converged.

    `tension` (n + 1,) [N] is that before the step. A held end has its tension
    prescribed, so its node keeps its stiffness.
    """
    work, node = step.work, at.tensions(step.new_state, n)
    stiffness, shift = at.node_row(work, n, _LINE_ROW), at.row(work, n, at.SHIFT)
    largest = 0.0
    for i in range(n + 1):
        largest = max(largest, node[i])
    settled = True
    for i in range(n + 1):
        if (i == 0 and proximal_held) or (i == n and distal_held):
            continue
        behind = step.proximal - step.state[0] if i == 0 else shift[i - 1]
        stretched = (step.distal - step.state[1] if i == n else shift[i]) - behind
        true = nodes.tension_after_stretch(prm, n, i, tension[i], stretched)
        if abs(max(true, 0.0) - node[i]) > LINEARIZATION_TOLERANCE * largest:
            settled = False
        if abs(true - tension[i]) > LINEARIZATION_TOLERANCE * largest:
            line = (true - tension[i]) / stretched
            # The line of the stretch found can overshoot without end, that of the
            # tension found never does: go between them.
            found = nodes.stretch_between(prm, n, i, tension[i], node[i])
            changed = node[i] - tension[i]
            if node[i] > 0.0 and abs(changed) > LINEARIZATION_TOLERANCE * largest:
                steady = changed / found
                # 0.3: share of the overshooting line, in the logarithm.
                line = steady * (line / steady) ** 0.3
            stiffness[i] = line
    return settled
