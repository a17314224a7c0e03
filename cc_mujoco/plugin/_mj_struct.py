"""Compiled access to `mjModel` and `mjData`, at the offsets of `_mj_offsets.py`."""

from __future__ import annotations

import math

from mujoco import mjtWrap

from cc_mujoco.plugin._ffi import Bytes, internal, text
from cc_mujoco.plugin._mj_offsets import MjData as MjData
from cc_mujoco.plugin._mj_offsets import MjModel as MjModel


@internal
def has_timestep(model: MjModel) -> bool:
    return bool(0.0 < model.opt.timestep < math.inf)


@internal
def disabled(model: MjModel, flag: int) -> bool:
    """Return whether a part of the engine is disabled, an `mjtDisableBit`."""
    return bool(model.opt.disableflags & flag != 0)


@internal
def name(model: MjModel, start: int) -> Bytes:
    """Return a name by its place in all names, as of `model.name_siteadr`."""
    return text(model.names.ctypes.data + start)


@internal
def attributes(model: MjModel, instance: int) -> int:
    return int(model.plugin_attr.ctypes.data + model.plugin_attradr[instance])


@internal
def state(model: MjModel, data: MjData, instance: int) -> int:
    return int(data.plugin_state.ctypes.data + 8 * model.plugin_stateadr[instance])


@internal
def path_end(model: MjModel, tendon: int) -> int:
    """Return the place behind the last one of a tendon's path in `wrap_type`."""
    return int(model.tendon_adr[tendon] + model.tendon_num[tendon])


@internal
def wrap_body(model: MjModel, place: int) -> int:
    """Return the body of the site or geom at a place in `wrap_type`; -1 of a pulley."""
    if model.wrap_type[place] == mjtWrap.mjWRAP_PULLEY:
        return -1
    thing = model.wrap_objid[place]
    if model.wrap_type[place] == mjtWrap.mjWRAP_SITE:
        return int(model.site_bodyid[thing])
    return int(model.geom_bodyid[thing])


@internal
def first_cable(model: MjModel, instance: int) -> int:
    other = 0
    while model.plugin[other] != model.plugin[instance]:
        other += 1
    return other
