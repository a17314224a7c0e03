"""Slipping segments, found from the ends: fronts march in until friction holds.

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
`_graph.py`, which presumes nothing, takes over.
"""

from __future__ import annotations

from cc_mujoco.native import FloatArray, compiled, internal

LIMIT_TOLERANCE = 1e-11
"""Relative excess over the friction limit that counts as holding (rounding)."""


@internal
def overcome_direction(
    proximal: float,
    distal: float,
    hold_distal: float,
    hold_proximal: float,
    drag: float,
) -> int:
    """Return the direction in which the end tensions overcome a resting segment, or 0.

    `hold_distal`, `hold_proximal`: ratio held against motion towards distal (+1),
    proximal (-1).
    """
    if distal > (hold_distal * proximal + drag) * (1.0 + LIMIT_TOLERANCE):
        return 1
    if proximal > (hold_proximal * distal + drag) * (1.0 + LIMIT_TOLERANCE):
        return -1
    return 0


@internal
def _carry_relation(
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


@internal
def _null_slip(
    p: float,
    q: float,
    distal_p: float,
    distal_q: float,
    slip_direction: float,
    proximal: float,
    distal: float,
    growth: float,
    drag: float,
    end_stiffness: float,
) -> float:
    """Return the slip of the centre of the segment with the null point.

    With the null point at fraction (1 - z)/2 of the segment, net friction is z times
    its limit and the centre slips by z times the lengthening, in this step, of the half
    on whose side the null point lies. Both follow from the tensions at its ends,
    T_proximal = p + q w and T_distal = distal_p - distal_q w. Rounding the null point
    to the centre (z = 0) would cost first-order accuracy.

    `slip_direction` is +1 where the ends are pulled apart, -1 where they are pushed
    together, `proximal` and `distal` the tensions before the step, `end_stiffness` that
    of half a segment.
    """
    slip, share = 0.0, 0.0
    per_tension = (growth - 1.0) / (growth + 1.0)
    constant = 2.0 * drag / (growth + 1.0)
    for _ in range(4):
        low = p + q * slip
        high = distal_p - distal_q * slip
        # At the segment's edge the null point passes to its neighbour, for which the
        # tension of the node between them counts; inside, their harmonic mean: where
        # one side rests, friction holds the segment as if that end were locked.
        behind, ahead = low - proximal, high - distal
        mean = 0.0
        if behind * ahead > 0.0:
            mean = 2.0 * behind * ahead / (behind + ahead)
        side = behind if share * slip_direction > 0.0 else ahead
        change = mean + (side - mean) * share**2
        reach = slip_direction * change / end_stiffness
        if reach <= 0.0:
            slip = 0.0
            break
        limit = per_tension * max(low + high, 0.0) + constant
        share = (distal_p - p) / ((q + distal_q) * reach + limit)
        share = min(max(share, -1.0), 1.0)
        slip = share * reach
    # Both halves yield equally, so the centre stays between its neighbours. That also
    # holds it where the fronts are close but have not met.
    with_proximal, with_distal = (proximal - p) / q, (distal_p - distal) / distal_q
    slip = max(slip, min(with_proximal, with_distal, 0.0))
    slip = min(slip, max(with_proximal, with_distal, 0.0))
    # Where the rounds have not settled, net friction would exceed its limit.
    both, tilt = q + distal_q, per_tension * (q - distal_q)
    limit = per_tension * (p + distal_p) + constant
    least = (distal_p - p - limit) / (both + tilt)
    most = (distal_p - p + limit) / (both - tilt)
    return min(max(slip, least), most)


@compiled
def march(
    n: int,
    tension: FloatArray,
    compliance: FloatArray,
    half: FloatArray,
    growth: FloatArray,
    hold_distal: FloatArray,
    hold_proximal: FloatArray,
    drag: FloatArray,
    proximal: float,
    distal: float,
    shift: FloatArray,
    node: FloatArray,
    work: FloatArray,
) -> bool:
    """Solve one step by marching the two fronts; return whether that applies.

    Nodes (n + 1,) have `tension` before the step [N], negative where slack, and
    `compliance` [m/N]. Segments (n,) have half of theirs, `growth` E, `hold_distal` and
    `hold_proximal` H against motion that way, and `drag` B [N], see `_friction.py`. The
    ends move by `proximal` and `distal` [m]. Out, undefined where the march does not
    apply: `shift` (n,), slip in this step [m], and the tensions `node`. `work` holds (8
    (n + 1),).
    """
    m = n + 1
    # w_i = proximal_c T_i - proximal_e after the spring of node i and proximal_a
    # T_{i+1} - proximal_b before that of node i + 1; from the distal end the same for
    # -w, mirrored.
    proximal_a, proximal_b = work[:m], work[m : 2 * m]
    proximal_c, proximal_e = work[2 * m : 3 * m], work[3 * m : 4 * m]
    distal_a, distal_b = work[4 * m : 5 * m], work[5 * m : 6 * m]
    distal_c, distal_e = work[6 * m : 7 * m], work[7 * m : 8 * m]
    proximal_c[0], proximal_e[0] = compliance[0], compliance[0] * tension[0] - proximal
    distal_c[n], distal_e[n] = compliance[n], compliance[n] * tension[n] + distal
    i, j = 0, n  # segments < i belong to the proximal front, >= j to the distal one
    proximal_direction, distal_direction = 0, 0
    at_meeting, inner, outer = 0.0, 0.0, 0.0
    settled = False
    for _ in range(8 * n + 16):
        if i == j:
            # Every segment slips: the two relations meet at node i.
            if i < n:
                whole = proximal_c[i] + distal_a[i]
                at_meeting = (proximal_e[i] + distal_b[i]) / whole
                outer = proximal_c[i] * at_meeting - proximal_e[i]
            else:
                whole = proximal_a[n - 1] + distal_c[n]
                at_meeting = (proximal_b[n - 1] + distal_e[n]) / whole
            if i > 0:
                inner = proximal_a[i - 1] * at_meeting - proximal_b[i - 1]
            if i > 0 and inner * float(proximal_direction) < 0.0:
                i -= 1
                if i == 0:
                    proximal_direction = 0
                continue
            if i < n and outer * float(distal_direction) < 0.0:
                j += 1
                if j == n:
                    distal_direction = 0
                continue
            settled = True
            break
        s = i
        last = i + 1 == j
        ahead = distal_e[j] / distal_c[j] if last else tension[i + 1]
        slip_direction = overcome_direction(
            max(proximal_e[i] / proximal_c[i], 0.0), max(ahead, 0.0), hold_distal[i],
            hold_proximal[i], drag[i],
        )  # fmt: skip
        from_proximal = slip_direction != 0
        if last and slip_direction != 0 and proximal_direction != slip_direction:
            from_proximal = (
                distal_direction != slip_direction and proximal_direction == 0
            )
        if not from_proximal:
            if not last:
                s = j - 1
                slip_direction = overcome_direction(
                    max(tension[s], 0.0), max(distal_e[j] / distal_c[j], 0.0),
                    hold_distal[s], hold_proximal[s], drag[s],
                )  # fmt: skip
            if slip_direction == 0:
                settled = True
                break
        if from_proximal:
            if proximal_direction == -slip_direction:
                return False
            proximal_direction = slip_direction
            i += 1
            proximal_a[s], proximal_b[s], proximal_c[i], proximal_e[i] = (
                _carry_relation(
                    proximal_c[s], proximal_e[s], growth[s], drag[s],
                    compliance[i], tension[i], slip_direction > 0,
                )
            )  # fmt: skip
        else:
            if distal_direction == -slip_direction:
                return False
            distal_direction = slip_direction
            distal_a[s], distal_b[s], distal_c[s], distal_e[s] = _carry_relation(
                distal_c[j], distal_e[j], growth[s], drag[s],
                compliance[s], tension[s], slip_direction < 0,
            )  # fmt: skip
            j -= 1
    if not settled:
        return False

    at_null = 0.0
    met = i == j
    if i + 1 >= j and proximal * distal < 0.0:
        # The ends move opposite ways: find the segment in which the motion turns.
        if met:
            slip_direction = distal_direction if i == 0 else proximal_direction
            if 0 < i < n and proximal_direction != distal_direction:
                if abs(inner) < abs(outer):
                    i -= 1
            elif proximal * float(slip_direction) < 0.0:
                for s in range(j - 1, 0, -1):
                    distal_a[s], distal_b[s], distal_c[s], distal_e[s] = (
                        _carry_relation(
                            distal_c[s + 1], distal_e[s + 1], growth[s], drag[s],
                            compliance[s], tension[s], slip_direction < 0,
                        )
                    )  # fmt: skip
                distal_direction = slip_direction
                i = 0
            else:
                for s in range(i, n - 1):
                    after = _carry_relation(
                        proximal_c[s], proximal_e[s], growth[s], drag[s],
                        compliance[s + 1], tension[s + 1], slip_direction > 0,
                    )  # fmt: skip
                    proximal_a[s], proximal_b[s] = after[0], after[1]
                    proximal_c[s + 1], proximal_e[s + 1] = after[2], after[3]
                proximal_direction = slip_direction
                i = n - 1
            j = i + 1
        # Fronts come to the null point from both sides, so friction there is kinetic,
        # unless only static friction holds the segment as a whole.
        turning = met or not overcome_direction(
            max(proximal_e[i] / proximal_c[i], 0.0),
            max(distal_e[j] / distal_c[j], 0.0), growth[i], growth[i], drag[i],
        )  # fmt: skip
        moved = 0
        while turning:
            at_null = _null_slip(
                proximal_e[i] / proximal_c[i], 1.0 / proximal_c[i],
                distal_e[j] / distal_c[j], 1.0 / distal_c[j],
                1.0 if distal > 0.0 else -1.0,
                tension[i], tension[j], growth[i], drag[i], 1.0 / half[i],
            )  # fmt: skip
            # A neighbour that would slip against its front has the null point.
            beyond = 0
            if j < n:
                at = (distal_e[j] - at_null) / distal_c[j]
                slip = (distal_b[j] - distal_a[j] * at) * float(distal_direction)
                if slip < -LIMIT_TOLERANCE * abs(at) * compliance[j]:
                    beyond = 1
            if i > 0:
                at = (proximal_e[i] + at_null) / proximal_c[i]
                slip = proximal_a[i - 1] * at - proximal_b[i - 1]
                slip *= float(proximal_direction)
                if slip < -LIMIT_TOLERANCE * abs(at) * compliance[i]:
                    beyond = -1 if beyond == 0 else 2
            if beyond == 0:
                break
            if beyond == 2 or beyond * moved < 0:
                return False
            moved = beyond
            if beyond > 0:
                proximal_direction = (
                    -distal_direction if proximal_direction == 0 else proximal_direction
                )
                proximal_a[i], proximal_b[i], proximal_c[j], proximal_e[j] = (
                    _carry_relation(
                        proximal_c[i], proximal_e[i], growth[i], drag[i],
                        compliance[j], tension[j], proximal_direction > 0,
                    )
                )  # fmt: skip
            else:
                distal_direction = (
                    -proximal_direction if distal_direction == 0 else distal_direction
                )
                distal_a[i], distal_b[i], distal_c[i], distal_e[i] = _carry_relation(
                    distal_c[j], distal_e[j], growth[i], drag[i],
                    compliance[i], tension[i], distal_direction < 0,
                )  # fmt: skip
            i, j = i + beyond, j + beyond
    for s in range(i, j):
        shift[s] = at_null
    for s in range(i + 1, j):
        node[s] = tension[s]
    if i < j:
        node[i] = (proximal_e[i] + at_null) / proximal_c[i]
        node[j] = (distal_e[j] - at_null) / distal_c[j]
    else:
        node[i] = at_meeting
    at = node[i]
    for s in range(i - 1, -1, -1):
        shift[s] = proximal_a[s] * at - proximal_b[s]
        at = (
            (at - drag[s]) / growth[s]
            if proximal_direction > 0
            else growth[s] * at + drag[s]
        )
        node[s] = at
    at = node[j]
    for s in range(j, n):
        shift[s] = distal_b[s] - distal_a[s] * at
        at = (
            (at - drag[s]) / growth[s]
            if distal_direction < 0
            else growth[s] * at + drag[s]
        )
        node[s + 1] = at
    return True
