"""Which segments slip, found from the ends: fronts march in until friction holds.

Method. Segment j (j = 0..n-1) carries the friction of its stretch of conduit, node i
(i = 0..n) the elasticity of the cable between the centres of segments i-1 and i, so a
step is a chain of springs `k` and friction elements with unknown displacements w_j:

    T_i = T_i,old + k_i (w_i - w_{i-1}),   w_{-1} and w_n the ends.

Seen from a driven end, the slipping part is an affine relation T = p + q w at its
front, q > 0; each segment that joins updates it in closed form (in pure Coulomb
friction this is the geometric series of thesis 2.10 and 2.12). A front stops where
friction holds a segment (thesis 2.17), so a step costs O(front length). When opposed
fronts meet, the null point is carried as a real position inside its segment.

The march presumes that the tension profile before the step lies inside the friction
cone, as it does while coefficients are constant. It says so when it fails, and
`graph.py`, which presumes nothing, takes over.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled

TOLERANCE = 1e-11
"""Relative excess over the friction limit that counts as holding (rounding)."""


@compiled
def pushed(
    left: float, right: float, hold_right: float, hold_left: float, drag: float
) -> int:
    """Direction in which tensions `left` and `right` overcome a segment at rest, or 0.

    `hold_right`, `hold_left`: ratio held against motion to the right (+1), left (-1).
    """
    if right > (hold_right * left + drag) * (1.0 + TOLERANCE):
        return 1
    if left > (hold_left * right + drag) * (1.0 + TOLERANCE):
        return -1
    return 0


@compiled
def _join(
    p: float, q: float, growth: float, drag: float, viscosity: float, inward: bool
) -> tuple[float, float]:
    """Carry T = p + q w of an end across a segment slipping inward or outward."""
    if inward:
        return growth * p + drag, growth * q + viscosity
    share = 1.0 / growth
    return (p - drag) * share, (q + viscosity) * share


@compiled
def _spring(
    p: float, q: float, stiffness: float, tension: float
) -> tuple[float, float, float]:
    """Carry that relation on across the next node's spring; also its compliance."""
    compliance = 1.0 / (stiffness + q)
    return (
        (p * stiffness + q * tension) * compliance,
        q * stiffness * compliance,
        compliance,
    )


@compiled
def _null_slip(
    p: float,
    q: float,
    far_p: float,
    far_q: float,
    way: float,
    left: float,
    right: float,
    growth: float,
    drag: float,
    end_stiffness: float,
) -> float:
    """Slip of the centre of the segment inside which the motion changes direction.

    With the null point at fraction (1 - z)/2 of the segment, net friction is z times
    its limit and the centre slips by z times the lengthening, in this step, of the half
    on whose side the null point lies. Both follow from the tensions beside the segment,
    T_left = p + q w and T_right = far_p - far_q w. Rounding the null point to the
    centre (z = 0) would cost first-order accuracy.

    `way` is +1 where the ends are pulled apart, -1 where they are pushed together,
    `left` and `right` the tensions before the step, `end_stiffness` that of half a
    segment.
    """
    slip, share = 0.0, 0.0
    per_tension = (growth - 1.0) / (growth + 1.0)
    constant = 2.0 * drag / (growth + 1.0)
    for _ in range(4):
        low = p + q * slip
        high = far_p - far_q * slip
        # At the segment's edge the null point passes to its neighbour, for which the
        # tension of the node between them counts; inside, the segment's mean.
        mean = 0.5 * (low - left + high - right)
        side = low - left if share * way > 0.0 else high - right
        change = mean + (side - mean) * share**2
        reach = way * change / end_stiffness
        if reach <= 0.0:
            return 0.0
        limit = per_tension * max(low + high, 0.0) + constant
        share = (far_p - p) / ((q + far_q) * reach + limit)
        share = min(max(share, -1.0), 1.0)
        slip = share * reach
    return slip


@compiled
def march(
    n: int,
    tension: FloatArray,
    stiffness: FloatArray,
    growth: FloatArray,
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
) -> bool:
    """Solve one step by marching the two fronts.

    Args:
        n: number of segments.
        tension: node tensions before the step (n+1,) [N], negative where slack.
        stiffness: node stiffness (n+1,) [N/m].
        growth: E of each segment (n,), see `friction.py`.
        hold_right: ratio a segment holds against motion towards distal (n,).
        hold_left: ratio a segment holds against motion towards proximal (n,).
        drag: B of each segment (n,) [N].
        viscosity: C of each segment per displacement of the step (n,) [N/m].
        near_p: proximal end, T_0 = near_p + near_q w_0 [N].
        near_q: its slope [N/m].
        far_p: distal end, T_n = far_p - far_q w_{n-1} [N].
        far_q: its slope [N/m].
        shift: out, slip of each segment in this step (n,) [m].
        node: out, node tensions (n+1,) [N].
        work: scratch (10 (n + 1),).

    Returns:
        True, or False where the march does not apply; outputs are then undefined.
    """
    m = n + 1
    # Relations after (`_p`, `_q`) and before (`_a`, `_b`) a node's spring, and the
    # compliance `_c` of that node with what lies behind it.
    left_p, left_q = work[:m], work[m : 2 * m]
    left_a, left_b = work[2 * m : 3 * m], work[3 * m : 4 * m]
    right_p, right_q = work[4 * m : 5 * m], work[5 * m : 6 * m]
    right_a, right_b = work[6 * m : 7 * m], work[7 * m : 8 * m]
    left_c, right_c = work[8 * m : 9 * m], work[9 * m : 10 * m]
    left_p[0], left_q[0] = near_p, near_q
    right_p[n], right_q[n] = far_p, far_q
    i, j = 0, n  # segments < i belong to the proximal front, >= j to the distal one
    left_way, right_way = 0, 0
    inner, outer = 0.0, 0.0  # slip on both sides of the node where the fronts meet
    settled = False
    for _ in range(8 * n + 16):
        if i == j:
            if i < n:
                slope = left_q[i] + right_b[i]
                outer = (right_a[i] - left_p[i]) / slope
                if i > 0:
                    spring = tension[i] + stiffness[i] * outer
                    inner = (spring - left_a[i - 1]) * left_c[i]
            else:
                slope = left_b[n - 1] + right_q[n]
                inner = (right_p[n] - left_a[n - 1]) / slope
            if slope <= 0.0:
                return False
            if i > 0 and inner * left_way < 0.0:
                i -= 1
                if i == 0:
                    left_way = 0
                continue
            if i < n and outer * right_way < 0.0:
                j += 1
                if j == n:
                    right_way = 0
                continue
            settled = True
            break
        last = i + 1 == j
        ahead = right_p[j] if last else tension[i + 1]
        way = pushed(
            max(left_p[i], 0.0), max(ahead, 0.0), hold_right[i], hold_left[i], drag[i]
        )
        from_left = way != 0
        if last and way != 0 and left_way != way:
            from_left = right_way != way and left_way == 0
        s = i
        if not from_left:
            if not last:
                s = j - 1
                way = pushed(
                    max(tension[s], 0.0),
                    max(right_p[j], 0.0),
                    hold_right[s],
                    hold_left[s],
                    drag[s],
                )
            if way == 0:
                settled = True
                break
        if from_left:
            if left_way == -way:
                return False
            left_way = way
            left_a[s], left_b[s] = _join(
                left_p[s], left_q[s], growth[s], drag[s], viscosity[s], way > 0
            )
            i += 1
            if i < n:
                left_p[i], left_q[i], left_c[i] = _spring(
                    left_a[s], left_b[s], stiffness[i], tension[i]
                )
        else:
            if right_way == -way:
                return False
            right_way = way
            right_a[s], right_b[s] = _join(
                right_p[j], right_q[j], growth[s], drag[s], viscosity[s], way < 0
            )
            j -= 1
            if j > 0:
                right_p[j], right_q[j], right_c[j] = _spring(
                    right_a[s], right_b[s], stiffness[j], tension[j]
                )
    if not settled:
        return False

    at_null = 0.0
    near_way, far_way = 0.0, 0.0
    if near_q > 0.0 and far_q > 0.0:
        near_way, far_way = np.sign(tension[0] - near_p), np.sign(far_p - tension[n])
    if i + 1 >= j and near_way * far_way < 0.0:
        # The ends move opposite ways: find the segment in which the motion turns.
        if i == j:
            way = right_way if i == 0 else left_way
            if 0 < i < n and left_way != right_way:
                if abs(inner) < abs(outer):
                    i -= 1
            elif near_way == -way:
                for s in range(j - 1, 0, -1):
                    right_a[s], right_b[s] = _join(
                        right_p[s + 1],
                        right_q[s + 1],
                        growth[s],
                        drag[s],
                        viscosity[s],
                        way < 0,
                    )
                    right_p[s], right_q[s], right_c[s] = _spring(
                        right_a[s], right_b[s], stiffness[s], tension[s]
                    )
                i = 0
            else:
                for s in range(i, n - 1):
                    left_a[s], left_b[s] = _join(
                        left_p[s],
                        left_q[s],
                        growth[s],
                        drag[s],
                        viscosity[s],
                        way > 0,
                    )
                    left_p[s + 1], left_q[s + 1], left_c[s + 1] = _spring(
                        left_a[s], left_b[s], stiffness[s + 1], tension[s + 1]
                    )
                i = n - 1
            j = i + 1
        if hold_right[i] == growth[i] and hold_left[i] == growth[i]:
            at_null = _null_slip(
                left_p[i],
                left_q[i],
                right_p[j],
                right_q[j],
                far_way,
                tension[i],
                tension[j],
                growth[i],
                drag[i],
                stiffness[0],
            )
    for s in range(i, j):
        shift[s] = at_null
    for s in range(i + 1, j):
        node[s] = tension[s]
    if i < j:
        node[i] = left_p[i] + left_q[i] * at_null
        node[j] = right_p[j] - right_q[j] * at_null
    elif i < n:
        if i > 0:
            shift[i - 1] = inner
        shift[i] = outer
        node[i] = left_p[i] + left_q[i] * outer
    else:
        shift[n - 1] = inner
        node[n] = left_a[n - 1] + left_b[n - 1] * inner
    for s in range(i - 1, -1, -1):
        if s < i - 1 or i < j:
            after = shift[s + 1]
            spring = tension[s + 1] + stiffness[s + 1] * after
            shift[s] = (spring - left_a[s]) * left_c[s + 1]
        node[s] = left_p[s] + left_q[s] * shift[s]
    for s in range(j, n):
        if s > j or i < j:
            before = shift[s - 1]
            spring = tension[s] - stiffness[s] * before
            shift[s] = (right_a[s] - spring) * right_c[s]
        node[s + 1] = right_p[s + 1] - right_q[s + 1] * shift[s]
    return True
