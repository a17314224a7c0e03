"""The decorator of compiled functions, and the guard of what it stored on disk.

Numba keeps compiled code until the file of that function changes, and does not look
at the functions it calls. So code older than any source here is thrown away.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import njit

types: Any = numba.types
Function = TypeVar("Function", bound=Callable[..., Any])

_HERE = Path(__file__).parent


def _drop_stale_code() -> None:
    newest = max(source.stat().st_mtime for source in _HERE.rglob("*.py"))
    for index in _HERE.rglob("__pycache__/*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink(missing_ok=True)


_drop_stale_code()


def compiled(function: Function) -> Function:
    """Compile for use from Python and from other compiled code, without the GIL."""
    dispatcher: Any = njit(
        cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True
    )(function)
    specialise = dispatcher.get_call_template

    def call_template(args: Any, kws: Any) -> Any:
        return specialise([_widest(given) for given in args], kws)

    dispatcher.get_call_template = call_template
    return cast("Function", dispatcher)


def _widest(given: Any) -> Any:
    """Return the type to compile for: one for an integer, known or not."""
    given = types.unliteral(given)
    return types.int64 if isinstance(given, types.Integer) else given
