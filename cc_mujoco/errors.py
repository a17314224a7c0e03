"""The one exception that this package raises for input it cannot accept."""

import functools
import inspect
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeVar, cast

Entry = TypeVar("Entry")
Function = TypeVar("Function", bound=Callable[..., Any])

RENAMED = {
    "--motion": "--trajectory",
    "--scene": "the first word, SCENE",
    "--threads": "--workers",
    "motion": "trajectory",
    "read_motion": "read_trajectory",
}
"""Options, arguments and functions that have another name now, which errors give."""

MANY = 30
"""Names that an error lists even if one of them is near to what was given."""


_SHOWN = 120
"""Characters of what was given that an error shows."""


class CableWarning(UserWarning):
    """Input that can be used, but perhaps does not mean what was intended."""


class CableError(ValueError):
    """Input that cannot be used; one sentence says what, where and what would be right.

    It is a `ValueError`, so callers that know nothing of this package catch it too.
    """

    @classmethod
    def unknown(
        cls, kind: str, name: str, allowed: Iterable[str], where: str = ""
    ) -> "CableError":
        """Build the error for a name that is not in a registry.

        Args:
            kind: Kind that the name should have, for example `"trajectory"`.
            name: The name that was given.
            allowed: The names that exist.
            where: The place that it was read from, if any.

        Returns:
            The error, with the nearest match if there is one, and all names allowed;
            of more than `MANY` the near ones alone, if any.
        """
        import difflib  # only a mistake needs it

        names = sorted(allowed)
        found = f"unknown {kind} {shown(name)}{f' in {where}' if where else ''}"
        if not names:
            return cls(f"{found}: there is none here.")
        near = difflib.get_close_matches(str(name), names)
        if near and len(names) > MANY:
            hint = " or ".join(map(repr, near))
            return cls(f"{found}: did you mean {hint}?")
        hint = f": did you mean {near[0]!r}?" if near else "."
        return cls(f"{found}{hint} Available: {', '.join(names)}.")


@contextmanager
def naming(place: str) -> Iterator[None]:
    """Begin the sentence of an error with the place that it is about."""
    try:
        yield
    except CableError as error:
        raise CableError(f"{place}: {error}") from None


def shown(given: object) -> str:
    """Return what was given as a short text of one line, for an error."""
    text = repr(given)
    if "\n" in text:
        text = " ".join(text.split())
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def require_utf8(text: str) -> None:
    """Refuse a path or another word with bytes that are no UTF-8.

    Raises:
        CableError: It has such bytes.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        raise CableError(f"{text!a} is no UTF-8 text; rename what it names.") from None


def import_extra(module: str, what: str, extra: str) -> Any:
    """Return a module of a package that only an extra of this one installs.

    Raises:
        CableError: It is missing; begins with `what`, as "a video needs PyAV".
    """
    try:
        return import_module(module)
    except ImportError:
        raise CableError(f"{what}: pip install 'cc_mujoco[{extra}]'.") from None


def require_new_name(name: str) -> None:
    """Refuse a name that is another one now.

    Raises:
        CableError: It is.
    """
    if name in RENAMED:
        raise CableError(f"{name} is now {RENAMED[name]}.")


def refuse_unknown(named: Iterable[str], allowed: Collection[str]) -> None:
    """Refuse arguments that are not allowed, and list those that are.

    Raises:
        CableError: There is one; names what a renamed one is now.
    """
    for name in named:
        require_new_name(name)
        if name not in allowed:
            raise CableError.unknown("argument", name, allowed)


def with_known_names(function: Function) -> Function:
    """Return a function that refuses unknown arguments in a sentence."""
    allowed = tuple(inspect.signature(function).parameters)

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        refuse_unknown(named, allowed)
        return function(*arguments, **named)

    return cast("Function", call)


def look_up(kind: str, name: str, registry: Mapping[str, Entry]) -> Entry:
    """Return the entry of a registry, or raise `CableError.unknown`."""
    if not isinstance(name, str) or name not in registry:
        raise CableError.unknown(kind, name, registry)
    return registry[name]
