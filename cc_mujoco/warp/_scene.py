"""Cables of a scene of the engine plugin."""

from __future__ import annotations

import mujoco
import numpy as np

from cc_mujoco.cable._route import Route
from cc_mujoco.plugin import from_mjcf
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._path_table import routes
from cc_mujoco.plugin._spec import compile_spec
from cc_mujoco.warp._ends import HeldCable
from cc_mujoco.warp._model import require_supported


def held_cables(
    source: mujoco.MjSpec | mujoco.MjModel,
) -> tuple[mujoco.MjModel, dict[str, HeldCable], dict[str, Route]]:
    """Return the compiled scene, its cables with ends, and the tendons' routes."""
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
