"""The nodes of a cable: what stretch and tension make of each other, compiled.

A node is a piece of cable between the centres of the segments beside it; the end spring
is part of the distal one. Packed parameters and state are those of `packing.py`.
"""

from __future__ import annotations

from cc_mujoco.compiled import FloatArray, compiled, internal
from cc_mujoco.transmission import elasticity as elastic
from cc_mujoco.transmission import friction as law
from cc_mujoco.transmission import packing as at

_EA = law.INDEX["axial_stiffness"]
_PRETENSION = law.INDEX["pretension"]
_END_COMPLIANCE = law.INDEX["end_compliance"]
_BRISTLE = law.INDEX["bristle_length"]
_STIFFENING = law.INDEX["stiffening"]


@internal
def piece(prm: FloatArray, n: int, i: int) -> tuple[float, float, float, float]:
    """Node i for `elasticity.py`: length, stiffness EA, stiffening, end spring."""
    length = at.node_length(prm, n)[i]
    spring = 0.0
    if i == n:
        spring = prm[_END_COMPLIANCE] + prm[at.YIELD_DISTAL]
    elif i == 0:
        spring = prm[at.YIELD_PROXIMAL]
    return length, prm[_EA], prm[_STIFFENING], spring


@internal
def set_node(prm: FloatArray, n: int, i: int) -> None:
    """Pack stiffness and compliance of a node."""
    length, ea, _, spring = piece(prm, n, i)
    stiffness = ea / length
    if spring > 0.0:
        stiffness = 1.0 / (1.0 / stiffness + spring)
    at.node_stiffness(prm, n)[i] = stiffness
    at.node_compliance(prm, n)[i] = 1.0 / stiffness


@internal
def node_stretch(prm: FloatArray, n: int, i: int, tension: float) -> float:
    """Stretch of node i [m]."""
    length, ea, stiffening, spring = piece(prm, n, i)
    if stiffening == 0.0:
        return float(tension * at.node_compliance(prm, n)[i])
    return elastic.stretch_of(tension, length, ea, stiffening, spring)


@internal
def tension_at(prm: FloatArray, n: int, i: int, stretched: float) -> float:
    """Tension of node i at a stretch [m]."""
    length, ea, stiffening, spring = piece(prm, n, i)
    if stiffening == 0.0:
        return float(stretched * at.node_stiffness(prm, n)[i])
    return elastic.tension_of(stretched, length, ea, stiffening, spring)


@internal
def pulled(prm: FloatArray, n: int, i: int, tension: float, stretched: float) -> float:
    """Tension of node i after it was stretched further [m]."""
    if stretched == 0.0:
        return tension
    length, ea, stiffening, spring = piece(prm, n, i)
    if stiffening == 0.0:
        return float(tension + at.node_stiffness(prm, n)[i] * stretched)
    total = stretched + elastic.stretch_of(tension, length, ea, stiffening, spring)
    return elastic.tension_of(total, length, ea, stiffening, spring)


@internal
def stretched(prm: FloatArray, n: int, i: int, before: float, after: float) -> float:
    """Stretch of node i between two tensions [m]."""
    length, ea, stiffening, spring = piece(prm, n, i)
    if stiffening == 0.0:
        return float((after - before) / at.node_stiffness(prm, n)[i])
    stretch = elastic.stretch_of(after, length, ea, stiffening, spring)
    return stretch - elastic.stretch_of(before, length, ea, stiffening, spring)


@internal
def rest_stretch(prm: FloatArray, tension: float) -> float:
    """Stretch of the cable with its end spring at a uniform tension [m]."""
    return elastic.stretch_of(
        tension, prm[at.LENGTH], prm[_EA], prm[_STIFFENING], prm[_END_COMPLIANCE]
    )


@internal
def elastic_energy(prm: FloatArray, n: int, tension: FloatArray) -> float:
    """Elastic energy of the cable and its end spring [J]."""
    stiffness = at.node_stiffness(prm, n)
    total = 0.0
    for i in range(n + 1):
        if prm[_STIFFENING] == 0.0:
            total += 0.5 * max(tension[i], 0.0) ** 2 / stiffness[i]
        else:
            length, ea, stiffening, spring = piece(prm, n, i)
            total += elastic.energy_at(tension[i], length, ea, stiffening, spring)
    return total


@compiled
def stretch(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Stretch of all nodes [m], which `state[3]` follows."""
    total = 0.0
    tension = at.tensions(state, n)
    for i in range(n + 1):
        length, ea, stiffening, spring = piece(prm, n, i)
        total += elastic.stretch_of(tension[i], length, ea, stiffening, spring)
    return total


@compiled
def slack(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Length of cable that lies slack in the conduit [m]."""
    tension, stiffness = at.tensions(state, n), at.node_stiffness(prm, n)
    total = 0.0
    for i in range(n + 1):
        total -= min(tension[i], 0.0) / stiffness[i]
    return total


@compiled
def stored(prm: FloatArray, n: int, state: FloatArray) -> float:
    """Elastic energy of the cable and of the bristles on it [J]."""
    total = elastic_energy(prm, n, at.tensions(state, n))
    if prm[_BRISTLE] > 0.0:
        force, stretched = at.bristle_forces(state, n), at.bristle_stretches(state, n)
        for j in range(n):
            total += 0.5 * abs(force[j] * stretched[j])
    return total


@compiled
def end_stiffness(prm: FloatArray, n: int, distal: bool) -> float:
    """Stiffness of an end against motion so small that friction holds the rest [N/m].

    That of the nodes up to the first segment that friction holds: of half a segment
    where the conduit bends from its mouth on.
    """
    compliance = 0.0
    factor = min(1.0 + prm[_STIFFENING] * prm[_PRETENSION], 100.0)
    stiffness = at.node_stiffness(prm, n)
    hold, drag = at.constant_hold(prm, n), at.constant_drag(prm, n)
    for i in range(n + 1):
        compliance += 1.0 / stiffness[n - i if distal else i]
        j = n - 1 - i if distal else i
        if i < n and (hold[j] > 1.0 or drag[j] > 0.0):
            return float(factor / compliance)
    # Nothing holds: one spring between both ends, which two equal masses find twice as
    # stiff as it is.
    return float(2.0 * factor / compliance)
