"""Descriptor of a quantity that is set, varied, fitted or reported.

    period: float = parameter(
        unit="s", bounds=(0.0, 1e3), default=1e-3, meaning="time between two steps"
    )
    Parameter("gearing", "1", "turns of the rotor per turn of the pulley", 0.0, 1e4)

A field of a dataclass carries its descriptor (`parameter`, `parameters_of`). From those
of `Cable` derive the table `PARAMETERS`, the indices of the packed vector, fast paths
of the kernel, the terms that estimators refuse, and the table in the documentation.
Variables of designs, effects and fits are described in the same way.
"""

import dataclasses
import math
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, NamedTuple

from cc_mujoco.errors import CableError, look_up, shown

ActsOn = Literal["coefficient", "drag", "elasticity", "pulley"]
"""Part of the cable's laws that a term changes: coefficient of Coulomb friction,
friction that needs no tension, stretch of the cable, its ends or its contacts, or the
winding on the proximal pulley."""

Dependence = Literal["rate", "history", "direction", "load", "time", "place"]
"""Quantity on which a term depends; a term without any is constant."""


class Term(NamedTuple):
    """Part of the cable's laws that a parameter switches on by not being 0.

    Attributes:
        equation: the law.
        source: publication, or the mechanism that it describes.
        acts_on: part of the laws that the term changes.
        depends_on: quantities on which it depends; empty if constant.
        constant_without: another parameter that makes the term constant if it is 0.
    """

    equation: str
    source: str
    acts_on: ActsOn
    depends_on: tuple[Dependence, ...] = ()
    constant_without: str = ""


@dataclass(frozen=True)
class Parameter:
    """Name, unit, bounds, meaning and source of one quantity.

    A number lies in [low, high], or in (low, high] if `low_open`; NaN never does.
    """

    name: str
    unit: str = "1"
    """Unit [SI]; `"1"` or empty where there is none."""
    meaning: str = ""
    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    default: float = math.nan
    """Value if none is given; NaN if it must be given."""
    scale: Literal["linear", "log"] = "linear"
    """Scale on which it is varied and fitted; positive numbers only for `"log"`."""
    source: str = ""
    """Publication, or what the quantity stands for."""
    whole: bool = False
    """True if only whole numbers are allowed."""
    text: bool = False
    """True if its values are texts."""
    choices: tuple[str, ...] = ()
    """Allowed texts; empty where any text is."""
    term: Term | None = None
    """Law of the cable that a value other than 0 switches on."""

    @property
    def span(self) -> str:
        """Bounds as the text of an interval."""
        return f"{'(' if self.low_open else '['}{self.low:g}, {self.high:g}]"

    @property
    def allowed(self) -> str:
        """Allowed values as text, with their unit."""
        if self.text:
            return "a text"
        if self.low == -math.inf and self.high == math.inf:
            return "one number"
        kind = "a whole number" if self.whole else "a number"
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        return f"{kind} in {self.span}{unit}"

    def admits(self, value: Any) -> bool:
        """Return whether a value is a number within the bounds, integral if `whole`.

        Truth values and arrays are not admitted, though they compare as numbers.
        """
        # A check for `Real` takes much longer than one for `float`.
        is_number = isinstance(value, float) or isinstance(value, Real)
        if not is_number or isinstance(value, bool):
            return False
        above = value > self.low if self.low_open else value >= self.low
        within = above and value <= self.high
        return bool(within and (not self.whole or float(value).is_integer()))

    def check(self, value: Any, label: str = "") -> None:
        """Require that a value is admitted.

        Args:
            value: candidate value.
            label: subject of the error; by default the name.

        Raises:
            CableError: it is not.
        """
        if not self.admits(value):
            raise self._refusal(value, label)

    def read(self, value: object, label: str = "") -> float | int | str:
        """Return a value that may be given as text, for instance on a command line.

        Args:
            value: text or number.
            label: subject of the error; by default the name.

        Returns:
            The text where `text`; an `int` where `whole`; else a finite `float`.

        Raises:
            CableError: the value is not allowed.
        """
        if self.choices:
            look_up(self.name, str(value), dict.fromkeys(self.choices))
        if self.text:
            return str(value)
        try:
            number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            number = math.nan
        if not (math.isfinite(number) and self.admits(number)):
            raise self._refusal(value, label)
        return round(number) if self.whole else number

    def _refusal(self, value: object, label: str) -> CableError:
        label = label or self.name
        return CableError(f"{label} must be {self.allowed}, not {shown(value)}.")


def parameter(
    *,
    unit: str,
    bounds: tuple[float, float],
    default: float,
    meaning: str,
    low_open: bool = False,
) -> float:
    """Define a field of a dataclass that carries its `Parameter`."""
    described = Parameter("", unit, meaning, *bounds, low_open, default)
    return dataclasses.field(default=default, metadata={"parameter": described})


def parameters_of(owner: Any) -> tuple[Parameter, ...]:
    """Return the parameters that the fields of a dataclass carry, in order."""
    return tuple(
        dataclasses.replace(field.metadata["parameter"], name=field.name)
        for field in dataclasses.fields(owner)
        if "parameter" in field.metadata
    )
