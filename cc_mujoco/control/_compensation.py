r"""Motor torque that makes a desired joint torque through friction, compiled.

The distal tension of a single cable follows from the desired torque. Two that pull
against each other can only exchange length with the motor: with the arms \(f_i\)
at the joint, all \((s_i - s_i^0)/f_i\) are equal, where \(s_i\) is the stretch of cable
i and \(s_i^0\) that of the pretension. Where creep, an elasticity that is not linear or
a pulley that is not round changes what belongs to it, \(s_i^0\) is the present stretch.
While a cable slips as a whole its stretch is in proportion to its distal tension, so
the torque follows from that one number, piecewise linearly: a cable that would have to
push is slack instead. One that is slack at the motor, and pulls since its drag keeps it
from being paid out, keeps the tension that it has.
"""

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import _eccentric as eccentric
from cc_mujoco.cable import _elasticity as elastic
from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._pre_step import loses_stretch
from cc_mujoco.cable._stepper import Cables
from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

SCRATCH_ROWS = 6  # rows of the scratch of these functions, with a number for each cable
_DRAG_TERMS = tuple(place for place, _, _ in law.DRAG_TERMS)


class Model(NamedTuple):
    """Cables of one device in a controller: parameters, state and scratch."""

    cables: Cables
    state: FloatMatrix  # (cables, numbers)
    arm: FloatArray  # arms at the present motor angle (cables,) [m/rad]
    # Sense in which a cable last slipped as a whole: 1 towards the joint, -1 towards
    # the motor, 0 never; and proximal per distal tension at that moment, 1 before.
    direction: FloatArray  # (cables,)
    gain: FloatArray  # (cables,)
    scratch: FloatMatrix  # (`SCRATCH_ROWS`, cables)
    new: FloatMatrix  # scratch like `state`
    work: FloatArray  # scratch of `cable._layout.work_size`


class _Slip(NamedTuple):
    """A cable that slips as a whole."""

    prm: FloatArray
    n: int
    state: FloatArray
    sense: float  # 1 towards the joint, -1 towards the motor; 0: uniform tension
    speed: float  # of the cable, positive towards the joint [m/s]


@internal
def _slip(model: Model, k: int, sense: float, joint_velocity: float) -> _Slip:
    """Return cable k, slipping in a sense at the velocity of the joint [rad/s]."""
    prm, n, _, _, distal = model.cables
    return _Slip(prm[k], n[k], model.state[k], sense, distal[k] * joint_velocity)


@internal
def _friction(slip: _Slip, j: int, ends: float) -> tuple[float, float, float]:
    """Return tension ratio, drag [N] and static ratio of segment j, slipping as `slip`.

    A resting segment starts to slip at the static ratio. The segment ends at a distance
    `ends` from the proximal end [m]. Every law of friction acts as in a step of the
    kernel, except for bristles, which count as fully bent. Viscous drag helps if the
    cable still moves the other way.
    """
    prm, n, state, sense, speed = slip
    values, length = at.scalars(prm), at.contact_length(prm, n)[j]
    if prm[at.CONSTANT_COULOMB] != 0.0:
        # Exponentials that would otherwise be computed for every segment.
        ratio, drag = at.constant_growth(prm, n)[j], at.constant_drag(prm, n)[j]
        return ratio, drag, at.constant_hold(prm, n)[j]
    node, slipped = at.tensions(state, n), at.slips(state, n)[j]
    angle = at.segment_angles(prm, n)[j] * law.wrap_factor(
        values, state[at.TRAVEL], ends - length, ends, prm[at.LENGTH]
    )
    slipped = abs(slipped) if slipped * sense > 0.0 else 0.0
    moving, resting = law.changed_coefficients(
        values, law.kinetic_coefficient(values, slipped, abs(speed)),
        law.holding_coefficient(values),
        law.drift_factor(values, state[at.TIME], state[at.HEAT]),
        0.5 * (max(node[j], 0.0) + max(node[j + 1], 0.0)), at.contact_ages(state, n)[j],
    )  # fmt: skip
    # As in the kernel, drag is that of the mean growth of both directions.
    growth = law.ratio(moving, angle)
    drag = law.drag(values, length, growth, j, n)
    drag += sense * speed * law.viscosity(values, length, growth, abs(speed), 1.0)
    way = law.direction_factor(values, sense)
    if way != 1.0:
        growth = law.ratio(moving * way, angle)
    return growth, drag, law.ratio(resting * way, angle)


@compiled
def has_drag(prm: FloatArray) -> bool:
    for place in _DRAG_TERMS:
        if prm[place] != 0.0:
            return True
    return False


@internal
def _starts_at_present(cables: Cables) -> bool:
    """Return whether stretch at rest differs from pretension over initial stiffness."""
    for k in range(cables.n.size):
        prm = cables.prm[k]
        if nodes.is_curved(prm) or loses_stretch(prm) or not eccentric.is_round(prm):
            return True
    return False


@internal
def _stretches(slip: _Slip, present: bool) -> tuple[float, float, float]:
    """Return the initial stretch of a cable [m], and two numbers of it while it slips.

    They are its stretch per distal tension [m/N], and that by drag at no distal tension
    [m]. Initial means at pretension, or, if `present`, the state and compliance now.
    """
    prm, n, state, sense, _ = slip
    length = at.contact_length(prm, n)
    ends = at.total(length)
    level, offset, start, unit, none = 1.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n + 1):
        j = n - i
        if i > 0 and sense != 0.0:
            growth, drag, _ = _friction(slip, j, ends)
            ends -= length[j]
            if sense < 0.0:
                level, offset = level * growth, offset * growth + drag
            else:
                level, offset = level / growth, (offset - drag) / growth
        tension, stiffness = prm[PLACE.pretension], at.node_stiffness(prm, n)[j]
        if present:
            tension, own = at.tensions(state, n)[j], nodes.piece_now(prm, n, state, j)
            stiffness = 1.0 / elastic.compliance_at(own, tension)
        start += tension / stiffness
        unit += level / stiffness
        none += offset / stiffness
    return start, unit, none


@internal
def _shared_tensions(
    model: Model, direction: FloatArray, joint_velocity: float, desired: float
) -> None:
    """Compute the distal tensions of all cables [N] that make a joint torque.

    They are written to row 0 of the model's scratch; row 2 is not changed. `direction`
    is the sense of slip of each cable, `joint_velocity` that of the joint [rad/s], and
    `desired` the torque [N m].
    """
    n, distal, scratch = model.cables.n, model.cables.distal, model.scratch
    share, taut = scratch[0], scratch[1]
    start, unit, none = scratch[3], scratch[4], scratch[5]
    if n.size == 1:
        share[0] = max(-desired / distal[0], 0.0)
        return
    present, held = _starts_at_present(model.cables), 0.0
    for k in range(n.size):
        slip = _slip(model, k, direction[k], joint_velocity)
        start[k], unit[k], none[k] = _stretches(slip, present)
        taut[k], share[k], node = 1.0, 0.0, at.tensions(slip.state, slip.n)
        if direction[k] > 0.0 and node[0] <= 0.0 and has_drag(slip.prm):
            # The motor pays out slack, and drag holds the rest.
            taut[k], share[k] = 0.0, max(node[slip.n], 0.0)
            held -= distal[k] * share[k]
    for _ in range(n.size):
        # Torque = -sum f_i (s_i0 + f_i g) / unit_i of the cables that are taut.
        constant, slope = held, 0.0
        for k in range(n.size):
            if taut[k] != 0.0:
                constant -= distal[k] * (start[k] - none[k]) / unit[k]
                slope -= distal[k] ** 2 / unit[k]
        if slope == 0.0:
            break
        angle = (desired - constant) / slope
        again = False
        for k in range(n.size):
            if taut[k] != 0.0:
                tension = (start[k] - none[k] + distal[k] * angle) / unit[k]
                share[k] = max(tension, 0.0)
                if tension < 0.0:
                    taut[k], again = 0.0, True
        if not again:
            break


@internal
def dynamic(model: Model, joint_velocity: float, desired: float) -> float:
    """Return the motor torque with dynamic friction (thesis, equation 4.2) [N m].

    It is the sum of the distal tensions times gains. Drag that needs no tension is
    added instead, since as part of a gain it would grow with the desired torque. After
    a reversal it acts against the past motion until the whole cable has turned. Until
    then a cable that pulls more than desired is not pulled harder than in the model,
    and one that pulls less is not released further. `joint_velocity` is that which the
    cables follow [rad/s].
    """
    share, torque = model.scratch[0], 0.0
    _shared_tensions(model, model.direction, joint_velocity, desired)
    for k in range(model.cables.n.size):
        if model.direction[k] != 0.0 and has_drag(model.cables.prm[k]):
            slip = _slip(model, k, model.direction[k], joint_velocity)
            tension = _proximal_tension(slip, share[k], False)
            node = at.tensions(slip.state, slip.n)
            if max(node[slip.n], 0.0) > share[k]:
                tension = min(tension, max(node[0], 0.0))
            else:
                tension = max(tension, max(node[0], 0.0))
            torque -= model.arm[k] * tension
        else:
            torque -= model.arm[k] * model.gain[k] * share[k]
    return torque


@internal
def full_slip_torque(
    model: Model, sense: float, joint_velocity: float, desired: float
) -> float:
    """Return the motor torque at which all cables slip fully in one direction [N m].

    Thesis, listing 4.1: if part of a cable sticks, its proximal tension is that at
    which equation 2.7 fails at every sticking node and the desired tension arrives at
    the joint. If all of it moves that way already, this is `dynamic`. `sense` is the
    direction in which the motor shall turn, 1, -1 or 0 for the present one; other
    arguments as there.
    """
    share, senses, torque = model.scratch[0], model.scratch[2], 0.0
    for k in range(senses.size):
        senses[k] = np.sign(model.arm[k]) * sense
    _shared_tensions(model, senses, joint_velocity, desired)
    for k in range(senses.size):
        tension = share[k]
        if sense != 0.0:
            slip = _slip(model, k, senses[k], joint_velocity)
            tension = _proximal_tension(slip, tension, True)
        torque -= model.arm[k] * tension
    return torque


@internal
def _proximal_tension(slip: _Slip, wanted: float, breaking: bool) -> float:
    """Return the proximal tension at which all segments slip one way [N].

    `wanted` is the distal tension [N]. If `breaking`, segments that do not slip that
    way yet must first exceed static friction.
    """
    prm, n, state, sense, _ = slip
    node, slips = at.tensions(state, n), at.slips(state, n)
    length = at.contact_length(prm, n)
    ends = at.total(length)
    need = wanted
    for i in range(n):
        j = n - 1 - i
        growth, drag, hold = _friction(slip, j, ends)
        ends -= length[j]
        moving = not breaking or slips[j] * sense > 0.0
        held = max(node[j + 1], 0.0)
        if sense < 0.0:
            need = max(growth * need + drag, 0.0)
            if not moving:
                need = max(need, hold * held + drag)
        else:
            need = max(need - drag, 0.0) / growth
            if not moving:
                need = min(need, max(held - drag, 0.0) / hold)
    return need
