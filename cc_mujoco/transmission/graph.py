"""Which segments slip, found for any state: a monotone graph carried along the cable.

Same chain as in `fronts.py`. Seen from the proximal end, the tension of node j as a
function of the displacement w_j of segment j is a nondecreasing, piecewise linear graph
whatever slips: friction opens a vertical gap at w = 0, the spring of a node shears it.
Carrying the graph through the cable and closing it with the distal end gives the one
solution of the step, with slip starting anywhere: every knot of the graph is the edge
between two states of one segment or node, so where the solution lies among the knots
tells which segments slip, which way, and which nodes are slack, and `chain.py` does the
rest. (Reading the graphs backwards would need no labels, but loses the displacement
where a graph is flat, and grows errors from segment to segment where drag is stiff.)

This is the dynamic programming of fused-lasso problems (Johnson, J. Comput. Graph.
Stat. 22, 2013) on a friction chain. It costs O(n) to O(n^2) and is needed where
coefficients change while the cable is loaded or an end is driven by tension; else
`fronts.py` gives the same answer faster. Here a null point is resolved to a segment,
not within it.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.transmission.chain import lay_slack, slipping, solve
from cc_mujoco.transmission.fronts import TOLERANCE

_LEFT, _HELD, _SLACK = 0, 1, 2


@compiled
def _read(
    x: FloatArray, y: FloatArray, count: int, left: float, right: float, at: float
) -> float:
    """Value at `at` of the graph of knots (x, y) and rays of slope `left`, `right`."""
    last = count - 1
    if at <= x[0]:
        return float(y[0] + left * (at - x[0]))
    if at >= x[last]:
        return float(y[last] + right * (at - x[last]))
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


@compiled
def _mark(
    n: int,
    label: FloatArray,
    passed: int,
    count: int,
    way: FloatArray,
    slack: FloatArray,
) -> None:
    """Read off which way each segment slips and which nodes are slack.

    The solution lies right of the first `passed` knots, and right of every knot that
    was dropped on the way. A knot keeps its meaning while it is carried along: left of
    it segment s is held, or slips left, or node s is slack.
    """
    for s in range(n):
        way[s] = 1.0
        slack[s] = 0.0
    slack[n] = 0.0
    for i in range(passed, count):
        if label[i] < 0.0:
            continue
        s = int(label[i]) // 3
        kind = int(label[i]) - 3 * s
        if kind == _SLACK:
            slack[s] = 1.0
        elif kind == _LEFT:
            way[s] = -1.0
        elif way[s] > 0.0:
            way[s] = 0.0


@compiled
def _settle(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    hold_right: FloatArray,
    hold_left: FloatArray,
    drag: FloatArray,
    viscosity: FloatArray,
    way: FloatArray,
    slack: FloatArray,
    near_p: float,
    near_q: float,
    far_p: float,
    far_q: float,
    shift: FloatArray,
    node: FloatArray,
    lines: FloatArray,
    work: FloatArray,
) -> None:
    """Displacements and tensions of a step of which `_mark` has told what slips."""
    gain, offset, own = lines[:n], lines[n : 2 * n], lines[2 * n :]
    for s in range(n - 1, -1, -1):
        if slack[s + 1] != 0.0 and drag[s] == 0.0 and viscosity[s] == 0.0:
            slack[s] = 1.0
        slip = way[s]
        if slack[s] != 0.0 and slack[s + 1] != 0.0:
            slip = 0.0
        if slip == 0.0:
            own[s] = np.inf
            continue
        gain[s], offset[s], own[s] = slipping(
            slip, hold_right[s], hold_left[s], drag[s], viscosity[s]
        )
    solve(
        n, tension, stiffness, gain, offset, own, slack,
        near_p, near_q, far_p, far_q, shift, node, work,
    )  # fmt: skip
    for i in range(n + 1):
        node[i] = max(node[i], 0.0)
    free = gain
    for s in range(n):
        free[s] = 1.0 if drag[s] == 0.0 and viscosity[s] == 0.0 else 0.0
    lay_slack(n, free, tension, stiffness, slack, near_p, near_q, far_p, far_q, shift)


@compiled
def sweep(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    growth_right: FloatArray,
    growth_left: FloatArray,
    hold_right: FloatArray,
    hold_left: FloatArray,
    drag: FloatArray,
    viscosity: FloatArray,
    near_p: float,
    near_q: float,
    far_p: float,
    far_q: float,
    shift: FloatArray,
    node: FloatArray,
    work: FloatArray,
) -> None:
    """Solve one step by carrying the graph; arguments as in `fronts.march`.

    `growth_right` and `growth_left` are E of slip that way, and ends are T = near_p +
    near_q w and T = far_p - far_q w. `work` holds (11 n + 11,). `hold_right` and
    `hold_left` are overwritten with E where a segment breaks away.
    """
    size = 2 * n + 3
    # Knots, and what it means to be left of one, see `_mark`.
    x, y, label = work[:size], work[size : 2 * size], work[2 * size : 3 * size]
    marks, rest = work[3 * size : 3 * size + 2 * n + 1], work[3 * size + 2 * n + 1 :]
    way, slack = marks[:n], marks[n:]
    for _ in range(n + 1):
        left, right = 0.0, near_q
        x[0], y[0], label[0] = 0.0, near_p, -1.0
        if near_q > 0.0:
            x[0], y[0], label[0] = -near_p / near_q, 0.0, _SLACK
        count = 1
        for s in range(n):
            b, c = drag[s], viscosity[s]
            at_rest = max(_read(x, y, count, left, right, 0.0), 0.0)
            # Knots left of zero, the gap of friction at zero, the other knots.
            split = 0
            while split < count and x[split] < 0.0:
                split += 1
            for i in range(count - 1, split - 1, -1):
                x[i + 2] = x[i]
                y[i + 2] = hold_right[s] * y[i] + b + c * x[i]
                label[i + 2] = label[i]
            shrink = 1.0 / hold_left[s]
            for i in range(split):
                y[i] = (y[i] - b + c * x[i]) * shrink
            x[split], y[split] = 0.0, (at_rest - b) / hold_left[s]
            x[split + 1], y[split + 1] = 0.0, hold_right[s] * at_rest + b
            label[split], label[split + 1] = 3.0 * s + _LEFT, 3.0 * s + _HELD
            count += 2
            left = (left + c) / hold_left[s]
            right = hold_right[s] * right + c
            # A cable does not push: cut the graph at zero tension.
            keep = -1
            while keep + 1 < count and y[keep + 1] <= 0.0:
                keep += 1
            if keep < 0 and left > 0.0:
                for i in range(count, 0, -1):
                    x[i], y[i], label[i] = x[i - 1], y[i - 1], label[i - 1]
                x[0] -= y[0] / left
                count += 1
                keep = 0
            elif keep >= 0:
                if keep + 1 < count:
                    part = -y[keep] / (y[keep + 1] - y[keep])
                    x[keep] += (x[keep + 1] - x[keep]) * part
                elif right > 0.0:
                    x[keep] -= y[keep] / right
                count -= keep
                if keep > 0:
                    for i in range(count):
                        x[i], y[i] = x[i + keep], y[i + keep]
                        label[i] = label[i + keep]
            if keep >= 0:
                y[0], label[0], left = 0.0, 3.0 * (s + 1) + _SLACK, 0.0
            if s + 1 < n:
                k, t = stiffness[s + 1], tension[s + 1]
                compliance = 1.0 / k
                for i in range(count):
                    x[i] += (y[i] - t) * compliance
                left = left * k / (k + left)
                right = right * k / (k + right)
        # The distal end closes the graph: f(w) = far_p - far_q w.
        passed = 0
        while passed < count and y[passed] + far_q * x[passed] < far_p:
            passed += 1
        _mark(n, label, passed, count, way, slack)
        _settle(
            n, tension, stiffness, hold_right, hold_left, drag, viscosity, way, slack,
            near_p, near_q, far_p, far_q, shift, node, work[: 3 * n], rest,
        )  # fmt: skip
        # A segment that breaks away follows the kinetic law: solve again with it. Slip
        # of rounding alone is none, or one that is about to slip would have.
        broke = False
        for s in range(n):
            load = node[s] + node[s + 1] + drag[s]
            if abs(shift[s]) * stiffness[s] <= TOLERANCE * load:
                shift[s] = 0.0
            elif shift[s] > 0.0 and hold_right[s] != growth_right[s]:
                hold_right[s] = growth_right[s]
                hold_left[s] = min(hold_left[s], growth_left[s])
                broke = True
            elif shift[s] < 0.0 and hold_left[s] != growth_left[s]:
                hold_left[s] = growth_left[s]
                hold_right[s] = min(hold_right[s], growth_right[s])
                broke = True
        if not broke:
            break
