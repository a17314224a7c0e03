r"""Motor torque that puts a desired torque on the joint through friction, compiled.

Which distal tensions make the desired torque? One cable leaves no choice. Of two that
pull against each other, motor and joint can only exchange length: with the arms
\(f_i\) at the joint, all \((s_i - s_i^0)/f_i\) are equal, where \(s_i\) is the stretch
of cable i and \(s_i^0\) that of the pretension. While a cable slips as a whole its
stretch is in proportion to its distal tension, so the torque follows from that one
number, piecewise linearly: a cable that would have to push is slack instead.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import FloatArray, compiled
from cc_mujoco.transmission import PARAMETERS, kernel
from cc_mujoco.transmission import friction as law
from cc_mujoco.transmission.packing import contact_length
from cc_mujoco.transmission.stepper import Counts

_SCALARS = len(PARAMETERS)
_FRICTION = law.INDEX["friction"]
_PRETENSION = law.INDEX["pretension"]


@compiled
def _stretches(prm: FloatArray, n: int, slip_direction: float) -> tuple[float, float]:
    """Stretch in the pretension [m], and per distal tension while all slips [m/N].

    `slip_direction` is the direction of slip, 0 for a tension that is the same all
    along.
    """
    values = prm[:_SCALARS]
    angle = kernel.segment_angles(prm, n)
    stiffness = kernel.node_stiffness(prm, n)
    level, rest, unit = 1.0, 0.0, 0.0
    for i in range(n + 1):
        j = n - i
        if i > 0 and slip_direction != 0.0:
            growth = law.ratio(values[_FRICTION], angle[j])
            level = level * growth if slip_direction < 0.0 else level / growth
        rest += values[_PRETENSION] / stiffness[j]
        unit += level / stiffness[j]
    return rest, unit


@compiled
def _shared(
    prm: FloatArray,
    n: Counts,
    distal: FloatArray,
    slip_direction: FloatArray,
    desired: float,
    share: FloatArray,
    taut: FloatArray,
) -> None:
    """Distal tension of every cable that together make the joint torque [N].

    Args:
        prm: packed parameters (cables, numbers).
        n: segments.
        distal: arms at the joint [m/rad].
        slip_direction: direction in which each cable slips.
        desired: joint torque [Nm].
        share: out.
        taut: scratch, which cables are.
    """
    if n.size == 1:
        share[0] = max(-desired / distal[0], 0.0)
        return
    taut[:] = 1.0
    for _ in range(n.size):
        # Torque = -sum f_i (s_i0 + f_i g) / unit_i of the cables that are taut.
        constant, slope = 0.0, 0.0
        for k in range(n.size):
            if taut[k] != 0.0:
                rest, unit = _stretches(prm[k], n[k], slip_direction[k])
                constant -= distal[k] * rest / unit
                slope -= distal[k] ** 2 / unit
        if slope == 0.0:
            break
        angle = (desired - constant) / slope
        again = False
        for k in range(n.size):
            rest, unit = _stretches(prm[k], n[k], slip_direction[k])
            tension = (rest + distal[k] * angle) / unit
            share[k] = max(tension, 0.0) if taut[k] != 0.0 else 0.0
            if taut[k] != 0.0 and tension < 0.0:
                taut[k], again = 0.0, True
        if not again:
            break


@compiled
def dynamic(
    prm: FloatArray,
    n: Counts,
    arm: FloatArray,
    distal: FloatArray,
    slip_direction: FloatArray,
    gain: FloatArray,
    desired: float,
    scratch: FloatArray,
) -> float:
    """Compensation of dynamic friction (4.2): every distal tension times its gain.

    Args:
        prm: packed parameters (cables, numbers).
        n: segments of every cable.
        arm: of every cable where the motor is (cables,) [m/rad].
        distal: arms at the joint [m/rad].
        slip_direction: direction in which every cable last slipped as a whole (cables,)
        gain: proximal per distal tension at that time (cables,).
        desired: joint torque [Nm].
        scratch: (3, cables).

    Returns:
        Motor torque [Nm].
    """
    share = scratch[0]
    _shared(prm, n, distal, slip_direction, desired, share, scratch[1])
    torque = 0.0
    for k in range(n.size):
        torque -= arm[k] * gain[k] * share[k]
    return torque


@compiled
def whole(
    prm: FloatArray,
    n: Counts,
    arm: FloatArray,
    distal: FloatArray,
    state: FloatArray,
    slip_direction: float,
    desired: float,
    scratch: FloatArray,
) -> float:
    """Torque at which the whole of every cable slips the way the motor shall turn.

    Listing 4.1: where part of a cable stands still, the proximal tension is the one at
    which (2.7) fails at every node that does, and at which the desired tension arrives.
    Where all of it moves that way already this is the compensation of dynamic friction.

    Args:
        prm: packed parameters (cables, numbers).
        n: segments of every cable.
        arm: of every cable where the motor is (cables,) [m/rad].
        distal: arms at the joint [m/rad].
        state: of the model (cables, numbers).
        slip_direction: sense in which the motor shall turn, 1, -1 or 0 for as it is.
        desired: joint torque [Nm].
        scratch: (3, cables).

    Returns:
        Motor torque [Nm].
    """
    share, senses = scratch[0], scratch[2]
    for k in range(n.size):
        senses[k] = np.sign(arm[k]) * slip_direction
    _shared(prm, n, distal, senses, desired, share, scratch[1])
    torque = 0.0
    for k in range(n.size):
        tension = share[k]
        if slip_direction != 0.0:
            tension = _breakaway(prm[k], n[k], state[k], senses[k], tension)
        torque -= arm[k] * tension
    return torque


@compiled
def _breakaway(
    prm: FloatArray, n: int, state: FloatArray, sense: float, wanted: float
) -> float:
    """Proximal tension at which all segments slip one way, `wanted` at the end [N]."""
    t = kernel.STATE_HEADER
    values = prm[:_SCALARS]
    angle = kernel.segment_angles(prm, n)
    holding = law.holding_coefficient(values)
    length = contact_length(prm, n)
    need = wanted
    for i in range(n):
        j = n - 1 - i
        slip, speed = state[t + n + 1 + j], state[t + 2 * n + 1 + j]
        moving = slip * sense > 0.0
        slipped = abs(slip) if moving else 0.0
        growth = law.ratio(law.kinetic_coefficient(values, slipped, speed), angle[j])
        drag = law.drag(values, length[j], growth, j, n)
        held = max(state[t + j + 1], 0.0)
        hold = law.ratio(holding, angle[j])
        if sense < 0.0:
            need = growth * need + drag
            if not moving:
                need = max(need, hold * held + drag)
        else:
            need = max(need - drag, 0.0) / growth
            if not moving:
                need = min(need, max(held - drag, 0.0) / hold)
    return need
