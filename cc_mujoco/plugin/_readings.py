"""Tensions, slip, slack and route of the cables in a simulation.

    reading = read(model, data, "flexor")
    reading.tension_distal, reading.moving_fraction, reading.slack

A reading is of the committed state: after `mj_step`, that of the configuration for
which the step computed its forces, so it agrees with `data.actuator_force` and with
MuJoCo's `actuatorfrc` sensors on the two actuators (+T_proximal and -T_distal). Under
RK4 `data.actuator_force` is that of the last stage.
"""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import mujoco
import numpy as np

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._cable import BENDS, PATHS
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._reading import (
    PATH_MEMORY,
    guided_compliance,
    read_states,
    slack_compliance,
)
from cc_mujoco.cable._reading import CableReading as CableReading
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin._mjcf import cable_of, instances
from cc_mujoco.plugin._path_table import routes
from cc_mujoco.plugin._registration import plugin_function


def cables(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of the cables of a model."""
    return tuple(instances(model))


def read(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> CableReading:
    """Return the state of a cable now; its arrays are copies.

    Raises:
        CableError: the model has no cable of that name, or the data are of another one.
    """
    held_instance(model, data, name)
    reading = Reader(model, name).read(data.plugin_state)
    parts = (getattr(reading, field.name) for field in fields(reading))
    return CableReading(*(part if part.ndim else part.item() for part in parts))


def read_state(
    model: mujoco.MjModel, name: str, plugin_state: FloatArray
) -> CableReading:
    """Return the state of a cable from arrays of plugin states, such as a batch's.

    Args:
        model: the model.
        name: the cable.
        plugin_state: `mjData.plugin_state` of any number of simulations, (..., m).

    Raises:
        CableError: the model has no cable of that name, or the array does not fit it.
    """
    return Reader(model, name).read(plugin_state)


class Reader:
    """Reader of one cable's state from `plugin_state`, with its lookups done once."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Look the cable up.

        Args:
            model: the model.
            name: the cable.

        Raises:
            CableError: the model has no cable of that name.
        """
        index = _instance(model, name)
        self.name, self.cable = name, cable_of(model, index, name)
        cable, ends = self.cable, model.actuator_plugin == index
        self.outputs = tuple(model.actuator_outadr[ends].tolist())
        """Places of the forces of its ends in `actuator_force`, proximal first."""
        self.start = int(model.plugin_stateadr[index])
        """Start of the cable's state in `plugin_state`."""
        first = self.start + kernel.STATE_HEADER
        self.nodes = slice(first, first + cable.segments + 1)
        """Places of the tensions of the nodes [N], below 0 where the cable is slack."""
        self.energy = self.start + 2
        """Place of the energy dissipated since reset [J]."""
        self._given: tuple[Any, ...] = self.start, guided_compliance(cable)
        if cable.path != PATHS[0]:
            # Lengths come first in a path's memory, see `_instance_data.path_memory`.
            lengths = self.start + kernel.state_size(cable.segments) + PATH_MEMORY
            packed = None
            if cable.clearance > 0.0:
                packed = routes(model, {name: cable})[name].packed(cable)
            self._given = self.start, *slack_compliance(cable, packed), lengths
        self._total = int(model.npluginstate)

    def read(self, plugin_state: FloatArray) -> CableReading:
        """Return the state of the cable from arrays of plugin states (..., m).

        Raises:
            CableError: the array does not fit the model.
        """
        if plugin_state.shape[-1] != self._total:
            raise CableError(
                f"plugin_state has {plugin_state.shape[-1]} numbers per simulation; "
                f"this model has {self._total}"
            )
        states = plugin_state.reshape(-1, self._total)
        found = read_states(states, *self._given)
        shape = plugin_state.shape[:-1]
        parts = (getattr(found, field.name) for field in fields(found))
        return CableReading(
            *(part.reshape((*shape, *part.shape[1:])) for part in parts)
        )


def route(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> FloatArray:
    """Return the path of a cable's conduit in space, from its route tendon.

    Returns:
        (P, 3) points [m], proximal to distal: sites, and where the tendon touches and
        leaves the geoms that it wraps. Needs `mj_tendon` (part of `mj_forward`).

    Raises:
        CableError: the model has no such cable, the cable no route, or the data are of
            another model.
    """
    held_instance(model, data, name)
    tendon = route_tendon(model, name)
    start, count = data.ten_wrapadr[tendon], data.ten_wrapnum[tendon]
    points = data.wrap_xpos.reshape(-1, 3)[start : start + count]
    is_pulley = data.wrap_obj.reshape(-1)[start : start + count] == -2
    return np.array(points[~is_pulley])


def route_wrap(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> float:
    """Return the total turning angle of a cable's route [rad], with arcs around geoms.

    Raises:
        CableError: the model has no such cable, the cable no route, or the data are of
            another model.
    """
    held_instance(model, data, name)
    return tendon_turn(model, data, route_tendon(model, name))


def tendon_turn(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> float:
    """Return the total turning angle of a spatial tendon, by its index [rad]."""
    return float(plugin_function("turn")(model._address, data._address, tendon))


def segment_wrap(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> FloatArray:
    """Wrap angle of each segment of a cable (segments,) [rad], proximal to distal.

    It follows from the sections of the conduit or, if the keys `bend` or `path` say so,
    from the route at the last evaluated position. Needs `mj_tendon` (part of
    `mj_forward`).

    Raises:
        CableError: the model has no cable of that name, or the data are of another one.
    """
    instance = held_instance(model, data, name)
    cable = cable_of(model, instance, name)
    if cable.bend == BENDS[0] and cable.path == PATHS[0]:
        return np.array(kernel.segment_angles(packed_parameters(cable), cable.segments))
    return numbers_of("wrap", model, data, instance, cable.segments)


def stored_energy(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> float:
    """Return the elastic energy of a cable in the present state [J].

    It includes that of friction bristles and of rope that drums of an open path have
    wound up or paid out so far.

    Raises:
        CableError: the model has no cable of that name, or the data are of another one.
    """
    index = held_instance(model, data, name)
    segments = cable_of(model, index, name).segments
    # The compliance of the nodes [m/N], then the energy.
    return float(numbers_of("compliance", model, data, index, segments + 2)[-1])


def numbers_of(
    name: str, model: mujoco.MjModel, data: mujoco.MjData, instance: int, count: int
) -> FloatArray:
    """Return the `count` numbers that callback `name` writes about an instance."""
    out = np.full(count, np.nan)
    call = plugin_function(name)
    call(model._address, data._address, instance, out.ctypes.data)
    return out


def route_tendon(model: mujoco.MjModel, name: str) -> int:
    """Return the index of the spatial tendon that draws a cable's conduit.

    In a model that was attached with a prefix or suffix the key `route` stands for the
    tendon that came along with the cable, see `find_route`.

    Raises:
        CableError: the model has no such cable, or the cable no route.
    """
    index = _instance(model, name)
    wanted = cable_of(model, index, name).route
    if not wanted:
        raise CableError(
            f"cable {name!r} has no route; set its key `route` to a spatial tendon"
        )
    tendon = int(plugin_function("route")(model._address, index))
    if tendon < 0:
        raise CableError(f"cable {name!r}: the model has no spatial tendon {wanted!r}")
    return tendon


def require_data_of(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    own = model.nq, model.nv, model.nbody, model.ntendon, model.nplugin
    poses = data.qpos.size, data.qvel.size, len(data.xpos)
    found = *poses, data.ten_length.size, data.nplugin
    if found != own:
        words = "{} positions, {} speeds, {} bodies, {} tendons and {} plugins"
        raise CableError(
            f"data have {words.format(*found)}, and the model has "
            f"{words.format(*own)}; give an MjData of this model"
        )


def held_instance(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> int:
    """Return the index of a cable's instance; raise if `data` do not fit the model."""
    index = _instance(model, name)
    require_kind("data", data, mujoco.MjData)
    require_data_of(model, data)
    if not plugin_function("holds")(model._address, data._address, index):
        raise CableError(
            f"cable {name!r}: the data were made by a model with other sizes or "
            "another kind of path; make new data of this model"
        )
    return index


def _instance(model: mujoco.MjModel, name: str) -> int:
    return look_up("cable", name, instances(model))


def moments(
    model: mujoco.MjModel, data: mujoco.MjData, poses: Sequence[FloatArray]
) -> FloatArray:
    """Return all actuators' moment arms (poses, outputs, nv); `data` are changed."""
    mujoco.mj_resetData(model, data)
    found = np.zeros((len(poses), model.nout, model.nv))
    for dense, qpos in zip(found, poses, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        sparse = data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(dense, data.actuator_moment, *sparse)
    return found
