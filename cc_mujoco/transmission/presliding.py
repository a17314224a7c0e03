"""One step of a cable whose friction builds up elastically, on bristles.

Same chain as in `fronts.py`. Before it slips, a segment is held by a spring to its
conduit. Its friction is the smaller of what the spring gives and what Coulomb allows,

    T_right = min(max(T_left + f + s w, lower), upper),

with the spring's force f before the step, its stiffness s and the displacement w, upper
= H T_left + B and lower its mirror image. Each of the three is one line in the
displacements of neighbours, increasing in the segment's own and decreasing in the
others, so that the step is a sequence of tridiagonal systems: guess which segments
slip, solve, look again (policy iteration, Howard 1960). It takes two to four rounds.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.transmission.chain import lay_slack, slipping, solve

_ROUNDS = 60
_ROUNDING = 1e-12


@compiled
def _limits(
    left: float, w: float, hold_right: float, hold_left: float, drag: float, c: float
) -> tuple[float, float]:
    """Least and most tension on the right that Coulomb friction allows."""
    return (left - drag + c * w) / hold_left, hold_right * left + drag + c * w


@compiled
def preslide(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    growth_right: FloatArray,
    growth_left: FloatArray,
    hold_right: FloatArray,
    hold_left: FloatArray,
    drag: FloatArray,
    viscosity: FloatArray,
    held: FloatArray,
    spring: FloatArray,
    near_p: float,
    near_q: float,
    far_p: float,
    far_q: float,
    shift: FloatArray,
    node: FloatArray,
    slipped: FloatArray,
    work: FloatArray,
) -> bool:
    """Solve one step; arguments as in `graph.sweep`, and three more.

    `spring` is the stiffness of the bristles of each segment (n,) [N/m], `held` their
    force [N], in and out. `slipped` (n,) says which way each segment is expected to
    slip, and then which part of its displacement [m] is slip and not stretch of its
    bristles. `work` holds (8 n + 1,).

    Returns:
        True, or False where no solution was found; outputs are then undefined.
    """
    way, slack = work[:n], work[n : 2 * n + 1]
    lines, rest = work[2 * n + 1 : 5 * n + 1], work[5 * n + 1 :]
    gain, offset, own = lines[:n], lines[n : 2 * n], lines[2 * n :]
    free = rest[2 * n :]
    for i in range(n + 1):
        slack[i] = 1.0 if tension[i] < 0.0 else 0.0
    for s in range(n):
        way[s] = 0.0
        if slipped[s] != 0.0:
            way[s] = 1.0 if slipped[s] > 0.0 else -1.0
    settled = False
    for _ in range(_ROUNDS):
        for s in range(n):
            gain[s], offset[s], own[s] = 1.0, held[s], spring[s] + viscosity[s]
            if way[s] != 0.0:
                gain[s], offset[s], own[s] = slipping(
                    way[s], hold_right[s], hold_left[s], drag[s], viscosity[s]
                )
        solve(
            n, tension, stiffness, gain, offset, own, slack,
            near_p, near_q, far_p, far_q, shift, node, rest,
        )  # fmt: skip
        for s in range(n):
            free[s] = 1.0 if own[s] == 0.0 else 0.0
        lay_slack(
            n, free, tension, stiffness, slack, near_p, near_q, far_p, far_q, shift
        )
        largest = 0.0
        for i in range(n + 1):
            largest = max(largest, abs(node[i]))
        settled = True
        for i in range(n + 1):
            behind = shift[i - 1] if i > 0 else 0.0
            ahead = shift[i] if i < n else 0.0
            strained = tension[i] + stiffness[i] * (ahead - behind)
            if i == 0:
                strained = near_p + near_q * ahead
            elif i == n:
                strained = far_p - far_q * behind
            now = 1.0 if strained < 0.0 else 0.0
            if now != slack[i]:
                slack[i] = now
                scale = largest + stiffness[i] * (abs(ahead) + abs(behind))
                if abs(strained) > _ROUNDING * scale:
                    settled = False
        for s in range(n):
            left, w = node[s], shift[s]
            least, most = _limits(
                left, w, hold_right[s], hold_left[s], drag[s], viscosity[s]
            )
            elastic = left + held[s] + (spring[s] + viscosity[s]) * w
            now, wanted = 0.0, elastic
            if elastic > most:
                now, wanted = 1.0, most
            elif elastic < least:
                now, wanted = -1.0, least
            if now != way[s]:
                scale = abs(left) + abs(node[s + 1]) + drag[s]
                if abs(node[s + 1] - wanted) > _ROUNDING * scale:
                    settled = False
                way[s] = now
        if not settled:
            continue
        # A segment that slips follows the kinetic law: solve again with it.
        for s in range(n):
            if way[s] > 0.0 and hold_right[s] != growth_right[s]:
                hold_right[s] = growth_right[s]
                hold_left[s] = min(hold_left[s], growth_left[s])
                settled = False
            elif way[s] < 0.0 and hold_left[s] != growth_left[s]:
                hold_left[s] = growth_left[s]
                hold_right[s] = min(hold_right[s], growth_right[s])
                settled = False
        if settled:
            break
    if not settled:
        return False
    for i in range(n + 1):
        if not np.isfinite(node[i]):
            return False
        node[i] = max(node[i], 0.0)
    for s in range(n):
        left, w = node[s], shift[s]
        stretched = held[s] + spring[s] * w
        slipped[s] = 0.0
        if way[s] != 0.0:
            # What Coulomb friction takes, without the share of viscosity.
            force = (hold_right[s] - 1.0) * left + drag[s]
            if way[s] < 0.0:
                force = -(hold_left[s] - 1.0) * node[s + 1] - drag[s]
            if spring[s] > 0.0:
                slipped[s] = (stretched - force) / spring[s]
            else:
                slipped[s] = w
            stretched = force
        held[s] = stretched
    return True
