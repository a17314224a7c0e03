"""Cables inside MuJoCo: the engine plugin, MJCF configuration, readings.

Importing this package registers the plugin `cc_mujoco.cable`.

Raises:
    ImportError: this MuJoCo is too old for the plugin, or cannot run it.
"""

from importlib import import_module

import lazy_loader

from cc_mujoco._mujoco_import import require_plugin_support
from cc_mujoco.native._library import does_without

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

require_plugin_support()  # first, as the modules of the plugin use what is new in it
if not does_without():
    import_module("cc_mujoco.plugin._registration").register()
