"""Friction of every segment in a step, and the state after it, compiled.

The laws are those of `_friction.py`, the rows of coefficients those of `_layout.py`.
"""

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _nonlinear_elasticity as nonlinear_elasticity
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._fronts import (
    PATH_TOLERANCE,
    CoulombChain,
    hold_against,
    overcome_direction,
)
from cc_mujoco.cable._layout import Step
from cc_mujoco.cable._pre_step import loses_stretch
from cc_mujoco.native import FloatArray, internal


@internal
def write_coefficients(
    prm: FloatArray, n: int, step: Step, tension: FloatArray
) -> None:
    """Write E, H, B and C of every segment, see `_friction.py`, to rows of scratch.

    With bristles their stiffness and force too. `tension` (n + 1,) [N] is that of the
    nodes before the ends move.
    """
    state, work, dt = step.state, step.work, step.dt
    if prm[at.CONSTANT_COULOMB] != 0.0:
        held, slipped = at.constant_hold(prm, n), at.slips(state, n)
        for j in range(n):
            # A segment that goes on slipping the same way has already broken away.
            own, way = at.constant_growth(prm, n)[j], slipped[j]
            at.row(work, n, at.HOLD_DISTAL)[j] = own if way > 0.0 else held[j]
            at.row(work, n, at.HOLD_PROXIMAL)[j] = own if way < 0.0 else held[j]
        at.row(work, n, at.GROWTH)[:] = at.constant_growth(prm, n)
        at.row(work, n, at.GROWTH_PROXIMAL)[:] = at.constant_growth(prm, n)
        at.row(work, n, at.DRAG)[:] = at.constant_drag(prm, n)
        at.row(work, n, at.VISCOSITY)[:] = 0.0
        return
    values = at.scalars(prm)
    is_state_dependent = prm[at.STATE_DEPENDENT] != 0.0
    guided, length = int(prm[at.GUIDED]), at.contact_length(prm, n)
    growth = at.row(work, n, at.GROWTH)
    growth_proximal = at.row(work, n, at.GROWTH_PROXIMAL)
    hold_distal = at.row(work, n, at.HOLD_DISTAL)
    hold_proximal = at.row(work, n, at.HOLD_PROXIMAL)
    drag, viscosity = at.row(work, n, at.DRAG), at.row(work, n, at.VISCOSITY)
    guess, travel, whole = at.row(work, n, at.SPEED), state[at.TRAVEL], prm[at.LENGTH]
    resting = law.holding_coefficient(values)
    drift = 1.0
    if is_state_dependent:
        drift = law.drift_factor(values, state[at.TIME] + dt, state[at.HEAT])
    constant_hold = at.constant_hold(prm, n)
    slips, speeds = at.slips(state, n), at.slip_speeds(state, n)
    angles, ages = at.segment_angles(prm, n), at.contact_ages(state, n)
    reached = 0.0
    for j in range(n):
        begin, reached = reached, reached + length[j]
        slip = slips[j]
        distal_hold = proximal_hold = constant_hold[j]
        angle = angles[j]
        if is_state_dependent:
            angle *= law.wrap_factor(values, travel, begin, reached, whole)
        mean = 0.5 * (max(tension[j], 0.0) + max(tension[j + 1], 0.0))
        coefficient = law.kinetic_coefficient(values, abs(slip), speeds[j])
        holding = resting
        if is_state_dependent:
            coefficient, holding = law.changed_coefficients(
                values, coefficient, resting, drift, mean, ages[j]
            )
        growth[j] = growth_proximal[j] = law.ratio(coefficient, angle)
        if is_state_dependent:
            distal_hold = proximal_hold = growth[j]
            if holding != coefficient:
                distal_hold = proximal_hold = law.ratio(holding, angle)
        drag[j] = law.drag(values, length[j], growth[j], j, guided)
        viscosity[j] = law.viscosity(values, length[j], growth[j], guess[j], dt)
        if values[PLACE.friction_asymmetry] != 0.0:
            distal = law.direction_factor(values, 1.0)
            proximal = law.direction_factor(values, -1.0)
            growth[j] = law.ratio(coefficient * distal, angle)
            growth_proximal[j] = law.ratio(coefficient * proximal, angle)
            distal_hold, proximal_hold = growth[j], growth_proximal[j]
            if holding != coefficient:
                distal_hold = law.ratio(holding * distal, angle)
                proximal_hold = law.ratio(holding * proximal, angle)
        if values[PLACE.bristle_length] > 0.0:
            spring = law.bristle_stiffness(values, coefficient, angle, mean, drag[j])
            force = at.bristle_forces(state, n)[j]
            stretch = at.bristle_stretches(state, n)[j]
            at.row(work, n, at.HELD)[j] = law.bristle_force(force, stretch, spring)
            # Bristles bend by the way on the surface, slip is of unstretched cable.
            spring *= moving_path.surface_ratio(prm, tension[j], tension[j + 1])
            at.row(work, n, at.SPRING)[j] = spring
        # A segment that goes on slipping the same way has already broken away.
        hold_distal[j] = growth[j] if slip > 0.0 else distal_hold
        hold_proximal[j] = growth_proximal[j] if slip < 0.0 else proximal_hold


@internal
def friction_holds(n: int, chain: CoulombChain) -> bool:
    tension = chain.tension
    for j in range(n):
        way = overcome_direction(
            max(tension[j], 0.0), max(tension[j + 1], 0.0), hold_against(chain, j, 1),
            hold_against(chain, j, -1), chain.drag[j], PATH_TOLERANCE,
        )  # fmt: skip
        if way != 0:
            return False
    return True


@internal
def update_viscosity(prm: FloatArray, n: int, step: Step, node: FloatArray) -> bool:
    """Update the speeds for the viscosity of grease; return whether they converged.

    The drag is implicit in the slip, so grease dissipates for any dt and after any
    round; its error is of first order in dt (0.06 % RMS at 1 ms where the ends turn at
    once). Converged is a drag error of all segments below 1e-5 of the largest tension.
    """
    values = at.scalars(prm)
    shift, guess = at.row(step.work, n, at.SHIFT), at.row(step.work, n, at.SPEED)
    length, largest = at.contact_length(prm, n), 0.0
    for i in range(n + 1):
        largest = max(largest, node[i])
    error = 0.0
    for j in range(n):
        speed = abs(shift[j]) / step.dt
        taken = law.grease_viscosity(values, guess[j])
        right = law.grease_viscosity(values, speed)
        error += abs(right - taken) * speed * length[j]
        guess[j] = law.next_guess(values, guess[j], speed)
    return error <= nonlinear_elasticity.LINEARIZATION_TOLERANCE * largest


POSITION, TENSION = 0, 1
"""Kinds of an end: its displacement or its tension is prescribed."""


@internal
def written_size(prm: FloatArray, n: int) -> int:
    """Return the number of leading entries that this cable uses of a state."""
    if prm[at.PATH_LENGTHENS] != 0.0:
        return at.state_size(n)
    if prm[PLACE.clearance] > 0.0:
        return at.rest_wrap(n) + 1
    rows = 2
    if prm[PLACE.bristle_length] > 0.0:
        rows = 4
    if prm[PLACE.ageing_friction] > 0.0:
        rows = 5
    return at.STATE_HEADER + 1 + (1 + rows) * n


@internal
def commit(
    prm: FloatArray, n: int, tension: FloatArray, proximal_kind: int, distal_kind: int,
    step: Step,
) -> None:  # fmt: skip
    """Complete the new state; `tension` (n + 1,) [N] is that before the ends moved."""
    state, new_state, work = step.state, step.new_state, step.work
    stiffness = at.node_stiffness(prm, n)
    shift = at.row(work, n, at.SHIFT)
    node = at.tensions(new_state, n)
    # Tension from displacement, not from the solver's ratios: the stretch of the cable
    # then adds up over any number of steps.
    is_curved, is_curved_cable = nodes.is_curved(prm), nodes.is_curved_cable(prm)
    proximal, distal = max(node[0], 0.0), max(node[n], 0.0)
    if is_curved_cable:
        for i in range(1, n):
            stretched = shift[i] - shift[i - 1]
            node[i] = nodes.tension_after_stretch(prm, n, i, tension[i], stretched)
    else:
        for i in range(1, n):
            strained = tension[i] + stiffness[i] * (shift[i] - shift[i - 1])
            node[i] = min(strained, 0.0) if node[i] <= 0.0 else strained
    for end in range(2):
        i = n * end
        behind = shift[n - 1] if end == 1 else step.proximal - state[0]
        ahead = step.distal - state[1] if end == 1 else shift[0]
        stretched = ahead - behind
        strained = tension[i] + stiffness[i] * stretched
        if is_curved:
            strained = nodes.tension_after_stretch(prm, n, i, tension[i], stretched)
        elif node[i] <= 0.0:
            strained = min(strained, 0.0)
        node[i] = strained
    if proximal_kind == POSITION:
        new_state[0] = step.proximal
    else:
        node[0] = proximal
        stretched = nodes.stretch_between(prm, n, 0, tension[0], node[0])
        new_state[0] = state[0] + shift[0] - stretched
    if distal_kind == POSITION:
        new_state[1] = step.distal
    else:
        node[n] = distal
        stretched = nodes.stretch_between(prm, n, n, tension[n], node[n])
        new_state[1] = state[1] + shift[n - 1] + stretched
    lost, mixed = 0.0, 0.0
    slipped, has_bristles = shift, prm[PLACE.bristle_length] > 0.0
    if has_bristles:
        slipped = at.row(work, n, at.SLIPPED)
        _commit_bristles(prm, n, step, tension)
    lengthens = prm[at.PATH_LENGTHENS] != 0.0
    if lengthens or loses_stretch(prm):
        # The cable slips as its path lengthens, so friction was that of before.
        tension = at.tensions(state, n)
    # At mean tensions, so that work of the ends is what is stored more, and heat.
    low = 0.5 * (tension[0] + node[0])
    if is_curved or not (tension[0] >= 0.0 and node[0] >= 0.0):
        low = nodes.mean_tension(prm, n, 0, tension[0], node[0])
    is_plain = not (is_curved or lengthens or has_bristles)
    for j in range(n if is_plain else 0):  # the usual case, in few instructions
        high = 0.5 * (tension[j + 1] + node[j + 1])
        if not (tension[j + 1] >= 0.0 and node[j + 1] >= 0.0):
            high = nodes.mean_tension(prm, n, j + 1, tension[j + 1], node[j + 1])
        lost += (high - low) * shift[j]
        low = high
    path, cable = at.carried_path(prm, n), at.carried_cable(prm, n)
    for j in range(0 if is_plain else n):
        high = 0.5 * (tension[j + 1] + node[j + 1])
        if is_curved or not (tension[j + 1] >= 0.0 and node[j + 1] >= 0.0):
            high = nodes.mean_tension(prm, n, j + 1, tension[j + 1], node[j + 1])
        ratio = moving_path.surface_ratio(prm, low, high)
        lost += (high - low) * shift[j] * ratio
        if lengthens:
            # Cable that a surface carries to a node of another strain.
            mixed += (high - low) * (cable[j] * ratio - path[j])
        if has_bristles:
            lost += at.row(work, n, at.RELEASED_ENERGY)[j]
        low = high
    _commit_slip(prm, n, step, slipped)
    lost = max(lost, 0.0)
    if prm[at.CONSTANT_COULOMB] == 0.0:
        new_state[at.TIME] = state[at.TIME] + step.dt
        new_state[at.TRAVEL] = state[at.TRAVEL] + (new_state[1] - state[1])
        values, heat = at.scalars(prm), state[at.HEAT]
        new_state[at.HEAT] = law.heat_after_step(values, heat, lost, step.dt)
    new_state[2] += lost + max(mixed, 0.0)
    if lengthens:
        return
    new_state[3] = new_state[3] + (new_state[1] - state[1]) - (new_state[0] - state[0])


@internal
def _commit_slip(prm: FloatArray, n: int, step: Step, slipped: FloatArray) -> None:
    """Write slip distance, speed and contact age after a slip of `slipped` (n,) [m]."""
    state, new_state, dt, values = step.state, step.new_state, step.dt, at.scalars(prm)
    remembers = prm[PLACE.stribeck_friction] > 0.0 or prm[PLACE.grease_drag] > 0.0
    before, slip = at.slips(state, n), at.slips(new_state, n)
    speeds, ages = at.slip_speeds(state, n), at.contact_ages(state, n)
    new_speeds, new_ages = at.slip_speeds(new_state, n), at.contact_ages(new_state, n)
    for j in range(n):
        moved = slipped[j]
        slip[j] = moved + before[j] if moved * before[j] > 0.0 else moved
    for j in range(n if remembers else 0):
        speed = speeds[j] if slipped[j] * before[j] > 0.0 else 0.0
        new_speeds[j] = law.remembered_speed(values, speed, slipped[j], dt)
    for j in range(n if prm[PLACE.ageing_friction] > 0.0 else 0):
        new_ages[j] = law.age_after_step(values, ages[j], slipped[j], dt)


@internal
def _commit_bristles(prm: FloatArray, n: int, step: Step, tension: FloatArray) -> None:
    """Write force and stretch of the bristles, and the energy [J] that they lost."""
    state, new_state, work = step.state, step.new_state, step.work
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
