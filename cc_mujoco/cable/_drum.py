"""The rope on a drum at an end of a path that lengthens, compiled.

Rope goes onto a drum at the strain of the piece that it comes from, and friction keeps
that strain while it lies there. So a surface that takes in du takes du / (1 + strain)
of unstretched rope, and the drum gives the same rope out again, last in, first out.
Below it lies rope at the strain of the pretension, as it was mounted.

The torque is the tension of the first piece times the radius, and that piece is a
spring of EA by its unstretched length. With both, no law can return all work of every
closed motion: the forces of drum and load would be one function of the length of the
piece less what the drum paid out, whatever the drum holds. What is lost is the heat of
the rope that slips where it leaves the drum, at another tension T than its own,

    W(own) - W(T) - T (own strain - strain at T) >= 0

per unstretched length, with W the elastic energy; there is none where it leaves as it
was wound. The jump of strain at the outlet of a drum is that of Crellin et al.
(J. Appl. Mech. 64, 1997). Rope with Coulomb friction all around a drum loses as much,
0.85 times that at a coefficient of 0.3 (`tests/cable/test_drum.py`).

A state has room for some layers of one strain each. Where there are more, the two
neighbours become one that lose least energy by it, which counts as heat.
"""

from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _moving_path as moving_path
from cc_mujoco.cable import _nodes as nodes
from cc_mujoco.cable._friction import PLACE
from cc_mujoco.native import FloatArray, internal

_MOUNTED, _OWED, _BOTTOM = 0, 1, 2
"""Indices in the memory of a drum: unstretched length paid out of the rope as mounted;
unstretched length paid out that no layer has given yet; stretched, then unstretched
length of the innermost layer [m]. Empty layers come last."""
_TOP = _BOTTOM + 2 * (at.DRUM_LAYERS - 1)  # index of the last layer
_EMPTY_LAYER = 1e-12
"""Length of a layer up to which it counts as empty [m]."""
_NO_FLOW = 1e-30
"""Length paid out in a step up to which a drum counts as still [m]."""


@internal
def passing_ratio(
    prm: FloatArray, n: int, state: FloatArray, end: int, paid: float
) -> float:
    """Return stretched over unstretched length of rope that leaves or enters a drum.

    `paid` is the length of surface [m] that the drum at that end (0, 1) pays out, or
    takes in if negative.
    """
    if not paid > _NO_FLOW:
        i = n * end
        return moving_path.stretch_ratio(prm, max(at.tensions(state, n)[i], 0.0))
    drum = at.drum(state, n, end)
    left, given = paid, 0.0
    for i in range(at.DRUM_LAYERS):
        k = _TOP - 2 * i
        if left > 0.0 and drum[k] > 0.0:
            part = min(left, drum[k])
            given += part * (drum[k + 1] / drum[k])
            left -= part
    return paid / (given + left / moving_path.stretch_ratio(prm, prm[PLACE.pretension]))


@internal
def turn(
    prm: FloatArray, n: int, state: FloatArray, new_state: FloatArray, end: int,
    paid: float, ratio: float,
) -> float:  # fmt: skip
    """Update the layers of the drum at an end (0, 1); return the slip heat [J].

    `paid` and its stretch `ratio` are those of `passing_ratio`. `new_state` has the
    tensions after the step; its layers are updated.
    """
    if abs(paid) <= _NO_FLOW:
        return 0.0
    i, drum = n * end, at.drum(new_state, n, end)
    if paid < 0.0:
        heat = _take_in(prm, drum, -paid, -paid / ratio)
    else:
        mean = 0.5 * (at.tensions(state, n)[i] + at.tensions(new_state, n)[i])
        drum[_OWED] += paid / ratio
        heat = _pay_out(prm, drum, paid, max(mean, 0.0))
    k = _top_layer(drum)
    if k >= _BOTTOM:
        most = 0.5 * drum[k + 1]
        part = min(max(drum[_OWED], -most), most)
        drum[k + 1] -= part
        drum[_OWED] -= part
    return heat


@internal
def _top_layer(drum: FloatArray) -> int:
    """Return the index of the outermost layer, below `_BOTTOM` if there is none."""
    k = _TOP
    while k >= _BOTTOM and drum[k] <= 0.0:
        k -= 2
    return k


@internal
def _mixing_heat(
    prm: FloatArray, length: float, unstretched: float, other: float, also: float
) -> float:
    """Return the energy that two layers lose when they become one [J].

    Stretched lengths are `length`, `other`, unstretched ones `unstretched`, `also` [m].
    """
    both = unstretched + also
    if not nodes.is_curved_cable(prm):
        # A difference of energies would lose its digits in single precision.
        apart = length / unstretched - other / also
        shared = unstretched / both * also
        return float(0.5 * prm[PLACE.axial_stiffness] * shared * apart * apart)
    energy = unstretched * moving_path.strain_energy(prm, length / unstretched)
    energy += also * moving_path.strain_energy(prm, other / also)
    return energy - both * moving_path.strain_energy(prm, (length + other) / both)


@internal
def _take_in(
    prm: FloatArray, drum: FloatArray, length: float, unstretched: float
) -> float:
    """Add a layer of this `length` and `unstretched` length [m]; return the heat [J].

    Where there is no room left, the two layers that lose least energy are merged.
    """
    k = _top_layer(drum)
    if k < _TOP:
        drum[k + 2], drum[k + 3] = length, unstretched
        return 0.0
    best = _TOP
    least = _mixing_heat(prm, drum[k], drum[k + 1], length, unstretched)
    for i in range(at.DRUM_LAYERS - 1):
        k = _BOTTOM + 2 * i
        heat = _mixing_heat(prm, drum[k], drum[k + 1], drum[k + 2], drum[k + 3])
        if heat < least:
            best, least = k, heat
    if best == _TOP:
        drum[best] += length
        drum[best + 1] += unstretched
    else:
        drum[best] += drum[best + 2]
        drum[best + 1] += drum[best + 3]
        for k in range(best + 2, _TOP):
            drum[k] = drum[k + 2]
        drum[_TOP], drum[_TOP + 1] = length, unstretched
    return max(least, 0.0)


@internal
def _pay_out(prm: FloatArray, drum: FloatArray, paid: float, tension: float) -> float:
    """Take `paid` [m] off the layers, outermost first; return the slip heat [J].

    `tension` [N] is that of the piece of cable that the rope joins.
    """
    left, heat = paid, 0.0
    for i in range(at.DRUM_LAYERS):
        k = _TOP - 2 * i
        if left > 0.0 and drum[k] > 0.0:
            part, amount = left, left * (drum[k + 1] / drum[k])
            own = drum[k] / drum[k + 1]
            if left >= drum[k] - _EMPTY_LAYER:
                part, amount = drum[k], drum[k + 1]
                drum[k] = drum[k + 1] = 0.0
            else:
                drum[k] -= part
                drum[k + 1] -= amount
            heat += amount * _slip_heat(prm, own, tension)
            drum[_OWED] -= amount
            left -= part
    if left > 0.0:
        own = moving_path.stretch_ratio(prm, prm[PLACE.pretension])
        heat += left / own * _slip_heat(prm, own, tension)
        drum[_MOUNTED] += left / own
        drum[_OWED] -= left / own
    return heat


@internal
def _slip_heat(prm: FloatArray, own: float, tension: float) -> float:
    """Return the heat per unstretched length of rope that leaves a drum [N].

    `own` is its stretch ratio on the drum; `tension` [N] is that of the cable ahead.
    """
    ratio = moving_path.stretch_ratio(prm, tension)
    lost = moving_path.strain_energy(prm, own) - moving_path.strain_energy(prm, ratio)
    return max(lost - tension * (own - ratio), 0.0)


@internal
def wound_energy(prm: FloatArray, n: int, state: FloatArray, end: int) -> float:
    """Return the elastic energy of the rope on a drum, relative to as mounted [J]."""
    drum, mounted = at.drum(state, n, end), prm[PLACE.pretension]
    ratio = moving_path.stretch_ratio(prm, mounted)
    total = -float(drum[_MOUNTED]) * moving_path.strain_energy(prm, ratio)
    for i in range(at.DRUM_LAYERS):
        k = _BOTTOM + 2 * i
        if drum[k] > 0.0:
            total += drum[k + 1] * moving_path.strain_energy(prm, drum[k] / drum[k + 1])
    return total
