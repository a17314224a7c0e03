"""Relation of stretch and tension at the nodes of a cable, compiled.

A node is a piece of cable between the centres of the adjacent segments; the springs at
the ends are part of the first and the last. Packed parameters and state are those of
`_layout.py`.
"""

from cc_mujoco.cable import _elasticity as elastic
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray, compiled, inlined, internal


@internal
def is_curved(prm: FloatArray) -> bool:
    """Return whether the stiffness of a node depends on its tension."""
    return float(prm[at.CURVED]) != 0.0


@internal
def is_curved_cable(prm: FloatArray) -> bool:
    """Return whether the stiffness of every node depends on its tension."""
    return float(prm[at.CURVED]) > 1.0


@inlined
def is_curved_node(prm: FloatArray, n: int, i: int) -> bool:
    """Return whether the stiffness of node i depends on its tension."""
    return is_curved_cable(prm) or (is_curved(prm) and (i == 0 or i == n))


@internal
def curvature(values: FloatArray) -> float:
    """Return 2 if the stiffness of all nodes depends on tension, 1: of ends, or 0."""
    if values[PLACE.bedding_strain] > 0.0 or values[PLACE.clearance] > 0.0:
        return 2.0
    return 1.0 if is_soft(values, 0) or is_soft(values, 1) else 0.0


@internal
def is_soft(values: FloatArray, end: int) -> bool:
    """Return whether the spring at an end (0, 1) hardens or has hysteresis."""
    if end == 1:
        return float(values[PLACE.end_hardening] + values[PLACE.end_loss]) > 0.0
    return float(values[PLACE.proximal_hardening] + values[PLACE.proximal_loss]) > 0.0


@internal
def spring_compliance(values: FloatArray, end: int) -> float:
    """Return the compliance of the spring at an end (0, 1) at no tension [m/N]."""
    return float(
        values[PLACE.end_compliance if end == 1 else PLACE.proximal_compliance]
    )


@internal
def linear_compliance(values: FloatArray, end: int) -> float:
    """Return the compliance of the linear spring at an end (0, 1), or 0 [m/N]."""
    return 0.0 if is_soft(values, end) else spring_compliance(values, end)


@internal
def node_piece(prm: FloatArray, n: int, i: int) -> elastic.Piece:
    """Return node i as a `Piece`, with T_held of its end spring before the step."""
    ratio = prm[at.RATIO_DISTAL if i == n else at.RATIO_PROXIMAL]
    held = prm[at.HELD_DISTAL if i == n else at.HELD_PROXIMAL]
    return _held_piece(prm, n, i, held, ratio)


@internal
def given_between(
    prm: FloatArray, n: int, i: int, before: float, after: float
) -> float:
    """Return how far clearance and end spring of node i give between tensions [m]."""
    held = prm[at.HELD_DISTAL if i == n else at.HELD_PROXIMAL]
    own = _held_piece(prm, n, i, held, 1.0)
    linear = (after - before) * end_spring(prm, n, i)
    return elastic.given_between(own, before, after) + linear


@internal
def giving_slope(prm: FloatArray, n: int, i: int, tension: float) -> float:
    """Return the derivative of `given_between` by the tension [m/N]."""
    held = prm[at.HELD_DISTAL if i == n else at.HELD_PROXIMAL]
    own = _held_piece(prm, n, i, held, 1.0)
    return elastic.giving_slope(own, tension) + end_spring(prm, n, i)


@internal
def piece_now(prm: FloatArray, n: int, state: FloatArray, i: int) -> elastic.Piece:
    """Return node i as a `Piece`, with T_held of its end spring in `state`."""
    return _held_piece(prm, n, i, state[at.HELD_TENSIONS + (1 if i == n else 0)], 1.0)


@internal
def end_spring(prm: FloatArray, n: int, i: int) -> float:
    """Return the compliance of the linear spring at node i [m/N]."""
    if i == n:
        return linear_compliance(prm, 1)
    return linear_compliance(prm, 0) if i == 0 else 0.0


@internal
def _held_piece(
    prm: FloatArray, n: int, i: int, held: float, ratio: float
) -> elastic.Piece:
    """Return node i as a `Piece`, its soft end spring with T_held = `held` [N].

    The compliance of that spring is divided by `ratio`.
    """
    length, taut = at.node_length(prm, n)[i], at.node_compliance(prm, n)[i]
    play, seating = 0.0, prm[PLACE.seating_tension]
    if prm[PLACE.clearance] > 0.0:
        play, seating = node_play(prm, n, at.segment_angles(prm, n), i)
    if i == n and is_soft(prm, 1):
        return _piece(prm, taut, length, play, seating, 1, held, ratio)
    if i == 0 and is_soft(prm, 0):
        return _piece(prm, taut, length, play, seating, 0, held, ratio)
    return _piece(prm, taut, length, play, seating, -1, 0.0, 1.0)


@internal
def node_play(
    prm: FloatArray, n: int, angles: FloatArray, i: int
) -> tuple[float, float]:
    """Return final stretch of clearance at node i [m] and its T_c [N].

    `angles` (n,) are wrap angles [rad]. The node has half of either segment beside it,
    with the sum of their play and of their compliance at no tension.
    """
    clearance, seating = at.clearance_factors(prm, n), at.seating_factors(prm, n)
    turn, eased = 0.0, 0.0
    if i > 0:
        turn += 0.5 * angles[i - 1] * clearance[i - 1]
        eased += 0.5 * angles[i - 1] * clearance[i - 1] / seating[i - 1]
    if i < n:
        turn += 0.5 * angles[i] * clearance[i]
        eased += 0.5 * angles[i] * clearance[i] / seating[i]
    factor = turn / eased if eased > 0.0 else 1.0
    return turn * prm[PLACE.clearance], factor * prm[PLACE.seating_tension]


@internal
def wrap_with_play(prm: FloatArray, n: int, angles: FloatArray) -> float:
    """Return the sum of these angles (n,) times `clearance_factors` [rad]."""
    factors, wrap = at.clearance_factors(prm, n), 0.0
    for j in range(n):
        wrap += angles[j] * factors[j]
    return wrap


@internal
def seated_at(
    prm: FloatArray, n: int, angles: FloatArray, i: int, tension: float
) -> float:
    """Return the stretch of clearance at node i in these bends and tension [m]."""
    play, seating = node_play(prm, n, angles, i)
    return play * tension / (max(tension, 0.0) + seating)


@internal
def seated_stretch(
    prm: FloatArray, n: int, angles: FloatArray, tension: float
) -> float:
    """Return the stretch of all clearance in these bends at a uniform tension [m]."""
    total = 0.0
    for i in range(n + 1 if prm[PLACE.clearance] > 0.0 else 0):
        total += seated_at(prm, n, angles, i, tension)
    return total


@internal
def _piece(
    prm: FloatArray, taut: float, length: float, play: float, seating: float, end: int,
    held: float, ratio: float,
) -> elastic.Piece:  # fmt: skip
    """Return a `Piece` with this compliance [m/N], length and final clearance [m].

    `seating` is its T_c [N]. The soft spring at its `end` (0, 1; -1: none) has T_held =
    `held` [N]; its compliance is divided by `ratio`.
    """
    spring, hardening, loss = 0.0, 0.0, 0.0
    if end == 1:
        hardening, loss = prm[PLACE.end_hardening], prm[PLACE.end_loss]
    elif end == 0:
        hardening, loss = prm[PLACE.proximal_hardening], prm[PLACE.proximal_loss]
    if end >= 0:
        spring = spring_compliance(prm, end) / ratio
    return elastic.Piece(
        taut, length * prm[PLACE.bedding_strain], prm[PLACE.bedding_tension],
        play, seating, spring, hardening, elastic.returned_share(loss), held,
    )  # fmt: skip


@internal
def recall_springs(prm: FloatArray, state: FloatArray) -> None:
    """Copy T_held of the springs at both ends from the state to `prm`."""
    prm[at.HELD_PROXIMAL] = state[at.HELD_TENSIONS]
    prm[at.HELD_DISTAL] = state[at.HELD_TENSIONS + 1]


@internal
def rest_springs(prm: FloatArray, n: int, state: FloatArray) -> None:
    """Set T_held of both soft end springs in a state to their tensions at rest."""
    tension = at.tensions(state, n)
    state[at.HELD_TENSIONS] = max(tension[0], 0.0) if is_soft(prm, 0) else 0.0
    state[at.HELD_TENSIONS + 1] = max(tension[n], 0.0) if is_soft(prm, 1) else 0.0


@internal
def slide_springs(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Update T_held of both soft end springs for a new state; return the heat [J]."""
    tension, heat = at.tensions(state, n), 0.0
    for end in range(2):
        if is_soft(prm, end):
            held = prm[at.HELD_DISTAL if end == 1 else at.HELD_PROXIMAL]
            own = _held_piece(prm, n, n * end, held, 1.0)
            heat += elastic.bristle_heat(own, own.held, tension[n * end])
            state[at.HELD_TENSIONS + end] = elastic.held_tension(own, tension[n * end])
    return heat


@internal
def half_piece(prm: FloatArray, n: int, j: int) -> elastic.Piece:
    """Return half of the contact length of segment j as a `Piece`."""
    length, half = at.contact_length(prm, n)[j], at.half_compliance(prm, n)[j]
    turn = 0.5 * at.segment_angles(prm, n)[j] * at.clearance_factors(prm, n)[j]
    play, seating = turn * prm[PLACE.clearance], at.seating_factors(prm, n)[j]
    seating *= prm[PLACE.seating_tension]
    return _piece(prm, half, 0.5 * length, play, seating, -1, 0.0, 1.0)


@internal
def set_node(prm: FloatArray, n: int, i: int) -> None:
    """Pack stiffness and compliance of node i if taut, with its linear springs."""
    spring = 0.0
    if i == n:
        spring = linear_compliance(prm, 1) / prm[at.RATIO_DISTAL]
        spring += prm[at.YIELD_DISTAL]
    elif i == 0:
        spring = linear_compliance(prm, 0) / prm[at.RATIO_PROXIMAL]
        spring += prm[at.YIELD_PROXIMAL]
    stiffness = 1.0 / (at.node_length(prm, n)[i] / prm[PLACE.axial_stiffness] + spring)
    at.node_stiffness(prm, n)[i] = stiffness
    at.node_compliance(prm, n)[i] = 1.0 / stiffness


@internal
def node_stretch(prm: FloatArray, n: int, i: int, tension: float) -> float:
    """Return the stretch of node i at a tension [m]."""
    if not is_curved_node(prm, n, i):
        return float(tension * at.node_compliance(prm, n)[i])
    return elastic.stretch_of(node_piece(prm, n, i), tension)


@internal
def tension_at(prm: FloatArray, n: int, i: int, stretched: float) -> float:
    """Return the tension of node i at a stretch [m]."""
    if not is_curved_node(prm, n, i):
        return float(stretched * at.node_stiffness(prm, n)[i])
    return elastic.tension_of(node_piece(prm, n, i), stretched)


@inlined
def tension_after_stretch(
    prm: FloatArray, n: int, i: int, tension: float, stretched: float
) -> float:
    """Return the tension of node i after it is stretched by `stretched` [m] more."""
    if stretched == 0.0:
        return tension
    if not is_curved_node(prm, n, i):
        return float(tension + at.node_stiffness(prm, n)[i] * stretched)
    return _curved_tension_after_stretch(prm, n, i, tension, stretched)


@internal
def _curved_tension_after_stretch(
    prm: FloatArray, n: int, i: int, tension: float, stretched: float
) -> float:
    own = node_piece(prm, n, i)
    found = elastic.tension_of(own, stretched + elastic.stretch_of(own, tension))
    if tension > 0.0 and found > 0.0:
        # The sum loses digits of its change, which would add up over steps.
        off = elastic.stretch_between(own, tension, found) - stretched
        found -= off / elastic.compliance_at(own, found)
    return found


@internal
def stretch_between(
    prm: FloatArray, n: int, i: int, before: float, after: float
) -> float:
    """Return the change of the stretch of node i between two tensions [m]."""
    if not is_curved_node(prm, n, i):
        return float((after - before) / at.node_stiffness(prm, n)[i])
    return elastic.stretch_between(node_piece(prm, n, i), before, after)


@internal
def mean_tension(prm: FloatArray, n: int, i: int, before: float, after: float) -> float:
    """Return the mean tension of node i over a change: work by stretch, slack 0 [N]."""
    low, high = min(before, after), max(before, after)
    if high <= 0.0:
        return 0.0
    is_straight = not is_curved_node(prm, n, i)
    if low >= 0.0 and (is_straight or high - low <= 1e-6 * high):
        return 0.5 * (low + high)
    if is_straight:
        return 0.5 * high * (high / (high - low))
    own = node_piece(prm, n, i)
    gained = elastic.energy_at(own, after) - elastic.energy_at(own, before)
    gained += elastic.bristle_heat(own, before, after)
    return gained / (elastic.stretch_of(own, after) - elastic.stretch_of(own, before))


@internal
def rest_stretch(prm: FloatArray, n: int, wrap: float, tension: float) -> float:
    """Return the stretch of cable and end springs at a uniform tension [m].

    `wrap` is that of `wrap_with_play` [rad]; all clearance has the T_c of segment 0.
    """
    springs = linear_compliance(prm, 1) + linear_compliance(prm, 0)
    taut = prm[at.LENGTH] / prm[PLACE.axial_stiffness] + springs
    play, seating = wrap * prm[PLACE.clearance], at.seating_factors(prm, n)[0]
    seating *= prm[PLACE.seating_tension]
    own = _piece(prm, taut, prm[at.LENGTH], play, seating, -1, 0.0, 1.0)
    return elastic.stretch_of(own, tension) + soft_rest_stretch(prm, tension)


@internal
def rest_spring_stretch(prm: FloatArray, tension: float) -> float:
    """Return the stretch of all springs at the ends, loaded to a tension [m]."""
    linear = linear_compliance(prm, 0) + linear_compliance(prm, 1)
    return linear * tension + soft_rest_stretch(prm, tension)


@internal
def soft_rest_stretch(prm: FloatArray, tension: float) -> float:
    """Return the stretch of soft springs at the ends, loaded to a tension [m]."""
    total = 0.0
    for end in range(2):
        if is_soft(prm, end):
            own = _piece(prm, 0.0, 0.0, 0.0, 1.0, end, 0.0, 1.0)
            total += elastic.spring_between(own, 0.0, tension)
    return total


@internal
def elastic_energy(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Return the elastic energy of the cable and its end springs [J]."""
    stiffness, tension = at.node_stiffness(prm, n), at.tensions(state, n)
    total = 0.0
    for i in range(n + 1):
        if not is_curved_node(prm, n, i):
            total += 0.5 * max(tension[i], 0.0) ** 2 / stiffness[i]
        else:
            total += elastic.energy_at(piece_now(prm, n, state, i), tension[i])
    return total


@compiled
def total_stretch(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Return the stretch of all nodes [m]: `state[3]` where no path may lengthen."""
    total = 0.0
    tension = at.tensions(state, n)
    for i in range(n + 1):
        total += elastic.stretch_of(piece_now(prm, n, state, i), tension[i])
    return total


@compiled
def slack_length(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Return the slack length of cable in the conduit [m]."""
    tension = at.tensions(state, n)
    total = 0.0
    for i in range(n + 1):
        total -= node_stretch(prm, n, i, min(tension[i], 0.0))
    return total


@compiled
def end_stiffness(prm: FloatArray, n: int, distal: bool) -> float:
    """Return the stiffness seen at one end [N/m].

    It is that of the nodes in series up to the first segment that friction holds (half
    a segment if the conduit bends at its mouth), or twice the whole cable's if none is.
    """
    compliance = 0.0
    stiffness = at.node_stiffness(prm, n)
    hold, drag = at.constant_hold(prm, n), at.constant_drag(prm, n)
    for i in range(n + 1):
        compliance += 1.0 / stiffness[n - i if distal else i]
        j = n - 1 - i if distal else i
        if i < n and (hold[j] > 1.0 or drag[j] > 0.0):
            return float(1.0 / compliance)
    # Nothing holds: of a spring between two equal masses each has one half.
    return float(2.0 / compliance)
