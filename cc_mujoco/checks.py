"""Checks of numbers: one sentence when one is wrong."""

from __future__ import annotations

import math
from typing import Any

from cc_mujoco.errors import CableError

LONGEST = 1e4
"""Most that an episode may last [s]; all of its motion is kept in memory."""


def number(label: str, value: Any, low: float, high: float, unit: str) -> None:
    """Check that a value is a number in [low, high].

    Raises:
        CableError: If it is not (NaN never is), naming it and the range.
    """
    try:
        admitted = bool(low <= value <= high)
    except (TypeError, ValueError):
        admitted = False
    if not admitted:
        among = f"a number in [{low:g}, {high:g}] {unit}".rstrip()
        if low == -math.inf and high == math.inf:
            among = "one number"
        raise CableError(f"{label} must be {among}, not {value!r}.")


def parameter(owner: object, name: str, low: float, high: float, unit: str) -> None:
    """Check that an attribute of an object is a number in [low, high].

    Raises:
        CableError: If it is not, naming the object's class and the attribute.
    """
    number(f"{type(owner).__name__}.{name}", getattr(owner, name), low, high, unit)
