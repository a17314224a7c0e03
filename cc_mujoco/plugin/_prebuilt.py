"""Functions of a prebuilt library of the plugin, where the process has loaded one."""

from __future__ import annotations

import ctypes

_library: ctypes.CDLL | None = None
"""Shared library that holds the registered plugin, if it is not compiled here."""


def use_library(library: ctypes.CDLL) -> None:
    """Have compiled code call the functions of a library that MuJoCo has registered."""
    global _library
    _library = library


def address_in_library(symbol: str) -> int | None:
    """Return the address of a function in the shared library of the plugin.

    It is None where the plugin is compiled in this process.

    Raises:
        ImportError: The library has no such function.
    """
    if _library is None:
        return None
    try:
        return ctypes.cast(getattr(_library, symbol), ctypes.c_void_p).value
    except AttributeError:
        raise ImportError(
            f"{_library._name} lacks the function `{symbol}`; write it anew with "
            "`cc-mujoco plugin`."
        ) from None
