"""Slipping segments, found for any state: a monotone graph carried along the cable.

The chain is that of `_fronts.py`. Seen from the proximal end, the tension of node j as
a function of the displacement w_j of segment j is a nondecreasing, piecewise linear
graph whatever slips: friction opens a vertical gap at w = 0, the spring of a node
shears it. Carrying the graph through the cable and closing it with the distal end gives
the one solution of the step, with slip starting anywhere: every knot of the graph is
the edge between two states of one segment or node. The place of the solution among the
knots gives which segments slip, in which direction, and which nodes are slack;
`_chain_solve.py` does the rest. (Reading the graphs backwards would need no labels, but
loses the displacement where a graph is flat, and grows errors from segment to segment
where drag is stiff.)

Policy iteration nearly always finds the same answer in O(n) a round, so the graph is
used only if it does not converge. It starts from the slip and slack of the step before.
Each round solves the step for one guess and corrects it where a law does not hold
(Howard 1960). The tensions of a step are unique, so a guess that needs no correction is
right. Not unique is the motion of a piece that slips with every node slack or at its
limit: it may move as a whole, and takes the same energy wherever it stays.

The graph is the dynamic programming of fused-lasso problems (Johnson, J. Comput. Graph.
Stat. 22, 2013) on a friction chain. It costs O(n) to O(n^2). Where friction is constant
and both ends are driven by position, `_fronts.py` gives the same answer faster. Here
the segment of a null point is found, not the point within it.
"""

import numpy as np

from cc_mujoco.cable import _chain_solve as chains
from cc_mujoco.cable._chain_solve import Chain, ChainMotion
from cc_mujoco.cable._fronts import LIMIT_TOLERANCE, PATH_TOLERANCE, overcome_direction
from cc_mujoco.native import FloatArray, compiled, internal


@internal
def solve_marked(
    n: int, chain: Chain, motion: ChainMotion, lines: FloatArray, work: FloatArray
) -> None:
    """Solve a step for the `direction` and `slack` of `motion`; lay slack cable evenly.

    `lines` (3 n,) and `work` (2 n,) are scratch.
    """
    drag, viscosity = chain.drag, chain.viscosity
    slip_direction, slack, node = motion.direction, motion.slack, motion.node
    lies = False
    for s in range(n - 1, -1, -1):
        if slack[s + 1] != 0.0 and drag[s] == 0.0 and viscosity[s] == 0.0:
            slack[s] = 1.0
        if slack[s] != 0.0 and slack[s + 1] != 0.0:
            slip_direction[s] = 0.0
            lies = True
    gain, offset, own = lines[:n], lines[n : 2 * n], lines[2 * n :]
    for s in range(n):
        if slip_direction[s] == 0.0:
            own[s] = np.inf
            continue
        gain[s], offset[s], own[s] = chains.slipping(chain, s, slip_direction[s])
    chains.solve(n, chain, lines, motion, work)
    for i in range(n + 1):
        node[i] = max(node[i], 0.0)
    if not lies:
        return
    free = gain
    for s in range(n):
        free[s] = 1.0 if drag[s] == 0.0 and viscosity[s] == 0.0 else 0.0
    chains.lay_slack(n, chain, free, motion)


@internal
def solve_with_slack(
    n: int, chain: Chain, motion: ChainMotion, lines: FloatArray, work: FloatArray
) -> bool:
    """Solve a step in which any node may be or become slack; return whether solved.

    `motion` has a guess of slip directions and slack nodes on input. After six rounds
    slack is corrected only when all slip directions are right, as both at once may
    cycle.
    """
    tension, stiffness = chain.tension, chain.stiffness
    drag, viscosity = chain.drag, chain.viscosity
    slip_direction, slack = motion.direction, motion.slack
    shift, node = motion.shift, motion.node
    # 3 % of random steps that follow each other take more (`test_solvers.py`).
    for rounds in range(12):
        for s in range(n):
            if slack[s] != 0.0 and drag[s] == 0.0 and viscosity[s] == 0.0:
                slack[s + 1] = 1.0
        solve_marked(n, chain, motion, lines, work)
        right = True
        for s in range(n):
            way = slip_direction[s]
            if way == 0.0 or shift[s] == 0.0:
                now = overcome_direction(
                    node[s], node[s + 1], chain.hold_distal[s], chain.hold_proximal[s],
                    drag[s], PATH_TOLERANCE,
                )  # fmt: skip
                if now != 0 and float(now) == way:
                    # Slack at both ends of a chain that slips: one of them is taut.
                    slack[s], slack[s + 1] = 0.0, 0.0
                    right = False
                elif float(now) != way:
                    slip_direction[s] = float(now)
                    right = False
            elif shift[s] * way < 0.0:
                slip_direction[s] = 0.0
                right = False
        may_change = right or rounds < 6
        for i in range(n + 1):
            if not np.isfinite(node[i]):
                return False
            if i == 0:
                strained, strain = chain.proximal_p, chain.proximal_q * shift[0]
            elif i == n:
                strained, strain = chain.distal_p, -chain.distal_q * shift[n - 1]
            else:
                strained = tension[i]
                strain = stiffness[i] * (shift[i] - shift[i - 1])
            now_slack = 1.0 if strained + strain < 0.0 else 0.0
            if now_slack == slack[i] or not may_change:
                continue
            size = abs(strain)
            if 0 < i < n:
                size = stiffness[i] * (abs(shift[i]) + abs(shift[i - 1]))
            if abs(strained + strain) > LIMIT_TOLERANCE * (abs(strained) + size):
                slack[i], right = now_slack, False
        if right:
            return True
    return False


_SLIPS_LEFT, _HELD, _SLACK = 0, 1, 2
"""States of a segment, or of a node (`_SLACK`), on the left of a knot of the graph."""


@internal
def _evaluate_graph(
    x: FloatArray, y: FloatArray, count: int, before: float, behind: float, at: float
) -> float:
    """Return the value of a piecewise linear graph at `at`.

    It has `count` knots (x, y), the slope `before` the first and `behind` the last.
    """
    last = count - 1
    if at <= x[0]:
        return float(y[0] + before * (at - x[0]))
    if at >= x[last]:
        return float(y[last] + behind * (at - x[last]))
    a, b = 0, last
    while b - a > 1:
        c = (a + b) // 2
        if x[c] <= at:
            a = c
        else:
            b = c
    width = x[b] - x[a]
    share = (at - x[a]) / width if width > 0.0 else 0.0
    return float(y[a] + (y[b] - y[a]) * share)


@internal
def _read_solution(
    n: int, label: FloatArray, passed: int, count: int, motion: ChainMotion
) -> None:
    """Set `direction` and `slack` of `motion` by the place of the solution in a graph.

    It lies right of the first `passed` of `count` knots, and of all knots dropped on
    the way. The `label` of a knot is 3 s + the state of segment or node s left of it.
    """
    slip_direction, slack = motion.direction, motion.slack
    for s in range(n):
        slip_direction[s] = 1.0
        slack[s] = 0.0
    slack[n] = 0.0
    for i in range(passed, count):
        if label[i] < 0.0:
            continue
        s = int(label[i]) // 3
        kind = int(label[i]) - 3 * s
        if kind == _SLACK:
            slack[s] = 1.0
        elif kind == _SLIPS_LEFT:
            slip_direction[s] = -1.0
        elif slip_direction[s] > 0.0:
            slip_direction[s] = 0.0


@internal
def solve_by_graph(n: int, chain: Chain, motion: ChainMotion, work: FloatArray) -> None:
    """Solve a step by carrying the graph along the cable; `work` is as in `sweep`."""
    hold_distal, hold_proximal = chain.hold_distal, chain.hold_proximal
    proximal_p, proximal_q = chain.proximal_p, chain.proximal_q
    distal_p, distal_q = chain.distal_p, chain.distal_q
    size = 2 * n + 3
    # Knots and their labels, see `_read_solution`.
    x, y, label = work[:size], work[size : 2 * size], work[2 * size : 3 * size]
    proximal, distal = 0.0, proximal_q
    x[0], y[0], label[0] = 0.0, proximal_p, -1.0
    if proximal_q > 0.0:
        x[0], y[0], label[0] = -proximal_p / proximal_q, 0.0, float(_SLACK)
    count = 1
    for s in range(n):
        b, c = chain.drag[s], chain.viscosity[s]
        at_rest = max(_evaluate_graph(x, y, count, proximal, distal, 0.0), 0.0)
        # Knots left of zero, the gap of friction at zero, the other knots.
        split = 0
        while split < count and x[split] < 0.0:
            split += 1
        for i in range(count - 1, split - 1, -1):
            x[i + 2] = x[i]
            y[i + 2] = hold_distal[s] * y[i] + b + c * x[i]
            label[i + 2] = label[i]
        shrink = 1.0 / hold_proximal[s]
        for i in range(split):
            y[i] = (y[i] - b + c * x[i]) * shrink
        x[split], y[split] = 0.0, (at_rest - b) / hold_proximal[s]
        x[split + 1], y[split + 1] = 0.0, hold_distal[s] * at_rest + b
        label[split] = float(3 * s + _SLIPS_LEFT)
        label[split + 1] = float(3 * s + _HELD)
        count += 2
        proximal = (proximal + c) / hold_proximal[s]
        distal = hold_distal[s] * distal + c
        # A cable does not push: cut the graph at zero tension.
        keep = -1
        while keep + 1 < count and y[keep + 1] <= 0.0:
            keep += 1
        # There are two knots to spare; states that are no numbers could take more.
        if keep < 0 and proximal > 0.0 and count < 2 * s + 5:
            for i in range(count, 0, -1):
                x[i], y[i], label[i] = x[i - 1], y[i - 1], label[i - 1]
            x[0] -= y[0] / proximal
            count += 1
            keep = 0
        elif keep >= 0:
            if keep + 1 < count:
                part = -y[keep] / (y[keep + 1] - y[keep])
                x[keep] += (x[keep + 1] - x[keep]) * part
            elif distal > 0.0:
                x[keep] -= y[keep] / distal
            count -= keep
            if keep > 0:
                for i in range(count):
                    x[i], y[i] = x[i + keep], y[i + keep]
                    label[i] = label[i + keep]
        if keep >= 0:
            y[0], label[0], proximal = 0.0, float(3 * (s + 1) + _SLACK), 0.0
        if s + 1 < n:
            k, t = chain.stiffness[s + 1], chain.tension[s + 1]
            compliance = 1.0 / k
            for i in range(count):
                x[i] += (y[i] - t) * compliance
            proximal = proximal * k / (k + proximal)
            distal = distal * k / (k + distal)
    # The distal end closes the graph: f(w) = distal_p - distal_q w.
    passed = 0
    while passed < count and y[passed] + distal_q * x[passed] < distal_p:
        passed += 1
    _read_solution(n, label, passed, count, motion)
    solve_marked(n, chain, motion, work[: 3 * n], work[3 * size + 2 * n + 1 :])


@compiled
def sweep(
    n: int, last: FloatArray, chain: Chain, growth_distal: FloatArray,
    growth_proximal: FloatArray, shift: FloatArray, node: FloatArray, work: FloatArray,
) -> None:  # fmt: skip
    """Solve a step from any state, into `shift` and `node` as in `ChainMotion`.

    The sign of `last` (n,) is the slip direction of each segment in the step before.
    `growth_distal` and `growth_proximal` (n,) are E for slip in that direction, which
    replaces H in `chain` where a segment breaks away. `work` holds (11 n + 11,).
    """
    tension, stiffness, drag = chain.tension, chain.stiffness, chain.drag
    size = 6 * n + 9  # what comes before it is free outside of the graph
    marks, rest = work[size : size + 2 * n + 1], work[size + 2 * n + 1 :]
    motion, lines = ChainMotion(marks[:n], marks[n:], shift, node), work[: 3 * n]
    for i in range(n + 1):
        motion.slack[i] = 1.0 if tension[i] <= 0.0 else 0.0
    for s in range(n):
        motion.direction[s] = np.sign(last[s])
    for _ in range(n + 1):
        if not solve_with_slack(n, chain, motion, lines, rest):
            solve_by_graph(n, chain, motion, work)
        # A segment that breaks away follows the kinetic law: solve again with it. Slip
        # within rounding does not count, or a segment about to slip would break away.
        broke = False
        for s in range(n):
            load = node[s] + node[s + 1] + drag[s]
            if abs(shift[s]) * stiffness[s] <= LIMIT_TOLERANCE * load:
                shift[s] = 0.0
            elif chains.break_away(chain, s, shift[s], growth_distal, growth_proximal):
                broke = True
        if not broke:
            break
