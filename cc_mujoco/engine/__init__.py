"""Cables inside MuJoCo: the engine plugin, MJCF configuration, readings.

Importing this package registers the plugin `cc_mujoco.cable`.
"""

from cc_mujoco.engine.config import PLUGIN
from cc_mujoco.engine.mjcf import from_mjcf, to_mjcf
from cc_mujoco.engine.plugin import register
from cc_mujoco.engine.reading import (
    CableReading,
    Reader,
    cables,
    read,
    read_state,
    route,
    route_tendon,
    route_wrap,
    segment_wrap,
    stored,
)
from cc_mujoco.engine.start import StepLimits, settle, step_limits
from cc_mujoco.engine.tendons import add_friction
from cc_mujoco.engine.timers import untimed

register()

__all__ = [
    "PLUGIN",
    "CableReading",
    "Reader",
    "StepLimits",
    "add_friction",
    "cables",
    "from_mjcf",
    "read",
    "read_state",
    "register",
    "route",
    "route_tendon",
    "route_wrap",
    "segment_wrap",
    "settle",
    "step_limits",
    "stored",
    "to_mjcf",
    "untimed",
]
