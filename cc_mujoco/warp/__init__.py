"""Cables in mujoco_warp: many worlds at once, on a GPU or a CPU.

Raises:
    ImportError: mujoco_warp is not installed.
"""

from importlib.util import find_spec

import lazy_loader

if find_spec("warp") is None or find_spec("mujoco_warp") is None:
    raise ImportError("cc_mujoco.warp needs mujoco_warp: pip install 'cc_mujoco[warp]'")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
