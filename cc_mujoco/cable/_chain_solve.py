"""Solution of the chain of springs and friction elements for known slip directions.

The chain is that of `_fronts.py`. Each segment is then one linear relation between the
tensions at its ends and its displacement w,

    T_distal = gain T_proximal + offset + own w,

with `own` infinite where it rests. As for any tridiagonal system, the step is one pass
along the cable that eliminates and one back that substitutes. Elimination adds
compliances in series, all of one sign, so nothing cancels. Substitution is by the
displacements, so an error does not grow from segment to segment however stiff drag is.
"""

from typing import NamedTuple

import numpy as np

from cc_mujoco.native import FloatArray, internal


class Chain(NamedTuple):
    """Springs (nodes), friction elements (segments) and end conditions of a step.

    The end tensions are proximal_p + proximal_q w and distal_p - distal_q w [N], with
    the displacement w of the adjacent segment [m].
    """

    tension: FloatArray  # of each node before the step (n + 1,) [N]
    stiffness: FloatArray  # of each node (n + 1,) [N/m]
    hold_distal: FloatArray  # tension ratio of each segment if it slips to distal (n,)
    hold_proximal: FloatArray  # the same if it slips to proximal (n,)
    drag: FloatArray  # friction of each segment that needs no tension (n,) [N]
    viscosity: FloatArray  # viscous drag of each segment per displacement (n,) [N/m]
    proximal_p: float
    proximal_q: float
    distal_p: float
    distal_q: float


class ChainMotion(NamedTuple):
    """Motion of a chain in a step: an initial guess, or the solution."""

    direction: FloatArray  # slip of each segment: 1 to distal, -1, 0 at rest (n,)
    slack: FloatArray  # not 0 where a node is slack (n + 1,)
    shift: FloatArray  # displacement of each segment in this step (n,) [m]
    node: FloatArray  # tension of each node (n + 1,) [N]


@internal
def slipping(chain: Chain, s: int, slip_direction: float) -> tuple[float, float, float]:
    """Return `gain`, `offset` [N] and `own` [N/m] of segment s if it slips this way."""
    drag, viscosity = chain.drag[s], chain.viscosity[s]
    if slip_direction > 0.0:
        return chain.hold_distal[s], drag, viscosity
    hold = chain.hold_proximal[s]
    return 1.0 / hold, -drag / hold, viscosity / hold


@internal
def solve(
    n: int, chain: Chain, lines: FloatArray, motion: ChainMotion, work: FloatArray
) -> None:
    """Solve a step for `shift` and `node` of `motion`, given its `slack` and `lines`.

    `lines` (3 n,) are `gain`, `offset` [N] and `own` [N/m] of all segments; `work` is
    scratch (2 n,).
    """
    gain, offset, own = lines[:n], lines[n : 2 * n], lines[2 * n : 3 * n]
    slack, shift, node = motion.slack, motion.shift, motion.node
    tension, stiffness = chain.tension, chain.stiffness
    p, q = work[:n], work[n : 2 * n]  # T = p + q w on the left of each segment
    p[0], q[0] = chain.proximal_p, chain.proximal_q
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
    constant, slope = chain.distal_p, chain.distal_q
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
    first: int, last: int, tension: FloatArray, stiffness: FloatArray, proximal: float,
    proximal_bound: bool, distal: float, distal_bound: bool, shift: FloatArray,
) -> None:  # fmt: skip
    """Set `shift` of the segments between slack nodes so that their strain is even.

    Nodes `first` to `last` are slack, so no friction acts between them. `proximal` and
    `distal` are the displacements on either side of them [m]; if one is not bound, as
    at an end without tension, their strain is 0.
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
def lay_slack(n: int, chain: Chain, free: FloatArray, motion: ChainMotion) -> None:
    """Strain slack cable evenly, but for segments that friction holds (`free` 0)."""
    tension, slack, shift = chain.tension, motion.slack, motion.shift
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
            proximal_bound = first > 0 or chain.proximal_q > 0.0
            distal_bound = last < n or chain.distal_q > 0.0
            proximal, distal = 0.0, 0.0
            if first > 0:
                proximal = shift[first - 1]
            elif proximal_bound:
                proximal = (tension[0] - chain.proximal_p) / chain.proximal_q
            if last < n:
                distal = shift[last]
            elif distal_bound:
                distal = (chain.distal_p - tension[n]) / chain.distal_q
            lay_evenly(
                first, last, tension, chain.stiffness, proximal, proximal_bound,
                distal, distal_bound, shift,
            )  # fmt: skip
        first = last + 1


@internal
def break_away(
    chain: Chain, s: int, way: float, growth_distal: FloatArray,
    growth_proximal: FloatArray,
) -> bool:  # fmt: skip
    """Give a slipping segment its kinetic ratios; return whether they have changed.

    It slips to distal if `way` > 0, to proximal if `way` < 0. `growth_distal` and
    `growth_proximal` (n,) are the kinetic tension ratios for slip in that direction.
    """
    hold_distal, hold_proximal = chain.hold_distal, chain.hold_proximal
    if way > 0.0 and hold_distal[s] != growth_distal[s]:
        hold_distal[s] = growth_distal[s]
        hold_proximal[s] = min(hold_proximal[s], growth_proximal[s])
        return True
    if way < 0.0 and hold_proximal[s] != growth_proximal[s]:
        hold_proximal[s] = growth_proximal[s]
        hold_distal[s] = min(hold_distal[s], growth_distal[s])
        return True
    return False
