"""Trajectories and tasks as text: a name, a name with numbers, a file, a user's object.

    with_numbers("task", "hold:-12", TASKS)            # Hold(pull=-12.0)
    with_numbers("trajectory", "sine:0.3,frequency=2", TRAJECTORIES)

The first number may have no name: it is the first parameter of the motion or task.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from cc_mujoco._utils.tables import is_table
from cc_mujoco._utils.user_code import named_object, user_errors, without_mark
from cc_mujoco.errors import CableError, look_up, naming

Entry = TypeVar("Entry")


def is_user_object(text: object, registry: Mapping[str, Any]) -> bool:
    """Return whether a text is `MODULE:NAME` and not a name with numbers."""
    if not isinstance(text, str) or is_table(text):
        return False
    place, colon, name = text.partition(":")
    return bool(colon) and place not in registry and name.isidentifier()


def given_fields(text: str) -> tuple[str, ...]:
    """Return the names of the parameters in a text; the first may be empty."""
    rest = text.partition(":")[2]
    pieces = rest.split(",") if rest else []
    return tuple(p.partition("=")[0].strip() if "=" in p else "" for p in pieces)


def with_numbers(kind: str, text: str, registry: Mapping[str, Entry]) -> Entry:
    """Return the entry of a name, with the parameters that are given behind it.

    The text is `NAME`, `NAME:NUMBER` or `NAME:FIELD=NUMBER,FIELD=NUMBER`; entries are
    frozen dataclasses. `kind` is what an error calls them.
    """
    name, colon, rest = text.partition(":")
    found: Any = look_up(kind, name, registry)
    if not colon:
        return registry[name]
    kinds = {
        field.name: int if isinstance(getattr(found, field.name), int) else float
        for field in dataclasses.fields(found)
        if isinstance(getattr(found, field.name), (int, float))
    }
    if not kinds:
        raise CableError(f"{kind} {text!r}: {name!r} takes no numbers; write {name!r}.")
    numbers: dict[str, float] = {}
    for place, piece in enumerate(rest.split(",")):
        field, equals, number = piece.rpartition("=")
        field = field.strip() if equals or place else next(iter(kinds))
        if field not in kinds:
            raise CableError(
                f"{kind} {text!r}: {piece!r} must be FIELD=NUMBER with FIELD one of "
                f"{', '.join(kinds)}."
            )
        if field in numbers:
            raise CableError(f"{kind} {text!r} gives {field!r} twice; give it once.")
        try:
            numbers[field] = kinds[field](number)
        except ValueError:
            whole = "whole " if kinds[field] is int else ""
            raise CableError(
                f"{kind} {text!r}: {number!r} must be a {whole}number, the {field} of "
                f"{name!r}."
            ) from None
    with naming(f"{kind} {text!r}"):
        replaced: Entry = dataclasses.replace(found, **numbers)
        return replaced


def user_object(
    kind: str,
    text: str,
    registry: Mapping[str, Any],
    base: type[Any],
    wrap: Callable[[str, Any], Any],
) -> Any:
    """Return the object `MODULE:NAME`, or what it returns where it is a function.

    It must be of the class `base`. `wrap` is called with the text and an object of a
    class of the user; what it returns reports errors of the user's code by file and
    line. `kind` and `registry` are for the error of an unknown name.
    """
    place, _, name = text.partition(":")
    if not name.isidentifier() and text == without_mark(text):
        raise CableError.unknown(kind, place, registry)
    found = named_object(kind, text, "object")
    if not isinstance(found, base):
        made = found
        if callable(found):
            with user_errors(f"{kind} {text!r}"):
                made = found()
        if not isinstance(made, base):
            raise CableError(
                f"{kind} {text!r} must be a {base.__name__}, or a function without "
                f"arguments that returns one, not {made!r}."
            )
        found = made
    return found if is_package_object(found) else wrap(text, found)


def is_package_object(given: object) -> bool:
    return type(given).__module__.partition(".")[0] == __name__.partition(".")[0]


def user_classes(given: object) -> tuple[str, ...]:
    """Return the user's classes of an object and of its fields, as `MODULE:NAME`."""
    kind = type(given)
    found = [] if is_package_object(given) else [f"{kind.__module__}:{kind.__name__}"]
    if dataclasses.is_dataclass(given):
        for field in dataclasses.fields(given):
            value = getattr(given, field.name)
            if type(value).__module__ != "builtins":
                found += user_classes(value)
    return tuple(found)
