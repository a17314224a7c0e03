"""Compiled prediction of the motion of the cable ends in the coming step.

MuJoCo needs the force of a cable before it has computed the step. An end is a stiff
spring, and if the step is long for its stiffness, its force is the tension at

    x + alpha h v + beta h^2 a(T)

instead of at x, its displacement, with its velocity v and the acceleration a that
MuJoCo is about to find, which falls with the tension T itself: a step of Newmark's
method (J. Eng. Mech. Div. 85, 1959) in terms of displacements. The integrator then sees
a spring of the frequency w/sqrt(1 + beta (h w)^2) in the place of w. With

    beta = max(1/s - 1/(h w)^2, 0)

that is no more than sqrt(s)/h, which is stable. So an end is implicit by as much as
stability needs, and explicit if (h w)^2 is below s. For all integrators but RK4 s is
2.5 and

    alpha = 0.25 (s beta)^2,

which damps vibration that the step cannot resolve; they are stable below s (1 + 2
alpha) = 4. With s >= 2.4, beta is at most 1/6 where explicit ends are stable, so that
the frequency is off by (beta - 1/12) (h w)^2 / 2, no more than theirs. RK4 has damping
of its own, most at s of 6; for it s is 5.8 (stable up to 8) and alpha is 0, and each of
its four stages predicts from its own displacement, by the stiffness there. All springs
of a cable beyond its ends stay explicit, and so do the ends under `discrete`, whose
constraints are known only after the actuators.

`_predict_acceleration` solves for a as MuJoCo does: smooth forces, with those of the
cables as they were, and the constraints that are active at the acceleration of the step
before, or, tried again, at the one found with them; a friction cone that slips keeps
its force. It includes the dampers that the integrator takes implicitly: those of joints
and, under `implicit` and `implicitfast`, those of tendons and of actuators of affine
gain or bias.

A cable pulls and does not push. At an implicit end the tension that Newmark's method
gives is right while the cable stays taut. If slack runs out within a step, or returns,
it is not: an end that meets the cable with the speed v stretches it by up to h v, which
throws it back with up to 1.5 v. Such a step is one of the backward Euler method
instead: the end has the tension of the position after the step,

    T = F(x + h v + h^2 a(T)).

The cable then gives out no more energy than it stored. With m the mass that an end
moves, V the energy of the cable, F = dV/dx, which grows with x, and x' = x + h v',

    m (v'^2 - v^2) / 2 + V(x') - V(x) <= -(h T)^2 / (2 m).

So the end of a cable that snaps taut comes back with less than its own speed, and what
the step cannot resolve is lost.

Under RK4 each stage is evaluated first at its own displacements, which shows the
stiffness there, between that of a cable that slips and that of an end that friction
holds; this stiffness determines beta. If RK4 resolves the vibration on a cable that
slips, an end that becomes slack stays as it is, and one that becomes taut has the
tension of the middle of the rest of the step at the stage. A motor of 2e-3 kg m^2 on an
ankle of 1 kg m^2 that is thrown into slack, at 4 steps a period, then errs by 7 % of
the tension (`tests/plugin/test_implicit_ends.py`); with backward Euler in all stages by
16 %, with explicit ends by 6 %, which give out more energy.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable._newmark import NEWMARK, NEWMARK_RK4
from cc_mujoco.cable._pack import differ
from cc_mujoco.native import FloatArray, internal
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _evaluate as evaluating
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _path as path
from cc_mujoco.plugin._evaluate import evaluate, is_rk4
from cc_mujoco.plugin._ffi import MjData, MjModel, disabled
from cc_mujoco.plugin._instance_data import MAX_DOFS, Block

_UNKNOWN, _PLAIN, _CONSTRAINED, _DAMPED = 0, 1, 2, 3
"""Values of `known_step`, the way in which the acceleration of the step was found: not
yet; by MuJoCo's factor of the inertia; with constraints; with dampers, too."""


class _Prediction(NamedTuple):
    """Memory of a prediction; vectors are (nv,), matrices (nv * nv,)."""

    found: FloatArray  # predicted acceleration
    force: FloatArray  # sum of the smooth forces
    row: FloatArray  # scratch
    answer: FloatArray  # scratch
    between: FloatArray  # scratch
    inertia: FloatArray  # inertia matrix
    factor: FloatArray  # Cholesky factor of the inertia with constraints
    damped: FloatArray  # Cholesky factor of the inertia with dampers


@internal
def _prediction(lead: Block, nv: int) -> _Prediction:
    vector, square = lead + lead.prediction, nv * nv
    matrix = vector + 40 * nv
    return _Prediction(
        ffi.floats(vector, nv), ffi.floats(vector + 8 * nv, nv),
        ffi.floats(vector + 16 * nv, nv), ffi.floats(vector + 24 * nv, nv),
        ffi.floats(vector + 32 * nv, nv), ffi.floats(matrix, square),
        ffi.floats(matrix + 8 * square, square),
        ffi.floats(matrix + 16 * square, square),
    )  # fmt: skip


@internal
def is_implicit(model: MjModel, block: Block) -> bool:
    """Return whether the ends of a cable are implicit.

    They are if the time step is above half of what is stable for an end alone in the
    pose `qpos0`, so that poses of less inertia are stable too.
    """
    if (
        block.explicit_ends != 0
        or model.nv > MAX_DOFS
        or model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    ):
        return False
    step = model.opt.timestep
    rk4 = is_rk4(model)
    most = NEWMARK_RK4.implicit_limit if rk4 else NEWMARK.implicit_limit
    for end in range(2):
        if block.tied[end] != 0:
            continue
        actuator, mobility = block.actuators[end], 0.0
        target = model.actuator_trnid[actuator, 0]
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
            dof = model.jnt_dofadr[target]
            mobility = model.dof_invweight0[dof]
            armature = model.dof_armature[dof]
            if armature > 0.0:  # which MuJoCo leaves out for the slide of a body
                mobility = min(mobility, 1.0 / armature)
        else:
            mobility = model.tendon_invweight0[target]
        mobility *= attachments.pulley_radius(model, block.outputs[end]) ** 2
        if step * step * mobility * held_stiffness(block, end) > most:
            return True
    return False


@internal
def held_stiffness(block: Block, end: int) -> float:
    if block.stiffness[end] == 0.0:
        prm = blocks.parameters(block)
        block.stiffness[end] = kernel.end_stiffness(prm, block.segments, end == 1)
    return float(block.stiffness[end])


@internal
def slipping_stiffness(block: Block) -> float:
    """Return the stiffness seen at an end while the whole cable slips [N/m]."""
    # Each of two equal masses sees half of the cable, of twice the stiffness.
    stiffness = kernel.node_stiffness(blocks.parameters(block), block.segments)
    compliance = 0.0
    for i in range(stiffness.size):
        compliance += 1.0 / stiffness[i]
    return 2.0 / compliance


@internal
def newmark_terms(
    model: MjModel, stiffness: float, mobility: float
) -> tuple[float, float]:
    """Return alpha and beta, see the module, for an end of this stiffness [N/m].

    `mobility` is its acceleration per tension times the squared time step [m/N].
    """
    most, gain = NEWMARK.stability_limit, NEWMARK.velocity_gain
    if is_rk4(model):
        most, gain = NEWMARK_RK4.stability_limit, 0.0
    square = mobility * stiffness
    share = max(1.0 - most / square, 0.0) if square > 0.0 else 0.0
    return gain * share * share, share / most


@internal
def _predict_acceleration(
    model: MjModel, data: MjData, lead: Block, own: _Prediction
) -> None:
    """Predict the acceleration `found` of the step, with all tensions unchanged.

    Set `known_step` of `lead`, the block of the model's first cable, too. MuJoCo must
    have evaluated in `data` all that comes before actuator plugins, and the paths of
    all open cables must have been measured.
    """
    nv = model.nv
    found, scratch, inertia = own.found.ctypes.data, own.row, own.inertia
    damping, damped = own.damped, own.damped.ctypes.data
    _smooth_forces(model, data, model.plugin[lead.instance], own.force, scratch)
    dampers = _damping_matrix(model, data, damping, scratch)
    if data.nefc == 0 and not dampers:
        ffi.solve_inertia(model, data, found, own.force.ctypes.data, 1)
        lead.known_step = _PLAIN
        return
    ffi.full_inertia(model, data, inertia.ctypes.data)
    if dampers:
        step = model.opt.timestep
        for i in range(nv * nv):
            damping[i] = inertia[i] + step * damping[i]
    _solve_constrained(model, data, own)
    lead.known_step = _CONSTRAINED
    if not dampers:
        return
    ffi.multiply_inertia(model, data, scratch.ctypes.data, found)
    ffi.factorise(damped, nv, 0.0)
    ffi.solve_factorised(found, damped, scratch.ctypes.data, nv)
    lead.known_step = _DAMPED


@internal
def _smooth_forces(
    model: MjModel, data: MjData, kind: int, force: FloatArray, acted: FloatArray
) -> None:
    """Write the sum of all forces but those of constraints to `force` (nv,).

    `kind` is the number of the cable plugin; cables pull with the tensions of their
    states. `acted` (nv,) is scratch.
    """
    nv, sum_at = model.nv, force.ctypes.data
    force[:] = data.qfrc_passive[:nv]
    ffi.add(force, data.qfrc_bias[:nv], -1.0)
    ffi.add(force, data.qfrc_applied[:nv], 1.0)
    for body in range(1, model.nbody):
        given = data.xfrc_applied[body]
        if not ffi.is_zero(given):
            at, point = given.ctypes.data, data.xipos.ctypes.data + 24 * body
            ffi.apply_wrench(model, data, at, at + 24, point, body, sum_at)
    acted[:] = 0.0
    for actuator in range(model.nactuator):
        plugin = model.actuator_plugin[actuator]
        if plugin >= 0 and model.plugin[plugin] == kind:
            continue
        first = model.actuator_outadr[actuator]
        share = _tendon_share(model, data, actuator)
        for output in range(first, first + model.actuator_outnum[actuator]):
            given_force = _limited_force(model, data, actuator, output)
            add_moment(data, output, share * given_force, acted)
    for instance in range(model.nplugin):
        block = evaluating.packed_block_of(model, data, instance, kind)
        if block == 0:
            continue
        begin, n = evaluating.origin(block, model, data, instance)[0], block.segments
        node = layout.tensions(blocks.kernel_state(begin, n), n)
        if block.tied[0] == 0:
            lever = blocks.winding(model, data, block)[1]
            add_moment(data, block.outputs[0], max(node[0], 0.0) * lever, acted)
        if block.tied[1] == 0:
            add_moment(data, block.outputs[1], -max(node[n], 0.0), acted)
        if blocks.is_open(block):
            if block.passive_fresh == 0:
                ffi.add(force, ffi.floats(block + block.pulls, nv), -1.0)
            led = blocks.path_of(block, 0)
            path.apply_pulls(model, data, led, node, 0.0, -1, sum_at)
    for joint in range(model.njnt):
        dof = model.jnt_dofadr[joint]
        if model.jnt_type[joint] < mujoco.mjtJoint.mjJNT_SLIDE:
            continue
        if model.jnt_actgravcomp[joint] != 0:
            acted[dof] += data.qfrc_gravcomp[dof]
        if model.jnt_actfrclimited[joint] != 0:
            low, high = model.jnt_actfrcrange[joint, 0], model.jnt_actfrcrange[joint, 1]
            acted[dof] = min(max(acted[dof], low), high)
    ffi.add(force, acted, 1.0)


@internal
def _limited_force(model: MjModel, data: MjData, actuator: int, output: int) -> float:
    force = data.actuator_force[output]
    if model.actuator_forcelimited[actuator] != 0:
        low = model.actuator_forcerange[actuator, 0]
        high = model.actuator_forcerange[actuator, 1]
        force = min(max(force, low), high)
    return float(force)


@internal
def _is_clamped(model: MjModel, data: MjData, actuator: int) -> bool:
    """Return whether a range limits an actuator's force now; it then does not damp."""
    if model.actuator_forcelimited[actuator] != 0:
        force = data.actuator_force[model.actuator_outadr[actuator]]
        low = model.actuator_forcerange[actuator, 0]
        high = model.actuator_forcerange[actuator, 1]
        if force <= low or force >= high:
            return True
    return _tendon_share(model, data, actuator) != 1.0


@internal
def _tendon_share(model: MjModel, data: MjData, actuator: int) -> float:
    """Return the factor by which a tendon's range reduces an actuator's force.

    MuJoCo scales the forces of all actuators of a tendon so that their sum is within
    its `actuatorfrcrange`.
    """
    tendon = attachments.holding_tendon(model, actuator)
    if tendon < 0 or model.tendon_actfrclimited[tendon] == 0:
        return 1.0
    total = 0.0
    for other in range(model.nactuator):
        if attachments.holding_tendon(model, other) == tendon:
            output = model.actuator_outadr[other]
            total += _limited_force(model, data, other, output)
    low = model.tendon_actfrcrange[tendon, 0]
    high = model.tendon_actfrcrange[tendon, 1]
    allowed = min(max(total, low), high)
    return allowed / total if allowed != total else 1.0


@internal
def add_moment(data: MjData, output: int, force: float, target: FloatArray) -> None:
    if force == 0.0:
        return
    start = data.moment_rowadr[output]
    for i in range(start, start + data.moment_rownnz[output]):
        target[data.moment_colind[i]] += force * data.actuator_moment[i]


@internal
def _damping_matrix(
    model: MjModel, data: MjData, out: FloatArray, scratch: FloatArray
) -> bool:
    """Write the implicitly integrated damping to `out` (nv * nv,); return if not 0."""
    nv, any_damping = model.nv, False
    out[:] = 0.0
    if is_rk4(model):
        return False
    euler = model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    undamped = disabled(model, mujoco.mjtDisableBit.mjDSBL_DAMPER)
    if not undamped and not (
        euler and disabled(model, mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    ):
        for i in range(nv):
            out[i * nv + i] = model.dof_damping[i]
            any_damping = any_damping or out[i * nv + i] != 0.0
    if euler:
        return any_damping
    for actuator in range(model.nactuator):
        if model.actuator_plugin[actuator] >= 0:
            continue
        rate = 0.0
        if model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE:
            rate -= model.actuator_biasprm[actuator, 2]
        if model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_AFFINE:
            control = data.ctrl[model.actuator_ctrladr[actuator]]
            rate -= model.actuator_gainprm[actuator, 2] * control
        if rate > 0.0 and not _is_clamped(model, data, actuator):
            scratch[:] = 0.0
            add_moment(data, model.actuator_outadr[actuator], 1.0, scratch)
            _add_square(rate, scratch, out)
            any_damping = True
    for tendon in range(model.ntendon):
        rate = model.tendon_damping[tendon]
        if rate > 0.0 and not undamped:
            scratch[:] = 0.0
            start = model.ten_J_rowadr[tendon]
            for i in range(start, start + model.ten_J_rownnz[tendon]):
                scratch[model.ten_J_colind[i]] = data.ten_J[i]
            _add_square(rate, scratch, out)
            any_damping = True
    return any_damping


@internal
def _add_square(rate: float, row: FloatArray, out: FloatArray) -> None:
    """Add `rate` row row^T, for a row (nv,), to the matrix `out` (nv * nv,)."""
    nv = row.size
    for i in range(nv):
        for j in range(nv if row[i] != 0.0 else 0):
            out[i * nv + j] += rate * row[i] * row[j]


@internal
def _constraint_row(model: MjModel, data: MjData, i: int) -> tuple[int, int]:
    """Return the begin and the end of row i of the constraint Jacobian in `efc_J`."""
    if ffi.is_sparse(model) == 0:
        return model.nv * i, model.nv * (i + 1)
    start = data.efc_J_rowadr[i]
    return start, start + data.efc_J_rownnz[i]


@internal
def _solve_constrained(model: MjModel, data: MjData, own: _Prediction) -> None:
    """Solve for the acceleration `found` of `own` under smooth forces and constraints.

    The active constraints are found in up to three trials. `factor` of `own` becomes
    the Cholesky factor of the inertia with their stiffness.
    """
    nv, count, found, factor = model.nv, data.nefc, own.found, own.factor
    right, sparse = own.row, ffi.is_sparse(model) != 0
    found[:] = data.qacc_warmstart[:nv]
    ffi.mark_stack(data)
    state, before = ffi.borrow_floats(data, count), ffi.borrow_floats(data, count)
    given, push = ffi.borrow_floats(data, count), ffi.borrow_floats(data, count)
    for trial in range(3):
        for i in range(count):
            start, end = _constraint_row(model, data, i)
            off = -data.efc_aref[i]
            for k in range(start, end):
                a = data.efc_J_colind[k] if sparse else k - start
                off += data.efc_J[k] * found[a]
            given[i] = -data.efc_D[i] * off
            push[i] = _constraint_force(data, i, given, state)
        if trial > 0 and not differ(state, before, count):
            break
        before[:] = state
        factor[:] = own.inertia
        right[:] = own.force
        for i in range(count):
            start, end = _constraint_row(model, data, i)
            stiff = data.efc_D[i] if state[i] != 0.0 else 0.0
            pushed = stiff * data.efc_aref[i] + push[i]
            if stiff == 0.0 and push[i] == 0.0:
                continue
            for k in range(start, end):
                a = data.efc_J_colind[k] if sparse else k - start
                value = data.efc_J[k]
                right[a] += value * pushed
                for m in range(start, end if stiff != 0.0 and value != 0.0 else start):
                    b = data.efc_J_colind[m] if sparse else m - start
                    factor[a * nv + b] += stiff * value * data.efc_J[m]
        ffi.factorise(factor.ctypes.data, nv, 0.0)
        ffi.solve_factorised(
            found.ctypes.data, factor.ctypes.data, right.ctypes.data, nv
        )
    ffi.free_stack(data)


@internal
def _constraint_force(
    data: MjData, i: int, given: FloatArray, state: FloatArray
) -> float:
    """Set `state[i]` to 1 if constraint i acts as a spring, or else to 0.

    Return its constant force if it is no spring, such as that of dry friction that
    slips. `given` has the forces of constraints up to i if all acted as springs.
    """
    force, kind = given[i], data.efc_type[i]
    state[i] = 1.0
    if kind == mujoco.mjtConstraint.mjCNSTR_EQUALITY:
        return 0.0
    if (
        kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
        or kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON
    ):
        most = data.efc_frictionloss[i]
        if abs(force) < most:
            return 0.0
        state[i] = 0.0
        return math.copysign(most, force)
    if kind == mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC:
        contact = data.contact[data.efc_id[i]]
        first = contact.efc_address
        if i > first:
            most = contact.friction[i - first - 1]
            normal = max(given[first], 0.0)
            if abs(force) > most * normal:
                state[i] = 0.0
                return math.copysign(most * normal, force)
            return 0.0
    if force <= 0.0:
        state[i] = 0.0
    return 0.0


@internal
def predict_ends(
    model: MjModel, data: MjData, block: Block, lead: Block, out: FloatArray
) -> None:
    """Predict the motion of the ends of a cable in the step, `out` (9,).

    Pairs for the proximal and the distal end: displacement x [m], h v [m], h^2 a [m]
    with unchanged tensions, and the decrease of h^2 a per tension, all ends on the same
    bodies included [m/N]; last 1, as ends yield to their tension. `lead` is the block
    of the model's first cable.
    """
    own = _prediction(lead, model.nv)
    if lead.known_step == _UNKNOWN:
        evaluating.follow_paths(model, data, block.instance, lead.evaluation_count)
        _predict_acceleration(model, data, lead, own)
    _predict_ends(model, data, block, lead.known_step, own, out)
    out[8] = 1.0


@internal
def predict_known_motion(
    model: MjModel, data: MjData, block: Block, out: FloatArray
) -> None:
    """Compute the `out` (9,) of `predict_ends` by the acceleration in `data`.

    The last number is 0, as this acceleration does not depend on the tensions.
    """
    ffi.mark_stack(data)
    row, none = ffi.borrow_floats(data, model.nv), ffi.borrow_floats(data, 0)
    answer, found = ffi.borrow_floats(data, model.nv), data.qacc[: model.nv]
    own = _Prediction(found, none, row, answer, none, none, none, none)
    _predict_ends(model, data, block, _PLAIN, own, out)
    out[8] = 0.0
    ffi.free_stack(data)


@internal
def _predict_ends(
    model: MjModel, data: MjData, block: Block, known: int, own: _Prediction,
    out: FloatArray,
) -> None:  # fmt: skip
    nv, step = model.nv, model.opt.timestep
    row, answer, between = own.row, own.answer, own.between
    right, solved = row.ctypes.data, answer.ctypes.data
    for end in range(2):
        out[end], lever = _end_position(model, data, block, end)
        out[2 + end] = out[4 + end] = out[6 + end] = 0.0
        if block.tied[end] != 0:
            continue
        row[:] = 0.0
        add_moment(data, block.outputs[end], lever, row)
        if known == _PLAIN:
            ffi.solve_inertia(model, data, solved, right, 1)
        else:
            ffi.solve_factorised(solved, own.factor.ctypes.data, right, nv)
        if known == _DAMPED:
            ffi.multiply_inertia(model, data, between.ctypes.data, solved)
            ffi.solve_factorised(
                solved, own.damped.ctypes.data, between.ctypes.data, nv
            )
        speed = data.actuator_velocity[block.outputs[end]]
        out[2 + end] = step * lever * speed
        out[4 + end] = step * step * ffi.dot(row, own.found)
        out[6 + end] = step * step * _mobility(model, data, block.instance, answer)


@internal
def _mobility(model: MjModel, data: MjData, own: int, answer: FloatArray) -> float:
    """Return the sum over all ends of their acceleration per tension [1/kg].

    `answer` (nv,) is the acceleration by a unit tension at an end of instance `own`.
    """
    total = 0.0
    for other in range(model.nplugin):
        if model.plugin[other] != model.plugin[own]:
            continue
        block = blocks.block_of(model, data, other)
        for end in range(2 if block != 0 else 0):
            if block.tied[end] == 0:
                arm, moved = _end_position(model, data, block, end)[1], 0.0
                output = block.outputs[end]
                start = data.moment_rowadr[output]
                for i in range(start, start + data.moment_rownnz[output]):
                    moved += data.actuator_moment[i] * answer[data.moment_colind[i]]
                total += abs(arm * moved)
    return total


@internal
def _end_position(
    model: MjModel, data: MjData, block: Block, end: int
) -> tuple[float, float]:
    if end == 0:
        return blocks.winding(model, data, block)
    return blocks.displacement(data, block, 1), 1.0


@internal
def evaluate_prediction(
    model: MjModel, block: Block, state: int, aim: FloatArray, dt: float
) -> bool:
    """Evaluate a cable with implicit ends from the committed state at address `state`.

    `aim` is the result of `predict_ends` (9,), `dt` the time since that state [s]. The
    parameters must be up to date. Return whether the new state is finite.
    """
    n, tried, none = block.segments, is_rk4(model), (0.0, 0.0)
    old = blocks.kernel_state(state, n)
    new = blocks.kernel_state(block + block.new_state, n)
    node_before, node = layout.tensions(old, n), layout.tensions(new, n)
    used, left, resolved = np.empty(4), np.empty(2), np.zeros(2)
    left[:] = 1.0
    if tried and not evaluate(block, state, (aim[0], aim[1]), none, dt):
        return False
    for end in range(2):
        stiffness = held_stiffness(block, end)
        if tried:
            soft = min(slipping_stiffness(block), stiffness)
            if newmark_terms(model, soft, aim[6 + end])[1] == 0.0:
                # Rest of the step at a later stage that begins from the first one.
                if state == block + block.first_stage:
                    left[end] = max(1.0 - dt / model.opt.timestep, 0.0)
                # Of 8 at the limit of stability; RK4 resolves its vibration well.
                resolved[end] = 1.0 if soft * aim[6 + end] < 5.0 else 0.0
            # Met on the way: between that of a slipping cable and of the held end.
            gained = abs(max(node[n * end], 0.0) - max(node_before[n * end], 0.0))
            moved = abs(new[end] - old[end])
            if not gained >= stiffness * moved:
                stiffness = max(gained / moved, soft)
        alpha, beta = newmark_terms(model, stiffness, aim[6 + end])
        used[end] = aim[end] + alpha * aim[2 + end] + beta * aim[4 + end]
        used[2 + end] = aim[8] * beta * aim[6 + end]
    if not evaluate(block, state, (used[0], used[1]), (used[2], used[3]), dt):
        return False
    ahead, passes, doubt = np.empty(2), np.zeros(2), np.zeros(2)
    for end in range(2):
        share = left[end]
        ahead[end] = aim[end] + share * (aim[2 + end] + share * aim[4 + end])
        if block.tied[end] != 0 or left[end] == 0.0:
            continue
        before, now = node_before[n * end], node[n * end]
        # Tension draws the proximal end towards distal, the distal end to proximal.
        sense = 1.0 if end == 0 else -1.0
        gained = max(now, 0.0) - max(before, 0.0)
        ahead[end] += sense * aim[8] * share * share * aim[6 + end] * gained
        relaxes = sense * (ahead[end] - new[end])
        if now <= 0.0:
            doubt[end] = 1.0 if before <= 0.0 and relaxes < 0.0 else 0.0
        elif before <= 0.0:
            passes[end] = 1.0
        elif resolved[end] == 0.0:
            outermost = kernel.node_stiffness(blocks.parameters(block), n)[n * end]
            doubt[end] = -1.0 if relaxes * outermost > now else 0.0
    doubtful = doubt[0] != 0.0 or doubt[1] != 0.0
    if not doubtful and passes[0] == 0.0 and passes[1] == 0.0:
        return True
    if doubtful:
        # The end of the step shows whether the end becomes taut (1) or slack (-1).
        if not evaluate(block, state, (ahead[0], ahead[1]), none, dt):
            return False
        for end in range(2):
            if doubt[end] != 0.0:
                taut = node[n * end] > 0.0
                passes[end] = 1.0 if taut == (doubt[end] > 0.0) else 0.0
    for end in range(2):
        if passes[end] != 0.0:
            share = left[end] if resolved[end] == 0.0 else 0.5 * left[end]
            used[end] = aim[end] + share * (aim[2 + end] + share * aim[4 + end])
            used[2 + end] = aim[8] * share * share * aim[6 + end]
    return evaluate(block, state, (used[0], used[1]), (used[2], used[3]), dt)
