"""State after a solved step, compiled: tensions, slip memory and dissipated energy."""

from __future__ import annotations

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._pre_step import loses_stretch
from cc_mujoco.native import FloatArray, internal

POSITION, TENSION = 0, 1
"""Quantity prescribed at an end."""

_STRIBECK = law.INDEX["stribeck_friction"]
_BRISTLE = law.INDEX["bristle_length"]
_AGEING = law.INDEX["ageing_friction"]
_GREASE = law.INDEX["grease_drag"]


@internal
def commit(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    tension: FloatArray,
    proximal_kind: int,
    proximal_value: float,
    distal_kind: int,
    distal_value: float,
    dt: float,
    new_state: FloatArray,
    work: FloatArray,
) -> None:
    """Write ends, slack, slip memory and dissipated energy of the step."""
    stiffness = at.node_stiffness(prm, n)
    shift = at.row(work, n, at.SHIFT)
    node = at.tensions(new_state, n)
    # Tension from displacement, not from the solver's ratios: the stretch of the cable
    # then adds up over any number of steps.
    behind = proximal_value - state[0]
    is_curved = nodes.is_curved(prm)
    for i in range(n + 1):
        ahead = shift[i] if i < n else distal_value - state[1]
        strained = tension[i] + stiffness[i] * (ahead - behind)
        if is_curved:
            strained = nodes.tension_after_stretch(
                prm, n, i, tension[i], ahead - behind
            )
        elif node[i] <= 0.0:
            strained = min(strained, 0.0)
        if (i == 0 and proximal_kind == TENSION) or (i == n and distal_kind == TENSION):
            strained = max(node[i], 0.0)
        node[i] = strained
        behind = ahead
    if proximal_kind == POSITION:
        new_state[0] = proximal_value
    else:
        stretched = nodes.stretch_between(prm, n, 0, tension[0], node[0])
        new_state[0] = state[0] + shift[0] - stretched
    if distal_kind == POSITION:
        new_state[1] = distal_value
    else:
        stretched = nodes.stretch_between(prm, n, n, tension[n], node[n])
        new_state[1] = state[1] + shift[n - 1] + stretched
    lost, mixed = 0.0, 0.0
    slipped, has_bristles = shift, prm[_BRISTLE] > 0.0
    if has_bristles:
        slipped = at.row(work, n, at.SLIPPED)
        _commit_bristles(prm, n, state, tension, new_state, work)
    values = at.scalars(prm)
    remembers = prm[_STRIBECK] > 0.0 or prm[_GREASE] > 0.0
    ages = prm[_AGEING] > 0.0
    before_slip, slip = at.slips(state, n), at.slips(new_state, n)
    lengthens = prm[at.PATH_LENGTHENS] != 0.0
    if lengthens or loses_stretch(prm):
        # The cable slips as its path lengthens, so friction was that of before.
        tension = at.tensions(state, n)
    # At mean tensions, so that work of the ends is what is stored more, and heat.
    low = nodes.mean_tension(prm, n, 0, tension[0], node[0])
    for j in range(n):
        moved = slipped[j]
        high = nodes.mean_tension(prm, n, j + 1, tension[j + 1], node[j + 1])
        ratio = moving_path.surface_ratio(prm, low, high)
        lost += (high - low) * shift[j] * ratio
        if lengthens:
            # Cable that a surface carries to a node of another strain.
            carried = at.carried_cable(prm, n)[j] * ratio - at.carried_path(prm, n)[j]
            mixed += (high - low) * carried
        if has_bristles:
            lost += at.row(work, n, at.RELEASED_ENERGY)[j]
        low = high
        same = moved * before_slip[j] > 0.0
        slip[j] = moved + before_slip[j] if same else moved
        if ages:
            age = at.contact_ages(state, n)[j]
            at.contact_ages(new_state, n)[j] = law.age_after_step(
                values, age, moved, dt
            )
        if remembers:
            speed = at.slip_speeds(state, n)[j] if same else 0.0
            at.slip_speeds(new_state, n)[j] = law.remembered_speed(
                values, speed, moved, dt
            )
    lost = max(lost, 0.0)
    if prm[at.CONSTANT_COULOMB] == 0.0:
        new_state[at.TIME] = state[at.TIME] + dt
        new_state[at.TRAVEL] = state[at.TRAVEL] + (new_state[1] - state[1])
        new_state[at.HEAT] = law.heat_after_step(
            at.scalars(prm), state[at.HEAT], lost, dt
        )
    new_state[2] += lost + max(mixed, 0.0)
    if lengthens:
        return
    new_state[3] = new_state[3] + (new_state[1] - state[1]) - (new_state[0] - state[0])


@internal
def _commit_bristles(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    tension: FloatArray,
    new_state: FloatArray,
    work: FloatArray,
) -> None:
    """Write force and stretch of the bristles, and the energy that they released."""
    shift, slipped = at.row(work, n, at.SHIFT), at.row(work, n, at.SLIPPED)
    held, spring = at.row(work, n, at.HELD), at.row(work, n, at.SPRING)
    forces, stretches = at.bristle_forces(state, n), at.bristle_stretches(state, n)
    new_forces = at.bristle_forces(new_state, n)
    new_stretches = at.bristle_stretches(new_state, n)
    for j in range(n):
        force, stretch, now = forces[j], stretches[j], 0.0
        ratio = moving_path.surface_ratio(prm, tension[j], tension[j + 1])
        own = spring[j] / ratio
        elastic = law.bristle_force(force, stretch, own)
        elastic += own * ratio * (shift[j] - slipped[j])
        if own > 0.0:
            now = min(max(held[j], -abs(elastic)), abs(elastic)) / own
        before = 0.5 * abs(force * stretch)
        at.row(work, n, at.RELEASED_ENERGY)[j] = before - 0.5 * abs(held[j] * now)
        new_forces[j] = held[j]
        new_stretches[j] = now
