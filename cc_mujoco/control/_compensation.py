r"""Motor torque that makes a desired joint torque through friction, compiled.

Which distal tensions make the desired torque? One cable leaves no choice. Of two that
pull against each other, motor and joint can only exchange length: with the arms \(f_i\)
at the joint, all \((s_i - s_i^0)/f_i\) are equal, where \(s_i\) is the stretch of cable
i and \(s_i^0\) that of the pretension. While a cable slips as a whole its stretch is in
proportion to its distal tension, so the torque follows from that one number, piecewise
linearly: a cable that would have to push is slack instead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import _friction as law
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.cable._stepper import Cables
from cc_mujoco.native import FloatArray, FloatMatrix, compiled

SCRATCH_ROWS = 6
"""Rows of the scratch of these functions, with a number for each cable."""
_DRAG_TERMS = tuple(place for place, _, _ in law.DRAG_TERMS)


class Model(NamedTuple):
    """Model that follows the cables of one device."""

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


@compiled
def _friction(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    sense: float,
    speed: float,
    j: int,
    ends: float,
) -> tuple[float, float, float]:
    """Return growth, drag [N] and holding growth of segment j for slip along `sense`.

    Every law of friction acts as in a step of the kernel, except bristles: they are
    bent by then. Drag of viscosity helps where the cable still moves the other way.
    `sense` is 1 towards the joint, -1 towards the motor; `speed` of the cable is
    positive towards the joint [m/s], `ends` is the place of the distal end [m].
    """
    values, length = at.scalars(prm), at.contact_length(prm, n)[j]
    if prm[at.CONSTANT_COULOMB] != 0.0:
        # Exponentials that would otherwise be computed for every segment.
        growth = at.constant_growth(prm, n)[j]
        constant_drag = law.drag(values, length, growth, j, n)
        return growth, constant_drag, at.constant_hold(prm, n)[j]
    node, slip = at.tensions(state, n), at.slips(state, n)[j]
    angle = at.segment_angles(prm, n)[j] * law.wrap_factor(
        values, state[at.TRAVEL], ends - length, ends, prm[at.LENGTH]
    )
    factor = law.load_factor(values, 0.5 * (max(node[j], 0.0) + max(node[j + 1], 0.0)))
    factor *= law.drift_factor(values, state[at.TIME], state[at.HEAT])
    factor *= 1.0 - sense * values[PLACE.friction_asymmetry]
    aged = values[PLACE.ageing_friction] * at.contact_ages(state, n)[j]
    slipped = abs(slip) if slip * sense > 0.0 else 0.0
    moving = law.kinetic_coefficient(values, slipped, abs(speed))
    growth = law.ratio(factor * (moving + aged), angle)
    hold = law.ratio(factor * (law.holding_coefficient(values) + aged), angle)
    drag = law.drag(values, length, growth, j, n)
    drag += sense * speed * law.viscosity(values, length, growth, abs(speed), 1.0)
    return growth, drag, hold


@compiled
def has_drag(prm: FloatArray) -> bool:
    for place in _DRAG_TERMS:
        if prm[place] != 0.0:
            return True
    return False


@compiled
def _stretches(
    prm: FloatArray, n: int, state: FloatArray, sense: float, speed: float
) -> tuple[float, float, float]:
    """Return the stretch in pretension [m]; of full slip per distal tension, at none.

    `sense` is the direction of slip, 0 for a uniform tension; the others see
    `_friction`.
    """
    stiffness = at.node_stiffness(prm, n)
    length = at.contact_length(prm, n)
    ends = at.total(length)
    level, offset, rest, unit, none = 1.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n + 1):
        j = n - i
        if i > 0 and sense != 0.0:
            growth, drag, _ = _friction(prm, n, state, sense, speed, j, ends)
            ends -= length[j]
            if sense < 0.0:
                level, offset = level * growth, offset * growth + drag
            else:
                level, offset = level / growth, (offset - drag) / growth
        rest += prm[PLACE.pretension] / stiffness[j]
        unit += level / stiffness[j]
        none += offset / stiffness[j]
    return rest, unit, none


@compiled
def _shared_tensions(
    model: Model, direction: FloatArray, joint_velocity: float, desired: float
) -> None:
    """Compute distal tensions of all cables that make the joint torque [N].

    The joint velocity is that at which the cables have to follow [rad/s]. The tensions
    are written to the first row of the scratch; the third is not touched.
    """
    prm, n, _, _, distal = model.cables
    scratch = model.scratch
    share, taut = scratch[0], scratch[1]
    rest, unit, none = scratch[3], scratch[4], scratch[5]
    if n.size == 1:
        share[0] = max(-desired / distal[0], 0.0)
        return
    taut[:] = 1.0
    for k in range(n.size):
        rest[k], unit[k], none[k] = _stretches(
            prm[k], n[k], model.state[k], direction[k], distal[k] * joint_velocity
        )
    for _ in range(n.size):
        # Torque = -sum f_i (s_i0 + f_i g) / unit_i of the cables that are taut.
        constant, slope = 0.0, 0.0
        for k in range(n.size):
            if taut[k] != 0.0:
                constant -= distal[k] * (rest[k] - none[k]) / unit[k]
                slope -= distal[k] ** 2 / unit[k]
        if slope == 0.0:
            break
        angle = (desired - constant) / slope
        again = False
        for k in range(n.size):
            tension = (rest[k] - none[k] + distal[k] * angle) / unit[k]
            share[k] = max(tension, 0.0) if taut[k] != 0.0 else 0.0
            if taut[k] != 0.0 and tension < 0.0:
                taut[k], again = 0.0, True
        if not again:
            break


@compiled
def dynamic(model: Model, joint_velocity: float, desired: float) -> float:
    """Return the motor torque with dynamic friction (4.2) [N m].

    It is the distal tensions times gains. Drag that needs no tension is added instead:
    as part of the gain it would grow with the desired torque. Where a motion turns, it
    stays against the past motion until all of the cable has turned; so there a cable
    that pulls more than desired is not pulled harder than in the model, nor one that
    pulls less released further.

    `joint_velocity` is that at which the cables have to follow [rad/s].
    """
    share = model.scratch[0]
    prm, n, _, _, distal = model.cables
    _shared_tensions(model, model.direction, joint_velocity, desired)
    torque = 0.0
    for k in range(n.size):
        if model.direction[k] != 0.0 and has_drag(prm[k]):
            speed, state = distal[k] * joint_velocity, model.state[k]
            tension = _proximal_tension(
                prm[k], n[k], state, model.direction[k], speed, share[k], False
            )
            node = at.tensions(state, n[k])
            if max(node[n[k]], 0.0) > share[k]:
                tension = min(tension, max(node[0], 0.0))
            else:
                tension = max(tension, max(node[0], 0.0))
            torque -= model.arm[k] * tension
        else:
            torque -= model.arm[k] * model.gain[k] * share[k]
    return torque


@compiled
def full_slip_torque(
    model: Model, sense: float, joint_velocity: float, desired: float
) -> float:
    """Return the motor torque at which all cables slip completely its way [N m].

    Listing 4.1: where part of a cable stands still, the proximal tension is the one at
    which (2.7) fails at every sticking node, and at which the desired tension arrives.
    Where all of it moves that way already this is the compensation of dynamic friction.
    `sense` is that in which the motor shall turn, 1, -1 or 0 for the present one;
    other arguments as in `dynamic`.
    """
    share, senses = model.scratch[0], model.scratch[2]
    prm, n, _, _, distal = model.cables
    for k in range(n.size):
        senses[k] = np.sign(model.arm[k]) * sense
    _shared_tensions(model, senses, joint_velocity, desired)
    torque = 0.0
    for k in range(n.size):
        tension = share[k]
        if sense != 0.0:
            speed, state = distal[k] * joint_velocity, model.state[k]
            tension = _proximal_tension(
                prm[k], n[k], state, senses[k], speed, tension, True
            )
        torque -= model.arm[k] * tension
    return torque


@compiled
def _proximal_tension(
    prm: FloatArray,
    n: int,
    state: FloatArray,
    sense: float,
    speed: float,
    wanted: float,
    breaking: bool,
) -> float:
    """Return the proximal tension at which all segments slip one way [N].

    `wanted` is the distal tension [N]; if `breaking`, segments that do not slip so yet
    have to be broken away. For `sense` and `speed` see `_friction`.
    """
    node, slips = at.tensions(state, n), at.slips(state, n)
    length = at.contact_length(prm, n)
    ends = at.total(length)
    need = wanted
    for i in range(n):
        j = n - 1 - i
        growth, drag, hold = _friction(prm, n, state, sense, speed, j, ends)
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
