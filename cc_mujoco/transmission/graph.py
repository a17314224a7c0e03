"""Which segments slip, found for any state: a monotone graph carried along the cable.

Same chain as in `fronts.py`. Seen from the proximal end, the tension of node j as a
function of the displacement w_j of segment j is a nondecreasing, piecewise linear graph
whatever slips: friction opens a vertical gap at w = 0, the spring of a node shears it.
Carrying the graph through the cable, closing it with the distal end, and reading it
backwards gives the one solution of the step, with slip starting anywhere. This is the
dynamic programming of fused-lasso problems (Johnson, J. Comput. Graph. Stat. 22, 2013)
on a friction chain. It costs O(n) to O(n^2) and is needed where coefficients change
while the cable is loaded or an end is driven by tension; else `fronts.py` gives the
same answer faster. Here a null point is resolved to a segment, not within it.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled


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
def _inverse(slope: float) -> float:
    """Slope of a ray with its axes exchanged; a flat ray ends where it begins."""
    return 1.0 / slope if slope > 0.0 else 0.0


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

    `growth_right` and `growth_left` are E of slip that way. `work` holds (7 n + 12,).
    `hold_right` and `hold_left` are overwritten with them where a segment breaks away.
    """
    x, y = work[: 2 * n + 6], work[2 * n + 6 : 4 * n + 12]
    at_rest = work[
        4 * n + 12 : 5 * n + 12
    ]  # node tension on the left of a held segment
    zero_from = work[
        5 * n + 12 : 6 * n + 12
    ]  # slip below which the node ahead is slack
    slack_until = work[6 * n + 12 : 7 * n + 12]  # slip up to which node s is slack
    for _ in range(n + 1):
        left, right = 0.0, near_q
        x[0], y[0] = 0.0, near_p
        if near_q > 0.0:
            x[0], y[0] = -near_p / near_q, 0.0
        count = 1
        for s in range(n):
            rest = max(_read(x, y, count, left, right, 0.0), 0.0)
            at_rest[s] = rest
            slack_until[s] = x[0] if y[0] == 0.0 and left == 0.0 else -np.inf
            # Knots left of zero, the gap of friction at zero, knots right of it.
            split = 0
            while split < count and x[split] < 0.0:
                split += 1
            rest_of = split
            while rest_of < count and x[rest_of] <= 0.0:
                rest_of += 1
            tail = count - rest_of
            if rest_of < split + 2:
                for c in range(tail - 1, -1, -1):
                    x[split + 2 + c] = x[rest_of + c]
                    y[split + 2 + c] = y[rest_of + c]
            elif rest_of > split + 2:
                for c in range(tail):
                    x[split + 2 + c] = x[rest_of + c]
                    y[split + 2 + c] = y[rest_of + c]
            count = split + 2 + tail
            for c in range(split):
                y[c] = (y[c] - drag[s] + viscosity[s] * x[c]) / hold_left[s]
            x[split], y[split] = 0.0, (rest - drag[s]) / hold_left[s]
            x[split + 1], y[split + 1] = 0.0, hold_right[s] * rest + drag[s]
            for c in range(split + 2, count):
                y[c] = hold_right[s] * y[c] + drag[s] + viscosity[s] * x[c]
            left = (left + viscosity[s]) / hold_left[s]
            right = hold_right[s] * right + viscosity[s]
            # A cable does not push: cut the graph at zero tension.
            if y[0] > 0.0 and left > 0.0:
                for c in range(count, 0, -1):
                    x[c], y[c] = x[c - 1], y[c - 1]
                x[0] = x[1] - y[1] / left
                y[0] = 0.0
                count += 1
            if y[0] <= 0.0:
                keep = 0
                while keep + 1 < count and y[keep + 1] <= 0.0:
                    keep += 1
                if keep + 1 < count:
                    height = y[keep + 1] - y[keep]
                    part = -y[keep] / height
                    x[keep] += (x[keep + 1] - x[keep]) * part
                elif right > 0.0:
                    x[keep] -= y[keep] / right
                y[keep] = 0.0
                if keep > 0:
                    for c in range(keep, count):
                        x[c - keep], y[c - keep] = x[c], y[c]
                    count -= keep
                left = 0.0
                zero_from[s] = x[0]
            else:
                zero_from[s] = -np.inf
            if s + 1 < n:
                k, t = stiffness[s + 1], tension[s + 1]
                for c in range(count):
                    x[c] += (y[c] - t) / k
                if left > 0.0:
                    left = left * k / (k + left)
                if right > 0.0:
                    right = right * k / (k + right)
        # The distal end closes the graph: f(w) = far_p - far_q w.
        if far_q > 0.0 and y[0] == 0.0 and left == 0.0 and far_p <= far_q * x[0]:
            w = far_p / far_q
            ahead = 0.0
        elif far_q > 0.0:
            for c in range(count):
                y[c] += far_q * x[c]
            left, right = 1.0 / (left + far_q), 1.0 / (right + far_q)
            w = _read(y, x, count, left, right, far_p)
            ahead = max(far_p - far_q * w, 0.0)
        else:
            ahead = far_p
            w = _read(y, x, count, _inverse(left), _inverse(right), far_p)
        node[n] = ahead
        for s in range(n - 1, -1, -1):
            if s < n - 1:
                w = shift[s + 1] - (ahead - tension[s + 1]) / stiffness[s + 1]
            rest = at_rest[s]
            low = (rest - drag[s]) / hold_left[s]
            high = hold_right[s] * rest + drag[s]
            dragged = drag[s] > 0.0 or viscosity[s] > 0.0
            if ahead == 0.0 and zero_from[s] > -np.inf:
                # With drag the segment stops there and the slack gathers at its node.
                w = zero_from[s] if dragged else min(w, zero_from[s])
            if ahead == 0.0 and rest == 0.0 and not dragged:
                shift[s], node[s] = w, 0.0
                continue
            # Where the graph is flat only the displacement tells slip from rest.
            margin = 1e-12 * (ahead + drag[s])
            if ahead > high or (ahead >= high - margin and w > 0.0):
                shift[s] = max(w, 0.0)
                ahead = (ahead - drag[s] - viscosity[s] * shift[s]) / hold_right[s]
            elif ahead < low or (ahead <= low + margin and w < 0.0):
                shift[s] = min(w, 0.0)
                ahead = hold_left[s] * ahead + drag[s] - viscosity[s] * shift[s]
            else:
                shift[s] = 0.0
                ahead = rest
            ahead = max(ahead, 0.0) if shift[s] > slack_until[s] else 0.0
            node[s] = ahead
        # A segment that breaks away follows the kinetic law: solve again with it.
        broke = False
        for s in range(n):
            if shift[s] > 0.0 and hold_right[s] != growth_right[s]:
                hold_right[s] = growth_right[s]
                hold_left[s] = min(hold_left[s], growth_left[s])
                broke = True
            elif shift[s] < 0.0 and hold_left[s] != growth_left[s]:
                hold_left[s] = growth_left[s]
                hold_right[s] = min(hold_right[s], growth_right[s])
                broke = True
        if not broke:
            break
