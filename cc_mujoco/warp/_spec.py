"""Scenes for mujoco_warp, which takes no engine plugins.

Apart from `_ends.py`, which works where MuJoCo is too old for the plugin.
"""

from __future__ import annotations

import mujoco

from cc_mujoco.plugin import from_mjcf
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._spec import require_spec
from cc_mujoco.warp._ends import force_of_callback
from cc_mujoco.warp._model import require_supported


def without_plugin(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a specification whose cable ends any MuJoCo can hold.

    The two actuators of each cable keep names, order, `gear` and what they pull; their
    force is one that the user gives (`biastype="user"`) and 0 until `attach` does.
    Sensors of these forces stay. Tendons that draw a conduit stay as well.

    Args:
        spec: specification with cables; not changed.

    Raises:
        CableError: it is no specification, or has a cable that cannot be used, or an
            integrator that is not supported in mujoco_warp.
    """
    require_spec(spec)
    from_mjcf(spec)
    require_supported(int(spec.option.integrator))
    plain = spec.copy()
    for actuator in plain.actuators:
        if actuator.plugin.plugin_name == PLUGIN:
            actuator.plugin.active = False
            actuator.plugin.name = ""
            actuator.plugin.plugin_name = ""
            force_of_callback(actuator)
    for plugin in list(plain.plugins):
        if plugin.plugin_name == PLUGIN:
            plain.delete(plugin)
    return plain
