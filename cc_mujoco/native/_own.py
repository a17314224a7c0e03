"""Compiled functions outside this package: each module has a library of its own."""

from __future__ import annotations

import ctypes
import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import CLibrary
from cc_mujoco.native._entries import entries_text, has_entry
from cc_mujoco.native._functions import FUNCTIONS, NativeFunction


def own_entry(function: NativeFunction) -> Callable[..., Any] | None:
    """Return a function of another package in C, None where Python must call it.

    Raises:
        CableError: its module leaves the subset.
        NativeLibraryError: it cannot be compiled.
    """
    return _entries(function.py_func.__module__).get(function.key)


@cache
def _entries(module: str) -> dict[str, Callable[..., Any]]:
    own = [f for f in FUNCTIONS if f.py_func.__module__ == module and f.is_entry]
    root = Path(inspect.getfile(own[0].py_func)).parent
    made = CLibrary({}, root)
    pairs = [(f.key, made.require(f.py_func)) for f in own]
    here = Path(__file__).parent
    text = "\n".join(
        [
            (here / "native.h").read_text(),
            made.text(),
            (here / "python_calls.h").read_text(),
            entries_text(made, [(k, found) for k, found in pairs if has_entry(found)]),
        ]
    )
    digest = hashlib.sha256(f"{native_library.FLAGS}{text}".encode()).hexdigest()[:20]
    name = f"lib{module.replace('.', '_')}-{digest}{native_library.SUFFIX}"
    path = native_library.folder() / name
    if not path.is_file():
        native_library.build_source(path, lambda place: place.write_text(text))
    return native_library.methods(ctypes.CDLL(str(path)))
