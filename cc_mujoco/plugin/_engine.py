"""MuJoCo's library in this process, and the name of the plugin in it."""

import ctypes
import sys
import threading
from functools import cache
from pathlib import Path

import mujoco

from cc_mujoco.native import _library as native_library
from cc_mujoco.native._library import NativeLibraryError

PLUGIN = "cc_mujoco.cable"
"""Name of the engine plugin."""

REQUIRED = ("axial_stiffness", "pretension", "friction", "conduit")
"""Keys that an MJCF instance must give; other effects are off unless given."""


def _load_library() -> ctypes.CDLL:
    patterns = {"win32": "mujoco.dll", "darwin": "libmujoco*.dylib"}
    folder = Path(mujoco.__file__).parent
    files = sorted(folder.glob(patterns.get(sys.platform, "libmujoco.so*")))
    if not files:
        raise NativeLibraryError(f"cc_mujoco finds no MuJoCo library in {folder}")
    return ctypes.CDLL(str(files[-1]))


LIBRARY = _load_library()
"""The MuJoCo library that the Python bindings use."""

_lock = threading.Lock()
_untimed_callers = 0
"""Number of callers inside `untimed`, over all threads."""
_clock = ctypes.c_void_p.in_dll(LIBRARY, "mjcb_time")
"""MuJoCo's clock, which `mujoco.set_mjcb_time` sets too."""
_own_clock: int | None = None
"""Address of MuJoCo's own clock while `untimed` has replaced it."""


class untimed:
    """Context in which MuJoCo takes no times: `MjData.timer` does not grow.

    It holds for all threads of the process. A clock that was set by
    `mujoco.set_mjcb_time` is left alone.
    """

    def __enter__(self) -> None:
        global _untimed_callers, _own_clock
        with _lock:
            self._ours = _untimed_callers > 0 or mujoco.get_mjcb_time() is None
            if self._ours:
                if _untimed_callers == 0:
                    _own_clock, _clock.value = _clock.value, _stopped_clock()
                _untimed_callers += 1

    def __exit__(self, *_: object) -> None:
        global _untimed_callers
        if self._ours:
            with _lock:
                _untimed_callers -= 1
                if _untimed_callers == 0 and _clock.value == _stopped_clock():
                    _clock.value = _own_clock


@cache
def _stopped_clock() -> int | None:
    """Return the address of a stopped clock, which MuJoCo calls without Python."""
    clock = native_library.library().cc_mujoco_stopped_clock
    return ctypes.cast(clock, ctypes.c_void_p).value
