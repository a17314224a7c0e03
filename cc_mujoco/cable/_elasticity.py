"""Tension and stretch of a piece of cable: linear, or softer until it is taut.

What the strands give until they lie close, and what the cable gives in a bend that is
wider than it, add to the stretch of what is taut,

    stretch(T) = l T / EA + l e T / (T + T_b) + c theta T / (T + T_c).

EA is the stiffness of the taut cable, e the strain by which a new rope is longer for it
(constructional stretch), and T_b the tension that takes half of it. Slack cable lies at
the outer wall of a bend of angle theta, taut cable at the inner one, a path that is
shorter by the clearance c times theta; T_c takes half of it. A slack cable, of negative
tension, goes on as it is at 0. Tension follows from stretch alone, so no path of motion
leaves anything behind.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cc_mujoco.native import internal

_MAX_ROUNDS = 60


class Piece(NamedTuple):
    """Elastic element: a linear stretch (`taut` T) plus two terms that saturate."""

    taut: float  # compliance at large tensions, that of the spring included [m/N]
    bedding: float  # final stretch of bedding [m]
    half: float  # tension that takes half of it [N]
    clearance: float  # final stretch of clearance in bends [m]
    seating: float  # tension that takes half of it [N]


@internal
def compliance_at(piece: Piece, tension: float) -> float:
    """Return the derivative of the stretch by the tension [m/N]."""
    pull = max(tension, 0.0)
    return (
        piece.taut
        + _slope(piece.bedding, piece.half, pull, pull)
        + _slope(piece.clearance, piece.seating, pull, pull)
    )


@internal
def _slope(most: float, half: float, before: float, after: float) -> float:
    """Return `most` T / (T + `half`) between two tensions by their difference [m/N]."""
    return most * half / ((before + half) * (after + half))


@internal
def compliance_between(piece: Piece, before: float, after: float) -> float:
    """Stretch between two different tensions by their difference [m/N]."""
    if before > 0.0 and after > 0.0:
        return (
            piece.taut
            + _slope(piece.bedding, piece.half, before, after)
            + _slope(piece.clearance, piece.seating, before, after)
        )
    return (stretch_of(piece, after) - stretch_of(piece, before)) / (after - before)


@internal
def stretch_of(piece: Piece, tension: float) -> float:
    """Stretch [m] at a tension [N]."""
    if tension <= 0.0:
        return tension * compliance_at(piece, 0.0)
    ending = piece.bedding / (tension + piece.half)
    return tension * (piece.taut + ending + piece.clearance / (tension + piece.seating))


@internal
def tension_of(piece: Piece, stretch: float) -> float:
    """Return the tension [N] at a stretch [m].

    With one amount that ends it is the positive root of a parabola. With both, the
    stretch is concave in the tension, so that Newton's steps rise to the root from what
    one amount alone would leave.
    """
    if stretch <= 0.0:
        return stretch / compliance_at(piece, 0.0)
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
    """Return the elastic energy [J] at a tension [N]; none where slack."""
    if tension <= 0.0:
        return 0.0
    stored = piece.bedding * piece.half * _stored(tension / piece.half)
    seated = piece.clearance * piece.seating * _stored(tension / piece.seating)
    return 0.5 * piece.taut * tension**2 + stored + seated


@internal
def _stored(x: float) -> float:
    """Return the dimensionless energy of a stretch that saturates.

    It is energy / (final stretch x half tension), at x = tension / half tension.
    """
    if x < 1e-3:
        # Series of ln(1 + x) - x / (1 + x), which loses its digits here.
        return x * x * (0.5 - x * (2.0 / 3.0 - x * (0.75 - x * 0.8)))
    return math.log1p(x) - x / (1.0 + x)
