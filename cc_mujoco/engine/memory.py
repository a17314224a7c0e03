"""Raw memory for compiled callbacks: views on C arrays, text, MuJoCo's own calls.

Addresses are plain integers here, so that callbacks can follow the pointers of
`mjModel` and `mjData` at the offsets of `layout.py`. All functions are compiled and
hold no lock; nothing here checks bounds.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
import numpy.typing as npt
from mujoco.introspect.enums import ENUMS
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from cc_mujoco.engine.layout import offset, structure

Bytes = npt.NDArray[np.uint8]

_PATTERNS = {"win32": "mujoco.dll", "darwin": "libmujoco*.dylib"}
_FOLDER = Path(mujoco.__file__).parent
_FOUND = sorted(_FOLDER.glob(_PATTERNS.get(sys.platform, "libmujoco.so*")))
if not _FOUND:
    raise ImportError(f"cc_mujoco finds no MuJoCo library in {_FOLDER}")
LIBRARY = ctypes.CDLL(str(_FOUND[-1]))
"""The MuJoCo library that the Python bindings use."""

for _name in ("mju_malloc", "mju_free", "mju_message"):
    # Compiled code finds these by name, which lets Numba keep it in its cache.
    _address = ctypes.cast(getattr(LIBRARY, _name), ctypes.c_void_p).value
    llvmlite.binding.add_symbol(_name, _address)

allocate = types.ExternalFunction("mju_malloc", types.intp(types.intp))
release = types.ExternalFunction("mju_free", types.void(types.intp))
_send = types.ExternalFunction("mju_message", types.void(types.intp))

_MESSAGE_SIZE = ctypes.sizeof(structure("mjLogMessage"))
_LEVEL = offset("mjLogMessage", "level")
_SUBJECT = offset("mjLogMessage", "subject")
_WARNING = int(ENUMS["mjtLogLevel"].values["mjLOG_WARNING"])
CAPACITY = structure("mjLogMessage").subject.size
"""Longest message in bytes, its final zero included."""


@intrinsic  # type: ignore[untyped-decorator]
def _pointer(context: Any, address: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), codegen


@njit(nogil=True)
def floats(address: int, count: int) -> npt.NDArray[np.float64]:
    """View on `count` doubles."""
    return carray(_pointer(address), (count,), np.float64)


@njit(nogil=True)
def words(address: int, count: int) -> npt.NDArray[np.int64]:
    """View on `count` 64-bit words, for pointers, sizes and comparison bit by bit."""
    return carray(_pointer(address), (count,), np.int64)


@njit(nogil=True)
def integers(address: int, count: int) -> npt.NDArray[np.int32]:
    """View on `count` C ints."""
    return carray(_pointer(address), (count,), np.int32)


@njit(nogil=True)
def characters(address: int, count: int) -> Bytes:
    """View on `count` bytes."""
    return carray(_pointer(address), (count,), np.uint8)


@njit(nogil=True)
def text(address: int) -> Bytes:
    """View on a zero-terminated string, without its zero."""
    length = 0
    while characters(address + length, 1)[0] != 0:
        length += 1
    return characters(address, length)


@njit(nogil=True)
def append(message: Bytes, used: int, part: Bytes) -> int:
    """Add text to a message; what does not fit is left out.

    Returns:
        The new length.
    """
    for i in range(part.size):
        if used < message.size - 1:
            message[used] = part[i]
            used += 1
    return used


@njit(nogil=True)
def append_integer(message: Bytes, used: int, value: int) -> int:
    """Add a number >= 0 in decimal digits.

    Returns:
        The new length.
    """
    digits = np.zeros(20, np.uint8)
    start = digits.size
    while True:
        start -= 1
        digits[start] = 48 + value % 10
        value //= 10
        if value == 0:
            break
    return append(message, used, digits[start:])


@njit(nogil=True)
def warn(message: Bytes, used: int) -> None:
    """Hand a message to MuJoCo as a warning.

    A warning during compilation becomes part of the `ValueError` when it fails.
    """
    record = allocate(_MESSAGE_SIZE)
    characters(record, _MESSAGE_SIZE)[:] = 0
    integers(record + _LEVEL, 1)[0] = _WARNING
    characters(record + _SUBJECT, used)[:] = message[:used]
    _send(record)
    release(record)
