"""Solution of the chain of springs and friction elements for known slip directions.

Same chain as in `_fronts.py`. Each segment is then one linear relation between the
tensions at its ends and its displacement w,

    T_distal = gain T_proximal + offset + own w,

`own` infinite where it stays at rest, so that the step is one pass along the cable that
eliminates and one back that substitutes, as for any tridiagonal system. Eliminated is
by compliances in series, all of one sign, so nothing cancels; substituted is by the
displacements, so an error does not grow from segment to segment however stiff drag is.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.native import FloatArray, internal


@internal
def slipping(
    slip_direction: float,
    hold_distal: float,
    hold_proximal: float,
    drag: float,
    viscosity: float,
) -> tuple[float, float, float]:
    """Return `gain`, `offset` and `own` of a slipping segment.

    With them T_distal = gain T_proximal + offset + own w at the slip speed w. `hold_*`
    are the ratios of the tensions where it slips towards either end.
    """
    if slip_direction > 0.0:
        return hold_distal, drag, viscosity
    return 1.0 / hold_proximal, -drag / hold_proximal, viscosity / hold_proximal


@internal
def solve(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    gain: FloatArray,
    offset: FloatArray,
    own: FloatArray,
    slack: FloatArray,
    proximal_p: float,
    proximal_q: float,
    distal_p: float,
    distal_q: float,
    shift: FloatArray,
    node: FloatArray,
    work: FloatArray,
) -> None:
    """Compute displacements and tensions of a step.

    The nodes (n + 1,) have `tension` before the step [N] and `stiffness` [N/m], and are
    `slack` where not 0. Friction of the segments (n,) is a ratio of tensions `gain`,
    `offset` [N], and `own` stiffness against displacement [N/m], inf at rest. Ends are
    T = proximal_p + proximal_q w and T = distal_p - distal_q w [N]. Out: `shift` (n,),
    slip in this step [m], and the tensions `node`. `work` holds (2 n,).
    """
    p, q = work[:n], work[n : 2 * n]  # T = p + q w on the left of each segment
    p[0], q[0] = proximal_p, proximal_q
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
    constant, slope = distal_p, distal_q
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


@internal
def lay_evenly(
    first: int,
    last: int,
    tension: FloatArray,
    stiffness: FloatArray,
    proximal: float,
    proximal_bound: bool,
    distal: float,
    distal_bound: bool,
    shift: FloatArray,
) -> None:
    """Lay slack cable evenly: without tension no friction keeps it where it is.

    Nodes `first` to `last` have no tension, and the segments between them no drag.
    `proximal` and `distal` is what moved before and behind them in this step [m]. Where
    one of them is not bound, as an end without tension, the cable lies unstrained.
    """
    rest, compliance = 0.0, 0.0
    for i in range(first, last + 1):
        rest += tension[i] / stiffness[i]
        compliance += 1.0 / stiffness[i]
    if not proximal_bound:
        proximal = distal + rest
    strained = (distal - proximal + rest) / compliance if distal_bound else 0.0
    for i in range(first, last):
        proximal += (strained - tension[i]) / stiffness[i]
        shift[i] = proximal


@internal
def lay_slack(
    n: int,
    free: FloatArray,
    tension: FloatArray,
    stiffness: FloatArray,
    slack: FloatArray,
    proximal_p: float,
    proximal_q: float,
    distal_p: float,
    distal_q: float,
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
            proximal_bound = first > 0 or proximal_q > 0.0
            distal_bound = last < n or distal_q > 0.0
            proximal, distal = 0.0, 0.0
            if first > 0:
                proximal = shift[first - 1]
            elif proximal_bound:
                proximal = (tension[0] - proximal_p) / proximal_q
            if last < n:
                distal = shift[last]
            elif distal_bound:
                distal = (distal_p - tension[n]) / distal_q
            lay_evenly(
                first, last, tension, stiffness, proximal, proximal_bound, distal,
                distal_bound, shift,
            )  # fmt: skip
        first = last + 1
