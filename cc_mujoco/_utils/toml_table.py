"""Tables of a TOML file, whose values are checked on access.

A getter of `Table` returns None for an absent key, and raises `CableError` for a value
of another kind.
"""

import math
import tomllib
from collections.abc import Container, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cc_mujoco._utils.parsing import parse_toml, unreadable
from cc_mujoco._utils.user_code import named_in_file
from cc_mujoco.errors import CableError


@dataclass(frozen=True)
class Table:
    """Table of a TOML file, with its name for error messages."""

    where: str
    content: dict[str, Any]

    def only(self, *allowed: str) -> None:
        for key in self.content:
            if key not in allowed:
                raise CableError.unknown("key", key, allowed, self.where)

    def wrong(self, key: str, right: str) -> CableError:
        return CableError(
            f"{self.where}, {key} must be {right}, not {self.shown(key)}."
        )

    def shown(self, key: str) -> str:
        text = repr(self.content[key])
        return text if len(text) <= 60 else f"{text[:57]}..."

    def table(self, key: str) -> "Table":
        """Return the table under a key of this one, an empty one if absent."""
        content = self.content.get(key, {})
        if not isinstance(content, dict):
            raise self.wrong(key, f"a table, written as [{key}]")
        return Table(f"{self.where}, [{key}]", content)

    def tables(self, key: str) -> "dict[str, Table]":
        outer = self.table(key)
        inner = {}
        for name, content in outer.content.items():
            if not isinstance(content, dict):
                raise outer.wrong(name, f"a table, written as [{key}.{name}]")
            inner[name] = Table(f"{self.where}, [{key}.{name}]", content)
        return inner

    def text(self, key: str) -> str | None:
        """Return a text, or None if it is absent."""
        value = self.content.get(key)
        if value is not None and not isinstance(value, str):
            raise self.wrong(key, "a text in quotes")
        return value

    def code(self, key: str, free: Container[str] = ()) -> str | None:
        """Return a text that may name a user's code that is allowed, or None."""
        value = self.text(key)
        return value and named_in_file(value, self.where, key, free=free)

    def flag(self, key: str) -> bool | None:
        """Return true or false, or None if it is absent."""
        value = self.content.get(key)
        if value is not None and not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def number(self, key: str, low: float = -math.inf) -> float | None:
        """Return a finite number not below `low`, or None if it is absent."""
        if key not in self.content:
            return None
        value = finite(self.content[key])
        if value is None or value < low:
            least = "" if low == -math.inf else f" of at least {low:g}"
            raise self.wrong(key, f"a finite number{least}")
        return value

    def pairs(self, key: str, right: str) -> list[tuple[float, float]] | None:
        """Return pairs of finite numbers, or None; `right` is the form in an error."""
        if key not in self.content:
            return None
        given, found = self.content[key], []
        for pair in given if isinstance(given, list) else [given]:
            match [finite(each) for each in pair] if isinstance(pair, list) else []:
                case [float(first), float(second)]:
                    found.append((first, second))
                case _:
                    raise self.wrong(key, right)
        return found

    def choice(self, key: str, allowed: Iterable[str]) -> str | None:
        """Return a text that is one of `allowed`, or None if it is absent."""
        value = self.text(key)
        if value is not None and value not in tuple(allowed):
            raise CableError.unknown(key, value, allowed, self.where)
        return value


def finite(value: object) -> float | None:
    """Return a value as a float, None if it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # TOML allows integers of any size
        return None
    return number if math.isfinite(number) else None


def read_toml(path: Path, what: str = "") -> Table:
    """Return a TOML file's content; `what` precedes its path in an error."""
    try:
        content = parse_toml(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise unreadable(f"{what}{path}", error) from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise CableError(f"{path} is not a TOML file: {error}.") from None
    return Table(str(path), content)
