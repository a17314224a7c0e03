"""One time step of one cable, compiled, without allocation.

    n = cable.segments
    pack(values, sections, n, prm)                    # once
    initialize(prm, n, u_proximal, u_distal, state)   # rest, uniform pretension
    advance(prm, n, state, u_proximal, u_distal, dt, new_state, work)

Guarantees: tensions are >= 0 and finite for finite input, friction never feeds energy
in, a term that is off changes no bit, and `advance` reads `state` and writes
`new_state` only. Everything is callable from Numba-compiled code and needs no GIL; a
caller of your own is best compiled without `cache=True`, for Numba would keep it when
this module changes.

The layout of `prm` and `state` is defined in `_layout.py`.

Node 0 is the proximal end, node n the distal end. Node i carries the strain of the
cable between the centres of the adjacent segments, so that the sum of T_i h_i / EA is
the stretch of the cable at all times.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco._utils.compilation import (
    INTEGER,
    REAL,
    REALS,
    FloatArray,
    borrow,
    compiled,
    exported,
    internal,
)
from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _nonlinear_elasticity as nonlinear_elasticity
from cc_mujoco.cable import _pack as prepare
from cc_mujoco.cable import _pre_step as before
from cc_mujoco.cable._chain_solve import lay_evenly
from cc_mujoco.cable._fronts import march, overcome_direction
from cc_mujoco.cable._graph import sweep
from cc_mujoco.cable._layout import STATE_HEADER as STATE_HEADER
from cc_mujoco.cable._layout import node_stiffness as node_stiffness
from cc_mujoco.cable._layout import parameter_size as parameter_size
from cc_mujoco.cable._layout import segment_angles as segment_angles
from cc_mujoco.cable._layout import state_size as state_size
from cc_mujoco.cable._layout import work_size as work_size
from cc_mujoco.cable._nodes import end_stiffness as end_stiffness
from cc_mujoco.cable._nodes import slack_length as slack_length
from cc_mujoco.cable._nodes import stored_energy as stored_energy
from cc_mujoco.cable._nodes import total_stretch as total_stretch
from cc_mujoco.cable._pack import expect_change as expect_change
from cc_mujoco.cable._pack import expect_lengthening as expect_lengthening
from cc_mujoco.cable._pack import expect_yielding as expect_yielding
from cc_mujoco.cable._pack import initialize as initialize
from cc_mujoco.cable._pack import pack as pack
from cc_mujoco.cable._pack import pack_mesh as pack_mesh
from cc_mujoco.cable._pack import rebend as rebend
from cc_mujoco.cable._presliding import preslide

POSITION, TENSION = 0, 1
"""Quantity prescribed at an end."""

OK, NOT_FINITE = 0, 1
"""Status of a step; on NOT_FINITE the new state is the old one."""

_SHIFT, _SLIPPED, _GROWTH, _GROWTH_PROXIMAL, _HOLD_DISTAL = 0, 1, 2, 3, 4
_HOLD_PROXIMAL, _DRAG, _VISCOSITY, _SPRING, _HELD, _SPEED = 5, 6, 7, 8, 9, 10
_RELEASED_ENERGY = _SPRING
_LOAD_INDEPENDENT = law.INDEX["load_independent_friction"]
_SEALS = law.INDEX["seal_proximal"], law.INDEX["seal_distal"]
_STRIBECK = law.INDEX["stribeck_friction"]
_STATIC = law.INDEX["static_friction"]
_ASYMMETRY = law.INDEX["friction_asymmetry"]
_BRISTLE = law.INDEX["bristle_length"]
_AGEING = law.INDEX["ageing_friction"]
_CRITICAL_SLIP = law.INDEX["critical_slip_distance"]
_STRESS_RELAXATION = law.INDEX["stress_relaxation"]
_GREASE = law.INDEX["grease_drag"]
_MAX_ROUNDS = 60


@compiled
def advance(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    u_proximal: float,
    u_distal: float,
    dt: float,
    new_state: FloatArray,
    work: FloatArray,
) -> int:
    """Run `step` with both ends driven by position [m]."""
    return step(
        prm, n, state, POSITION, u_proximal, POSITION, u_distal, dt, new_state, work
    )


@internal
def _stick_all(n: int, new_state: FloatArray) -> None:
    """Set the slip of every segment to zero: all have stuck."""
    at.slips(new_state, n)[:] = 0.0
    at.slip_speeds(new_state, n)[:] = 0.0


@internal
def _friction_holds(
    n: int,
    tension: FloatArray,
    hold_distal: FloatArray,
    hold_proximal: FloatArray,
    drag: FloatArray,
) -> bool:
    """Return whether friction holds the tensions of every segment."""
    for j in range(n):
        proximal, distal = max(tension[j], 0.0), max(tension[j + 1], 0.0)
        if (
            overcome_direction(
                proximal, distal, hold_distal[j], hold_proximal[j], drag[j]
            )
            != 0
        ):
            return False
    return True


@internal
def _update_viscosity(
    prm: FloatArray, n: int, node: FloatArray, dt: float, work: FloatArray
) -> bool:
    """Take the viscosity of grease at other slip speeds, for another round.

    Implicit in the slip of the step, so grease takes energy whatever dt, and after any
    round. The error is of first order in dt, as that of viscous friction (0.06 % RMS
    at 1 ms where the ends turn at once); rounds stop where all segments together are
    off the law by 1e-5 of the largest tension.

    Returns:
        Whether the speeds it was taken at were right already.
    """
    values = at.scalars(prm)
    shift, guess = at.row(work, n, _SHIFT), at.row(work, n, _SPEED)
    length, largest = at.contact_length(prm, n), 0.0
    for i in range(n + 1):
        largest = max(largest, node[i])
    error = 0.0
    for j in range(n):
        speed = abs(shift[j]) / dt
        taken = law.grease_viscosity(values, guess[j])
        right = law.grease_viscosity(values, speed)
        error += abs(right - taken) * speed * length[j]
        guess[j] = law.next_guess(values, guess[j], speed)
    return error <= nonlinear_elasticity.LINEARIZATION_TOLERANCE * largest


@internal
def _solve(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    tension: FloatArray,
    stiffness: FloatArray,
    proximal_p: float,
    proximal_q: float,
    distal_p: float,
    distal_q: float,
    node: FloatArray,
    work: FloatArray,
) -> None:
    """Solve the step with the coefficients in `work`, whatever slips and from where."""
    shift, slipped = at.row(work, n, _SHIFT), at.row(work, n, _SLIPPED)
    growth, growth_proximal = (
        at.row(work, n, _GROWTH),
        at.row(work, n, _GROWTH_PROXIMAL),
    )
    hold_distal, hold_proximal = (
        at.row(work, n, _HOLD_DISTAL),
        at.row(work, n, _HOLD_PROXIMAL),
    )
    drag, viscosity = at.row(work, n, _DRAG), at.row(work, n, _VISCOSITY)
    if prm[_BRISTLE] > 0.0:
        before_slip = at.slips(state, n)
        for j in range(n):
            slipped[j] = before_slip[j]
        held = at.row(work, n, _HELD)
        if preslide(
            n, tension, stiffness, growth, growth_proximal, hold_distal, hold_proximal,
            drag, viscosity, held, at.row(work, n, _SPRING),
            proximal_p, proximal_q, distal_p, distal_q, shift, node, slipped, work,
        ):  # fmt: skip
            return
    sweep(
        n, at.slips(state, n), tension, stiffness, growth, growth_proximal, hold_distal,
        hold_proximal, drag, viscosity, proximal_p, proximal_q, distal_p, distal_q,
        shift, node, work,
    )  # fmt: skip
    if prm[_BRISTLE] > 0.0:
        # No elastic part: bristles keep what they can without new energy.
        for j in range(n):
            slipped[j] = shift[j]
            most = abs(held[j])
            force = max(node[j + 1], 0.0) - max(node[j], 0.0)
            # Viscosity beyond all bounds can leave a node without a number.
            held[j] = min(max(force, -most), most) if np.isfinite(force) else 0.0


@internal
def _end_relation(
    kind: int, value: float, pulled: float, tension: float, stiffness: float
) -> tuple[float, float]:
    """Return p and q of T = p +- q w, an end's relation to the adjacent segment's slip.

    `pulled` is the outward motion of an end driven by position [m].
    """
    if kind == TENSION:
        return max(value, 0.0), 0.0
    return tension + stiffness * pulled, stiffness


@internal
def _constant_coefficients(
    prm: FloatArray, n: int, state: FloatArray, work: FloatArray
) -> None:
    """Write the coefficients of segments whose friction is constant."""
    growth, hold = at.constant_growth(prm, n), at.constant_hold(prm, n)
    constant_drag, slips = at.constant_drag(prm, n), at.slips(state, n)
    growth_distal, growth_proximal = (
        at.row(work, n, _GROWTH),
        at.row(work, n, _GROWTH_PROXIMAL),
    )
    hold_distal, hold_proximal = (
        at.row(work, n, _HOLD_DISTAL),
        at.row(work, n, _HOLD_PROXIMAL),
    )
    drag, viscosity = at.row(work, n, _DRAG), at.row(work, n, _VISCOSITY)
    for j in range(n):
        growth_distal[j] = growth_proximal[j] = growth[j]
        drag[j], viscosity[j] = constant_drag[j], 0.0
        # A segment that goes on slipping the same way has already broken away.
        hold_distal[j] = growth[j] if slips[j] > 0.0 else hold[j]
        hold_proximal[j] = growth[j] if slips[j] < 0.0 else hold[j]


@internal
def _coefficients(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    tension: FloatArray,
    dt: float,
    work: FloatArray,
) -> None:
    """Write the coefficients of every segment for this step, see `_friction.py`."""
    if prm[at.CONSTANT_COULOMB] != 0.0:
        _constant_coefficients(prm, n, state, work)
        return
    values = at.scalars(prm)
    is_state_dependent = prm[at.STATE_DEPENDENT] != 0.0
    asymmetry = values[_ASYMMETRY]
    guided, length = int(prm[at.GUIDED]), at.contact_length(prm, n)
    growth, growth_proximal = (
        at.row(work, n, _GROWTH),
        at.row(work, n, _GROWTH_PROXIMAL),
    )
    hold_distal, hold_proximal = (
        at.row(work, n, _HOLD_DISTAL),
        at.row(work, n, _HOLD_PROXIMAL),
    )
    drag, viscosity = at.row(work, n, _DRAG), at.row(work, n, _VISCOSITY)
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
            angle *= law.wrap_factor(
                values, state[at.TRAVEL], begin, reached, prm[at.LENGTH]
            )
        mean = 0.5 * (max(tension[j], 0.0) + max(tension[j + 1], 0.0))
        coefficient = law.kinetic_coefficient(values, abs(slip), speeds[j])
        holding = resting
        if is_state_dependent:
            factor = drift * law.load_factor(values, mean)
            extra = values[_AGEING] * ages[j]
            holding = factor * (holding + extra)
            # Without memory the first slip renews the contacts.
            extra = extra if values[_CRITICAL_SLIP] > 0.0 else 0.0
            coefficient = factor * (coefficient + extra)
        growth[j] = growth_proximal[j] = law.ratio(coefficient, angle)
        if is_state_dependent:
            distal_hold = proximal_hold = growth[j]
            if holding != coefficient:
                distal_hold = proximal_hold = law.ratio(holding, angle)
        drag[j] = law.drag(values, length[j], growth[j], j, guided)
        viscosity[j] = law.viscosity(
            values, length[j], growth[j], at.row(work, n, _SPEED)[j], dt
        )
        if asymmetry != 0.0:
            distal, proximal = 1.0 - asymmetry, 1.0 + asymmetry
            growth[j] = law.ratio(coefficient * distal, angle)
            growth_proximal[j] = law.ratio(coefficient * proximal, angle)
            distal_hold, proximal_hold = growth[j], growth_proximal[j]
            if holding != coefficient:
                distal_hold = law.ratio(holding * distal, angle)
                proximal_hold = law.ratio(holding * proximal, angle)
        if values[_BRISTLE] > 0.0:
            spring = law.bristle_stiffness(values, coefficient, angle, mean, drag[j])
            force = at.bristle_forces(state, n)[j]
            stretch = at.bristle_stretches(state, n)[j]
            at.row(work, n, _SPRING)[j] = spring
            at.row(work, n, _HELD)[j] = law.bristle_force(force, stretch, spring)
        # A segment that goes on slipping the same way has already broken away.
        hold_distal[j] = growth[j] if slip > 0.0 else distal_hold
        hold_proximal[j] = growth_proximal[j] if slip < 0.0 else proximal_hold


@internal
def _commit(
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
    shift = at.row(work, n, _SHIFT)
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
    lost = 0.0
    slipped, has_bristles = shift, prm[_BRISTLE] > 0.0
    if has_bristles:
        slipped = at.row(work, n, _SLIPPED)
        _commit_bristles(n, state, new_state, work)
    values = at.scalars(prm)
    remembers = prm[_STRIBECK] > 0.0 or prm[_GREASE] > 0.0
    ages = prm[_AGEING] > 0.0
    before_slip, slip = at.slips(state, n), at.slips(new_state, n)
    if prm[at.PATH_LENGTHENS] != 0.0:
        # While the path lengthens the cable slips, so friction was that of before.
        tension = at.tensions(state, n)
    low, low_before = max(node[0], 0.0), max(tension[0], 0.0)
    for j in range(n):
        moved = slipped[j]
        high, high_before = max(node[j + 1], 0.0), max(tension[j + 1], 0.0)
        force, before = high - low, high_before - low_before
        low, low_before = high, high_before
        # Mean friction over the slip; after a reversal slip begins at the new friction.
        mean = 0.5 * (force + before)
        taken = (mean if before * moved > 0.0 else force) * moved
        if taken != 0.0 and prm[at.PATH_LENGTHENS] != 0.0:
            taken *= moving_path.heating(prm, node[j], node[j + 1])
        if has_bristles:
            # What the elastic part of the motion takes and the bristles do not keep.
            taken += mean * (shift[j] - moved) + at.row(work, n, _RELEASED_ENERGY)[j]
        lost += max(taken, 0.0)
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
    if prm[at.CONSTANT_COULOMB] == 0.0:
        new_state[at.TIME] = state[at.TIME] + dt
        new_state[at.TRAVEL] = state[at.TRAVEL] + (new_state[1] - state[1])
        new_state[at.HEAT] = law.heat_after_step(
            at.scalars(prm), state[at.HEAT], lost, dt
        )
    new_state[2] += lost
    if prm[at.PATH_LENGTHENS] != 0.0:
        return
    new_state[3] = new_state[3] + (new_state[1] - state[1]) - (new_state[0] - state[0])


@internal
def _commit_bristles(
    n: int, state: FloatArray, new_state: FloatArray, work: FloatArray
) -> None:
    """Write force and stretch of the bristles, and the energy that they released."""
    shift, slipped = at.row(work, n, _SHIFT), at.row(work, n, _SLIPPED)
    held, spring = at.row(work, n, _HELD), at.row(work, n, _SPRING)
    forces, stretches = at.bristle_forces(state, n), at.bristle_stretches(state, n)
    new_forces = at.bristle_forces(new_state, n)
    new_stretches = at.bristle_stretches(new_state, n)
    for j in range(n):
        force, stretch, now = forces[j], stretches[j], 0.0
        start = law.bristle_force(force, stretch, spring[j])
        elastic = start + spring[j] * (shift[j] - slipped[j])
        if spring[j] > 0.0:
            now = min(max(held[j], -abs(elastic)), abs(elastic)) / spring[j]
        before = 0.5 * abs(force * stretch)
        at.row(work, n, _RELEASED_ENERGY)[j] = before - 0.5 * abs(held[j] * now)
        new_forces[j] = held[j]
        new_stretches[j] = now


@exported(
    INTEGER(REALS, INTEGER, REALS, INTEGER, REAL, INTEGER, REAL, REAL, REALS, REALS)
)
def step(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    proximal_kind: int,
    proximal_value: float,
    distal_kind: int,
    distal_value: float,
    dt: float,
    new_state: FloatArray,
    work: FloatArray,
) -> int:
    """Advance a cable by one time step.

    Args:
        prm: packed parameters, `_pack.pack`.
        n: number of segments.
        state: state before the step; not written.
        proximal_kind: POSITION or TENSION, what is prescribed at the proximal end.
        proximal_value: that displacement [m] or tension [N], >= 0.
        distal_kind: the same of the distal end; not both may be TENSION.
        distal_value: that displacement [m] or tension [N], >= 0.
        dt: time step [s]; matters only to rate-dependent terms.
        new_state: out, state after the step; must not overlap `state`.
        work: scratch, `work_size(n)`.

    Returns:
        OK or NOT_FINITE.
    """
    prm, state, new_state, work = (
        borrow(prm), borrow(state), borrow(new_state), borrow(work),
    )  # fmt: skip
    for i in range(at.state_size(n)):
        new_state[i] = state[i]
    # Until what changes the tensions before the ends move is done, they hold.
    yield_proximal, yield_distal = prm[at.YIELD_PROXIMAL], prm[at.YIELD_DISTAL]
    prepare.expect_yielding(prm, 0.0, 0.0)
    if not (np.isfinite(proximal_value) and np.isfinite(distal_value)):
        return NOT_FINITE
    is_constant_coulomb = prm[at.CONSTANT_COULOMB] != 0.0
    by_position = proximal_kind == POSITION and distal_kind == POSITION
    proximal_moved, distal_moved = proximal_value - state[0], distal_value - state[1]
    still = by_position and proximal_moved == 0.0 and distal_moved == 0.0
    changes, lengthens = prm[at.BENDS_CHANGE] != 0.0, prm[at.PATH_LENGTHENS] != 0.0
    if is_constant_coulomb and still and not changes:
        _stick_all(n, new_state)
        return OK
    growth, drag = at.constant_growth(prm, n), at.constant_drag(prm, n)
    hold_distal, hold_proximal = growth, growth
    tension = at.tensions(state, n)
    if prm[_STRESS_RELAXATION] > 0.0:
        tension = before.relax_stress(prm, n, state, dt, new_state, work)
    if lengthens:
        tension = before.stretch_by_path(
            prm, n, tension, proximal_moved, distal_moved, work
        )
    yielding = yield_proximal > 0.0 or yield_distal > 0.0
    if yielding:
        tension = before.add_end_springs(
            prm, n, state, tension, yield_proximal, yield_distal, new_state, work
        )
    node = at.tensions(new_state, n)
    shift = at.row(work, n, _SHIFT)
    greased = prm[_GREASE] > 0.0
    if greased:
        guess, speed = at.row(work, n, _SPEED), at.slip_speeds(state, n)
        for j in range(n):
            guess[j] = max(speed[j], law.MIN_GREASE_SPEED)
    is_curved = nodes.is_curved(prm)
    quick = is_constant_coulomb and by_position
    if quick and prm[_STATIC] > 0.0:
        _coefficients(prm, n, state, tension, dt, work)
        growth, drag = at.row(work, n, _GROWTH), at.row(work, n, _DRAG)
        hold_distal, hold_proximal = (
            at.row(work, n, _HOLD_DISTAL),
            at.row(work, n, _HOLD_PROXIMAL),
        )

    solved = False
    if quick and changes:
        # The fronts presume that friction holds the tensions before the step.
        quick = _friction_holds(n, tension, hold_distal, hold_proximal, drag)
        if quick and still and not lengthens:
            _stick_all(n, new_state)
            return OK
    if quick:
        stretch = new_state[3]
        if lengthens:
            stretch = 0.0
            for i in range(n + 1):
                stretch += nodes.node_stretch(prm, n, i, tension[i])
        stretch += distal_moved - proximal_moved
        dragged = prm[_LOAD_INDEPENDENT] + prm[_SEALS[0]] + prm[_SEALS[1]] > 0.0
        if is_curved:
            solved = stretch > 0.0 and nonlinear_elasticity.march_linearized(
                prm, n, tension, growth, hold_distal, hold_proximal, drag,
                proximal_moved, distal_moved, shift, node, work,
            )  # fmt: skip
        elif stretch <= 0.0 and not dragged:
            lay_evenly(
                0, n, tension, at.node_stiffness(prm, n), proximal_moved, True,
                distal_moved, True, shift,
            )  # fmt: skip
            node[:] = 0.0
            solved = True
        else:
            solved = march(
                n, tension, at.node_compliance(prm, n), at.half_compliance(prm, n),
                growth, hold_distal, hold_proximal, drag, proximal_moved, distal_moved,
                shift, node, work,
            )  # fmt: skip
        solved = solved and node[0] >= 0.0 and node[n] >= 0.0
    if not solved:
        stiffness = at.node_stiffness(prm, n)
        if is_curved:
            stiffness = nonlinear_elasticity.tangent_stiffness(prm, n, tension, work)
        for _ in range(_MAX_ROUNDS if is_curved or greased else 1):
            _coefficients(prm, n, state, tension, dt, work)
            proximal_p, proximal_q = _end_relation(
                proximal_kind, proximal_value, -proximal_moved, tension[0], stiffness[0]
            )
            distal_p, distal_q = _end_relation(
                distal_kind, distal_value, distal_moved, tension[n], stiffness[n]
            )
            _solve(
                prm, n, state, tension, stiffness,
                proximal_p, proximal_q, distal_p, distal_q, node, work,
            )  # fmt: skip
            settled = not greased or _update_viscosity(prm, n, node, dt, work)
            if is_curved and not nonlinear_elasticity.relinearize(
                prm, n, tension, proximal_kind == TENSION, proximal_moved,
                distal_kind == TENSION, distal_moved, shift, node, stiffness,
            ):  # fmt: skip
                settled = False
            if settled:
                break
    _commit(
        prm,
        n,
        state,
        tension,
        proximal_kind,
        proximal_value,
        distal_kind,
        distal_value,
        dt,
        new_state,
        work,
    )
    if yielding:
        before.remove_end_springs(
            prm, n, state, yield_proximal, yield_distal, new_state
        )
    if lengthens:
        new_state[2] += prm[at.CARRY_ENERGY]
        moving_path.apply_material_law(prm, n, at.tensions(state, n), node)
    return OK
