"""Units of the columns of a file, and their recognition in a column's name.

>>> from cc_mujoco._utils.units import ANGLE, unit_of
>>> unit = unit_of("motor_angle_deg", ANGLE)
>>> unit, round(ANGLE.factors[unit], 6)
('deg', 0.017453)
"""

import math
import re
from typing import NamedTuple


class Kind(NamedTuple):
    """A physical quantity, and the factors from its units to SI."""

    name: str  # the word for it
    unit: str  # the unit it has inside the program
    factors: dict[str, float]  # size of that unit in every unit that a file may use


_TURN, _KGF, _LBF, _INCH = 2.0 * math.pi, 9.80665, 4.4482216152605, 0.0254
CLOCK = Kind("time", "s", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})
ANGLE = Kind(
    "angle", "rad", {"rad": 1.0, "mrad": 1e-3, "deg": _TURN / 360, "rev": _TURN}
)
TORQUE = Kind(
    "torque",
    "Nm",
    {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2}
    | {"kgfcm": 1e-2 * _KGF, "lbfin": _INCH * _LBF},
)
FORCE = Kind("force", "N", {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": _KGF, "lbf": _LBF})
PHASE = Kind("phase", "1", {"percent": 1e-2, "%": 1e-2})
_UNITS = {
    unit.lower() for kind in (CLOCK, ANGLE, TORQUE, FORCE) for unit in kind.factors
} | {"m", "mm"}


def words(column: str) -> list[str]:
    """Return the lower-case words of a column's name, its unit spelled as usual."""
    parts = re.split(r"[\s_.,:;|(){}\[\]-]+", column.lower())
    found = [word for word in parts if word]
    others = {"\N{DEGREE SIGN}": "deg", "degree": "deg", "degrees": "deg"}
    others |= {"turns": "rev", "sec": "s", "\N{MICRO SIGN}s": "us"}
    return [*found[:-1], *(others.get(word, word) for word in found[-1:])]


def last_word(column: str) -> str:
    """Return the last word of a column's name; "" for a rate such as `speed_rad_s`."""
    found = words(column)
    if not found or (len(found) > 1 and found[-2] in _UNITS):
        return ""
    return found[-1]


def unit_of(column: str, measured: Kind) -> str | None:
    """Return the unit of a quantity with which a column's name ends, or None."""
    word = last_word(column)
    return next((unit for unit in measured.factors if unit.lower() == word), None)


def quantity_words(column: str, measured: Kind) -> tuple[tuple[str, ...], str | None]:
    """Return the words of a column's name without the quantity's, and its unit or None.

    For `ANGLE`, `knee_angle_deg` gives `("knee",)` and `deg`.
    """
    unit = unit_of(column, measured)
    found = words(column)
    left = found if unit is None else found[:-1]
    return tuple(word for word in left if word != measured.name), unit
