"""MuJoCo's library in this process, and the name of the plugin in it."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import mujoco

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
