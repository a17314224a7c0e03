"""Checks of arguments: one sentence when one is wrong."""

from collections.abc import Iterable, Mapping
from dataclasses import field, fields
from typing import Any

from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.errors import CableError, shown

MAX_DURATION = 1e4
"""Most that an episode may last [s]; all of its motion is kept in memory."""


def require_number(label: str, value: Any, low: float, high: float, unit: str) -> None:
    """Check that a value is a number in [low, high].

    Raises:
        CableError: If it is not (NaN never is), naming it and the range.
    """
    if not (type(value) is float and low <= value <= high):  # most are
        Parameter(label, unit, low=low, high=high).check(value)


def require_parameter(
    owner: object, name: str, low: float, high: float, unit: str
) -> None:
    """Check that an attribute of an object is a number in [low, high].

    Raises:
        CableError: If it is not, naming the object's class and the attribute.
    """
    require_number(
        f"{type(owner).__name__}.{name}", getattr(owner, name), low, high, unit
    )


def bounded(default: float, low: float, high: float, unit: str) -> Any:
    """Return a field of a dataclass whose `require_bounds` keeps it in [low, high]."""
    return field(default=default, metadata={"bounds": (low, high, unit)})


def require_bounds(owner: Any) -> None:
    """Check that every `bounded` field of a dataclass is a number within its bounds.

    Raises:
        CableError: The first that is not, as `require_parameter`.
    """
    for one in fields(owner):
        if "bounds" in one.metadata:
            require_parameter(owner, one.name, *one.metadata["bounds"])


def require_list(label: str, given: Any) -> tuple[str, ...]:
    """Check that an argument is a list of texts, and not one text.

    Raises:
        CableError: If it is not.
    """
    found = tuple(given) if isinstance(given, Iterable) else (given,)
    if isinstance(given, str) or not all(isinstance(one, str) for one in found):
        raise CableError(f"{label} must be a list of texts, not {shown(given)}.")
    return found


def require_dictionary(label: str, given: Any) -> Mapping[str, Any]:
    """Check that an argument is a dictionary by name; None is an empty one.

    Raises:
        CableError: If it is not.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise CableError(f"{label} must be a dictionary, not {shown(given)}.")
    for name in given:
        if not isinstance(name, str):
            raise CableError(f"{label} must have texts as names, not {shown(name)}.")
    return given
