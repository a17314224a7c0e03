"""Tables of a TOML file: values of the kind asked for, or a sentence that says so."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Table:
    """A table of the file, and how to call it in a sentence."""

    where: str
    content: dict[str, Any]

    def only(self, *allowed: str) -> None:
        """Refuse other keys."""
        for key in self.content:
            if key not in allowed:
                raise CableError.unknown(f"key in {self.where}", key, allowed)

    def wrong(self, key: str, right: str) -> CableError:
        """The error for a value that cannot be."""
        return CableError(f"{self.where}, {key} must be {right}, not {self.told(key)}.")

    def told(self, key: str) -> str:
        """A value as text, not too long."""
        told = repr(self.content[key])
        return told if len(told) <= 60 else f"{told[:57]}..."

    def table(self, key: str) -> Table:
        """A table inside this one, empty if it is not there."""
        content = self.content.get(key, {})
        if not isinstance(content, dict):
            raise self.wrong(key, f"a table, written as [{key}]")
        return Table(f"{self.where}, [{key}]", content)

    def tables(self, key: str) -> dict[str, Table]:
        """The tables of a table."""
        outer = self.table(key)
        inner = {}
        for name, content in outer.content.items():
            if not isinstance(content, dict):
                raise outer.wrong(name, f"a table, written as [{key}.{name}]")
            inner[name] = Table(f"{self.where}, [{key}.{name}]", content)
        return inner

    def text(self, key: str) -> str | None:
        """A text, or None if it is not there."""
        value = self.content.get(key)
        if value is not None and not isinstance(value, str):
            raise self.wrong(key, "a text in quotes")
        return value

    def number(self, key: str, low: float = -math.inf) -> float | None:
        """A finite number not below `low`, or None if it is not there."""
        if key not in self.content:
            return None
        value = finite(self.content[key])
        if value is None or value < low:
            least = "" if low == -math.inf else f" of at least {low:g}"
            raise self.wrong(key, f"a finite number{least}")
        return value

    def choice(self, key: str, allowed: Iterable[str]) -> str | None:
        """One of the words allowed, or None if it is not there."""
        value = self.text(key)
        if value is not None and value not in tuple(allowed):
            raise CableError.unknown(f"{key} in {self.where}", value, allowed)
        return value


def finite(value: object) -> float | None:
    """A finite number, or None if it is something else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # TOML allows integers of any size
        return None
    return number if math.isfinite(number) else None
