"""Cables inside MuJoCo: the engine plugin, MJCF configuration, readings.

Importing this package registers the plugin `cc_mujoco.cable`.
"""

import lazy_loader

from cc_mujoco.plugin._registration import register

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

register()
