"""One step of a cable whose friction builds up elastically, on bristles.

Same chain as in `fronts.py`. Before it slips, a segment is held by a spring to its
conduit. Its friction is the smaller of what the spring gives and what Coulomb allows,

    T_right = min(max(T_left + f + s w, lower), upper),

with the spring's force f before the step, its stiffness s and the displacement w, upper
= H T_left + B and lower its mirror image. Each of the three is one line in the
displacements of neighbours, increasing in the segment's own and decreasing in the
others, so that the step is a sequence of tridiagonal systems: guess which segments
slip, solve, look again (policy iteration, Howard 1960). It takes two to four rounds.
Reading a solution backwards along the cable, as `graph.py` does, is no way here: behind
stiff bristles an error in w grows exponentially from segment to segment.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled

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
    bristles. `work` holds (3 n,).

    Returns:
        True, or False where some of the cable goes slack; outputs are then undefined.
    """
    upper, right_side = work[:n], work[n : 2 * n]
    way = work[2 * n : 3 * n]
    for s in range(n):
        way[s] = 0.0
        if slipped[s] != 0.0:
            way[s] = 1.0 if slipped[s] > 0.0 else -1.0
    settled = False
    for _ in range(_ROUNDS):
        # Tension of node i is constant - before w[i - 1] + behind w[i].
        constant, before, behind = near_p, 0.0, near_q
        for s in range(n):
            if s + 1 < n:
                k = stiffness[s + 1]
                next_constant, next_before, next_behind = tension[s + 1], k, k
            else:
                next_constant, next_before, next_behind = far_p, far_q, 0.0
            if way[s] > 0.0:
                a, b, extra = hold_right[s], 1.0, drag[s]
                own = viscosity[s]
            elif way[s] < 0.0:
                a, b, extra = 1.0, hold_left[s], -drag[s]
                own = viscosity[s]
            else:
                a, b, extra = 1.0, 1.0, held[s]
                own = spring[s] + viscosity[s]
            # a T_left + extra + own w - b T_right = 0
            diagonal = a * behind + own + b * next_before
            rhs = b * next_constant - a * constant - extra
            if s > 0:
                lower = a * before
                diagonal -= lower * upper[s - 1]
                rhs += lower * right_side[s - 1]
            upper[s] = b * next_behind / diagonal
            right_side[s] = rhs / diagonal
            constant, before, behind = next_constant, next_before, next_behind
        shift[n - 1] = right_side[n - 1]
        for s in range(n - 2, -1, -1):
            shift[s] = right_side[s] + upper[s] * shift[s + 1]
        node[0] = near_p + near_q * shift[0]
        for i in range(1, n):
            node[i] = tension[i] + stiffness[i] * (shift[i] - shift[i - 1])
        node[n] = far_p - far_q * shift[n - 1]
        settled = True
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
        if not 0.0 <= node[i] < np.inf:
            return False
    for s in range(n):
        left, w = node[s], shift[s]
        stretched = held[s] + spring[s] * w
        slipped[s] = 0.0
        if way[s] != 0.0:
            least, most = _limits(left, 0.0, hold_right[s], hold_left[s], drag[s], 0.0)
            force = (most if way[s] > 0.0 else least) - left
            if spring[s] > 0.0:
                slipped[s] = (stretched - force) / spring[s]
            else:
                slipped[s] = w
            stretched = force
        held[s] = stretched
    return True
