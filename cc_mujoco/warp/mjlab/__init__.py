"""Cables in mjlab: an actuator, an observation, and events of its managers.

Raises:
    ImportError: mjlab is not installed.
"""

from importlib import import_module
from importlib.util import find_spec

import lazy_loader

if find_spec("mjlab") is None:
    raise ImportError("cc_mujoco.warp.mjlab needs mjlab: pip install mjlab")

# Before the modules of this package: mjlab imports `walking_task` on its way.
import_module("mjlab")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
