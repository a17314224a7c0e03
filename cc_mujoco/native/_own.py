"""Compiled functions outside this package: each module has a library of its own."""

from __future__ import annotations

import hashlib
import platform
import types
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import CLibrary
from cc_mujoco.native._entries import entries_text


@cache
def own_entries(
    functions: tuple[tuple[str, types.FunctionType], ...],
) -> dict[str, Callable[..., Any]]:
    """Return the functions of one module of another package in C, by their keys."""
    first = functions[0][1]
    made = CLibrary({}, Path(first.__code__.co_filename).parent)
    called = {key: made.require(function) for key, function in functions}
    here = Path(__file__).parent
    text = "\n".join(
        [
            (here / "native.h").read_text(),
            (here / "python_calls.h").read_text(),
            made.text(),
            entries_text(made, called),
        ]
    )
    code = f"{native_library.FLAGS}{platform.machine()}{text}".encode()
    module = first.__module__.replace(".", "_")
    name = f"lib{module}-{hashlib.sha256(code).hexdigest()[:20]}"
    path = native_library.keep(name, lambda source: source.write_text(text))
    return native_library.methods(native_library.load(path))
