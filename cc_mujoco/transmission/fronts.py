"""Which segments slip, found from the ends: fronts march in until friction holds.

Method. Segment j (j = 0..n-1) carries the friction of its stretch of conduit, node i
(i = 0..n) the elasticity of the cable between the centres of segments i-1 and i, so a
step is a chain of springs `k` and friction elements with unknown displacements w_j:

    T_i = T_i,old + k_i (w_i - w_{i-1}),   w_{-1} and w_n the ends.

Seen from an end, the slipping part is an affine relation w = c T - e at its front, with
c > 0 the compliance behind it; each segment that joins updates it in closed form, which
sums the geometric series of thesis 2.10 and 2.12. A front stops where friction holds a
segment (2.17), so a step costs O(front length). When opposed fronts meet, the null
point is carried as a real position inside its segment.

The march presumes that both ends are driven by position, that no friction depends on
the rate, and that the tension profile before the step lies inside the friction cone, as
it does while coefficients are constant. It says so when it fails, and
`graph.py`, which presumes nothing, takes over.
"""

from __future__ import annotations

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
    c: float,
    e: float,
    growth: float,
    drag: float,
    compliance: float,
    before: float,
    inward: bool,
) -> tuple[float, float, float, float]:
    """Carry w = c T - e across a segment slipping inward or outward and a spring.

    Returns the relation at the segment's other node before that node's spring, of
    `compliance` and tension `before` the step, and after it.
    """
    if inward:
        a = c * (1.0 / growth)
        b = e + a * drag
    else:
        a = c * growth
        b = e - c * drag
    return a, b, a + compliance, b + compliance * before


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
    # Both halves give way alike, so the centre stays between its neighbours. That also
    # holds it where the fronts have come near but not met.
    with_left, with_right = (left - p) / q, (far_p - right) / far_q
    slip = max(slip, min(with_left, with_right, 0.0))
    slip = min(slip, max(with_left, with_right, 0.0))
    # Where the rounds have not settled, net friction would exceed its limit.
    both, tilt = q + far_q, per_tension * (q - far_q)
    limit = per_tension * (p + far_p) + constant
    least = (far_p - p - limit) / (both + tilt)
    most = (far_p - p + limit) / (both - tilt)
    return min(max(slip, least), most)


@compiled
def march(
    n: int,
    tension: FloatArray,
    compliance: FloatArray,
    growth: FloatArray,
    hold_right: FloatArray,
    hold_left: FloatArray,
    drag: FloatArray,
    near: float,
    far: float,
    shift: FloatArray,
    node: FloatArray,
    work: FloatArray,
) -> bool:
    """Solve one step by marching the two fronts.

    Args:
        n: number of segments.
        tension: node tensions before the step (n+1,) [N], negative where slack.
        compliance: of the nodes, 1/k (n+1,) [m/N].
        growth: E of each segment (n,), see `friction.py`.
        hold_right: ratio a segment holds against motion towards distal (n,).
        hold_left: ratio a segment holds against motion towards proximal (n,).
        drag: B of each segment (n,) [N].
        near: motion of the proximal end in this step [m].
        far: motion of the distal end in this step [m].
        shift: out, slip of each segment in this step (n,) [m].
        node: out, node tensions (n+1,) [N].
        work: scratch (8 (n + 1),).

    Returns:
        True, or False where the march does not apply; outputs are then undefined.
    """
    m = n + 1
    # w_i = left_c T_i - left_e after the spring of node i and left_a T_{i+1} - left_b
    # before that of node i + 1; from the distal end the same for -w, mirrored.
    left_a, left_b = work[:m], work[m : 2 * m]
    left_c, left_e = work[2 * m : 3 * m], work[3 * m : 4 * m]
    right_a, right_b = work[4 * m : 5 * m], work[5 * m : 6 * m]
    right_c, right_e = work[6 * m : 7 * m], work[7 * m : 8 * m]
    left_c[0], left_e[0] = compliance[0], compliance[0] * tension[0] - near
    right_c[n], right_e[n] = compliance[n], compliance[n] * tension[n] + far
    i, j = 0, n  # segments < i belong to the proximal front, >= j to the distal one
    left_way, right_way = 0, 0
    at_meeting, inner, outer = 0.0, 0.0, 0.0
    settled = False
    for _ in range(8 * n + 16):
        if i == j:
            # Every segment slips: the two relations meet at node i.
            if i < n:
                whole = left_c[i] + right_a[i]
                at_meeting = (left_e[i] + right_b[i]) / whole
                outer = left_c[i] * at_meeting - left_e[i]
            else:
                whole = left_a[n - 1] + right_c[n]
                at_meeting = (left_b[n - 1] + right_e[n]) / whole
            if i > 0:
                inner = left_a[i - 1] * at_meeting - left_b[i - 1]
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
        s = i
        last = i + 1 == j
        ahead = right_e[j] / right_c[j] if last else tension[i + 1]
        way = pushed(
            max(left_e[i] / left_c[i], 0.0),
            max(ahead, 0.0),
            hold_right[i],
            hold_left[i],
            drag[i],
        )
        from_left = way != 0
        if last and way != 0 and left_way != way:
            from_left = right_way != way and left_way == 0
        if not from_left:
            if not last:
                s = j - 1
                way = pushed(
                    max(tension[s], 0.0),
                    max(right_e[j] / right_c[j], 0.0),
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
            i += 1
            left_a[s], left_b[s], left_c[i], left_e[i] = _join(
                left_c[s], left_e[s], growth[s], drag[s],
                compliance[i], tension[i], way > 0,
            )  # fmt: skip
        else:
            if right_way == -way:
                return False
            right_way = way
            right_a[s], right_b[s], right_c[s], right_e[s] = _join(
                right_c[j], right_e[j], growth[s], drag[s],
                compliance[s], tension[s], way < 0,
            )  # fmt: skip
            j -= 1
    if not settled:
        return False

    at_null = 0.0
    met = i == j
    if i + 1 >= j and near * far < 0.0:
        # The ends move opposite ways: find the segment in which the motion turns.
        if met:
            way = right_way if i == 0 else left_way
            if 0 < i < n and left_way != right_way:
                if abs(inner) < abs(outer):
                    i -= 1
            elif near * way < 0.0:
                for s in range(j - 1, 0, -1):
                    right_a[s], right_b[s], right_c[s], right_e[s] = _join(
                        right_c[s + 1], right_e[s + 1], growth[s], drag[s],
                        compliance[s], tension[s], way < 0,
                    )  # fmt: skip
                right_way = way
                i = 0
            else:
                for s in range(i, n - 1):
                    left_a[s], left_b[s], left_c[s + 1], left_e[s + 1] = _join(
                        left_c[s], left_e[s], growth[s], drag[s],
                        compliance[s + 1], tension[s + 1], way > 0,
                    )  # fmt: skip
                left_way = way
                i = n - 1
            j = i + 1
        # Fronts come to the null point from both sides, so friction there is kinetic,
        # unless only static friction holds the segment as a whole.
        turning = met or not pushed(
            max(left_e[i] / left_c[i], 0.0),
            max(right_e[j] / right_c[j], 0.0),
            growth[i],
            growth[i],
            drag[i],
        )
        moved = 0
        while turning:
            at_null = _null_slip(
                left_e[i] / left_c[i], 1.0 / left_c[i],
                right_e[j] / right_c[j], 1.0 / right_c[j],
                1.0 if far > 0.0 else -1.0,
                tension[i], tension[j], growth[i], drag[i], 1.0 / compliance[0],
            )  # fmt: skip
            # A neighbour that would slip against its front has the null point.
            beyond = 0
            if j < n:
                at = (right_e[j] - at_null) / right_c[j]
                slip = (right_b[j] - right_a[j] * at) * right_way
                if slip < -TOLERANCE * abs(at) * compliance[j]:
                    beyond = 1
            if i > 0:
                at = (left_e[i] + at_null) / left_c[i]
                slip = (left_a[i - 1] * at - left_b[i - 1]) * left_way
                if slip < -TOLERANCE * abs(at) * compliance[i]:
                    beyond = -1 if beyond == 0 else 2
            if beyond == 0:
                break
            if beyond == 2 or beyond * moved < 0:
                return False
            moved = beyond
            if beyond > 0:
                left_way = -right_way if left_way == 0 else left_way
                left_a[i], left_b[i], left_c[j], left_e[j] = _join(
                    left_c[i], left_e[i], growth[i], drag[i],
                    compliance[j], tension[j], left_way > 0,
                )  # fmt: skip
            else:
                right_way = -left_way if right_way == 0 else right_way
                right_a[i], right_b[i], right_c[i], right_e[i] = _join(
                    right_c[j], right_e[j], growth[i], drag[i],
                    compliance[i], tension[i], right_way < 0,
                )  # fmt: skip
            i, j = i + beyond, j + beyond
    for s in range(i, j):
        shift[s] = at_null
    for s in range(i + 1, j):
        node[s] = tension[s]
    if i < j:
        node[i] = (left_e[i] + at_null) / left_c[i]
        node[j] = (right_e[j] - at_null) / right_c[j]
    else:
        node[i] = at_meeting
    at = node[i]
    for s in range(i - 1, -1, -1):
        shift[s] = left_a[s] * at - left_b[s]
        at = (at - drag[s]) / growth[s] if left_way > 0 else growth[s] * at + drag[s]
        node[s] = at
    at = node[j]
    for s in range(j, n):
        shift[s] = right_b[s] - right_a[s] * at
        at = (at - drag[s]) / growth[s] if right_way < 0 else growth[s] * at + drag[s]
        node[s + 1] = at
    return True
