"""Ropes in conduits: one table of the properties of pairs of materials.

    pair = MATERIALS["steel_ptfe"]
    pair.friction.typical, pair.axial_stiffness(1e-3)

Figures per area refer to the circle around the rope, voids included, so that they
multiply the area of the nominal diameter. `design/material_sources.csv` lists the
sources of every figure; where they differ, the figure is a range. The table has only
pairs with a source.
"""

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ENDS = ("low", "typical", "high")
"""Names of the ends and the middle of a range of friction, for a variable."""


@dataclass(frozen=True)
class Figure:
    """Number with its sources and, where they differ, its range."""

    low: float
    typical: float
    high: float
    sources: tuple[str, ...]  # words of `design/material_sources.csv`

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
    hottest: Figure | None = None  # highest service temperature [degC]; None if unknown
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


def _pairs() -> Iterator[Material]:
    content = tomllib.loads(Path(__file__).with_name("materials.toml").read_text())
    for name, pair in content["pairs"].items():
        for key, value in (content["ropes"][pair.pop("rope")] | pair).items():
            if isinstance(value, list):
                low, typical, high, *sources = value
                value = Figure(low, typical, high, tuple(sources))
            pair[key] = value
        yield Material(name, **pair)


MATERIALS: dict[str, Material] = {one.name: one for one in _pairs()}
"""Every pair by name."""
