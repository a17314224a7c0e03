"""Changes of a cable's tensions before its ends move in a step, compiled.

Bends change and redistribute its clearance, its stress relaxes, its conduit slides in
clamps, its path lengthens, and what holds its ends yields.
"""

import math

from cc_mujoco.cable import _drum as drum
from cc_mujoco.cable import _elasticity as elastic
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._layout import Step
from cc_mujoco.native import FloatArray, internal

TENSION_ROW, LOST_ROW = 0, 3
"""Rows of scratch, see `node_row`: tensions after these changes, and stretch that nodes
lose to relaxation and clamps."""


@internal
def seats_anew(prm: FloatArray) -> bool:
    """Return whether bends may change that take up clearance in a conduit."""
    lengthens = float(prm[at.PATH_LENGTHENS]) != 0.0  # `_open_path.lay` does it there
    changes = float(prm[at.BENDS_CHANGE]) != 0.0 and not lengthens
    return changes and float(prm[PLACE.clearance]) > 0.0


@internal
def seat_anew(prm: FloatArray, n: int, state: FloatArray, tension: FloatArray) -> None:
    """Change `tension` (n + 1,) to the stretch in the state after bends have changed.

    As it is not known where clearance changed, all nodes share the difference, as they
    would without friction.
    """
    off, soft = -state[3], 0.0
    for i in range(n + 1):
        own = nodes.node_piece(prm, n, i)
        off += elastic.stretch_of(own, tension[i])
        soft += elastic.compliance_at(own, tension[i])
    for i in range(n + 1):
        own = nodes.node_piece(prm, n, i)
        moved = -off * elastic.compliance_at(own, tension[i]) / soft
        tension[i] = nodes.tension_after_stretch(prm, n, i, tension[i], moved)


@internal
def begin_losses(n: int, step: Step) -> tuple[FloatArray, FloatArray]:
    """Return the two rows of scratch: tensions of the state, and lost stretch of 0."""
    old, tension = at.tensions(step.state, n), at.node_row(step.work, n, TENSION_ROW)
    lost = at.node_row(step.work, n, LOST_ROW)
    for i in range(n + 1):
        tension[i], lost[i] = old[i], 0.0
    return tension, lost


@internal
def heat_of_losses(prm: FloatArray, n: int, step: Step) -> float:
    """Return the heat of lost stretch: each node's times its mean tension [J].

    Where the path lengthens, it is converted from unstretched rope.
    """
    before, after = at.tensions(step.state, n), at.tensions(step.new_state, n)
    lost, total = at.node_row(step.work, n, LOST_ROW), 0.0
    for i in range(n + 1):
        if lost[i] != 0.0:
            mean = nodes.mean_tension(prm, n, i, before[i], after[i])
            total += lost[i] * mean * moving_path.surface_ratio(prm, mean, 0.0)
    return max(total, 0.0)


@internal
def relax_stress(
    prm: FloatArray, n: int, step: Step, tension: FloatArray, lost: FloatArray
) -> None:
    """Relax all of the cable equally: reduce `tension` [N], set lost stretch [m]."""
    time, scale = step.state[at.TIME], prm[PLACE.relaxation_time]
    before = 1.0 + prm[PLACE.stress_relaxation] * math.expm1(-time / scale)
    after = 1.0 + prm[PLACE.stress_relaxation] * math.expm1(-(time + step.dt) / scale)
    rest, wrap = prm[PLACE.pretension], step.state[at.rest_wrap(n)]
    if prm[at.PATH_LENGTHENS] != 0.0:  # as in the present bends
        wrap = nodes.wrap_with_play(prm, n, at.segment_angles(prm, n))
    grown = nodes.rest_stretch(prm, n, wrap, rest * before)
    grown -= nodes.rest_stretch(prm, n, wrap, rest * after)
    for i in range(n + 1):
        lost[i] = at.node_length(prm, n)[i] / prm[at.LENGTH] * grown
        tension[i] = nodes.tension_after_stretch(prm, n, i, tension[i], -lost[i])
    step.new_state[3] -= grown


@internal
def clamps_slide(prm: FloatArray) -> bool:
    """Return whether a clamp lets the conduit creep above its holding force."""
    slides = float(prm[PLACE.clamp_creep_proximal]) > 0.0
    return slides or float(prm[PLACE.clamp_creep_distal]) > 0.0


@internal
def loses_stretch(prm: FloatArray) -> bool:
    """Return whether stress relaxes or a clamp lets the conduit creep."""
    return float(prm[PLACE.stress_relaxation]) > 0.0 or clamps_slide(prm)


@internal
def slide_in_clamps(
    prm: FloatArray, n: int, step: Step, tension: FloatArray, lost: FloatArray
) -> None:
    """Shorten the path at both ends by the creep of the conduit in its clamps.

    The rate follows the tension after the creep, with the stiffness of the end node
    before it, so no step takes the tension below `clamp_force`.
    """
    stiffness, dt = at.node_stiffness(prm, n), step.dt
    for end in range(2):
        i = n * end
        creep = prm[PLACE.clamp_creep_proximal]
        if end == 1:
            creep = prm[PLACE.clamp_creep_distal]
        over = tension[i] - prm[PLACE.clamp_force]
        if creep > 0.0 and over > 0.0:
            # A curved cable is no stiffer than when it is taut.
            slid = creep * dt * over / (1.0 + stiffness[i] * creep * dt)
            if prm[at.PATH_LENGTHENS] != 0.0:
                slid /= moving_path.stretch_ratio(prm, tension[i])
            lost[i] += slid
            tension[i] = nodes.tension_after_stretch(prm, n, i, tension[i], -slid)
            if prm[at.PATH_LENGTHENS] == 0.0:
                step.new_state[3] -= slid


@internal
def stretch_by_path(prm: FloatArray, n: int, step: Step, old: FloatArray) -> FloatArray:
    """Stretch nodes of tension `old` by their path's growth; return tensions [N]."""
    state = step.state
    proximal, distal = step.proximal - state[0], step.distal - state[1]  # of the ends
    tension, gained = at.node_row(step.work, n, TENSION_ROW), at.lengthening(prm, n)
    for i in range(n + 1):
        moved = gained[i]
        if i == 0:
            ratio = drum.passing_ratio(prm, n, state, 0, proximal)
            moved += proximal - proximal / ratio
        if i == n:
            moved -= distal - distal / drum.passing_ratio(prm, n, state, 1, -distal)
        tension[i] = nodes.tension_after_stretch(prm, n, i, old[i], moved)
    return tension


@internal
def add_end_springs(
    prm: FloatArray, n: int, step: Step, old: FloatArray, yield_proximal: float,
    yield_distal: float,
) -> FloatArray:  # fmt: skip
    """Add springs at both ends for the rest of a step; return the tensions [N].

    `yield_proximal` and `yield_distal` are their compliances [m/N], `old` the tensions.
    A spring is relaxed at the tension in the state, or at 0 where that is negative.
    """
    tension = at.node_row(step.work, n, TENSION_ROW)
    before, new_state = at.tensions(step.state, n), step.new_state
    for i in range(n + 1):
        tension[i] = old[i]
    for end in range(2):
        i = n * end
        own = nodes.node_stretch(prm, n, i, old[i])
        yielding = yield_distal if end == 1 else yield_proximal
        prm[at.YIELD_DISTAL if end == 1 else at.YIELD_PROXIMAL] = yielding
        nodes.set_node(prm, n, i)
        if old[i] != before[i] or old[i] < 0.0:
            whole = own + yielding * max(before[i], 0.0)
            tension[i] = nodes.tension_at(prm, n, i, whole)
        if prm[at.PATH_LENGTHENS] == 0.0:
            new_state[3] += nodes.node_stretch(prm, n, i, tension[i]) - own
    return tension


@internal
def remove_end_springs(
    prm: FloatArray, n: int, step: Step, yield_proximal: float, yield_distal: float
) -> None:
    """Remove the springs of `add_end_springs` and update the positions of the ends."""
    new_state = step.new_state
    before, now = at.tensions(step.state, n), at.tensions(new_state, n)
    for end in range(2):
        i = n * end
        whole = nodes.node_stretch(prm, n, i, now[i])
        yielding = yield_distal if end == 1 else yield_proximal
        prm[at.YIELD_DISTAL if end == 1 else at.YIELD_PROXIMAL] = 0.0
        nodes.set_node(prm, n, i)
        if now[i] < 0.0:
            now[i] = nodes.tension_at(prm, n, i, whole)
        if prm[at.PATH_LENGTHENS] == 0.0:
            new_state[3] += nodes.node_stretch(prm, n, i, now[i]) - whole
        gone = yielding * (max(now[i], 0.0) - max(before[i], 0.0))
        new_state[end] += -gone if end == 1 else gone
        if end == 1 and prm[at.CONSTANT_COULOMB] == 0.0:
            new_state[at.TRAVEL] -= gone
