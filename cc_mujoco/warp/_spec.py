"""Scenes for mujoco_warp, which supports no engine plugins.

`_model.py` is separate, as it works with MuJoCo releases too old for the plugin.
"""

import mujoco
import numpy as np

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.cable._route import Route
from cc_mujoco.plugin import from_mjcf
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._path_table import routes
from cc_mujoco.plugin._spec import cable_ends, compile_spec
from cc_mujoco.warp._model import HeldCable, force_of_callback, require_supported


def without_plugin(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a specification whose cable ends are plain actuators.

    The two actuators of each cable keep names, order, `gear` and transmission; their
    force is user-defined (`biastype="user"`) and 0 until `attach`. Sensors of these
    forces stay. Tendons that draw a conduit stay as well.

    Args:
        spec: specification with cables; not changed.

    Raises:
        CableError: it is no specification, or has a cable that cannot be used, or an
            integrator that is not supported in mujoco_warp.
    """
    require_kind("spec", spec, mujoco.MjSpec)
    from_mjcf(spec)
    require_supported(int(spec.option.integrator))
    plain = spec.copy()
    for actuator in cable_ends(plain):
        own = actuator.plugin
        own.active, own.name, own.plugin_name = False, "", ""
        force_of_callback(actuator)
    for plugin in list(plain.plugins):
        if plugin.plugin_name == PLUGIN:
            plain.delete(plugin)
    return plain


def held_cables(
    source: mujoco.MjSpec | mujoco.MjModel,
) -> tuple[mujoco.MjModel, dict[str, HeldCable], dict[str, Route]]:
    """Return the compiled scene, its cables with their ends, and tendon routes."""
    cables = from_mjcf(source)
    option = source.opt if isinstance(source, mujoco.MjModel) else source.option
    require_supported(int(option.integrator))
    model = source if isinstance(source, mujoco.MjModel) else compile_spec(source)
    places = instances(model)
    held = {}
    for name, cable in cables.items():
        ends = np.flatnonzero(model.actuator_plugin == places[name]).tolist()
        held[name] = HeldCable(cable, *ends)
    return model, held, routes(model, cables)
