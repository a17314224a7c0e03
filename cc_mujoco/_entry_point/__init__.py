"""Entry point that MuJoCo calls at the end of its import, to register the cables.

It installs beside `cc_mujoco`, as `cc_mujoco_plugin`, so that a program that has no use
for that package need not wait for its import, nor for Numba.
"""

from __future__ import annotations

import importlib
import sys


def register() -> None:
    """Register the engine plugin if the program has imported `cc_mujoco`."""
    if "cc_mujoco" in sys.modules:
        importlib.import_module("cc_mujoco.plugin")
