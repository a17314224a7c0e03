"""Metadata of a field of `Cable`: unit, bounds, meaning, and its law if any.

    friction_drift: float = parameter(
        unit="1/s", bounds=(-1e3, 1e3), default=0.0, meaning="...",
        term=Term("mu *= 1 + d t", "thesis 3.2.3", "coefficient", ("time",)),
    )

All that depends on which terms there are derives from this: the table `PARAMETERS`, the
indices of the packed vector, the kernel's short cuts, what estimators refuse, the table
in the documentation and the lists of the tests.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from cc_mujoco import markdown

ActsOn = Literal["coefficient", "drag", "elasticity", "pulley"]
"""Target of a term: friction in proportion to tension and wrap angle, friction that
needs no tension, stretch (of the cable, its end or its contacts), or how the proximal
pulley winds the cable."""

Dependence = Literal["rate", "history", "direction", "load", "time", "place"]
"""Cause of a term's changes while a cable runs; a term without any is constant."""

_KEY = "parameter"


class Term(NamedTuple):
    """The law that a parameter switches on; off, bit for bit, while that is 0.

    Attributes:
        equation: the law.
        source: publication, or what it stands for.
        acts_on: what it changes.
        depends_on: what that changes with; empty if it is constant.
        constant_without: the parameter without which, too, it is constant.
    """

    equation: str
    source: str
    acts_on: ActsOn
    depends_on: tuple[Dependence, ...] = ()
    constant_without: str = ""


@dataclass(frozen=True)
class Parameter:
    """One scalar parameter of a cable.

    The value must lie in [low, high], or in (low, high] where `low_open`. One with a
    `term` switches it on; the others describe the cable, or shape a term.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    low_open: bool = False
    term: Term | None = None

    @property
    def span(self) -> str:
        """The allowed range as an interval."""
        return f"{'(' if self.low_open else '['}{self.low:g}, {self.high:g}]"

    @property
    def allowed(self) -> str:
        """The allowed range as text, with its unit."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"a number in {self.span}{unit}"

    def admits(self, value: float) -> bool:
        """Return whether `value` is finite and within bounds."""
        above = value > self.low if self.low_open else value >= self.low
        return above and value <= self.high


def parameter(
    *,
    unit: str,
    bounds: tuple[float, float],
    default: float,
    meaning: str,
    low_open: bool = False,
    term: Term | None = None,
) -> float:
    """A field of a dataclass that carries its `Parameter`."""
    described = Parameter("", unit, *bounds, default, meaning, low_open, term)
    return dataclasses.field(default=default, metadata={_KEY: described})


def parameters_of(owner: Any) -> tuple[Parameter, ...]:
    """The parameters that the fields of a dataclass carry, in their order."""
    return tuple(
        dataclasses.replace(field.metadata[_KEY], name=field.name)
        for field in dataclasses.fields(owner)
        if _KEY in field.metadata
    )


def as_table(parameters: tuple[Parameter, ...]) -> str:
    """Parameters as a Markdown table."""
    return markdown.table(
        ("key", "unit", "range", "default", "meaning"),
        [
            (f"`{p.name}`", p.unit, p.span, f"{p.default:g}", p.meaning)
            for p in parameters
        ],
    )
