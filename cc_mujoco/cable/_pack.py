"""Preparation of a cable for the kernel: packed parameters, state at rest, compiled.

`_layout.py` defines their layout.
"""

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _mesh as mesh
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal


@internal
def _update_for_angles(prm: FloatArray, n: int) -> None:
    """Pack the values that depend on the wrap angles of the segments."""
    values = at.scalars(prm)
    hold = law.holding_coefficient(values)
    guided = int(prm[at.GUIDED])
    dragged = values[PLACE.load_independent_friction] != 0.0
    dragged = dragged or values[PLACE.seal_proximal] != 0.0
    dragged = dragged or values[PLACE.seal_distal] != 0.0
    length = at.contact_length(prm, n)
    angle, drag = at.segment_angles(prm, n), at.constant_drag(prm, n)
    growth, holding = at.constant_growth(prm, n), at.constant_hold(prm, n)
    for j in range(n):
        if j > 0 and angle[j] == angle[j - 1]:  # as along an arc
            growth[j] = growth[j - 1]
        else:
            growth[j] = law.ratio(values[PLACE.friction], angle[j])
    holding[:] = growth
    for j in range(n if hold != values[PLACE.friction] else 0):
        holding[j] = law.ratio(hold, angle[j])
    drag[:] = 0.0
    for j in range(n if dragged else 0):
        drag[j] = law.drag(values, length[j], growth[j], j, guided)


@internal
def _update_for_lengths(prm: FloatArray, n: int) -> None:
    """Pack the values that depend only on the contact lengths of the segments."""
    length, half = at.contact_length(prm, n), at.half_compliance(prm, n)
    ea = prm[PLACE.axial_stiffness]
    for j in range(n):
        half[j] = 1.0 / (ea / (0.5 * length[j])) if length[j] > 0.0 else 0.0


@compiled
def expect_yielding(prm: FloatArray, proximal: float, distal: float) -> None:
    """Let the ends of a packed cable yield to their tensions in the next step.

    Per change of its tension in the step an end moves from its prescribed displacement
    into the cable, by `proximal` and `distal` [m/N]. The new state has the displacement
    reached. Both ends must be driven by position.
    """
    prm[at.YIELD_PROXIMAL] = proximal
    prm[at.YIELD_DISTAL] = distal


@compiled
def expect_change(prm: FloatArray) -> None:
    """Allow the bends of a packed cable to change before every step.

    Tensions may then lie beyond what friction holds, so slip may begin anywhere.
    """
    prm[at.BENDS_CHANGE] = 1.0


@compiled
def expect_lengthening(prm: FloatArray) -> None:
    """Allow the path of a packed cable to lengthen before every step.

    Call `expect_change` too, and `_moving_path.carry` before each step.
    """
    prm[at.PATH_LENGTHENS] = 1.0


@compiled
def pack_mesh(values: FloatArray, n: int, out: FloatArray) -> None:
    """Pack the parameters of a cable whose mesh is already in `out`.

    The mesh is `segment_angles`, `node_length`, `contact_length` and the factors on
    clearance of `_layout.py`, with the entries `LENGTH`, the sum of the nodes, and
    `GUIDED`.
    """
    for i in range(at.SCALARS):
        out[i] = values[i]
    out[at.BENDS_CHANGE] = out[at.PATH_LENGTHENS] = 0.0
    expect_yielding(out, 0.0, 0.0)
    out[at.CONSTANT_COULOMB] = 1.0 if law.is_constant_coulomb(values) else 0.0
    out[at.CURVED] = nodes.curvature(values)
    out[at.HELD_PROXIMAL] = out[at.HELD_DISTAL] = 0.0
    out[at.RATIO_PROXIMAL] = out[at.RATIO_DISTAL] = 1.0
    out[at.STATE_DEPENDENT] = 1.0 if law.is_state_dependent(values) else 0.0
    _update_for_angles(out, n)
    _update_for_lengths(out, n)
    gained = at.lengthening(out, n)
    at.carried_path(out, n)[:] = 0.0
    at.carried_cable(out, n)[:] = 0.0
    for i in range(n + 1):
        gained[i] = 0.0
        nodes.set_node(out, n, i)


@compiled
def pack(values: FloatArray, sections: FloatMatrix, n: int, out: FloatArray) -> None:
    """Pack the parameters of a cable for the kernel in `out`, of `parameter_size(n)`.

    `values` are in the order of `PARAMETERS`, `sections` (m, 4) those of the cable,
    proximal to distal.
    """
    total, _, even = mesh.measure_conduit(sections)
    contacts, lengths = at.contact_length(out, n), at.node_length(out, n)
    edges = lengths  # until the segments have their lengths
    mesh.lay_segments(sections, n, edges)
    mesh.segment_wraps(sections, edges, at.segment_angles(out, n))
    mesh.share_clearance(
        sections, edges, at.segment_angles(out, n), at.clearance_factors(out, n),
        at.seating_factors(out, n),
    )  # fmt: skip
    for j in range(n):
        contacts[j] = total / n if even else edges[j + 1] - edges[j]
    for i in range(n + 1):
        # The end nodes stand for half a segment.
        lengths[i] = 0.5 * contacts[0 if i == 0 else i - 1]
        lengths[i] += 0.5 * contacts[i] if 0 < i < n else 0.0
    out[at.LENGTH], out[at.GUIDED] = total, n
    pack_mesh(values, n, out)


@compiled
def rebend(prm: FloatArray, n: int, angles: FloatArray) -> None:
    """Set the wrap angles (n,) of the segments of a packed cable [rad].

    The length is kept. Call `expect_change` too.
    """
    set_path(prm, n, angles, at.contact_length(prm, n))


@internal
def differ(one: FloatArray, other: FloatArray, n: int) -> bool:
    """Return whether the first n entries of two arrays differ."""
    j = 0
    while j < n and one[j] == other[j]:
        j += 1
    return j < n


@internal
def set_path(prm: FloatArray, n: int, angles: FloatArray, contacts: FloatArray) -> bool:
    """Set wrap angles [rad], contact lengths [m] (n,); return whether any changed."""
    angle, contact = at.segment_angles(prm, n), at.contact_length(prm, n)
    bends, contact_changed = differ(angles, angle, n), differ(contacts, contact, n)
    angle[:], contact[:] = angles, contacts
    if contact_changed:
        _update_for_lengths(prm, n)
    if bends or contact_changed:
        _update_for_angles(prm, n)
    return bends or contact_changed


@internal
def rest_in(prm: FloatArray, n: int, angles: FloatArray, state: FloatArray) -> None:
    """Set the stretch in `state` of a cable at rest in these bends (n,) [rad]."""
    rest = prm[PLACE.pretension]
    state[3] = nodes.rest_stretch(prm, n, 0.0, rest)
    state[3] += nodes.seated_stretch(prm, n, angles, rest)
    if prm[PLACE.clearance] > 0.0 and prm[at.PATH_LENGTHENS] == 0.0:
        state[at.rest_wrap(n)] = nodes.wrap_with_play(prm, n, angles)


@compiled
def initialize(
    prm: FloatArray, n: int, u_proximal: float, u_distal: float, state: FloatArray
) -> None:
    """Set `state` to rest in uniform pretension, at these displacements [m]."""
    for i in range(at.state_size(n)):
        state[i] = 0.0
    state[0] = u_proximal
    state[1] = u_distal
    stretch = prm[PLACE.pretension] * prm[at.LENGTH] / prm[PLACE.axial_stiffness]
    springs = prm[PLACE.end_compliance] + prm[PLACE.proximal_compliance]
    state[3] = stretch + prm[PLACE.pretension] * springs
    if nodes.is_curved(prm):
        rest_in(prm, n, at.segment_angles(prm, n), state)
    if prm[at.PATH_LENGTHENS] != 0.0:
        state[3] = 0.0
    at.tensions(state, n)[:] = prm[PLACE.pretension]
    nodes.rest_springs(prm, n, state)
