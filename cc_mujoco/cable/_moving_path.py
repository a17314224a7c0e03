"""Law of a cable on a path whose pieces change their length, compiled.

A node is the cable that lies along one part of the path. With l the present length of
that part, m the unstretched length of cable in it and T its tension,

    1 + strain(T) = (l - X(T)) / m,        T = EA (l - m) / m without bedding and X,

where X is what gives way beside the rope: springs at its ends, clearance in a conduit.
So a piece of 0.2 m is ten times as stiff as one of 2 m. The unstretched lengths follow
from path and tensions. Their sum is constant: they move between nodes by slip, and
where the path moves over a cable that sticks: a pulley that turns carries it from one
piece to the next, at the strain that it has.

A step is solved in unstretched lengths too: near the tension before it a node is a
spring of EA (1 + strain)^2 / (l - X), and the lengthening of its path is divided by 1 +
strain. A node that was slack is a spring of EA / (l - X), as when it becomes taut, with
the length that the law gives: a straight line through the slack would be wrong by EA
strain^2, up to kN. `apply_material_law` then replaces the linear tensions by the law,
so that no cable is lost or made over any number of steps. `_drum.py` has the rope that
drums take in or out.

Cable that moves from node a to node b takes its energy along. With m dU/dm at fixed l
equal to T + (integral of strain over T), slip costs friction (T_b - T_a) (1 + mean
strain) per unstretched length, which is the heat (`surface_ratio`). Cable carried to a
node of another strain loses the difference between its energy and the work that it
does.
"""

from cc_mujoco.cable import _elasticity as elastic
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray, compiled, inlined, internal

_MAX_NODE_SHARE = 0.5
"""Largest part of a node's cable that a step may take out of it."""
_MAX_ROUNDS = 6
_FLOW_TOLERANCE = 1e-15
"""Length of path moved in a step that still counts as rounding [m]."""


@internal
def _cable_per_length(prm: FloatArray) -> elastic.Piece:
    taut, bedding = 1.0 / prm[PLACE.axial_stiffness], prm[PLACE.bedding_strain]
    half = prm[PLACE.bedding_tension]
    return elastic.Piece(taut, bedding, half, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0)


@inlined
def stretch_ratio(prm: FloatArray, tension: float) -> float:
    """Return stretched over unstretched length at a tension [N]; below 1 if slack."""
    if not nodes.is_curved_cable(prm):
        return float(1.0 + tension / prm[PLACE.axial_stiffness])
    return _curved_stretch_ratio(prm, tension)


@internal
def _curved_stretch_ratio(prm: FloatArray, tension: float) -> float:
    return 1.0 + elastic.stretch_of(_cable_per_length(prm), tension)


@internal
def strain_energy(prm: FloatArray, ratio: float) -> float:
    """Return the elastic energy per unstretched length at a stretch ratio >= 1 [N]."""
    strain = ratio - 1.0
    if not nodes.is_curved_cable(prm):
        return float(0.5 * prm[PLACE.axial_stiffness] * strain * strain)
    unit = _cable_per_length(prm)
    return elastic.energy_at(unit, elastic.tension_of(unit, strain))


@inlined
def surface_ratio(prm: FloatArray, proximal: float, distal: float) -> float:
    """Return the slip along the surface over the unstretched slip of a segment.

    It is 1 where the path cannot lengthen. The heat of slip is the slip along the
    surface times the difference of the segment's tensions `proximal`, `distal` [N].
    """
    if prm[at.PATH_LENGTHENS] == 0.0:
        return 1.0
    low, high = max(proximal, 0.0), max(distal, 0.0)
    if not nodes.is_curved_cable(prm):
        return float(1.0 + 0.5 * (low + high) / prm[PLACE.axial_stiffness])
    return _curved_surface_ratio(prm, low, high)


@internal
def _curved_surface_ratio(prm: FloatArray, low: float, high: float) -> float:
    if abs(high - low) <= 1e-6 * (high + low):
        return stretch_ratio(prm, 0.5 * (low + high))
    unit = _cable_per_length(prm)
    more = high * elastic.stretch_of(unit, high) - elastic.energy_at(unit, high)
    less = low * elastic.stretch_of(unit, low) - elastic.energy_at(unit, low)
    return 1.0 + (more - less) / (high - low)


@internal
def _carried_length(
    prm: FloatArray, n: int, tension: FloatArray, length: FloatArray, j: int,
    flow: float, ratio: float,
) -> float:  # fmt: skip
    """Return the unstretched length that the path carries from node j to j + 1 [m].

    The path moves by `flow` [m], back if negative. The nodes (n + 1,) have `tension`
    [N] and `length` of path [m]; `ratio` is the stretch ratio of the node it leaves.
    """
    if abs(flow) <= _FLOW_TOLERANCE:
        return 0.0
    k, way = j + 1, 1
    if flow > 0.0:
        k, way = j, -1
    left, total, own = abs(flow), 0.0, ratio
    while left > 0.0:
        last = k + way < 0 or k + way > n
        part = left if last else min(left, length[k])
        total += part / own
        left -= part
        k += way
        if left > 0.0:
            own = stretch_ratio(prm, tension[k])
    return total if flow > 0.0 else -total


@compiled
def carry(
    prm: FloatArray, n: int, tension: FloatArray, before: FloatArray, now: FloatArray,
    gained: FloatArray, was: FloatArray, bends: FloatArray,
) -> bool:  # fmt: skip
    """Move a packed cable to another path; return whether its parameters changed.

    `PATH_LENGTHENS` is set, and the packed wrap angles are those of the new path. The
    nodes (n + 1,) have `tension` before the step [N] and lengths of path `before` and
    `now` [m]. `gained` is the growth of each if no path moved across a segment [m]; its
    sum is the change in length. `was` and `bends` (n,) are the wrap angles of segments
    that a route bends, before and now [rad].
    """
    longer, length = at.lengthening(prm, n), at.node_length(prm, n)
    compliance, stiffness = at.node_compliance(prm, n), at.node_stiffness(prm, n)
    soft = 1.0 / prm[PLACE.axial_stiffness]
    path, cable = at.carried_path(prm, n), at.carried_cable(prm, n)
    flow, carried, changed = 0.0, 0.0, False
    following = stretch_ratio(prm, tension[0])
    springs = prm[PLACE.end_compliance] + prm[PLACE.proximal_compliance]
    play = prm[PLACE.clearance]
    for i in range(n + 1):
        came, ratio, grown = carried, following, now[i] - before[i]
        flow += gained[i] - grown
        carried = 0.0
        if i < n:
            following = stretch_ratio(prm, tension[i + 1])
            left = ratio if flow > 0.0 else following
            carried = _carried_length(prm, n, tension, before, i, flow, left)
            changed = changed or flow != path[i] or carried != cable[i]
            path[i], cable[i] = flow, carried
        share, rope = 1.0 / ratio, now[i]
        if springs + play > 0.0:
            rope -= nodes.given_between(prm, n, i, 0.0, tension[i])
        if play > 0.0:
            grown += nodes.seated_at(prm, n, was, i, tension[i])
            grown -= nodes.seated_at(prm, n, bends, i, tension[i])
        taken = grown * share + carried - came
        loose = rope * share * share
        if tension[i] < 0.0:
            taken -= _bend_of_slack(rope, ratio)
            loose = rope
        changed = changed or taken != longer[i] or loose != length[i]
        longer[i], length[i] = taken, loose
        if i == 0 or i == n:
            # A slack node is taken as when it becomes taut, and so is its spring.
            taut = 1.0 if tension[i] < 0.0 else ratio
            prm[at.RATIO_DISTAL if i == n else at.RATIO_PROXIMAL] = taut
            nodes.set_node(prm, n, i)
        else:
            own = loose * soft
            compliance[i], stiffness[i] = own, 1.0 / own
    return changed


@internal
def _bend_of_slack(length: float, ratio: float) -> float:
    """Return the unstretched length of a slack node beyond its linear law at T = 0 [m].

    `length` is that of its path [m], `ratio` its stretched over unstretched length.
    """
    return length * (1.0 - ratio) ** 2 / ratio


@internal
def _tension_by_law(
    prm: FloatArray, n: int, i: int, before: float, after: float
) -> float:
    """Return the tension of node i with bedding, spring or clearance by its law [N].

    `before` is the tension before the step, `after` that of the linear solution [N].
    """
    start, rope = stretch_ratio(prm, before), at.node_length(prm, n)[i]
    moved = nodes.stretch_between(prm, n, i, before, after)
    if before < 0.0:
        moved += _bend_of_slack(rope, start)
    else:
        rope *= start * start
    # Changes of lengths, as lengths are too coarse in single precision, by 3e-8 m.
    unit, cable = _cable_per_length(prm), rope / start - moved
    strain = elastic.stretch_of(unit, before)
    more = rope * strain / start + moved + nodes.given_between(prm, n, i, 0.0, before)
    if more <= 0.0:
        soft = cable * elastic.compliance_at(unit, 0.0)
        return float(more / (soft + nodes.giving_slope(prm, n, i, 0.0)))
    tension = max(after, 0.0)
    for _ in range(_MAX_ROUNDS):
        more = elastic.stretch_of(unit, tension)
        off = rope * (more - strain) / start - moved * (1.0 + more)
        off += nodes.given_between(prm, n, i, before, tension)
        slope = cable * elastic.compliance_at(unit, tension)
        slope += nodes.giving_slope(prm, n, i, tension)
        tension -= off / slope
    return tension


@internal
def apply_material_law(
    prm: FloatArray, n: int, before: FloatArray, after: FloatArray
) -> None:
    """Replace node tensions `after` a linear step [N] by those of the material law.

    `before` (n + 1,) are the tensions of the nodes before the step [N].
    """
    ea = prm[PLACE.axial_stiffness]
    for i in range(n + 1):
        old, new = before[i], after[i]
        if new == old:
            continue
        straight = not nodes.is_curved_node(prm, n, i)
        if not (straight and nodes.end_spring(prm, n, i) == 0.0):
            after[i] = _tension_by_law(prm, n, i, old, new)
        elif old < 0.0:
            after[i] = new * (ea / (ea - min(new, _MAX_NODE_SHARE * ea)))
        else:
            whole = ea + old
            risen = min(new - old, _MAX_NODE_SHARE * whole)
            after[i] = old + risen * whole / (whole - risen)


@compiled
def set_unstretched_lengths(
    prm: FloatArray, n: int, tension: FloatArray, length: FloatArray
) -> None:
    """Set a packed cable's nodes to their unstretched lengths, for energy and slack.

    The nodes (n + 1,) have this `tension` [N] and `length` of path [m].
    """
    own = at.node_length(prm, n)
    prm[at.RATIO_PROXIMAL] = prm[at.RATIO_DISTAL] = 1.0
    for i in range(n + 1):
        rope = length[i] - nodes.given_between(prm, n, i, 0.0, tension[i])
        own[i] = rope / stretch_ratio(prm, tension[i])
        nodes.set_node(prm, n, i)
