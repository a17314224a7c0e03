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
own displacement. All springs of a cable beyond its ends stay explicit,
and all under `discrete`, whose constraints are known only after the actuators.

`foresee` solves for a as MuJoCo does: smooth forces, with those of the cables as they
were, and the constraints that are active at the acceleration of the step before, or,
tried again, at the one found with them; a friction cone that slips keeps its force. So
are the dampers that the integrator takes implicitly: those of joints, and, under
`implicit` and `implicitfast`, those of tendons and of actuators of affine gain or bias.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from cc_mujoco.engine import ends, fields, pieces
from cc_mujoco.engine.block import (
    AREA,
    DISTAL,
    EVALUATION,
    EXPLICIT,
    FRESH,
    GUIDED,
    HOLDERS,
    INSTANCE,
    MOUTH,
    PROXIMAL,
    ROUTE,
    SCRATCH,
    SEGMENTS,
    STIFFNESS,
    TIED,
    displacement,
    opens,
    parameters_at,
    pulls_at,
    shape_at,
    wound,
)
from cc_mujoco.engine.evaluation import origin
from cc_mujoco.engine.memory import (
    add,
    apply_force,
    assign,
    dot,
    equal,
    factorise,
    fill,
    floats,
    full_inertia,
    internal,
    is_sparse,
    load_integer,
    load_real,
    load_word,
    solve_factorised,
    solve_inertia,
    store_real,
    store_word,
    times_inertia,
    vanishes,
)
from cc_mujoco.transmission import kernel, packing

Floats = npt.NDArray[np.float64]

_SQUARE, _SQUARE_RK4, _VELOCITY = 2.5, 5.8, 0.25
_LOOK, _LOOK_RK4 = 1.0, 2.0
"""Square of step times frequency, in `qpos0`, above which an end may be implicit."""
MOST = 300
"""Degrees of freedom up to which the ends are implicit: factors are dense."""
_ROUNDS = 3

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)
_NO_EULER_DAMPING = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
_NO_DAMPER = int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_AFFINE_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE)
_AFFINE_GAIN = int(mujoco.mjtGain.mjGAIN_AFFINE)
_PARAMETERS = 10  # of gain and bias of an actuator
_EQUALITY = 0
_FRICTION_DOF, _FRICTION_TENDON, _ELLIPTIC = 1, 2, 7
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)

_UNKNOWN, _PLAIN, _CONSTRAINED, _DAMPED = 0, 1, 2, 3
"""State of knowledge of the step: nothing; the acceleration, by MuJoCo's own factor of
the inertia; by a factor with constraints; with dampers after them."""


@internal
def first(model: int, instance: int) -> int:
    """The first cable of a model of which this is one."""
    kind = fields.integer(model, fields.PLUGIN, instance)
    other = 0
    while fields.integer(model, fields.PLUGIN, other) != kind:
        other += 1
    return other


@internal
def area_size(model: int) -> int:
    """Bytes that the first cable of a model keeps for all of them."""
    nv = fields.dofs(model)
    return 8 * (1 + 5 * nv + 3 * nv * nv) if nv <= MOST else 0


@internal
def forget(block: int) -> None:
    """Begin another evaluation, whose step is looked at anew; of the first cable."""
    store_word(block + EVALUATION, load_word(block + EVALUATION) + 1)
    if load_word(block + AREA) != 0:
        store_word(block + load_word(block + AREA), _UNKNOWN)


@internal
def unknown(area: int) -> bool:
    """Return whether the step has not been analysed yet."""
    return load_word(area) == _UNKNOWN


@internal
def implicit(model: int, block: int) -> bool:
    """Return whether the step is so long that the ends of a cable must be implicit.

    It may be where it is half of what is stable for an end, by the inertia of the pose
    `qpos0`, so that a pose of less inertia is stable too.
    """
    if load_word(block + EXPLICIT) != 0 or fields.dofs(model) > MOST:
        return False
    integrator = fields.integrator(model)
    if integrator == _DISCRETE:
        return False
    step = fields.timestep(model)
    most = _LOOK_RK4 if integrator == _RK4 else _LOOK
    for end in range(2):
        if load_word(block + TIED + 8 * end) != 0:
            continue
        output = load_word(block + (DISTAL if end else PROXIMAL))
        actuator = load_word(block + HOLDERS + 8 * end)
        target = fields.integer(model, fields.ACTUATOR_TRNID, 2 * actuator)
        mobility = 0.0
        if fields.integer(model, fields.ACTUATOR_TRNTYPE, actuator) == _JOINT:
            dof = fields.integer(model, fields.JNT_DOFADR, target)
            mobility = fields.real(model, fields.DOF_INVWEIGHT0, dof)
        else:
            mobility = fields.real(model, fields.TENDON_INVWEIGHT0, target)
        mobility *= ends.gear(model, output) ** 2
        if step * step * mobility * _stiffness(block, end) > most:
            return True
    return False


@internal
def _stiffness(block: int, end: int) -> float:
    """Stiffness of an end that friction holds [N/m]."""
    stiffness = load_real(block + STIFFNESS + 8 * end)
    if stiffness == 0.0:
        n = load_word(block + SEGMENTS)
        prm = floats(parameters_at(block), kernel.parameter_size(n))
        stiffness = kernel.end_stiffness(prm, n, end == 1)
        store_real(block + STIFFNESS + 8 * end, stiffness)
    return float(stiffness)


@internal
def _blend(model: int, block: int, end: int, mobility: float) -> tuple[float, float]:
    """Return alpha h [s] and beta h^2 [s^2] of an end, see above.

    `mobility` is its acceleration per tension [1/kg].
    """
    runge_kutta = fields.integrator(model) == _RK4
    step, most = fields.timestep(model), _SQUARE_RK4 if runge_kutta else _SQUARE
    square = step * step * mobility * _stiffness(block, end)
    share = max(1.0 - most / square, 0.0) if square > 0.0 else 0.0
    velocity = 0.0 if runge_kutta else _VELOCITY * share * share * step
    return velocity, share * step * step / most


@internal
def foresee(model: int, data: int, kind: int, area: int) -> None:
    """Find the acceleration of the step, with all tensions as they are.

    Args:
        model: address of the model.
        data: address of the data, with all that MuJoCo evaluates before plugins of
            actuators, and all open cables led along their paths.
        kind: MuJoCo's number of the plugin.
        area: address of `area_size` bytes, of the first cable.
    """
    nv = fields.dofs(model)
    found, force = floats(area + 8, nv), floats(area + 8 + 8 * nv, nv)
    scratch = floats(area + 8 + 16 * nv, nv)
    inertia = area + 8 + 40 * nv
    factor, damped = inertia + 8 * nv * nv, inertia + 16 * nv * nv
    _smooth(model, data, kind, force, scratch)
    integrator = fields.integrator(model)
    damping = floats(damped, nv * nv)
    dampers = _damp(model, data, integrator, damping, scratch)
    count = load_integer(data + fields.NEFC)
    if count == 0 and not dampers:
        solve_inertia(model, data, found.ctypes.data, force.ctypes.data, 1)
        store_word(area, _PLAIN)
        return
    full_inertia(model, data, inertia)
    whole = floats(inertia, nv * nv)
    if dampers:
        step = fields.timestep(model)
        for i in range(nv * nv):
            damping[i] = whole[i] + step * damping[i]
    _constrain(
        model, data, count, whole, force, floats(factor, nv * nv), found, scratch
    )
    if not dampers:
        store_word(area, _CONSTRAINED)
        return
    times_inertia(model, data, scratch.ctypes.data, found.ctypes.data)
    factorise(damped, nv, 0.0)
    solve_factorised(found.ctypes.data, damped, scratch.ctypes.data, nv)
    store_word(area, _DAMPED)


@internal
def _smooth(model: int, data: int, kind: int, force: Floats, acted: Floats) -> None:
    """Sum of all forces but those of constraints (nv,)."""
    nv = fields.dofs(model)
    assign(force, floats(load_word(data + fields.PASSIVE), nv))
    add(force, floats(load_word(data + fields.BIAS), nv), -1.0)
    add(force, floats(load_word(data + fields.APPLIED), nv), 1.0)
    applied = load_word(data + fields.XFRC)
    for body in range(1, fields.bodies(model)):
        given = floats(applied + 48 * body, 6)
        if not vanishes(given):
            point = load_word(data + fields.XIPOS) + 24 * body
            apply_force(
                model, data, applied + 48 * body, point, body, force.ctypes.data,
                given[0], given[1], given[2],
            )  # fmt: skip
    fill(acted, 0.0)
    for actuator in range(fields.actuators(model)):
        plugin = fields.integer(model, fields.ACTUATOR_PLUGIN, actuator)
        if plugin >= 0 and fields.integer(model, fields.PLUGIN, plugin) == kind:
            continue
        first = fields.integer(model, fields.ACTUATOR_OUTADR, actuator)
        number = fields.integer(model, fields.ACTUATOR_OUTNUM, actuator)
        for output in range(first, first + number):
            given_force = fields.force(data, output)
            if fields.byte(model, fields.FORCE_LIMITED, actuator) != 0:
                low = fields.real(model, fields.FORCE_RANGE, 2 * actuator)
                high = fields.real(model, fields.FORCE_RANGE, 2 * actuator + 1)
                given_force = min(max(given_force, low), high)
            _add_moment(data, output, given_force, acted)
    for instance in range(fields.plugins(model)):
        block = 0
        if fields.integer(model, fields.PLUGIN, instance) == kind:
            block = fields.block(data, instance)
        if block == 0:
            continue
        n = load_word(block + SEGMENTS)
        begin = origin(block, model, data, instance)[0]
        state = floats(begin, kernel.state_size(n))
        node = packing.tensions(state, n)
        if load_word(block + TIED) == 0:
            lever = wound(model, block, displacement(data, block, PROXIMAL))[1]
            output = load_word(block + PROXIMAL)
            _add_moment(data, output, max(node[0], 0.0) * lever, acted)
        if load_word(block + TIED + 8) == 0:
            _add_moment(data, load_word(block + DISTAL), -max(node[n], 0.0), acted)
        if opens(block):
            if load_word(block + FRESH) == 0:
                add(force, floats(pulls_at(block, n), nv), -1.0)
            pieces.pull(
                model, data, load_word(block + ROUTE), load_word(block + MOUTH),
                floats(shape_at(block, n, 0), pieces.shape_size(n)), n,
                load_word(block + GUIDED), node, 0.0, -1, block + SCRATCH,
                force.ctypes.data,
            )  # fmt: skip
    for joint in range(fields.joints(model)):
        dof = fields.integer(model, fields.JNT_DOFADR, joint)
        if fields.integer(model, fields.JNT_TYPE, joint) < _SLIDE:
            continue
        if fields.byte(model, fields.JNT_ACTGRAVCOMP, joint) != 0:
            acted[dof] += fields.real(data, fields.GRAVCOMP, dof)
        if fields.byte(model, fields.JNT_ACTFRCLIMITED, joint) != 0:
            low = fields.real(model, fields.JNT_ACTFRCRANGE, 2 * joint)
            high = fields.real(model, fields.JNT_ACTFRCRANGE, 2 * joint + 1)
            acted[dof] = min(max(acted[dof], low), high)
    add(force, acted, 1.0)


@internal
def _add_moment(data: int, output: int, force: float, target: Floats) -> None:
    """Add what the force of an actuator's output does to the degrees of freedom."""
    if force == 0.0:
        return
    start = fields.integer(data, fields.MOMENT_ROWADR, output)
    columns = load_word(data + fields.MOMENT_COLIND) + 4 * start
    values = load_word(data + fields.MOMENT) + 8 * start
    for i in range(fields.integer(data, fields.MOMENT_ROWNNZ, output)):
        target[load_integer(columns + 4 * i)] += force * load_real(values + 8 * i)


@internal
def _damp(model: int, data: int, integrator: int, out: Floats, scratch: Floats) -> bool:
    """Damping (nv * nv,) that the integrator takes implicitly; whether there is any."""
    nv, any_damping = fields.dofs(model), False
    fill(out, 0.0)
    if integrator == _RK4:
        return False
    euler = integrator == _EULER
    if not fields.disabled(model, _NO_DAMPER) and not (
        euler and fields.disabled(model, _NO_EULER_DAMPING)
    ):
        for i in range(nv):
            out[i * nv + i] = fields.real(model, fields.DOF_DAMPING, i)
            any_damping = any_damping or out[i * nv + i] != 0.0
    if euler:
        return any_damping
    for actuator in range(fields.actuators(model)):
        if fields.integer(model, fields.ACTUATOR_PLUGIN, actuator) >= 0:
            continue
        rate = 0.0
        if fields.integer(model, fields.BIASTYPE, actuator) == _AFFINE_BIAS:
            rate -= fields.real(model, fields.BIASPRM, _PARAMETERS * actuator + 2)
        if fields.integer(model, fields.GAINTYPE, actuator) == _AFFINE_GAIN:
            control = fields.integer(model, fields.CTRLADR, actuator)
            gain = fields.real(model, fields.GAINPRM, _PARAMETERS * actuator + 2)
            rate -= gain * fields.real(data, fields.CTRL, control)
        if rate > 0.0:
            fill(scratch, 0.0)
            output = fields.integer(model, fields.ACTUATOR_OUTADR, actuator)
            _add_moment(data, output, 1.0, scratch)
            _add_square(rate, scratch, out)
            any_damping = True
    for tendon in range(fields.tendons(model)):
        rate = fields.real(model, fields.TENDON_DAMPING, tendon)
        if rate > 0.0 and not fields.disabled(model, _NO_DAMPER):
            fill(scratch, 0.0)
            start = fields.integer(model, fields.TEN_J_ROWADR, tendon)
            columns = load_word(model + fields.TEN_J_COLIND) + 4 * start
            values = load_word(data + fields.TEN_J) + 8 * start
            for i in range(fields.integer(model, fields.TEN_J_ROWNNZ, tendon)):
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
def _constrain(
    model: int,
    data: int,
    count: int,
    base: Floats,
    force: Floats,
    factor: Floats,
    found: Floats,
    right: Floats,
) -> None:
    """Acceleration under smooth forces and the constraints, and its factor.

    Args:
        model: address of the model.
        data: address of the data.
        count: number of scalar constraints.
        base: inertia (nv * nv,).
        force: smooth forces (nv,).
        factor: out, of what inertia and active constraints make (nv * nv,).
        found: out, acceleration (nv,).
        right: scratch (nv,).
    """
    nv = fields.dofs(model)
    sparse = is_sparse(model) != 0
    assign(found, floats(load_word(data + fields.WARMSTART), nv))
    state, before, given = np.zeros(count), np.full(count, -1.0), np.zeros(count)
    weight = floats(load_word(data + fields.EFC_D), count)
    aim = floats(load_word(data + fields.EFC_AREF), count)
    jacobian = load_word(data + fields.EFC_J)
    columns = load_word(data + fields.EFC_COLIND)
    push = np.zeros(count)
    for trial in range(_ROUNDS):
        for i in range(count):
            start, number = nv * i, nv
            if sparse:
                start = fields.integer(data, fields.EFC_ROWADR, i)
                number = fields.integer(data, fields.EFC_ROWNNZ, i)
            off = -aim[i]
            for k in range(number):
                a = load_integer(columns + 4 * (start + k)) if sparse else k
                off += load_real(jacobian + 8 * (start + k)) * found[a]
            given[i] = -weight[i] * off
            push[i] = _push(data, i, given, state)
        if trial > 0 and equal(state, before):
            return
        assign(before, state)
        assign(factor, base)
        assign(right, force)
        for i in range(count):
            start, number = nv * i, nv
            if sparse:
                start = fields.integer(data, fields.EFC_ROWADR, i)
                number = fields.integer(data, fields.EFC_ROWNNZ, i)
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


@internal
def _push(data: int, i: int, given: Floats, state: Floats) -> float:
    """Set whether constraint i gives way like a spring, else return its force.

    `given` are the forces of the constraints up to i if they all do.
    """
    force = given[i]
    kind = fields.integer(data, fields.EFC_TYPE, i)
    state[i] = 1.0
    if kind == _EQUALITY:
        return 0.0
    if kind == _FRICTION_DOF or kind == _FRICTION_TENDON:
        most = fields.real(data, fields.EFC_FRICTIONLOSS, i)
        if abs(force) < most:
            return 0.0
        state[i] = 0.0
        return math.copysign(most, force)
    if kind == _ELLIPTIC:
        contact = fields.integer(data, fields.EFC_ID, i)
        place = load_word(data + fields.CONTACT) + fields.CONTACT_SIZE * contact
        first = load_integer(place + fields.CONTACT_EFC)
        if i > first:
            most = load_real(place + fields.CONTACT_FRICTION + 8 * (i - first - 1))
            normal = max(given[first], 0.0)
            if abs(force) > most * normal:
                state[i] = 0.0
                return math.copysign(most * normal, force)
            return 0.0
    if force <= 0.0:
        state[i] = 0.0
    return 0.0


@internal
def aim(model: int, data: int, block: int, kind: int, area: int, out: Floats) -> None:
    """Compute where to evaluate the ends of a cable, and how far they yield (4,).

    Displacements [m] of the proximal and the distal end while their tensions stay as
    they are, and by how much they go into the cable per tension [m/N]. How ends on the
    same bodies move each other is added to what each does by itself.
    """
    nv = fields.dofs(model)
    known = load_word(area)
    found = floats(area + 8, nv)
    row, answer = floats(area + 8 + 16 * nv, nv), floats(area + 8 + 24 * nv, nv)
    between = floats(area + 8 + 32 * nv, nv)
    inertia = area + 8 + 40 * nv
    factor, damped = inertia + 8 * nv * nv, inertia + 16 * nv * nv
    for end in range(2):
        x, lever = _place(model, data, block, end)
        out[end], out[2 + end] = x, 0.0
        if load_word(block + TIED + 8 * end) != 0:
            continue
        output = load_word(block + (DISTAL if end else PROXIMAL))
        fill(row, 0.0)
        _add_moment(data, output, lever, row)
        if known == _PLAIN:
            solve_inertia(model, data, answer.ctypes.data, row.ctypes.data, 1)
        else:
            solve_factorised(answer.ctypes.data, factor, row.ctypes.data, nv)
        if known == _DAMPED:
            times_inertia(model, data, between.ctypes.data, answer.ctypes.data)
            solve_factorised(answer.ctypes.data, damped, between.ctypes.data, nv)
        mobility = _mobility(model, data, kind, answer)
        velocity, acceleration = _blend(model, block, end, mobility)
        out[end] += velocity * lever * fields.real(data, fields.VELOCITY, output)
        out[end] += acceleration * dot(row, found)
        out[2 + end] = acceleration * mobility


@internal
def _mobility(model: int, data: int, kind: int, answer: Floats) -> float:
    """Compute the acceleration of all cable ends together per tension [1/kg].

    `answer` (nv,) is the acceleration of the degrees of freedom by it.
    """
    total = 0.0
    for other in range(fields.plugins(model)):
        block = 0
        if fields.integer(model, fields.PLUGIN, other) == kind:
            block = fields.block(data, other)
        for end in range(2 if block != 0 else 0):
            if load_word(block + TIED + 8 * end) == 0:
                arm = _place(model, data, block, end)[1]
                output = load_word(block + (DISTAL if end else PROXIMAL))
                total += abs(arm * _along(data, output, answer))
    return total


@internal
def reached(model: int, data: int, block: int, end: int) -> float:
    """Return where an implicit end is evaluated [m], by the acceleration in `data`.

    It is that of `aim` where the acceleration is the one that MuJoCo finds.
    """
    x, lever = _place(model, data, block, end)
    if load_word(block + TIED + 8 * end) != 0:
        return x
    nv = fields.dofs(model)
    output = load_word(block + (DISTAL if end else PROXIMAL))
    row, answer = np.zeros(nv), np.empty(nv)
    _add_moment(data, output, lever, row)
    solve_inertia(model, data, answer.ctypes.data, row.ctypes.data, 1)
    kind = fields.integer(model, fields.PLUGIN, load_word(block + INSTANCE))
    mobility = _mobility(model, data, kind, answer)
    velocity, acceleration = _blend(model, block, end, mobility)
    found = floats(load_word(data + fields.ACCELERATIONS), nv)
    moved = velocity * lever * fields.real(data, fields.VELOCITY, output)
    return float(x + moved + acceleration * dot(row, found))


@internal
def _place(model: int, data: int, block: int, end: int) -> tuple[float, float]:
    """Displacement of an end [m], and the lever of its tension."""
    if end == 0:
        return wound(model, block, displacement(data, block, PROXIMAL))
    return displacement(data, block, DISTAL), 1.0


@internal
def _along(data: int, output: int, motion: Floats) -> float:
    """Return how far a motion of the degrees of freedom takes an actuator's output."""
    start = fields.integer(data, fields.MOMENT_ROWADR, output)
    columns = load_word(data + fields.MOMENT_COLIND) + 4 * start
    values = load_word(data + fields.MOMENT) + 8 * start
    total = 0.0
    for i in range(fields.integer(data, fields.MOMENT_ROWNNZ, output)):
        total += load_real(values + 8 * i) * motion[load_integer(columns + 4 * i)]
    return total
