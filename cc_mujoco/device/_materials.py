"""Ropes in conduits: one table of the properties of pairs of materials.

    pair = MATERIALS["steel_ptfe"]
    pair.friction.typical, pair.axial_stiffness(1e-3)

Figures per area refer to the circle around the rope, voids included, so that they
multiply the area of the nominal diameter. `design/material_sources.csv` lists the
sources of every figure; where they differ, the figure is a range. The table has only
pairs with a source.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

ENDS = ("low", "typical", "high")
"""Names of the ends and the middle of a range of friction, for a variable."""


@dataclass(frozen=True)
class Figure:
    """Number with its sources and, where they differ, its range."""

    low: float
    typical: float
    high: float
    sources: tuple[str, ...]  # words of `design/material_sources.csv`

    @classmethod
    def one(cls, value: float, source: str) -> Figure:
        return cls(value, value, value, (source,))

    def at(self, end: str) -> float:
        return float(getattr(self, end))


@dataclass(frozen=True)
class Material:
    """Material properties of a rope and of its friction in a conduit."""

    name: str
    meaning: str
    friction: Figure  # kinetic friction coefficient between the two [1]
    modulus: Figure  # effective modulus of the rope [N/m^2]
    density: Figure  # density of the rope [kg/m^3]
    strength: Figure  # breaking load of the rope per area [N/m^2]
    hottest: Figure | None  # highest service temperature [degC]; None if unknown
    wires: int = 0  # wires side by side across the rope; 0 where it is of fibres

    def axial_stiffness(self, diameter: float) -> float:
        """Return EA [N] of a rope of this diameter [m]."""
        return self.modulus.typical * area(diameter)

    def breaking_load(self, diameter: float) -> float:
        """Return the breaking load [N] of a rope of this diameter [m]."""
        return self.strength.typical * area(diameter)


def area(diameter: float) -> float:
    """Area of the circle around a rope of this diameter [m], in m^2."""
    return 0.25 * math.pi * diameter**2


def _per_area(pounds: float, inches: float) -> float:
    return pounds * 4.4482216 / area(0.0254 * inches)


def _turned(share: float) -> float:
    """Return the friction mu of a rope with a `share` exp(-mu pi) over half a turn."""
    return math.log(1.0 / share) / math.pi


def _pairs() -> Iterator[Material]:
    # E over the metal times its share of the circle; 1 % per G pounds per square inch.
    inch = 100.0 * 4.4482216 / (0.0000162 * 0.25 * math.pi * 0.0254**2)
    circle = 111.824e9 * 365.279 / 804.248
    modulus = Figure(circle, inch, inch, ("calqlata", "aero"))
    dense = 0.124 / area(0.006)
    density = Figure(2.867 / area(0.032), dense, dense, ("calqlata", "api"))
    strong = _per_area(4800.0, 0.25), 21.2e3 / area(0.006), _per_area(480.0, 0.0625)
    steel = modulus, density, Figure(*strong, ("schooner", "api", "steel_cable"))
    nylon = Figure.one(99.0, "quadrant")  # hottest
    # 15 wires across: three strands of 7x19 side by side, of five wires each
    yield Material(
        "steel_ptfe",
        "steel rope in a conduit lined with PTFE, dry",
        Figure(0.05, 0.06, 0.10, ("ptfe", "housing")),
        *steel,
        Figure.one(260.0, "medh"),
        15,
    )
    yield Material(
        "nylon_steel_ptfe",
        "steel rope coated with nylon, in a conduit lined with PTFE, dry; figures are "
        "of the rope without its coat",
        Figure(0.04, 0.05, 0.05, ("ptc",)),
        *steel,
        nylon,
        15,
    )
    yield Material(
        "steel_nylon",
        "steel rope in a conduit lined with nylon, dry",
        Figure(0.15, 0.25, 0.30, ("firstrate", "quadrant", "ptc")),
        *steel,
        nylon,
        15,
    )
    yield Material(
        "steel_steel_greased",
        "steel rope in a bare steel coil, greased",
        Figure(0.05, 0.16, 0.50, ("adams", "autodesk", "ptc")),
        *steel,
        None,
        15,
    )
    yield Material(
        "steel_steel",
        "steel rope in a bare steel coil, dry",
        Figure(0.72, 0.72, 0.80, ("lubricants", "ptc", "autodesk")),
        *steel,
        None,
        15,
    )
    bedded = 1000.0 * 4.4482216 / 0.00078 / area(0.009)
    strong = _per_area(8000.0, 0.25), _per_area(5400.0, 0.1875), _per_area(12e3, 0.25)
    yield Material(
        "dyneema_steel",
        "braided UHMWPE rope (Dyneema) in a bare steel coil, dry; its stiffness is "
        "that of rope that was bedded in",
        Figure(_turned(0.60), _turned(0.60), _turned(0.48), ("carabiner",)),
        Figure(modulus.typical, modulus.typical, bedded, ("dsm", "dux")),
        Figure.one(0.15 * density.typical, "dsm"),
        Figure(*strong, ("schooner", "samson")),
        Figure.one(70.0, "dsm"),
    )


MATERIALS: dict[str, Material] = {one.name: one for one in _pairs()}
"""Every pair by name."""
