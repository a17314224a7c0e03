"""MuJoCo's timers, which are stopped while they are not used.

MuJoCo's Python package reads a clock where every stage of every step begins and ends,
for `MjData.timer`. In a scene as small as a device that is a third of the step.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco

from cc_mujoco.native import _library as native_library

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
