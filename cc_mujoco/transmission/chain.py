"""The chain of springs and friction elements, once it is known what slips which way.

Same chain as in `fronts.py`. Each segment is then one line between the tensions beside
it and its displacement w,

    T_right = gain T_left + offset + own w,

`own` infinite where it stays at rest, so that the step is one pass along the cable that
eliminates and one back that substitutes, as for any tridiagonal system. Eliminated is
by compliances in series, all of one sign, so nothing cancels; substituted is by the
displacements, so an error does not grow from segment to segment however stiff drag is.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled


@compiled
def slipping(
    way: float, hold_right: float, hold_left: float, drag: float, viscosity: float
) -> tuple[float, float, float]:
    """Line `gain`, `offset`, `own` of a segment that slips towards `way`."""
    if way > 0.0:
        return hold_right, drag, viscosity
    return 1.0 / hold_left, -drag / hold_left, viscosity / hold_left


@compiled
def solve(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    gain: FloatArray,
    offset: FloatArray,
    own: FloatArray,
    slack: FloatArray,
    near_p: float,
    near_q: float,
    far_p: float,
    far_q: float,
    shift: FloatArray,
    node: FloatArray,
    work: FloatArray,
) -> None:
    """Displacements and tensions of a step.

    Args:
        n: number of segments.
        tension: node tensions before the step (n+1,) [N].
        stiffness: of the nodes (n+1,) [N/m].
        gain: ratio of the tensions of each segment (n,).
        offset: what its friction adds (n,) [N].
        own: stiffness against its displacement (n,) [N/m]; inf: it stays at rest.
        slack: not 0 where a node is without tension (n+1,).
        near_p: the proximal end is T = near_p + near_q w [N].
        near_q: [N/m].
        far_p: the distal end is T = far_p - far_q w [N].
        far_q: [N/m].
        shift: out, slip of each segment in this step (n,) [m].
        node: out, node tensions (n+1,) [N].
        work: scratch (2 n,).
    """
    p, q = work[:n], work[n : 2 * n]  # T = p + q w on the left of each segment
    p[0], q[0] = near_p, near_q
    if slack[0] != 0.0:
        p[0], q[0] = 0.0, 0.0
    for s in range(n - 1):
        if slack[s + 1] != 0.0:
            p[s + 1], q[s + 1] = 0.0, 0.0
            continue
        k, t = stiffness[s + 1], tension[s + 1]
        if own[s] == np.inf:
            p[s + 1], q[s + 1] = t, k
            continue
        constant, slope = gain[s] * p[s] + offset[s], gain[s] * q[s] + own[s]
        p[s + 1] = (k * constant + slope * t) / (k + slope)
        q[s + 1] = k * slope / (k + slope)
    constant, slope = far_p, far_q
    for s in range(n - 1, -1, -1):
        # T = constant - slope w on the right of the segment.
        if slack[s + 1] != 0.0:
            constant, slope = 0.0, 0.0
        w = 0.0
        if own[s] != np.inf:
            stiff = gain[s] * q[s] + own[s] + slope
            if stiff > 0.0:
                w = (constant - gain[s] * p[s] - offset[s]) / stiff
        if s == n - 1:
            node[n] = constant - slope * w
        shift[s] = w
        node[s] = p[s] + q[s] * w
        k, t = stiffness[s], tension[s]
        constant, slope = t + k * w, k


@compiled
def lay(
    first: int,
    last: int,
    tension: FloatArray,
    stiffness: FloatArray,
    left: float,
    left_bound: bool,
    right: float,
    right_bound: bool,
    shift: FloatArray,
) -> None:
    """Lay slack cable evenly: without tension no friction keeps it where it is.

    Nodes `first` to `last` have no tension, and the segments between them no drag.
    `left` and `right` is what moved before and behind them in this step [m]. Where one
    of them is not bound, as an end without tension, the cable lies unstrained.
    """
    rest, compliance = 0.0, 0.0
    for i in range(first, last + 1):
        rest += tension[i] / stiffness[i]
        compliance += 1.0 / stiffness[i]
    if not left_bound:
        left = right + rest
    strained = (right - left + rest) / compliance if right_bound else 0.0
    for i in range(first, last):
        left += (strained - tension[i]) / stiffness[i]
        shift[i] = left


@compiled
def lay_slack(
    n: int,
    free: FloatArray,
    tension: FloatArray,
    stiffness: FloatArray,
    slack: FloatArray,
    near_p: float,
    near_q: float,
    far_p: float,
    far_q: float,
    shift: FloatArray,
) -> None:
    """Lay all slack cable evenly that nothing holds; arguments as in `solve`.

    `free` is not 0 where a segment has no friction without tension (n,).
    """
    first = 0
    while first < n:
        last = first
        while (
            last < n
            and slack[last] != 0.0
            and slack[last + 1] != 0.0
            and free[last] != 0.0
        ):
            last += 1
        if last > first:
            left_bound = first > 0 or near_q > 0.0
            right_bound = last < n or far_q > 0.0
            left, right = 0.0, 0.0
            if first > 0:
                left = shift[first - 1]
            elif left_bound:
                left = (tension[0] - near_p) / near_q
            if last < n:
                right = shift[last]
            elif right_bound:
                right = (far_p - tension[n]) / far_q
            lay(
                first, last, tension, stiffness, left, left_bound, right, right_bound,
                shift,
            )  # fmt: skip
        first = last + 1
