"""Tension along a cable in closed form over the capstan angle (see `continuum`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Route(NamedTuple):
    """Compliance of a conduit over the capstan angle.

    Attributes:
        angle: Capstan angle of the edges between bends, (m+1,).
        density: Compliance per unit angle R / (mu EA) of each bend [m/N], (m,).
        lump: Compliance of the straight cable at each edge [m/N], (m+1,).
    """

    angle: list[float]
    density: list[float]
    lump: list[float]

    def mirrored(self) -> Route:
        """Return the same conduit seen from the distal end."""
        return Route(
            [self.angle[-1] - a for a in reversed(self.angle)],
            self.density[::-1],
            self.lump[::-1],
        )


class Piece(NamedTuple):
    """Part of one bend on which ln T is straight: T = tension e^(slope (phi - low))."""

    low: float
    high: float
    tension: float
    slope: float
    density: float
    lump: float  # straight cable at `low`, not counted by the piece before


class Front(NamedTuple):
    """Front at the far end of a run of pieces, or inside one."""

    angle: float
    stretch: float  # magnitude of the stretch change behind the front [m]
    weight: float  # integral of e^(sign (front - phi)) dC behind the front [m/N]


@dataclass
class Profile:
    """Tension along a taut cable: knots in angle, ln T at them, slope between them."""

    knots: list[float]
    log_tension: list[float]
    slopes: list[float]

    def at(self, angle: float) -> float:
        """Tension [N] at a capstan angle."""
        return math.exp(float(np.interp(angle, self.knots, self.log_tension)))


def build_route(
    sections: Sequence[tuple[float, float]], friction: float, axial_stiffness: float
) -> Route:
    """Lay (length, radius) sections, radius inf when straight, along the angle."""
    angle, density, lump = [0.0], [], [0.0]
    for length, radius, *_ in sections:
        turn = friction * length / radius
        if turn > 0.0:
            angle.append(angle[-1] + turn)
            density.append(length / (turn * axial_stiffness))
            lump.append(0.0)
        else:
            lump[-1] += length / axial_stiffness
    return Route(angle, density, lump)


def _integral(rate: float, width: float) -> float:
    """Integral of e^(rate z) over 0 < z < width."""
    return math.expm1(rate * width) / rate if rate else width


def cut(route: Route, profile: Profile) -> list[Piece]:
    """Cut a profile at the edges of the bends."""
    pieces = []
    for i, density in enumerate(route.density):
        low, end = route.angle[i], route.angle[i + 1]
        inner = [k for k in profile.knots if low < k < end]
        lump = route.lump[i]
        for high in [*inner, end]:
            j = int(np.searchsorted(profile.knots, 0.5 * (low + high))) - 1
            rise = profile.slopes[j] * (low - profile.knots[j])
            tension = math.exp(profile.log_tension[j] + rise)
            pieces.append(Piece(low, high, tension, profile.slopes[j], density, lump))
            low, lump = high, 0.0
    return pieces


def mirror(pieces: list[Piece], route: Route) -> list[Piece]:
    """Return the same pieces seen from the distal end."""
    total = route.angle[-1]
    lumps = [*(piece.lump for piece in pieces), route.lump[-1]][1:]
    return [
        Piece(
            total - p.high,
            total - p.low,
            p.tension * math.exp(p.slope * (p.high - p.low)),
            -p.slope,
            p.density,
            lump,
        )
        for p, lump in zip(reversed(pieces), reversed(lumps), strict=True)
    ]


def grow(front: Front, piece: Piece, sign: float, width: float) -> Front:
    """Move a front from the start of a piece to `width` inside it.

    Behind a front at f the tension is T(f) e^(sign (f - phi)); sign +1 when the end
    stretches the cable, -1 when it releases it. With G the weight, moving the front by
    df adds (sign + slope) T(f) G(f) df of stretch, and dG/df = sign G + density.
    """
    weight, base = front.weight + piece.lump, sign * piece.density
    change = (weight + base) * _integral(piece.slope + sign, width)
    change -= base * _integral(piece.slope, width)
    stretch = abs(sign + piece.slope) * piece.tension * change
    weight = (weight + base) * math.exp(sign * width) - base
    return Front(piece.low + width, front.stretch + stretch, weight)
