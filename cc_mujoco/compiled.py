"""The decorator of every compiled function, and the guard of its cache.

Numba keeps compiled code beside the source and drops it when that file changes, but
not when a function that it calls, in another file, does. So compiled code older than
any source of its part, or of the parts that it calls, is removed at import.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""What compiled functions take; one-dimensional and contiguous unless said."""

Function = TypeVar("Function", bound=Callable[..., Any])

_CALLS = {
    "transmission": ("transmission", "engine"),
    "engine": ("transmission", "engine"),
    "control": ("transmission", "engine", "control"),
    "predecessors": ("transmission", "engine", "predecessors"),
    "reproduce/experiments": ("transmission", "engine", "reproduce/experiments"),
}
"""Parts of the package that are compiled, and those whose code is in theirs."""


def _drop_stale_code() -> None:
    root = Path(__file__).parent
    for part, called in _CALLS.items():
        sources = [root / "compiled.py"]
        for other in called:
            sources += (root / other).glob("*.py")
        newest = max(source.stat().st_mtime for source in sources)
        for index in (root / part / "__pycache__").glob("*.nbi"):
            try:
                if index.stat().st_mtime < newest:
                    index.unlink()
            except OSError:
                continue  # gone already, or a read-only install, where nothing is stale


_drop_stale_code()


def compiled(function: Function) -> Function:
    """Compile for use from Python and from other compiled code, without the GIL."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return cast("Function", njit(cache=True, **options)(function))
    except RuntimeError:  # Numba finds no folder that it may write its cache to
        return cast("Function", njit(**options)(function))
