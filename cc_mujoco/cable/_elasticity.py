"""Tension and stretch of a piece of cable: linear, or softer while its strands bed in.

With bedding, what the strands give until they lie close adds to the stretch of what is
taut,

    strain(T) = T / EA + e T / (T + T_b),

so that EA is the stiffness of the taut cable, e the strain by which a new rope is
longer for it (constructional stretch), and T_b the tension that takes half of it. A
slack cable, of negative tension, goes on as it is at 0. `spring` is a compliance in
series [m/N]. Both directions are closed forms: tension follows from stretch alone, so
no path of motion leaves anything behind.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cc_mujoco.native import internal


class Piece(NamedTuple):
    """Elastic element that stretches by `taut` T + `bedding` T / (T + `half`).

    Attributes:
        taut: compliance at large tensions, that of the spring included [m/N].
        bedding: stretch that bedding takes in the end [m].
        half: tension that takes half of it [N].
    """

    taut: float
    bedding: float
    half: float


@internal
def compliance_at(piece: Piece, tension: float) -> float:
    """Return the derivative of the stretch by the tension [m/N]."""
    all_in = max(tension, 0.0) + piece.half
    return piece.taut + piece.bedding * piece.half / (all_in * all_in)


@internal
def compliance_between(piece: Piece, before: float, after: float) -> float:
    """Stretch between two different tensions by their difference [m/N]."""
    if before > 0.0 and after > 0.0:
        low, high = before + piece.half, after + piece.half
        return piece.taut + piece.bedding * piece.half / (low * high)
    return (stretch_of(piece, after) - stretch_of(piece, before)) / (after - before)


@internal
def stretch_of(piece: Piece, tension: float) -> float:
    """Stretch [m] at a tension [N]."""
    if tension <= 0.0:
        return tension * compliance_at(piece, 0.0)
    return tension * (piece.taut + piece.bedding / (tension + piece.half))


@internal
def tension_of(piece: Piece, stretch: float) -> float:
    """Return the tension [N] at a stretch [m]: the positive root of a parabola."""
    if stretch <= 0.0:
        return stretch / compliance_at(piece, 0.0)
    linear = piece.taut * piece.half + piece.bedding - stretch
    root = math.sqrt(linear * linear + 4.0 * piece.taut * stretch * piece.half)
    # Of two forms the one that takes no difference of equals.
    if linear > 0.0:
        return 2.0 * stretch * piece.half / (linear + root)
    return 0.5 * (root - linear) / piece.taut


@internal
def energy_at(piece: Piece, tension: float) -> float:
    """Return the elastic energy [J] at a tension [N]; none where slack."""
    if tension <= 0.0:
        return 0.0
    x = tension / piece.half
    if x < 1e-3:
        # Series of ln(1 + x) - x / (1 + x), which loses its digits here.
        stored = x * x * (0.5 - x * (2.0 / 3.0 - x * (0.75 - x * 0.8)))
    else:
        stored = math.log1p(x) - x / (1.0 + x)
    return 0.5 * piece.taut * tension**2 + piece.bedding * piece.half * stored
