"""Checks of the arguments of public calls, each with a one-sentence error."""

import math
import sys
from typing import Any, TypeVar

import numpy as np

from cc_mujoco.errors import CableError, shown
from cc_mujoco.native import FloatArray

Kind = TypeVar("Kind")

MAX_FORCE = 1e12  # that is accepted [N]: 1,000 times the largest `axial_stiffness`


def require_kind(label: str, given: Any, kind: type[Kind]) -> Kind:
    if not isinstance(given, kind):
        raise CableError(f"{label} must be a {kind.__name__}, not {shown(given)}")
    return given


def numbers(
    label: str,
    given: Any,
    shape: tuple[int, ...] | None = None,
    high: float = math.inf,
    unit: str = "",
) -> FloatArray:
    """Return an argument as finite numbers of size up to `high`; `label` names it."""
    try:
        found = np.asarray(given)
    except ValueError:  # rows of unequal length
        found = np.asarray(None)
    if found.dtype.kind not in "biuf":
        raise CableError(f"{label} must be numbers, not {shown(given)}")
    array = np.asarray(found, dtype=np.float64)
    if shape is not None and array.shape != shape:
        raise CableError(f"{label} has shape {array.shape}; it must be {shape}")
    allowed = np.abs(array) <= min(high, sys.float_info.max)
    if not allowed.all():
        place = tuple(int(k) for k in np.argwhere(~allowed)[0])
        where = f"{label} {list(place)}" if place else label
        number = f"{array[place]} {unit}".rstrip()
        size = f", at most {high:g} in size" if math.isfinite(high) else ""
        raise CableError(f"{where} is {number}; it must be finite{size}")
    return array
