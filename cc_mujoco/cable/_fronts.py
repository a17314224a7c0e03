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

from typing import NamedTuple

from cc_mujoco.native import FloatArray, compiled, internal

LIMIT_TOLERANCE = 1e-11
"""Relative excess over the friction limit that counts as holding (rounding)."""
PATH_TOLERANCE = 1e-9
"""`LIMIT_TOLERANCE` if bends change, as rounding of the path stretches short nodes."""


@internal
def overcome_direction(
    proximal: float, distal: float, hold_distal: float, hold_proximal: float,
    drag: float, tolerance: float,
) -> int:  # fmt: skip
    """Return the direction in which a segment at rest breaks away, 0 if it holds.

    `proximal`, `distal` are its tensions [N], `drag` is in [N], `hold_distal` and
    `hold_proximal` are the ratios that it holds against motion to distal (+1) and
    proximal (-1), `tolerance` is the relative excess that counts as holding.
    """
    if distal > (hold_distal * proximal + drag) * (1.0 + tolerance):
        return 1
    if proximal > (hold_proximal * distal + drag) * (1.0 + tolerance):
        return -1
    return 0


class CoulombChain(NamedTuple):
    """Nodes (n + 1,) and segments (n,) of a step in which friction is constant."""

    tension: FloatArray  # of each node before the step, negative where slack [N]
    compliance: FloatArray  # of each node [m/N]
    half: FloatArray  # compliance of half of each segment [m/N]
    growth: FloatArray  # E of each segment, see `_friction.py`
    hold: FloatArray  # H of each segment, unless it goes on slipping the same way
    slips: FloatArray  # slip of each segment since it last stuck or turned [m]
    drag: FloatArray  # B of each segment [N]


@internal
def hold_against(chain: CoulombChain, s: int, way: int) -> float:
    """Return the tension ratio H that a segment holds against motion `way` (+1 distal).

    A segment that goes on slipping the same way has already broken away.
    """
    going_on = chain.slips[s] * float(way) > 0.0
    return float(chain.growth[s] if going_on else chain.hold[s])


class _Front(NamedTuple):
    """Relations of displacement w [m] and tension T [N] where a front has passed.

    Before the spring of a node w = a T - b, with the index of the segment, and behind
    that spring w = c T - e. On the front from the distal end w stands for -w.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    e: FloatArray


@internal
def _front(work: FloatArray, m: int) -> _Front:
    return _Front(work[:m], work[m : 2 * m], work[2 * m : 3 * m], work[3 * m :])


@internal
def _carry(front: _Front, near: int, far: int, chain: CoulombChain, way: int) -> None:
    """Carry a front from one node to the next, across a segment that slips.

    `way` is positive if the segment slips in the direction of the front's march.
    """
    s, c, e = min(near, far), front.c[near], front.e[near]
    growth, drag = chain.growth[s], chain.drag[s]
    if way > 0:
        front.a[s] = c * (1.0 / growth)
        front.b[s] = e + front.a[s] * drag
    else:
        front.a[s] = c * growth
        front.b[s] = e - c * drag
    front.c[far] = front.a[s] + chain.compliance[far]
    front.e[far] = front.b[s] + chain.compliance[far] * chain.tension[far]


@internal
def _run(
    front: _Front, near: int, stop: int, chain: CoulombChain, direction: int
) -> int:
    """Carry a front on while segments slip, before `stop`; return the node reached."""
    step = 1 if stop > near else -1
    way, going = step * direction, float(direction)
    c, e = front.c[near], front.e[near]
    for _ in range(abs(stop - near) - 1):
        far = near + step
        s = min(near, far)
        growth, drag, t = chain.growth[s], chain.drag[s], chain.tension[far]
        low, high = max(e / c, 0.0), t
        if way < 0:
            low, high = max(t, 0.0), low
        hold = growth if chain.slips[s] * going > 0.0 else chain.hold[s]
        if not high > (hold * low + drag) * (1.0 + LIMIT_TOLERANCE):
            break
        if way > 0:
            a = c * (1.0 / growth)
            b = e + a * drag
        else:
            a = c * growth
            b = e - c * drag
        c, e = a + chain.compliance[far], b + chain.compliance[far] * t
        front.a[s], front.b[s], front.c[far], front.e[far] = a, b, c, e
        near = far
    return near


@internal
def _null_slip(
    left: _Front, right: _Front, chain: CoulombChain, s: int, slip_direction: float
) -> float:
    """Return the slip of the centre of segment s, in which motion turns (null point).

    With the null point at fraction (1 - z)/2 of the segment, net friction is z times
    its limit and the centre slips by z times the lengthening, in this step, of the half
    in which the null point lies. Both follow from the tensions at its ends, T_proximal
    = p + q w and T_distal = distal_p - distal_q w. Rounding the null point to the
    centre (z = 0) would cost first-order accuracy.

    `slip_direction` is +1 if the ends are pulled apart, -1 if they are pushed together.
    """
    p, q = left.e[s] / left.c[s], 1.0 / left.c[s]
    distal_p, distal_q = right.e[s + 1] / right.c[s + 1], 1.0 / right.c[s + 1]
    proximal, distal = chain.tension[s], chain.tension[s + 1]
    growth, drag, end_stiffness = chain.growth[s], chain.drag[s], 1.0 / chain.half[s]
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
    return float(min(max(slip, least), most))


@compiled
def march(
    n: int, chain: CoulombChain, proximal: float, distal: float, shift: FloatArray,
    node: FloatArray, work: FloatArray,
) -> bool:  # fmt: skip
    """Solve one step by marching the two fronts; return whether that applies.

    The ends move by `proximal` and `distal` [m]. Results, undefined if it does not
    apply, are `shift` (n,), slip in this step [m], and the tensions `node` (n + 1,)
    [N]. `work` holds (8 (n + 1),).
    """
    m = n + 1
    tension, compliance = chain.tension, chain.compliance
    growth, drag = chain.growth, chain.drag
    left = _front(work[: 4 * m], m)  # of the proximal end
    right = _front(work[4 * m : 8 * m], m)
    left.c[0], left.e[0] = compliance[0], compliance[0] * tension[0] - proximal
    right.c[n], right.e[n] = compliance[n], compliance[n] * tension[n] + distal
    i, j = 0, n  # segments < i belong to the proximal front, >= j to the distal one
    proximal_direction, distal_direction = 0, 0
    at_meeting, inner, outer = 0.0, 0.0, 0.0
    settled = False
    for _ in range(8 * n + 16):
        if i == j:
            # Every segment slips: the two relations meet at node i.
            if i < n:
                whole = left.c[i] + right.a[i]
                at_meeting = (left.e[i] + right.b[i]) / whole
                outer = left.c[i] * at_meeting - left.e[i]
            else:
                whole = left.a[n - 1] + right.c[n]
                at_meeting = (left.b[n - 1] + right.e[n]) / whole
            if i > 0:
                inner = left.a[i - 1] * at_meeting - left.b[i - 1]
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
        ahead = right.e[j] / right.c[j] if last else tension[i + 1]
        slip_direction = overcome_direction(
            max(left.e[i] / left.c[i], 0.0), max(ahead, 0.0), hold_against(chain, i, 1),
            hold_against(chain, i, -1), drag[i], LIMIT_TOLERANCE,
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
                    max(tension[s], 0.0), max(right.e[j] / right.c[j], 0.0),
                    hold_against(chain, s, 1), hold_against(chain, s, -1), drag[s],
                    LIMIT_TOLERANCE,
                )  # fmt: skip
            if slip_direction == 0:
                settled = True
                break
        if from_proximal:
            if proximal_direction == -slip_direction:
                return False
            proximal_direction = slip_direction
            i += 1
            _carry(left, s, i, chain, slip_direction)
            if i + 1 < j:
                i = _run(left, i, j, chain, slip_direction)
        else:
            if distal_direction == -slip_direction:
                return False
            distal_direction = slip_direction
            _carry(right, j, s, chain, -slip_direction)
            j -= 1
            if i + 1 < j:
                j = _run(right, j, i, chain, slip_direction)
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
                    _carry(right, s + 1, s, chain, -slip_direction)
                distal_direction = slip_direction
                i = 0
            else:
                for s in range(i, n - 1):
                    _carry(left, s, s + 1, chain, slip_direction)
                proximal_direction = slip_direction
                i = n - 1
            j = i + 1
        # Fronts come to the null point from both sides, so friction there is kinetic,
        # unless only static friction holds the segment as a whole.
        turning = met or not overcome_direction(
            max(left.e[i] / left.c[i], 0.0),
            max(right.e[j] / right.c[j], 0.0), growth[i], growth[i], drag[i],
            LIMIT_TOLERANCE,
        )  # fmt: skip
        moved = 0
        while turning:
            way = 1.0 if distal > 0.0 else -1.0
            at_null = _null_slip(left, right, chain, i, way)
            # A neighbour that would slip against its front has the null point.
            beyond = 0
            if j < n:
                at = (right.e[j] - at_null) / right.c[j]
                slip = (right.b[j] - right.a[j] * at) * float(distal_direction)
                if slip < -LIMIT_TOLERANCE * abs(at) * compliance[j]:
                    beyond = 1
            if i > 0:
                at = (left.e[i] + at_null) / left.c[i]
                slip = left.a[i - 1] * at - left.b[i - 1]
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
                _carry(left, i, j, chain, proximal_direction)
            else:
                distal_direction = (
                    -proximal_direction if distal_direction == 0 else distal_direction
                )
                _carry(right, j, i, chain, -distal_direction)
            i, j = i + beyond, j + beyond
    for s in range(i, j):
        shift[s] = at_null
    for s in range(i + 1, j):
        node[s] = tension[s]
    if i < j:
        node[i] = (left.e[i] + at_null) / left.c[i]
        node[j] = (right.e[j] - at_null) / right.c[j]
    else:
        node[i] = at_meeting
    at = node[i]
    for s in range(i - 1, -1, -1):
        shift[s] = left.a[s] * at - left.b[s]
        if proximal_direction > 0:
            at = (at - drag[s]) / growth[s]
        else:
            at = growth[s] * at + drag[s]
        node[s] = at
    at = node[j]
    for s in range(j, n):
        shift[s] = right.b[s] - right.a[s] * at
        if distal_direction < 0:
            at = (at - drag[s]) / growth[s]
        else:
            at = growth[s] * at + drag[s]
        node[s + 1] = at
    return True


@compiled
def repeat_slip(
    n: int, chain: CoulombChain, proximal: float, distal: float, shift: FloatArray,
    node: FloatArray, work: FloatArray,
) -> bool:  # fmt: skip
    """Solve a step as if the segments slip, or rest, exactly as in the last step.

    Return whether that is the solution: those that slip go on, friction holds the
    others, and no node is slack. The tensions before the step may be any. Arguments and
    results are those of `march`; `work` holds (3 n,).
    """
    tension, compliance = chain.tension, chain.compliance
    a, b, shrink = work[:n], work[n : 2 * n], work[2 * n : 3 * n]
    c, e = compliance[0], compliance[0] * tension[0] - proximal
    for s in range(n):
        way, drag, soft = chain.slips[s], chain.drag[s], compliance[s + 1]
        if way > 0.0:
            shrink[s] = 1.0 / chain.growth[s]
            a[s] = c * shrink[s]
            b[s] = e + a[s] * drag
        elif way < 0.0:
            a[s] = c * chain.growth[s]
            b[s] = e - c * drag
        else:
            node[s], a[s], b[s] = e / c, 0.0, 0.0
            if s > 0 and chain.slips[s - 1] == 0.0:
                node[s] = tension[s]
        c, e = a[s] + soft, b[s] + soft * tension[s + 1]
    at = (e + distal) / c
    node[n] = at
    if not at >= 0.0:
        return False
    for s in range(n - 1, -1, -1):
        way, drag, high = chain.slips[s], chain.drag[s], at
        shift[s] = a[s] * high - b[s]
        if way > 0.0:
            at = (high - drag) * shrink[s]
        elif way < 0.0:
            at = chain.growth[s] * high + drag
        else:
            at = node[s]
            if overcome_direction(
                at, high, chain.hold[s], chain.hold[s], drag, PATH_TOLERANCE
            ):
                return False
        node[s] = at
        moved = shift[s] if way > 0.0 else -shift[s]
        least = LIMIT_TOLERANCE * (at + high + drag) * compliance[s]
        if way != 0.0 and not moved > least:
            return False
        if not at >= 0.0:
            return False
    return True
