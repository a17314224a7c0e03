"""Objects that a user names as `MODULE:NAME`, and errors of the user's code.

    make = named_object("controller", "my_module:my_function", "function")
    with user_errors("controller 'my_module:my_function'"):
        make(drive)

An exception inside becomes a `CableError` with file and line, and is its cause.
"""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from cc_mujoco.errors import CableError


def named_object(kind: str, name: str, form: str) -> Any:
    """Return the object `MODULE:NAME`; modules are found as by `import` in this folder.

    Args:
        kind: What the object is for, for error messages.
        name: `MODULE:NAME`.
        form: What Python calls such an object, for error messages.

    Raises:
        CableError: There is no such module or object, or the module raises.
    """
    place, _, inside = name.partition(":")
    try:
        return getattr(_module(kind, name, place), inside)
    except AttributeError:
        raise CableError(
            f"{kind} {name!r}: module {place!r} has no {form} {inside!r}."
        ) from None


def _module(kind: str, name: str, place: str) -> ModuleType:
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        with user_errors(f"{kind} {name!r}"):
            return importlib.import_module(place)
    except CableError as error:
        missing = getattr(error.__cause__, "name", None)
        absent = isinstance(error.__cause__, ModuleNotFoundError)
        if place and not (absent and missing and f"{place}.".startswith(f"{missing}.")):
            raise
        raise CableError(
            f"{kind} {name!r}: there is no module {place!r}; it must be importable "
            f"or lie in {here}."
        ) from None
    finally:
        sys.path.remove(here)


@contextmanager
def user_errors(what: str) -> Iterator[None]:
    """Turn an exception into one sentence that names the object, file and line."""
    try:
        yield
    except CableError:
        raise
    except Exception as error:
        if isinstance(error, SyntaxError):
            message, file, line = error.msg, error.filename, error.lineno
        else:
            last = traceback.extract_tb(error.__traceback__)[-1]
            message, file, line = str(error), last.filename, last.lineno
        raise CableError(
            f"{what} raised {type(error).__name__} in {file}, line {line}: {message}"
        ) from error
