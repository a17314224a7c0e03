"""The decorator of compiled functions, which Numba keeps until their sources change."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import njit

from rig.code_stamp import stamp_compiled_code

types: Any = numba.types
Function = TypeVar("Function", bound=Callable[..., Any])

stamp_compiled_code(Path(__file__).parent)


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
