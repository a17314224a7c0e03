"""Log columns of a device with several axes: each begins with the name of its axis.

column_prefixes(["hip", "ankle"])           # ("hip.", "ankle.")
column_prefixes(["knee"])                   # ("",)
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cc_mujoco.errors import CableError


def column_prefixes(names: Iterable[str]) -> tuple[str, ...]:
    """Return the prefix of each axis's columns: `NAME.`, or "" for a single axis."""
    found = tuple(names)
    return ("",) if len(found) == 1 else tuple(f"{name}." for name in found)


def axis_columns(
    columns: Mapping[str, Any], prefix: str, prefixes: Sequence[str]
) -> Mapping[str, Any]:
    """Return one axis's columns without `prefix`, and those common to all axes."""
    if not prefix:
        return columns
    every, size = tuple(prefixes), len(prefix)
    found = {n: value for n, value in columns.items() if not n.startswith(every)}
    for name, value in columns.items():
        if name.startswith(prefix):
            found[name[size:]] = value
    return found


def split_by_axis(text: str, names: Iterable[str]) -> str | dict[str, str]:
    """Return the value for each axis from a text such as `hip=pi,ankle=model`.

    A text that names no axis is returned unchanged. `hip=sine:0.3,frequency=2` is one
    value: after a colon, `NAME=NUMBER` belongs to it.
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
