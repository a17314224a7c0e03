"""Tension and stretch of a piece of cable: linear, softer until it is taut, or soft.

Strands that settle until they touch (bedding), and clearance in bends of a wider
conduit, add to the stretch of the taut cable,

    stretch(T) = l T / EA + l e T / (T + T_b) + c theta T / (T + T_c).

EA is the stiffness of the taut cable, e the strain by which bedding makes a new rope
longer (constructional stretch), and T_b the tension that takes half of it. Slack cable
lies at the outer wall of a bend of angle theta, taut cable at the inner one, a path
that is shorter by the clearance c times theta; T_c takes half of it. A slack cable, of
negative tension, has the compliance that it has at 0. Tension is a function of stretch
alone, so there is no hysteresis.

Textile and skin that hold the end of a cable are a spring of compliance C that hardens
by h, X(T) = C ln(1 + h T) / h, with an elastic friction element (bristle) in parallel,

    stretch(T) += X(T) / 3 + 2/3 X(T_held),    T <= T_held <= T / (1 - 3/2 loss).

T_held, the tension to which the bristle is set, changes only as far as these limits
require. Loading sets it to the lower limit, where the stretch is X(T), unloading to the
upper one. So a cycle from 0 to any tension and back loses `loss` times the work of
loading, and after a turn the spring is three times as stiff as before it.
"""

import math
from typing import NamedTuple

from cc_mujoco.native import internal

_MAX_ROUNDS = 60
_PROMPT = 1.0 / 3.0
"""Share of the stretch of a hysteretic spring that follows its tension at once."""


class Piece(NamedTuple):
    """Elastic law of a piece of cable, see the module, with the spring at its end."""

    taut: float  # compliance at large tensions, with a linear spring's [m/N]
    bedding: float  # final stretch of bedding [m]
    half: float  # T_b, tension at which bedding has half its final stretch [N]
    clearance: float  # final stretch of clearance in bends [m]
    seating: float  # T_c, tension at which clearance has half its final stretch [N]
    spring: float  # C, compliance of a soft spring at no tension, 0: none [m/N]
    hardening: float  # h of the soft spring [1/N]
    returned: float  # unloading over loading tension of it, at equal stretch
    held: float  # T_held of its bristle [N]


@internal
def compliance_at(piece: Piece, tension: float) -> float:
    """Return the derivative of the stretch by the tension [m/N]."""
    pull = max(tension, 0.0)
    smooth = _smooth_secant(piece, pull, pull)
    return smooth if piece.spring == 0.0 else smooth + spring_slope(piece, tension)


@internal
def spring_slope(piece: Piece, tension: float) -> float:
    """Return the derivative of the soft spring's stretch by the tension [m/N]."""
    if tension <= 0.0:
        return piece.spring
    if tension >= piece.held:
        return _hardened_slope(piece, tension)
    prompt = _PROMPT * _hardened_slope(piece, tension)
    if tension >= piece.returned * piece.held:
        return prompt
    held = tension / piece.returned
    return prompt + (1.0 - _PROMPT) * _hardened_slope(piece, held) / piece.returned


@internal
def returned_share(loss: float) -> float:
    """Return unloading over loading tension at equal stretch, for a spring's `loss`."""
    return 1.0 - loss / (1.0 - _PROMPT)


@internal
def held_tension(piece: Piece, tension: float) -> float:
    """Return T_held of the spring's bristle after a change to `tension` [N]."""
    pull = max(tension, 0.0)
    return min(max(piece.held, pull), pull / piece.returned)


@internal
def _hardened_slope(piece: Piece, pull: float) -> float:
    return piece.spring / (1.0 + piece.hardening * pull)


@internal
def _hardened_between(piece: Piece, before: float, after: float) -> float:
    """Return X(`after`) - X(`before`) for two tensions >= 0 [m], X as in the module."""
    more = (after - before) / (1.0 + piece.hardening * before)
    if piece.hardening == 0.0:
        return piece.spring * more
    return piece.spring * math.log1p(piece.hardening * more) / piece.hardening


@internal
def spring_between(piece: Piece, before: float, after: float) -> float:
    """Return the change of the soft spring's stretch between two tensions [m]."""
    if piece.spring == 0.0:
        return 0.0
    start, end = max(before, 0.0), max(after, 0.0)
    first, last = held_tension(piece, before), held_tension(piece, after)
    slack = piece.spring * (min(after, 0.0) - min(before, 0.0))
    prompt = _PROMPT * _hardened_between(piece, start, end)
    return slack + prompt + (1.0 - _PROMPT) * _hardened_between(piece, first, last)


@internal
def _slope(most: float, half: float, before: float, after: float) -> float:
    """Return the secant slope of `most` T / (T + `half`) between two tensions [m/N]."""
    return most * half / ((before + half) * (after + half))


@internal
def _smooth_secant(piece: Piece, before: float, after: float) -> float:
    """Return the secant compliance without the soft spring, tensions >= 0 [m/N]."""
    bedding = _slope(piece.bedding, piece.half, before, after)
    return piece.taut + bedding + _slope(piece.clearance, piece.seating, before, after)


@internal
def compliance_between(piece: Piece, before: float, after: float) -> float:
    """Return the secant compliance between two different tensions [m/N]."""
    if before > 0.0 and after > 0.0:
        smooth = _smooth_secant(piece, before, after)
        if piece.spring == 0.0:
            return smooth
        return smooth + spring_between(piece, before, after) / (after - before)
    return (stretch_of(piece, after) - stretch_of(piece, before)) / (after - before)


@internal
def stretch_of(piece: Piece, tension: float) -> float:
    """Return the stretch [m] at a tension [N]."""
    if tension <= 0.0:
        return tension * _slack_compliance(piece)
    ending = piece.bedding / (tension + piece.half)
    smooth = piece.taut + ending + piece.clearance / (tension + piece.seating)
    return tension * smooth + spring_between(piece, 0.0, tension)


@internal
def stretch_between(piece: Piece, before: float, after: float) -> float:
    """Return the change of the stretch from one tension to another [m]."""
    if before > 0.0 and after > 0.0:
        smooth = _smooth_secant(piece, before, after) * (after - before)
        return smooth + spring_between(piece, before, after)
    return stretch_of(piece, after) - stretch_of(piece, before)


@internal
def given_between(piece: Piece, before: float, after: float) -> float:
    """Return how far clearance and soft spring give between two tensions [m]."""
    start, end = max(before, 0.0), max(after, 0.0)
    play = _slope(piece.clearance, piece.seating, start, end) * (end - start)
    slack = piece.clearance / piece.seating * (min(after, 0.0) - min(before, 0.0))
    return play + slack + spring_between(piece, before, after)


@internal
def giving_slope(piece: Piece, tension: float) -> float:
    """Return the derivative of `given_between` by the tension [m/N]."""
    pull = max(tension, 0.0)
    play = _slope(piece.clearance, piece.seating, pull, pull)
    return play if piece.spring == 0.0 else play + spring_slope(piece, tension)


@internal
def _slack_compliance(piece: Piece) -> float:
    """Return the compliance of a slack piece, which is that at tension 0 [m/N]."""
    return _smooth_secant(piece, 0.0, 0.0) + piece.spring


@internal
def tension_of(piece: Piece, stretch: float) -> float:
    """Return the tension [N] at a stretch [m].

    With bedding or clearance it is the root of a parabola. With both the stretch is
    concave in the tension, so Newton's steps rise to the root from a lower bound.
    """
    if stretch <= 0.0:
        return stretch / _slack_compliance(piece)
    if piece.spring > 0.0:
        return _tension_with_spring(piece, stretch)
    if piece.clearance == 0.0:
        return _root(piece.taut, piece.bedding, piece.half, stretch)
    if piece.bedding == 0.0:
        return _root(piece.taut, piece.clearance, piece.seating, stretch)
    most = piece.bedding + piece.clearance
    tension = _root(piece.taut, most, min(piece.half, piece.seating), stretch)
    for _ in range(_MAX_ROUNDS):
        off = stretch - stretch_of(piece, tension)
        risen = tension + off / compliance_at(piece, tension)
        if not risen > tension:
            break
        tension = risen
    return tension


@internal
def _tension_with_spring(piece: Piece, stretch: float) -> float:
    """Return the tension [N] at a stretch > 0 [m] of a piece with a soft spring."""
    # Between tensions at which the bristle begins to slide the stretch is concave, so
    # Newton's steps rise to the root from the lower one.
    sliding = piece.returned * piece.held
    tension, slope = 0.0, 1.0 / piece.returned  # of T_held by the tension
    if stretch >= stretch_of(piece, piece.held):
        tension, slope = piece.held, 1.0
    elif stretch >= stretch_of(piece, sliding):
        tension, slope = sliding, 0.0
    for _ in range(_MAX_ROUNDS):
        held = slope * tension if slope > 0.0 else piece.held
        rate = (
            _smooth_secant(piece, tension, tension)
            + _PROMPT * _hardened_slope(piece, tension)
            + (1.0 - _PROMPT) * slope * _hardened_slope(piece, held)
        )
        risen = tension + (stretch - stretch_of(piece, tension)) / rate
        if not risen > tension:
            break
        tension = risen
    return tension


@internal
def _root(taut: float, most: float, half: float, stretch: float) -> float:
    """Return the tension [N] of `taut` T + `most` T / (T + `half`) = `stretch`."""
    linear = taut * half + most - stretch
    root = math.sqrt(linear * linear + 4.0 * taut * stretch * half)
    # Of two forms the one that takes no difference of equals.
    if linear > 0.0:
        return 2.0 * stretch * half / (linear + root)
    return 0.5 * (root - linear) / taut


@internal
def energy_at(piece: Piece, tension: float) -> float:
    """Return the elastic energy at a tension, the work that unloading returns [J]."""
    if tension <= 0.0:
        return 0.0
    stored = piece.bedding * piece.half * _stored(tension / piece.half)
    seated = piece.clearance * piece.seating * _stored(tension / piece.seating)
    total = 0.5 * piece.taut * tension**2 + stored + seated
    if piece.spring > 0.0:
        total += _PROMPT * _hardened_energy(piece, tension)
        bristle = _hardened_energy(piece, held_tension(piece, tension))
        total += (1.0 - _PROMPT) * piece.returned * bristle
    return total


@internal
def _hardened_energy(piece: Piece, tension: float) -> float:
    """Return the integral of T dX from 0 to a tension, X as in the module [J]."""
    x = piece.hardening * tension
    if x < 1e-3:
        # Series of x - ln(1 + x), which loses its digits here.
        small = 0.5 - x * (1.0 / 3.0 - x * (0.25 - x * 0.2))
        return piece.spring * tension * tension * small
    return piece.spring * (x - math.log1p(x)) / piece.hardening**2


@internal
def bristle_heat(piece: Piece, before: float, after: float) -> float:
    """Return the heat of the bristle for a change between two tensions [J].

    The heat of a whole cycle is counted in loading, and `energy_at` excludes it.
    """
    if piece.returned == 1.0:
        return 0.0
    more = _hardened_energy(piece, held_tension(piece, after))
    more -= _hardened_energy(piece, held_tension(piece, before))
    return (1.0 - _PROMPT) * (1.0 - piece.returned) * max(more, 0.0)


@internal
def _stored(x: float) -> float:
    """Return the energy of a stretch e T / (T + T_b) over e T_b, at x = T / T_b."""
    if x < 1e-3:
        # Series of ln(1 + x) - x / (1 + x), which loses its digits here.
        return x * x * (0.5 - x * (2.0 / 3.0 - x * (0.75 - x * 0.8)))
    return math.log1p(x) - x / (1.0 + x)
