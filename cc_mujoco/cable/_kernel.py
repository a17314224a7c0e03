"""One time step of one cable, compiled, without allocation.

    n = cable.segments
    pack(values, sections, n, prm)                    # once
    initialize(prm, n, u_proximal, u_distal, state)   # rest, uniform pretension
    advance(prm, n, state, u_proximal, u_distal, dt, new_state, work)

Guarantees: tensions are >= 0 and finite for finite input, friction never feeds energy
in, a term that is off changes no bit, and `advance` reads `state` and writes
`new_state` only. Calls from Python release its lock.

The layout of `prm` and `state` is defined in `_layout.py`.

Node 0 is the proximal end, node n the distal end. Node i carries the strain of the
cable between the centres of the adjacent segments, so that the sum of T_i h_i / EA is
the stretch of the cable at all times.
"""

import numpy as np

from cc_mujoco.cable import _coefficients as coefficients
from cc_mujoco.cable import _drum as drum
from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable import _nonlinear_elasticity as nonlinear_elasticity
from cc_mujoco.cable import _pack as prepare
from cc_mujoco.cable import _pre_step as before
from cc_mujoco.cable._chain_solve import Chain, lay_evenly
from cc_mujoco.cable._coefficients import POSITION as POSITION
from cc_mujoco.cable._coefficients import TENSION as TENSION
from cc_mujoco.cable._coefficients import written_size as written_size
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._fronts import CoulombChain, march, repeat_slip
from cc_mujoco.cable._graph import sweep
from cc_mujoco.cable._layout import STATE_HEADER as STATE_HEADER
from cc_mujoco.cable._layout import Step
from cc_mujoco.cable._layout import node_stiffness as node_stiffness
from cc_mujoco.cable._layout import parameter_size as parameter_size
from cc_mujoco.cable._layout import segment_angles as segment_angles
from cc_mujoco.cable._layout import state_size as state_size
from cc_mujoco.cable._layout import work_size as work_size
from cc_mujoco.cable._nodes import end_stiffness as end_stiffness
from cc_mujoco.cable._nodes import slack_length as slack_length
from cc_mujoco.cable._nodes import total_stretch as total_stretch
from cc_mujoco.cable._pack import expect_change as expect_change
from cc_mujoco.cable._pack import expect_lengthening as expect_lengthening
from cc_mujoco.cable._pack import expect_yielding as expect_yielding
from cc_mujoco.cable._pack import initialize as initialize
from cc_mujoco.cable._pack import pack as pack
from cc_mujoco.cable._pack import pack_mesh as pack_mesh
from cc_mujoco.cable._pack import rebend as rebend
from cc_mujoco.cable._presliding import preslide
from cc_mujoco.native import FloatArray, compiled, internal

OK, NOT_FINITE, MARCHED, UNSOLVED = 0, 1, 2, 3
"""Status of a step; on NOT_FINITE the new state is the old one.

`begin_step` returns MARCHED where only `finish_step` is left, UNSOLVED where
`solve_step` comes before it, and the final status elsewhere.
"""


@compiled
def advance(
    prm: FloatArray, n: int, state: FloatArray, u_proximal: float, u_distal: float,
    dt: float, new_state: FloatArray, work: FloatArray,
) -> int:  # fmt: skip
    """Advance by one `step` with both ends driven by position [m]."""
    return step(
        prm, n, state, POSITION, u_proximal, POSITION, u_distal, dt, new_state, work
    )


@compiled
def stored_energy(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Return the elastic energy of the cable and of its bristles [J].

    With drums it includes the rope on them, less the energy as mounted.
    """
    total = nodes.elastic_energy(prm, n, state)
    if prm[PLACE.bristle_length] > 0.0:
        force, stretched = at.bristle_forces(state, n), at.bristle_stretches(state, n)
        for j in range(n):
            total += 0.5 * abs(force[j] * stretched[j])
    if prm[at.PATH_LENGTHENS] != 0.0:
        total += drum.wound_energy(prm, n, state, 0)
        total += drum.wound_energy(prm, n, state, 1)
    return total


@internal
def _stick_all(n: int, new_state: FloatArray) -> None:
    at.slips(new_state, n)[:] = 0.0
    at.slip_speeds(new_state, n)[:] = 0.0


@internal
def _solve(prm: FloatArray, n: int, step: Step, chain: Chain, node: FloatArray) -> None:
    """Solve a step from any state, for the coefficients in rows of `step`."""
    work, slips = step.work, at.slips(step.state, n)
    shift, slipped = at.row(work, n, at.SHIFT), at.row(work, n, at.SLIPPED)
    if prm[PLACE.bristle_length] > 0.0:
        slipped[:] = slips
        if preslide(n, chain, step):
            return
    growth = at.row(work, n, at.GROWTH)
    growth_proximal = at.row(work, n, at.GROWTH_PROXIMAL)
    sweep(n, slips, chain, growth, growth_proximal, shift, node, work)
    if prm[PLACE.bristle_length] > 0.0:
        held = at.row(work, n, at.HELD)
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
    """Return p [N] and q [N/m] of an end's condition T = p +- q w, see `Chain`.

    `kind` is POSITION or TENSION, and then `value` the tension [N]. `pulled` is the
    outward motion of an end driven by position [m].
    """
    if kind == TENSION:
        return max(value, 0.0), 0.0
    return tension + stiffness * pulled, stiffness


@internal
def _tension_to_move(prm: FloatArray, n: int, step: Step) -> FloatArray:
    """Return the node tensions [N] from which the ends move, see `_pre_step.py`."""
    tension = at.tensions(step.state, n)
    if (
        before.loses_stretch(prm)
        or before.seats_anew(prm)
        or prm[at.PATH_LENGTHENS] != 0.0
        or prm[at.YIELD_PROXIMAL] > 0.0
        or prm[at.YIELD_DISTAL] > 0.0
    ):
        tension = at.node_row(step.work, n, before.TENSION_ROW)
    return tension


@internal
def step_of(
    state: FloatArray, new_state: FloatArray, work: FloatArray, dt: float,
    proximal: float, distal: float,
) -> Step:  # fmt: skip
    """Return a `Step` of these values, for kernels of Warp."""
    return Step(state, new_state, work, dt, proximal, distal)


@internal
def begin_step(
    prm: FloatArray, n: int, proximal_kind: int, distal_kind: int, step: Step
) -> int:
    """Change tensions by `_pre_step.py`, then try the fronts; return the status."""
    state, new_state, work = step.state, step.new_state, step.work
    whole = new_state[: at.state_size(n)]
    whole[:] = state[: at.state_size(n)]
    # The ends do not yield while other changes come before their motion.
    yield_proximal, yield_distal = prm[at.YIELD_PROXIMAL], prm[at.YIELD_DISTAL]
    prepare.expect_yielding(prm, 0.0, 0.0)
    nodes.recall_springs(prm, state)
    if not (np.isfinite(step.proximal) and np.isfinite(step.distal)):
        return NOT_FINITE
    is_constant_coulomb = prm[at.CONSTANT_COULOMB] != 0.0
    by_position = proximal_kind == POSITION and distal_kind == POSITION
    proximal_moved, distal_moved = step.proximal - state[0], step.distal - state[1]
    still = by_position and proximal_moved == 0.0 and distal_moved == 0.0
    changes, lengthens = prm[at.BENDS_CHANGE] != 0.0, prm[at.PATH_LENGTHENS] != 0.0
    if is_constant_coulomb and still and not changes:
        _stick_all(n, new_state)
        return OK
    tension = at.tensions(state, n)
    if before.loses_stretch(prm) or before.seats_anew(prm):
        tension, lost = before.begin_losses(n, step)
        if before.seats_anew(prm):
            before.seat_anew(prm, n, state, tension)
        if prm[PLACE.stress_relaxation] > 0.0:
            before.relax_stress(prm, n, step, tension, lost)
        if before.clamps_slide(prm):
            before.slide_in_clamps(prm, n, step, tension, lost)
    if lengthens:
        tension = before.stretch_by_path(prm, n, step, tension)
    yielding = yield_proximal > 0.0 or yield_distal > 0.0
    if yielding and lengthens:
        # The springs are of unstretched rope, as the nodes.
        yield_proximal /= drum.passing_ratio(prm, n, state, 0, proximal_moved)
        yield_distal /= drum.passing_ratio(prm, n, state, 1, -distal_moved)
    if yielding:
        tension = before.add_end_springs(
            prm, n, step, tension, yield_proximal, yield_distal
        )
    quick = is_constant_coulomb and by_position
    chain = CoulombChain(
        tension, at.node_compliance(prm, n), at.half_compliance(prm, n),
        at.constant_growth(prm, n), at.constant_hold(prm, n), at.slips(state, n),
        at.constant_drag(prm, n),
    )  # fmt: skip
    if quick and changes:
        # The fronts presume that friction holds the tensions before the step.
        quick = coefficients.friction_holds(n, chain)
        follows = lengthens or yielding or before.seats_anew(prm)
        if quick and still and not follows:
            _stick_all(n, new_state)
            return OK
    node, shift = at.tensions(new_state, n), at.row(work, n, at.SHIFT)
    if not quick:
        again = is_constant_coulomb and by_position and not nodes.is_curved(prm)
        if again and repeat_slip(
            n, chain, proximal_moved, distal_moved, shift, node, work
        ):
            return MARCHED
        return UNSOLVED
    stretch = new_state[3]
    if lengthens:
        stretch = 0.0
        for i in range(n + 1):
            stretch += nodes.node_stretch(prm, n, i, tension[i])
    stretch += distal_moved - proximal_moved
    free = prm[PLACE.load_independent_friction] + prm[PLACE.seal_proximal]
    dragged = free + prm[PLACE.seal_distal] > 0.0  # by friction that needs no tension
    if nodes.is_curved(prm):
        solved = stretch > 0.0
        solved = solved and nonlinear_elasticity.march_linearized(prm, n, step, chain)
    elif stretch <= 0.0 and not dragged:
        lay_evenly(
            0, n, tension, at.node_stiffness(prm, n), proximal_moved, True,
            distal_moved, True, shift,
        )  # fmt: skip
        node[:] = 0.0
        solved = True
    else:
        solved = march(n, chain, proximal_moved, distal_moved, shift, node, work)
    return MARCHED if solved and node[0] >= 0.0 and node[n] >= 0.0 else UNSOLVED


@internal
def solve_step(
    prm: FloatArray, n: int, proximal_kind: int, distal_kind: int, step: Step
) -> None:
    """Solve a step for which `begin_step` returned UNSOLVED; second part of `step`."""
    state, work = step.state, step.work
    tension, node = _tension_to_move(prm, n, step), at.tensions(step.new_state, n)
    proximal_moved, distal_moved = step.proximal - state[0], step.distal - state[1]
    greased, is_curved = prm[PLACE.grease_drag] > 0.0, nodes.is_curved(prm)
    if greased:
        guess, speed = at.row(work, n, at.SPEED), at.slip_speeds(state, n)
        for j in range(n):
            guess[j] = max(speed[j], law.MIN_GREASE_SPEED)
    stiffness = at.node_stiffness(prm, n)
    if is_curved:
        stiffness = nonlinear_elasticity.tangent_stiffness(prm, n, tension, work)
    for _ in range(60 if is_curved or greased else 1):
        coefficients.write_coefficients(prm, n, step, tension)
        proximal_p, proximal_q = _end_relation(
            proximal_kind, step.proximal, -proximal_moved, tension[0], stiffness[0]
        )
        distal_p, distal_q = _end_relation(
            distal_kind, step.distal, distal_moved, tension[n], stiffness[n]
        )
        chain = Chain(
            tension, stiffness, at.row(work, n, at.HOLD_DISTAL),
            at.row(work, n, at.HOLD_PROXIMAL), at.row(work, n, at.DRAG),
            at.row(work, n, at.VISCOSITY), proximal_p, proximal_q, distal_p, distal_q,
        )  # fmt: skip
        _solve(prm, n, step, chain, node)
        settled = not greased or coefficients.update_viscosity(prm, n, step, node)
        if is_curved and not nonlinear_elasticity.relinearize(
            prm, n, step, tension, proximal_kind == TENSION, distal_kind == TENSION
        ):
            settled = False
        if settled:
            break


@internal
def finish_step(
    prm: FloatArray, n: int, proximal_kind: int, distal_kind: int, step: Step
) -> None:
    """Complete the new state from the solution of a step; last part of `step`."""
    state, new_state = step.state, step.new_state
    yield_proximal, yield_distal = prm[at.YIELD_PROXIMAL], prm[at.YIELD_DISTAL]
    tension = _tension_to_move(prm, n, step)
    coefficients.commit(prm, n, tension, proximal_kind, distal_kind, step)
    if before.loses_stretch(prm):
        new_state[2] += before.heat_of_losses(prm, n, step)
    if yield_proximal > 0.0 or yield_distal > 0.0:
        before.remove_end_springs(prm, n, step, yield_proximal, yield_distal)
    if prm[at.PATH_LENGTHENS] != 0.0:
        old, new = at.tensions(state, n), at.tensions(new_state, n)
        moving_path.apply_material_law(prm, n, old, new)
        for end in range(2):
            sense, value = 1.0, step.proximal
            if end == 1:
                sense, value = -1.0, step.distal
            ratio = drum.passing_ratio(prm, n, state, end, sense * (value - state[end]))
            new_state[end] = value + ratio * (new_state[end] - value)
            paid = sense * (new_state[end] - state[end])
            new_state[2] += drum.turn(prm, n, state, new_state, end, paid, ratio)
    if nodes.is_curved(prm):
        new_state[2] += nodes.slide_springs(prm, n, new_state)


@compiled
def step(
    prm: FloatArray, n: int, state: FloatArray, proximal_kind: int,
    proximal_value: float, distal_kind: int, distal_value: float, dt: float,
    new_state: FloatArray, work: FloatArray,
) -> int:  # fmt: skip
    """Advance a cable by one time step; return OK or NOT_FINITE.

    `prm` are its packed parameters and `state` is that before the step, which is not
    written. A kind says what is prescribed at an end, POSITION [m] or TENSION [N] >= 0,
    not both TENSION. `dt` [s] matters only to rate-dependent terms. The result is
    `new_state`, which must not overlap `state`. `work` holds `work_size(n)`.
    """
    own = Step(state, new_state, work, dt, proximal_value, distal_value)
    status = begin_step(prm, n, proximal_kind, distal_kind, own)
    if status == OK or status == NOT_FINITE:
        return status
    if status == UNSOLVED:
        solve_step(prm, n, proximal_kind, distal_kind, own)
    finish_step(prm, n, proximal_kind, distal_kind, own)
    return OK
