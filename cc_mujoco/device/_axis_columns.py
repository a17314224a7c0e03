"""Columns of a device with several axes: those of an axis begin with its name.

column_prefixes(["hip", "ankle"])           # ("hip.", "ankle."); of one axis ("",)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cc_mujoco.errors import CableError


def column_prefixes(names: Iterable[str]) -> tuple[str, ...]:
    """Return the beginnings of the columns of axes by their names."""
    found = tuple(names)
    return ("",) if len(found) == 1 else tuple(f"{name}." for name in found)


def axis_columns(
    columns: Mapping[str, Any], prefix: str, prefixes: Sequence[str]
) -> Mapping[str, Any]:
    """Return the columns of one axis under plain names, with those of the device."""
    if not prefix:
        return columns
    every, size = tuple(prefixes), len(prefix)
    found = {n: value for n, value in columns.items() if not n.startswith(every)}
    for name, value in columns.items():
        if name.startswith(prefix):
            found[name[size:]] = value
    return found


def split_by_axis(text: str, names: Iterable[str]) -> str | dict[str, str]:
    """Return the parts of `hip=pi,ankle=model` by axis, or a text without any.

    `hip=sine:0.3,frequency=2` is one part, as numbers follow a colon.
    """
    known, last = tuple(names), ""
    found: dict[str, str] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        is_number = last and ":" in found[last]
        if equals and name.strip() in known:
            last = name.strip()
            if last in found:
                raise CableError(f"axis {last!r} is given twice in {text!r}.")
            found[last] = value.strip()
        elif equals and known and name.strip().isidentifier() and not is_number:
            raise CableError.unknown("axis", name.strip(), known)
        elif last:
            found[last] += f",{part}"
        else:
            return text
    return found
