"""Compiled prediction of the motion of the cable ends in the coming step.

The force of a cable is due before MuJoCo knows where the step leads. An end is a stiff
spring, and where the step is long for it, it takes the tension at

    x + alpha h v + beta h^2 a(T)

instead of at x, its displacement, with its velocity v and the acceleration a that
MuJoCo is about to find, which falls with the tension T itself: a step of Newmark's
method (J. Eng. Mech. Div. 85, 1959) in terms of displacements. The integrator then sees
a spring of the frequency w/sqrt(1 + beta (h w)^2) in the place of w. With

    beta = max(1/s - 1/(h w)^2, 0)

that is no more than sqrt(s)/h, which is stable, and an end is implicit by as much as
stability needs: not at all below. For Euler and its kin s is 2.5 and

    alpha = 0.25 (s beta)^2,

which damps what the step cannot resolve; they are stable below s (1 + 2 alpha) = 4. At
s >= 2.4, beta is at most 1/6 where explicit ends are stable, so that the frequency is
off by (beta - 1/12) (h w)^2 / 2, no more than theirs. RK4 damps by itself, most at s of
6; there s is 5.8, of 8, alpha is 0, and each of its four stages looks ahead from its
own displacement, by the stiffness that it meets (`_slack_passage.py`). All springs of a
cable beyond its ends stay explicit, and all under `discrete`, whose constraints are
known only after the actuators.

`predict_acceleration` solves for a as MuJoCo does: smooth forces, with those of the
cables as they were, and the constraints that are active at the acceleration of the step
before, or, tried again, at the one found with them; a friction cone that slips keeps
its force. So are the dampers that the integrator takes implicitly: those of joints,
and, under `is_implicit` and `implicitfast`, those of tendons and of actuators of affine
gain or bias.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as layout
from cc_mujoco.cable._newmark import IMPLICIT_LIMIT, STABILITY_LIMIT, VELOCITY_GAIN
from cc_mujoco.plugin import _attachments as attachments
from cc_mujoco.plugin import _instance_data as blocks
from cc_mujoco.plugin import _mj_struct as mj_struct
from cc_mujoco.plugin import _open_path as open_path
from cc_mujoco.plugin._evaluate import RK4, origin, packed_block
from cc_mujoco.plugin._ffi import (
    add,
    apply_force,
    assign,
    borrow_floats,
    dot,
    equal,
    factorise,
    fill,
    floats,
    free_stack,
    full_inertia,
    internal,
    is_sparse,
    is_zero,
    load_integer,
    load_real,
    load_word,
    mark_stack,
    multiply_inertia,
    solve_factorised,
    solve_inertia,
    store_real,
    store_word,
)

Floats = npt.NDArray[np.float64]

_STABILITY_LIMIT_RK4, _IMPLICIT_LIMIT_RK4 = 5.8, 0.3
"""`STABILITY_LIMIT` and `IMPLICIT_LIMIT` for RK4."""
MAX_DOFS = 300
"""Degrees of freedom up to which the ends are implicit: factors are dense."""
_MAX_ROUNDS = 3

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)
_NO_EULER_DAMPING = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
_AFFINE_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE)
_AFFINE_GAIN = int(mujoco.mjtGain.mjGAIN_AFFINE)
_PRM_SIZE = 10  # of gain and bias of an actuator
_EQUALITY = 0
_FRICTION_DOF, _FRICTION_TENDON, _ELLIPTIC = 1, 2, 7
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)

_UNKNOWN, _PLAIN, _CONSTRAINED, _DAMPED = 0, 1, 2, 3
"""State of knowledge of the step: nothing; the acceleration, by MuJoCo's own factor of
the inertia; by a factor with constraints; with dampers after them."""


@internal
def area_size(model: int) -> int:
    """Return the bytes that the first cable of a model keeps for all of them."""
    nv = mj_struct.dofs(model)
    return 8 * (1 + 5 * nv + 3 * nv * nv) if nv <= MAX_DOFS else 0


@internal
def begin_evaluation(block: int) -> None:
    """Begin another evaluation of the first cable, with a new prediction."""
    store_word(
        block + blocks.EVALUATION_COUNT, load_word(block + blocks.EVALUATION_COUNT) + 1
    )
    if load_word(block + blocks.PREDICTION_AREA) != 0:
        store_word(block + load_word(block + blocks.PREDICTION_AREA), _UNKNOWN)


@internal
def is_unknown(area: int) -> bool:
    """Return whether the step has not been analysed yet."""
    return load_word(area) == _UNKNOWN


@internal
def is_implicit(model: int, block: int) -> bool:
    """Return whether the step is so long that the ends of a cable must be implicit.

    It may be where it is half of what is stable for an end, by the inertia of the pose
    `qpos0`, so that a pose of less inertia is stable too.
    """
    if load_word(block + blocks.EXPLICIT_ENDS) != 0 or mj_struct.dofs(model) > MAX_DOFS:
        return False
    integrator = mj_struct.integrator(model)
    if integrator == _DISCRETE:
        return False
    step = mj_struct.timestep(model)
    most = _IMPLICIT_LIMIT_RK4 if integrator == RK4 else IMPLICIT_LIMIT
    for end in range(2):
        if load_word(block + blocks.TIED_ENDS + 8 * end) != 0:
            continue
        output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
        actuator = load_word(block + blocks.END_ACTUATORS + 8 * end)
        target = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
        mobility = 0.0
        if mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator) == _JOINT:
            dof = mj_struct.integer(model, mj_struct.JNT_DOFADR, target)
            mobility = mj_struct.real(model, mj_struct.DOF_INVWEIGHT0, dof)
            armature = mj_struct.real(model, mj_struct.DOF_ARMATURE, dof)
            if armature > 0.0:  # which MuJoCo leaves out for the slide of a body
                mobility = min(mobility, 1.0 / armature)
        else:
            mobility = mj_struct.real(model, mj_struct.TENDON_INVWEIGHT0, target)
        mobility *= attachments.pulley_radius(model, output) ** 2
        if step * step * mobility * held_stiffness(block, end) > most:
            return True
    return False


@internal
def held_stiffness(block: int, end: int) -> float:
    """Return the stiffness of an end that friction holds [N/m]."""
    stiffness = load_real(block + blocks.STIFFNESS + 8 * end)
    if stiffness == 0.0:
        n = load_word(block + blocks.SEGMENTS)
        prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
        stiffness = kernel.end_stiffness(prm, n, end == 1)
        store_real(block + blocks.STIFFNESS + 8 * end, stiffness)
    return float(stiffness)


@internal
def slipping_stiffness(block: int) -> float:
    """Return the stiffness of an end while the whole cable slips [N/m].

    Between two equal masses, which find it twice as stiff as it is.
    """
    n = load_word(block + blocks.SEGMENTS)
    prm = floats(blocks.parameters_at(block), kernel.parameter_size(n))
    stiffness, compliance = kernel.node_stiffness(prm, n), 0.0
    for i in range(stiffness.size):
        compliance += 1.0 / stiffness[i]
    return 2.0 / compliance


@internal
def newmark_terms(model: int, stiffness: float, mobility: float) -> tuple[float, float]:
    """Return alpha, and beta of an end of a stiffness [N/m], see above.

    `mobility` is its acceleration per tension, times the square of the step [m/N].
    """
    runge_kutta = mj_struct.integrator(model) == RK4
    most = _STABILITY_LIMIT_RK4 if runge_kutta else STABILITY_LIMIT
    square = mobility * stiffness
    share = max(1.0 - most / square, 0.0) if square > 0.0 else 0.0
    return 0.0 if runge_kutta else VELOCITY_GAIN * share * share, share / most


@internal
def predict_acceleration(model: int, data: int, kind: int, area: int) -> None:
    """Find the acceleration of the step, with all tensions as they are.

    `data` has all that MuJoCo evaluates before plugins of actuators, and all open
    cables led along their paths; `area` is that of the first cable (`area_size` bytes).
    """
    nv = mj_struct.dofs(model)
    found, force = floats(area + 8, nv), floats(area + 8 + 8 * nv, nv)
    scratch = floats(area + 8 + 16 * nv, nv)
    inertia = area + 8 + 40 * nv
    factor, damped = inertia + 8 * nv * nv, inertia + 16 * nv * nv
    _smooth_forces(model, data, kind, force, scratch)
    integrator = mj_struct.integrator(model)
    damping = floats(damped, nv * nv)
    dampers = _damping_matrix(model, data, integrator, damping, scratch)
    count = load_integer(data + mj_struct.NEFC)
    if count == 0 and not dampers:
        solve_inertia(model, data, found.ctypes.data, force.ctypes.data, 1)
        store_word(area, _PLAIN)
        return
    full_inertia(model, data, inertia)
    whole = floats(inertia, nv * nv)
    if dampers:
        step = mj_struct.timestep(model)
        for i in range(nv * nv):
            damping[i] = whole[i] + step * damping[i]
    _solve_constrained(
        model, data, count, whole, force, floats(factor, nv * nv), found, scratch
    )
    if not dampers:
        store_word(area, _CONSTRAINED)
        return
    multiply_inertia(model, data, scratch.ctypes.data, found.ctypes.data)
    factorise(damped, nv, 0.0)
    solve_factorised(found.ctypes.data, damped, scratch.ctypes.data, nv)
    store_word(area, _DAMPED)


@internal
def _smooth_forces(
    model: int, data: int, kind: int, force: Floats, acted: Floats
) -> None:
    """Compute the sum of all forces without those of constraints (nv,)."""
    nv = mj_struct.dofs(model)
    assign(force, floats(load_word(data + mj_struct.QFRC_PASSIVE), nv))
    add(force, floats(load_word(data + mj_struct.QFRC_BIAS), nv), -1.0)
    add(force, floats(load_word(data + mj_struct.QFRC_APPLIED), nv), 1.0)
    applied = load_word(data + mj_struct.XFRC_APPLIED)
    for body in range(1, mj_struct.bodies(model)):
        given = floats(applied + 48 * body, 6)
        if not is_zero(given):
            point = load_word(data + mj_struct.XIPOS) + 24 * body
            apply_force(
                model, data, applied + 48 * body, point, body, force.ctypes.data,
                given[0], given[1], given[2],
            )  # fmt: skip
    fill(acted, 0.0)
    for actuator in range(mj_struct.actuators(model)):
        plugin = mj_struct.integer(model, mj_struct.ACTUATOR_PLUGIN, actuator)
        if plugin >= 0 and mj_struct.integer(model, mj_struct.PLUGIN, plugin) == kind:
            continue
        first = mj_struct.integer(model, mj_struct.ACTUATOR_OUTADR, actuator)
        number = mj_struct.integer(model, mj_struct.ACTUATOR_OUTNUM, actuator)
        share = _tendon_share(model, data, actuator)
        for output in range(first, first + number):
            given_force = _limited_force(model, data, actuator, output)
            _add_moment(data, output, share * given_force, acted)
    for instance in range(mj_struct.plugins(model)):
        block = 0
        if mj_struct.integer(model, mj_struct.PLUGIN, instance) == kind:
            block = packed_block(model, data, instance)
        if block == 0:
            continue
        n = load_word(block + blocks.SEGMENTS)
        begin = origin(block, model, data, instance)[0]
        state = floats(begin, kernel.state_size(n))
        node = layout.tensions(state, n)
        if load_word(block + blocks.TIED_ENDS) == 0:
            lever = blocks.proximal_winding(
                model, block, blocks.displacement(data, block, blocks.PROXIMAL)
            )[1]
            output = load_word(block + blocks.PROXIMAL)
            _add_moment(data, output, max(node[0], 0.0) * lever, acted)
        if load_word(block + blocks.TIED_ENDS + 8) == 0:
            _add_moment(
                data, load_word(block + blocks.DISTAL), -max(node[n], 0.0), acted
            )
        if blocks.is_open(block):
            if load_word(block + blocks.PASSIVE_FRESH) == 0:
                add(force, floats(blocks.pulls_at(block, n), nv), -1.0)
            open_path.apply_pulls(
                model, data,
                load_word(block + blocks.ROUTE), load_word(block + blocks.MOUTH),
                floats(blocks.shape_at(block, n, 0), open_path.shape_size(n)), n,
                load_word(block + blocks.GUIDED), node, 0.0, -1, block + blocks.SCRATCH,
                force.ctypes.data,
            )  # fmt: skip
    for joint in range(mj_struct.joints(model)):
        dof = mj_struct.integer(model, mj_struct.JNT_DOFADR, joint)
        if mj_struct.integer(model, mj_struct.JNT_TYPE, joint) < _SLIDE:
            continue
        if mj_struct.byte(model, mj_struct.JNT_ACTGRAVCOMP, joint) != 0:
            acted[dof] += mj_struct.real(data, mj_struct.QFRC_GRAVCOMP, dof)
        if mj_struct.byte(model, mj_struct.JNT_ACTFRCLIMITED, joint) != 0:
            low = mj_struct.real(model, mj_struct.JNT_ACTFRCRANGE, 2 * joint)
            high = mj_struct.real(model, mj_struct.JNT_ACTFRCRANGE, 2 * joint + 1)
            acted[dof] = min(max(acted[dof], low), high)
    add(force, acted, 1.0)


@internal
def _limited_force(model: int, data: int, actuator: int, output: int) -> float:
    """Return the force of an actuator's output within its `forcerange`."""
    force = mj_struct.force(data, output)
    if mj_struct.byte(model, mj_struct.FORCE_LIMITED, actuator) != 0:
        low = mj_struct.real(model, mj_struct.FORCE_RANGE, 2 * actuator)
        high = mj_struct.real(model, mj_struct.FORCE_RANGE, 2 * actuator + 1)
        force = min(max(force, low), high)
    return float(force)


@internal
def _is_clamped(model: int, data: int, actuator: int) -> bool:
    """Return whether a range limits an actuator's force, which then has no damping."""
    output = mj_struct.integer(model, mj_struct.ACTUATOR_OUTADR, actuator)
    if mj_struct.byte(model, mj_struct.FORCE_LIMITED, actuator) != 0:
        force = mj_struct.force(data, output)
        low = mj_struct.real(model, mj_struct.FORCE_RANGE, 2 * actuator)
        high = mj_struct.real(model, mj_struct.FORCE_RANGE, 2 * actuator + 1)
        if force <= low or force >= high:
            return True
    return _tendon_share(model, data, actuator) != 1.0


@internal
def _tendon_share(model: int, data: int, actuator: int) -> float:
    """Return the share of an actuator's force that its tendon's range leaves.

    MuJoCo scales the forces of all actuators of a tendon so that their sum is within
    the `actuatorfrcrange` of that tendon.
    """
    if mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, actuator) != _TENDON:
        return 1.0
    tendon = mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * actuator)
    if mj_struct.byte(model, mj_struct.TENDON_ACTFRCLIMITED, tendon) == 0:
        return 1.0
    total = 0.0
    for other in range(mj_struct.actuators(model)):
        if (
            mj_struct.integer(model, mj_struct.ACTUATOR_TRNTYPE, other) == _TENDON
            and mj_struct.integer(model, mj_struct.ACTUATOR_TRNID, 2 * other) == tendon
        ):
            output = mj_struct.integer(model, mj_struct.ACTUATOR_OUTADR, other)
            total += _limited_force(model, data, other, output)
    low = mj_struct.real(model, mj_struct.TENDON_ACTFRCRANGE, 2 * tendon)
    high = mj_struct.real(model, mj_struct.TENDON_ACTFRCRANGE, 2 * tendon + 1)
    allowed = min(max(total, low), high)
    return allowed / total if allowed != total else 1.0


@internal
def _add_moment(data: int, output: int, force: float, target: Floats) -> None:
    """Add the generalised force of an actuator's output."""
    if force == 0.0:
        return
    start = mj_struct.integer(data, mj_struct.MOMENT_ROWADR, output)
    columns = load_word(data + mj_struct.MOMENT_COLIND) + 4 * start
    values = load_word(data + mj_struct.ACTUATOR_MOMENT) + 8 * start
    for i in range(mj_struct.integer(data, mj_struct.MOMENT_ROWNNZ, output)):
        target[load_integer(columns + 4 * i)] += force * load_real(values + 8 * i)


@internal
def _damping_matrix(
    model: int, data: int, integrator: int, out: Floats, scratch: Floats
) -> bool:
    """Write the damping that is integrated implicitly (nv * nv,); return if any."""
    nv, any_damping = mj_struct.dofs(model), False
    fill(out, 0.0)
    if integrator == RK4:
        return False
    euler = integrator == _EULER
    if not mj_struct.disabled(model, _NO_DAMPER) and not (
        euler and mj_struct.disabled(model, _NO_EULER_DAMPING)
    ):
        for i in range(nv):
            out[i * nv + i] = mj_struct.real(model, mj_struct.DOF_DAMPING, i)
            any_damping = any_damping or out[i * nv + i] != 0.0
    if euler:
        return any_damping
    for actuator in range(mj_struct.actuators(model)):
        if mj_struct.integer(model, mj_struct.ACTUATOR_PLUGIN, actuator) >= 0:
            continue
        rate = 0.0
        if (
            mj_struct.integer(model, mj_struct.ACTUATOR_BIASTYPE, actuator)
            == _AFFINE_BIAS
        ):
            rate -= mj_struct.real(
                model, mj_struct.ACTUATOR_BIASPRM, _PRM_SIZE * actuator + 2
            )
        if (
            mj_struct.integer(model, mj_struct.ACTUATOR_GAINTYPE, actuator)
            == _AFFINE_GAIN
        ):
            control = mj_struct.integer(model, mj_struct.ACTUATOR_CTRLADR, actuator)
            gain = mj_struct.real(
                model, mj_struct.ACTUATOR_GAINPRM, _PRM_SIZE * actuator + 2
            )
            rate -= gain * mj_struct.real(data, mj_struct.CTRL, control)
        if rate > 0.0 and not _is_clamped(model, data, actuator):
            fill(scratch, 0.0)
            output = mj_struct.integer(model, mj_struct.ACTUATOR_OUTADR, actuator)
            _add_moment(data, output, 1.0, scratch)
            _add_square(rate, scratch, out)
            any_damping = True
    for tendon in range(mj_struct.tendons(model)):
        rate = mj_struct.real(model, mj_struct.TENDON_DAMPING, tendon)
        if rate > 0.0 and not mj_struct.disabled(model, _NO_DAMPER):
            fill(scratch, 0.0)
            start = mj_struct.integer(model, mj_struct.TEN_J_ROWADR, tendon)
            columns = load_word(model + mj_struct.TEN_J_COLIND) + 4 * start
            values = load_word(data + mj_struct.TEN_J) + 8 * start
            for i in range(mj_struct.integer(model, mj_struct.TEN_J_ROWNNZ, tendon)):
                scratch[load_integer(columns + 4 * i)] = load_real(values + 8 * i)
            _add_square(rate, scratch, out)
            any_damping = True
    return any_damping


@internal
def _add_square(rate: float, row: Floats, out: Floats) -> None:
    """Add the product of a row (nv,) with itself to a matrix (nv * nv,)."""
    nv = row.size
    for i in range(nv):
        for j in range(nv if row[i] != 0.0 else 0):
            out[i * nv + j] += rate * row[i] * row[j]


@internal
def _solve_constrained(
    model: int,
    data: int,
    count: int,
    base: Floats,
    force: Floats,
    factor: Floats,
    found: Floats,
    right: Floats,
) -> None:
    """Compute the acceleration under smooth forces and constraints, with its factor.

    `base` is the inertia and `factor`, out, that of inertia and active constraints (nv
    * nv,); `force`, `found` (out) and `right` (scratch) are (nv,).
    """
    nv = mj_struct.dofs(model)
    sparse = is_sparse(model) != 0
    assign(found, floats(load_word(data + mj_struct.QACC_WARMSTART), nv))
    mark_stack(data)
    state, before = borrow_floats(data, count), borrow_floats(data, count)
    given, push = borrow_floats(data, count), borrow_floats(data, count)
    weight = floats(load_word(data + mj_struct.EFC_D), count)
    aim = floats(load_word(data + mj_struct.EFC_AREF), count)
    jacobian = load_word(data + mj_struct.EFC_J)
    columns = load_word(data + mj_struct.EFC_COLIND)
    for trial in range(_MAX_ROUNDS):
        for i in range(count):
            start, number = nv * i, nv
            if sparse:
                start = mj_struct.integer(data, mj_struct.EFC_ROWADR, i)
                number = mj_struct.integer(data, mj_struct.EFC_ROWNNZ, i)
            off = -aim[i]
            for k in range(number):
                a = load_integer(columns + 4 * (start + k)) if sparse else k
                off += load_real(jacobian + 8 * (start + k)) * found[a]
            given[i] = -weight[i] * off
            push[i] = _constraint_force(data, i, given, state)
        if trial > 0 and equal(state, before):
            break
        assign(before, state)
        assign(factor, base)
        assign(right, force)
        for i in range(count):
            start, number = nv * i, nv
            if sparse:
                start = mj_struct.integer(data, mj_struct.EFC_ROWADR, i)
                number = mj_struct.integer(data, mj_struct.EFC_ROWNNZ, i)
            stiff = weight[i] if state[i] != 0.0 else 0.0
            pushed = stiff * aim[i] + push[i]
            for k in range(number if stiff != 0.0 or push[i] != 0.0 else 0):
                a = load_integer(columns + 4 * (start + k)) if sparse else k
                own = load_real(jacobian + 8 * (start + k))
                right[a] += own * pushed
                for m in range(number if stiff != 0.0 and own != 0.0 else 0):
                    b = load_integer(columns + 4 * (start + m)) if sparse else m
                    other = load_real(jacobian + 8 * (start + m))
                    factor[a * nv + b] += stiff * own * other
        factorise(factor.ctypes.data, nv, 0.0)
        solve_factorised(found.ctypes.data, factor.ctypes.data, right.ctypes.data, nv)
    free_stack(data)


@internal
def _constraint_force(data: int, i: int, given: Floats, state: Floats) -> float:
    """Set whether constraint i gives way like a spring, else return its force.

    `given` are the forces of the constraints up to i if they all do.
    """
    force = given[i]
    kind = mj_struct.integer(data, mj_struct.EFC_TYPE, i)
    state[i] = 1.0
    if kind == _EQUALITY:
        return 0.0
    if kind == _FRICTION_DOF or kind == _FRICTION_TENDON:
        most = mj_struct.real(data, mj_struct.EFC_FRICTIONLOSS, i)
        if abs(force) < most:
            return 0.0
        state[i] = 0.0
        return math.copysign(most, force)
    if kind == _ELLIPTIC:
        contact = mj_struct.integer(data, mj_struct.EFC_ID, i)
        place = load_word(data + mj_struct.CONTACT) + mj_struct.CONTACT_SIZE * contact
        first = load_integer(place + mj_struct.CONTACT_EFC)
        if i > first:
            most = load_real(place + mj_struct.CONTACT_FRICTION + 8 * (i - first - 1))
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
    model: int, data: int, block: int, kind: int, area: int, out: Floats
) -> None:
    """Compute where the ends of a cable are, and how they move in the step (9,).

    Pairs for the proximal and the distal end: displacement x [m], h v [m] and h^2 a [m]
    while the tensions stay as they are, and by how much h^2 a falls with the tension
    [m/N]; at last 1, as ends yield to their tension. How ends on the same bodies move
    each other is added to what each does by itself.
    """
    nv, step = mj_struct.dofs(model), mj_struct.timestep(model)
    known = load_word(area)
    found = floats(area + 8, nv)
    row, answer = floats(area + 8 + 16 * nv, nv), floats(area + 8 + 24 * nv, nv)
    between = floats(area + 8 + 32 * nv, nv)
    inertia = area + 8 + 40 * nv
    factor, damped = inertia + 8 * nv * nv, inertia + 16 * nv * nv
    for end in range(2):
        out[end], lever = _end_position(model, data, block, end)
        out[2 + end] = out[4 + end] = out[6 + end] = 0.0
        if load_word(block + blocks.TIED_ENDS + 8 * end) != 0:
            continue
        output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
        fill(row, 0.0)
        _add_moment(data, output, lever, row)
        if known == _PLAIN:
            solve_inertia(model, data, answer.ctypes.data, row.ctypes.data, 1)
        else:
            solve_factorised(answer.ctypes.data, factor, row.ctypes.data, nv)
        if known == _DAMPED:
            multiply_inertia(model, data, between.ctypes.data, answer.ctypes.data)
            solve_factorised(answer.ctypes.data, damped, between.ctypes.data, nv)
        speed = mj_struct.real(data, mj_struct.ACTUATOR_VELOCITY, output)
        out[2 + end] = step * lever * speed
        out[4 + end] = step * step * dot(row, found)
        out[6 + end] = step * step * _mobility(model, data, kind, answer)
    out[8] = 1.0


@internal
def _mobility(model: int, data: int, kind: int, answer: Floats) -> float:
    """Compute the acceleration of all cable ends together per tension [1/kg].

    `answer` (nv,) is the acceleration of the degrees of freedom by it.
    """
    total = 0.0
    for other in range(mj_struct.plugins(model)):
        block = 0
        if mj_struct.integer(model, mj_struct.PLUGIN, other) == kind:
            block = blocks.block_of(model, data, other)
        for end in range(2 if block != 0 else 0):
            if load_word(block + blocks.TIED_ENDS + 8 * end) == 0:
                arm = _end_position(model, data, block, end)[1]
                output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
                total += abs(arm * _output_motion(data, output, answer))
    return total


@internal
def predict_known_motion(model: int, data: int, block: int, out: Floats) -> None:
    """Compute what `predict_ends` does (9,), by the acceleration in `data`.

    It is the same where that acceleration is the one that MuJoCo finds; nothing yields.
    """
    nv, step = mj_struct.dofs(model), mj_struct.timestep(model)
    mark_stack(data)
    row, answer = borrow_floats(data, nv), borrow_floats(data, nv)
    kind = mj_struct.integer(
        model, mj_struct.PLUGIN, load_word(block + blocks.INSTANCE)
    )
    found = floats(load_word(data + mj_struct.QACC), nv)
    for end in range(2):
        out[end], lever = _end_position(model, data, block, end)
        out[2 + end] = out[4 + end] = out[6 + end] = 0.0
        if load_word(block + blocks.TIED_ENDS + 8 * end) != 0:
            continue
        output = load_word(block + (blocks.DISTAL if end else blocks.PROXIMAL))
        fill(row, 0.0)
        _add_moment(data, output, lever, row)
        solve_inertia(model, data, answer.ctypes.data, row.ctypes.data, 1)
        speed = mj_struct.real(data, mj_struct.ACTUATOR_VELOCITY, output)
        out[2 + end] = step * lever * speed
        out[4 + end] = step * step * dot(row, found)
        out[6 + end] = step * step * _mobility(model, data, kind, answer)
    out[8] = 0.0
    free_stack(data)


@internal
def _end_position(model: int, data: int, block: int, end: int) -> tuple[float, float]:
    """Return the displacement of an end [m], and the lever of its tension."""
    if end == 0:
        return blocks.proximal_winding(
            model, block, blocks.displacement(data, block, blocks.PROXIMAL)
        )
    return blocks.displacement(data, block, blocks.DISTAL), 1.0


@internal
def _output_motion(data: int, output: int, motion: Floats) -> float:
    """Return how far a motion of the degrees of freedom takes an actuator's output."""
    start = mj_struct.integer(data, mj_struct.MOMENT_ROWADR, output)
    columns = load_word(data + mj_struct.MOMENT_COLIND) + 4 * start
    values = load_word(data + mj_struct.ACTUATOR_MOMENT) + 8 * start
    total = 0.0
    for i in range(mj_struct.integer(data, mj_struct.MOMENT_ROWNNZ, output)):
        total += load_real(values + 8 * i) * motion[load_integer(columns + 4 * i)]
    return total
