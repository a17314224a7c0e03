"""Which segments slip, found from the ends: fronts march in until friction holds.

Method. Segment j (j = 0..n-1) carries the friction of its stretch of conduit, node i
(i = 0..n) the elasticity of the cable between the centres of segments i-1 and i, so a
step is a chain of springs `k` and friction elements with unknown displacements w_j:

    T_i = T_i,old + k_i (w_i - w_{i-1}),   w_{-1} and w_n the ends.

Seen from a driven end, the slipping part is an affine relation T = p + q w at its front,
q > 0; each segment that joins updates it in closed form (in pure Coulomb friction this
is the geometric series of thesis 2.10 and 2.12). A front stops where friction holds a
segment (thesis 2.17), so a step costs O(front length). When the fronts meet, the last
segment at rest is the null point of opposed motion; its tension ratio is free, which
places the null point inside the segment instead of on a node.

The march presumes that the tension profile before the step lies inside the friction
cone, as it does while coefficients are constant. It says so when it fails, and
`graph.py`, which presumes nothing, takes over.
"""

from __future__ import annotations

from cc_mujoco.compiled import compiled

TOLERANCE = 1e-13
"""Relative excess over the friction limit that counts as holding (rounding)."""


@compiled
def pushed(left, right, hold_right, hold_left, drag):
    """Direction in which tensions `left` and `right` overcome a segment at rest, or 0.

    `hold_right`, `hold_left`: ratio held against motion to the right (+1), left (-1).
    """
    if right > (hold_right * left + drag) * (1.0 + TOLERANCE):
        return 1
    if left > (hold_left * right + drag) * (1.0 + TOLERANCE):
        return -1
    return 0


@compiled
def _join(p, q, growth, drag, viscosity, inward):
    """Carry T = p + q w of an end across a segment slipping inward or outward."""
    if inward:
        return growth * p + drag, growth * q + viscosity
    return (p - drag) / growth, (q + viscosity) / growth


@compiled
def _spring(p, q, stiffness, tension):
    """Carry that relation on across the spring of the next node."""
    whole = stiffness + q
    return (p * stiffness + q * tension) / whole, q * stiffness / whole


@compiled
def _null_slip(p, q, far_p, far_q, way, before, growth, drag, end_stiffness):
    """Slip of the centre of the segment inside which the motion changes direction.

    With the null point at fraction (1 - z)/2 of the segment, net friction is z times
    its limit and the centre slips z times half the segment's change in length. Both
    follow from the tensions beside it, T_left = p + q w and T_right = far_p - far_q w.
    Rounding the null point to the centre (z = 0) would cost first-order accuracy.

    Args:
        way: +1 where the ends are pulled apart, -1 where they are pushed together.
        before: mean tension of the segment before the step.
        end_stiffness: stiffness of half a segment length.
    """
    slip = 0.0
    per_tension = (growth - 1.0) / (growth + 1.0)
    constant = 2.0 * drag / (growth + 1.0)
    for _ in range(4):
        total = max(p + far_p + (q - far_q) * slip, 0.0)
        reach = way * (0.5 * total - before) / end_stiffness
        if reach <= 0.0:
            return 0.0
        limit = per_tension * total + constant
        share = (far_p - p) / ((q + far_q) * reach + limit)
        slip = min(max(share, -1.0), 1.0) * reach
    return slip


@compiled
def march(
    n, tension, stiffness, growth, hold_right, hold_left, drag, viscosity,
    near_p, near_q, far_p, far_q, shift, node, work,
):  # fmt: skip
    """Solve one step by marching the two fronts.

    Args:
        n: number of segments.
        tension: node tensions before the step (n+1,) [N], negative where slack.
        stiffness: node stiffness (n+1,) [N/m].
        growth, hold_right, hold_left, drag, viscosity: per segment (n,), `friction.py`.
        near_p, near_q: the proximal end, T_0 = near_p + near_q w_0.
        far_p, far_q: the distal end, T_n = far_p - far_q w_{n-1}.
        shift: out, slip of each segment in this step (n,) [m].
        node: out, node tensions (n+1,) [N].
        work: scratch (8 (n + 1),).

    Returns:
        True, or False where the march does not apply; outputs are then undefined.
    """
    m = n + 1
    # Relations after (`_p`, `_q`) and before (`_a`, `_b`) a node's spring.
    left_p, left_q = work[:m], work[m : 2 * m]
    left_a, left_b = work[2 * m : 3 * m], work[3 * m : 4 * m]
    right_p, right_q = work[4 * m : 5 * m], work[5 * m : 6 * m]
    right_a, right_b = work[6 * m : 7 * m], work[7 * m : 8 * m]
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
                    whole = stiffness[i] + left_b[i - 1]
                    spring = tension[i] + stiffness[i] * outer
                    inner = (spring - left_a[i - 1]) / whole
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
                left_p[i], left_q[i] = _spring(
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
                right_p[j], right_q[j] = _spring(
                    right_a[s], right_b[s], stiffness[j], tension[j]
                )
    if not settled:
        return False

    at_null = 0.0
    if left_way * right_way < 0 and i + 1 >= j:
        if i == j:
            if abs(inner) < abs(outer):
                i -= 1
            else:
                j += 1
        if hold_right[i] == growth[i] and hold_left[i] == growth[i]:
            at_null = _null_slip(
                left_p[i], left_q[i], right_p[j], right_q[j], -left_way,
                0.5 * (tension[i] + tension[j]), growth[i], drag[i], stiffness[0],
            )  # fmt: skip
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
            whole = stiffness[s + 1] + left_b[s]
            shift[s] = (tension[s + 1] + stiffness[s + 1] * after - left_a[s]) / whole
        node[s] = left_p[s] + left_q[s] * shift[s]
    for s in range(j, n):
        if s > j or i < j:
            before = shift[s - 1]
            whole = stiffness[s] + right_b[s]
            shift[s] = (right_a[s] + stiffness[s] * before - tension[s]) / whole
        node[s + 1] = right_p[s + 1] - right_q[s + 1] * shift[s]
    return True
