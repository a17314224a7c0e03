"""MuJoCo's library in this process, and the name of the plugin in it."""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from cc_mujoco.native import _library as native_library
from cc_mujoco.native._library import NativeLibraryError

PLUGIN = "cc_mujoco.cable"
"""Name of the engine plugin."""

REQUIRED = ("axial_stiffness", "pretension", "friction", "conduit")
"""Keys that an MJCF instance must give; other effects are off unless given."""

_PATTERNS = {"win32": "mujoco.dll", "darwin": "libmujoco*.dylib"}
_FOLDER = Path(mujoco.__file__).parent
_FILES = sorted(_FOLDER.glob(_PATTERNS.get(sys.platform, "libmujoco.so*")))
if not _FILES:
    raise NativeLibraryError(f"cc_mujoco finds no MuJoCo library in {_FOLDER}")
LIBRARY = ctypes.CDLL(str(_FILES[-1]))
"""The MuJoCo library that the Python bindings use."""

_lock = threading.Lock()
_untimed_callers = 0
"""Number of callers inside `untimed`, over all threads."""


@contextmanager
def untimed() -> Iterator[None]:
    """Context in which MuJoCo takes no times: `MjData.timer` does not grow.

    It holds for all threads of the process. A clock that was set by
    `mujoco.set_mjcb_time` is left alone.
    """
    global _untimed_callers
    with _lock:
        ours = _untimed_callers > 0 or mujoco.get_mjcb_time() is None
        if ours:
            if _untimed_callers == 0:
                mujoco.set_mjcb_time(_stopped_clock())
            _untimed_callers += 1
    try:
        yield
    finally:
        if ours:
            with _lock:
                _untimed_callers -= 1
                if _untimed_callers == 0 and mujoco.get_mjcb_time() is _stopped_clock():
                    mujoco.set_mjcb_time(None)


@cache
def _stopped_clock() -> Any:
    """Return a stopped clock that MuJoCo can call without Python."""
    kind = ctypes.CFUNCTYPE(ctypes.c_double)
    return kind(("cc_mujoco_stopped_clock", native_library.library()))
