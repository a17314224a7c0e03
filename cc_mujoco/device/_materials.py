"""Ropes in conduits: one table of the properties of pairs of materials.

    pair = MATERIALS["steel_ptfe"]
    pair.friction.typical, pair.axial_stiffness(1e-3)

A figure is given per area of the circle about the rope, voids included, so that it goes
with the nominal diameter. Every figure names its sources; where they differ it is a
range. A pair for which none was found is not in the table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

WIRE_MODULUS = 207e9
"""Young's modulus of the steel of a wire [N/m^2] (source `calqlata`)."""

ENDS = ("low", "typical", "high")
"""Places in its range at which the friction of a pair may be taken."""

SOURCES: dict[str, str] = {
    "adams": "Contact parameters of Adams, as on cnblogs.com/sxhui/p/14557852.html",
    "aero": "Aero Assemblies, Elastic stretch calculator: factor 0.0000162 of 7x19 "
    "stainless, aeroassemblies.com/elastic-stretch-calculator",
    "api": "API Specification 9A, Wire rope, Table C.1: 6x7 fibre core, 6 mm, grade "
    "1770, 123doc.top/trich-doan/4943193-the-values-of-nominal-length-mass",
    "autodesk": "Autodesk Inventor help, Friction factors, "
    "help.autodesk.com/cloudhelp/2016/ENU/Inventor-Help",
    "calqlata": "CalQlata, Wire rope calculator Q&A: 32 mm 7x19, "
    "calqlata.com/productpages/00044-QandA.html",
    "carabiner": "Efficiency of AmSteel-Blue over one and two steel carabiners, 60 and "
    "48 % at 180 degrees, hwstock.org/rope/binerpulley",
    "dsm": "DSM, Technical brochure: Dyneema in marine and industrial applications: "
    "strength and elongation about those of steel of that diameter at 15 % of its "
    "weight; up to 70 degC, "
    "docobook.com/technical-brochure-dyneema-in-marine-and-industrial.html",
    "dux": "Stretch of 9 mm Dynex Dux after 50 cycles, 0.00078 per 1000 lb, "
    "catsailor.com/forum/ubbthreads.php/posts/170007",
    "firstrate": "First Rate Mold, Introduction to polyamide resins, "
    "firstratemold.com/introduction-to-polyamide-resins-nylon-pa",
    "housing": "Derailleur cable in its housing, liner not named, 0 to 540 degrees, "
    "killasgarage.bike/uncategorized/cable-routing-experimental-results",
    "lubricants": "Lubricants 13(2), 59, 2025, section 3.1: dry wire rope on a sheave "
    "and on rope, mdpi.com/2075-4442/13/2/59",
    "medh": "Mechanical Engineer's Data Handbook, p. 243: PTFE up to 260 degC, "
    "digilib.universitaspertamina.ac.id/ebook/Mechanical Engineer's Data Handbook",
    "ptc": "PTC Windchill, Friction coefficients, support.ptc.com/help/wrr/r12.0.0.0/"
    "en/wrr/ReferenceGuide/prediction/friction_coefficients.html",
    "ptfe": "Teflon PTFE, 0.05 to 0.08 and 0.10 at high load, "
    "corilonsyw.com/news-s-20.html",
    "quadrant": "Quadrant, Nylon 101: 0.25 dry on steel, up to 210 degF, "
    "pittsburgh.lairdplastics.com/product/materials/nylon/3350-nylon-101",
    "samson": "AmSteel-Blue of 3/16 in, rated 5400 lb as quoted on "
    "arboristsite.com/threads/amsteel-blue-splicing-experiments.66833",
    "schooner": "1/4 in: 7x7 stainless 4800 lb, Dyneema 8000 to 12000 lb, "
    "schooner-britannia.com/dyneema_splice.html",
    "steel_cable": "7x7 stainless of 1/16 in, 480 lb, "
    "0685.com/continuing-education/be-self-taught/44804.html",
}
"""Sources of the figures, by the word that names each in the table."""


@dataclass(frozen=True)
class Figure:
    """Number with its sources and, where they differ, its range."""

    low: float
    typical: float
    high: float
    sources: tuple[str, ...]
    """Keys of `SOURCES`."""

    @classmethod
    def one(cls, value: float, source: str) -> Figure:
        return cls(value, value, value, (source,))

    def at(self, end: str) -> float:
        return float(getattr(self, end))


@dataclass(frozen=True)
class Material:
    """A rope in a conduit."""

    name: str
    meaning: str
    lubricated: bool
    friction: Figure
    """Kinetic friction coefficient between the two [1]."""
    modulus: Figure
    """Effective modulus of the rope [N/m^2]."""
    density: Figure
    """Density of the rope [kg/m^3]."""
    strength: Figure
    """Breaking load of the rope per area [N/m^2]."""
    hottest: Figure | None
    """Highest service temperature [degC]; None where none was found."""
    wires: int = 0
    """Wires side by side across the rope; 0 where it is of fibres."""

    def axial_stiffness(self, diameter: float) -> float:
        """Return EA [N] of a rope of this diameter [m]."""
        return self.modulus.typical * area(diameter)

    def breaking_load(self, diameter: float) -> float:
        """Return the breaking load [N] of a rope of this diameter [m]."""
        return self.strength.typical * area(diameter)


def area(diameter: float) -> float:
    """Area of the circle about a rope of this diameter [m]; in m^2."""
    return 0.25 * math.pi * diameter**2


_POUND = 4.4482216  # N


def _per_area(pounds: float, inches: float) -> float:
    return pounds * _POUND / area(0.0254 * inches)


def _turned(share: float) -> float:
    """Return the friction at which a share of a pull is left after half a turn."""
    return math.log(1.0 / share) / math.pi


_STEEL_MODULUS = Figure(
    # E over the metal times its share of the circle; 1 % per G pounds per square inch.
    111.824e9 * 365.279 / 804.248,
    100.0 * _POUND / (0.0000162 * 0.25 * math.pi * 0.0254**2),
    100.0 * _POUND / (0.0000162 * 0.25 * math.pi * 0.0254**2),
    ("calqlata", "aero"),
)
_STEEL_DENSITY = Figure(
    2.867 / area(0.032), 0.124 / area(0.006), 0.124 / area(0.006), ("calqlata", "api")
)
_STEEL_STRENGTH = Figure(
    _per_area(4800.0, 0.25),
    21.2e3 / area(0.006),
    _per_area(480.0, 0.0625),
    ("schooner", "api", "steel_cable"),
)
_NYLON_HOTTEST = Figure.one(99.0, "quadrant")


def _steel(
    name: str,
    meaning: str,
    friction: Figure,
    hottest: Figure | None,
    lubricated: bool = False,
) -> Material:
    rope = _STEEL_MODULUS, _STEEL_DENSITY, _STEEL_STRENGTH
    # 15 wires across: three strands of 7x19 side by side, of five wires each
    return Material(name, meaning, lubricated, friction, *rope, hottest, 15)


MATERIALS: dict[str, Material] = {
    material.name: material
    for material in (
        _steel(
            "steel_ptfe",
            "steel rope in a conduit lined with PTFE, dry",
            Figure(0.05, 0.06, 0.10, ("ptfe", "housing")),
            Figure.one(260.0, "medh"),
        ),
        _steel(
            "nylon_steel_ptfe",
            "steel rope coated with nylon, in a conduit lined with PTFE, dry; figures "
            "are of the rope without its coat",
            Figure(0.04, 0.05, 0.05, ("ptc",)),
            _NYLON_HOTTEST,
        ),
        _steel(
            "steel_nylon",
            "steel rope in a conduit lined with nylon, dry",
            Figure(0.15, 0.25, 0.30, ("firstrate", "quadrant", "ptc")),
            _NYLON_HOTTEST,
        ),
        _steel(
            "steel_steel_greased",
            "steel rope in a bare steel coil, greased",
            Figure(0.05, 0.16, 0.50, ("adams", "autodesk", "ptc")),
            None,
            lubricated=True,
        ),
        _steel(
            "steel_steel",
            "steel rope in a bare steel coil, dry",
            Figure(0.72, 0.72, 0.80, ("lubricants", "ptc", "autodesk")),
            None,
        ),
        Material(
            "dyneema_steel",
            "braided UHMWPE rope (Dyneema) in a bare steel coil, dry; its stiffness is "
            "that of rope that was bedded in",
            False,
            Figure(_turned(0.60), _turned(0.60), _turned(0.48), ("carabiner",)),
            Figure(
                _STEEL_MODULUS.typical,
                _STEEL_MODULUS.typical,
                1000.0 * _POUND / 0.00078 / area(0.009),
                ("dsm", "dux"),
            ),
            Figure.one(0.15 * _STEEL_DENSITY.typical, "dsm"),
            Figure(
                _per_area(8000.0, 0.25),
                _per_area(5400.0, 0.1875),
                _per_area(12000.0, 0.25),
                ("schooner", "samson"),
            ),
            Figure.one(70.0, "dsm"),
        ),
    )
}
"""Every pair by name."""


def table_rows(materials: Iterable[Material]) -> list[list[str]]:
    """Return pairs as rows of text below the heads of the columns."""
    head = ["material", "rope and conduit", "friction", "modulus [GPa]"]
    head += ["density [kg/m^3]", "strength [GPa]", "hottest [degC]"]
    rows = [
        [
            one.name,
            one.meaning,
            _interval_text(one.friction),
            _interval_text(one.modulus, 1e-9),
            _interval_text(one.density),
            _interval_text(one.strength, 1e-9),
            "-" if one.hottest is None else _interval_text(one.hottest),
        ]
        for one in materials
    ]
    return [head, *rows]


def source_rows(materials: Iterable[Material]) -> list[list[str]]:
    """Return the sources of the figures of pairs, below the heads of the columns."""
    used: set[str] = set()
    for one in materials:
        for figure in vars(one).values():
            if isinstance(figure, Figure):
                used.update(figure.sources)
    return [["source", "what it is"], *([key, SOURCES[key]] for key in sorted(used))]


def _interval_text(figure: Figure, scale: float = 1.0) -> str:
    """`typical (low to high; sources)`, without a range where there is none."""
    values = (figure.low, figure.typical, figure.high)
    low, typical, high = (f"{float(f'{scale * value:.3g}'):g}" for value in values)
    span = "" if low == high else f"{low} to {high}; "
    return f"{typical} ({span}{', '.join(figure.sources)})"
