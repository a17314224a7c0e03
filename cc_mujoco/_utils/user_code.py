"""Objects that a user names as `MODULE:NAME` or `FILE.py:NAME`, and their errors.

    make = named_object("controller", "my_module:my_function", "function")
    with user_errors("controller 'my_module:my_function'"):
        make(drive)

An exception inside becomes a `CableError` with file and line, and is its cause.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from cc_mujoco.errors import CableError

_FILE_ENDING = ".py"
_FOREIGN_FOLDERS = tuple(
    sysconfig.get_paths()[key] for key in ("stdlib", "purelib", "platlib")
)
"""Folders of code that is not the user's."""
_FILE_MODULE_PREFIX = "cc_mujoco_user_"
"""Beginning of the name under which the file of a user is a module."""


def named_object(kind: str, name: str, form: str) -> Any:
    """Return the object `MODULE:NAME`; modules are found as by `import` in this folder.

    Args:
        kind: What the object is for, for error messages.
        name: `MODULE:NAME`, or `FILE.py:NAME` with the path of a file.
        form: What Python calls such an object, for error messages.

    Raises:
        CableError: There is no such module or object, or the module raises.
    """
    place, _, inside = name.rpartition(":")
    if place.endswith(_FILE_ENDING):
        module, called = _module_of_file(kind, name, place), "file"
    else:
        place, _, inside = name.partition(":")
        module, called = _module(kind, name, place), "module"
    try:
        return getattr(module, inside)
    except AttributeError:
        raise CableError(
            f"{kind} {name!r}: {called} {place!r} has no {form} {inside!r}."
        ) from None


def _module_of_file(kind: str, name: str, place: str) -> ModuleType:
    path = Path(place)
    if not path.is_file():
        raise CableError(f"{kind} {name!r}: there is no file {place!r}.")
    called = f"{_FILE_MODULE_PREFIX}{path.stem}"
    spec = importlib.util.spec_from_file_location(called, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[called] = module  # dataclasses look their module up
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)
    try:
        with user_errors(f"{kind} {name!r}"):
            spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    return module


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
            last = _own_frame(traceback.extract_tb(error.__traceback__))
            message, file, line = str(error), last.filename, last.lineno
        notes = getattr(error, "__notes__", [])
        message = " ".join("; ".join([message, *notes]).split())
        raise CableError(
            f"{what} raised {type(error).__name__} in {file}, line {line}: {message}"
        ) from error


def _own_frame(frames: traceback.StackSummary) -> traceback.FrameSummary:
    """Return the last frame in code of the user, or the last one without any."""
    package = str(Path(__file__).resolve().parents[1])
    own = [
        frame
        for frame in frames
        if not frame.filename.startswith((*_FOREIGN_FOLDERS, package, "<"))
    ]
    return (own or list(frames))[-1]
