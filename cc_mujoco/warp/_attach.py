"""Cables of a scene, attached to a mujoco_warp model."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

import mujoco
import mujoco_warp as mjw

from cc_mujoco.cable._route import Route
from cc_mujoco.errors import CableError
from cc_mujoco.warp._cables import AttachedCables
from cc_mujoco.warp._ends import HeldCable


def attach(
    m: mjw.Model,
    d: mjw.Data,
    source: mujoco.MjSpec | mujoco.MjModel,
    *,
    cables: Mapping[str, HeldCable] | None = None,
    terms: tuple[str, ...] = (),
    rest_in_pose: bool = False,
) -> AttachedCables:
    """Let the cables of a scene act in all worlds of a mujoco_warp model.

    Sets `m.callback.act_bias`; what was there is called before. A cable is laid at rest
    where the time of a world is before that of the last evaluation, as after
    `mujoco_warp.reset_data`, and takes one step whenever it is later. Evaluations at
    the same time do not add up.

    Args:
        m: model of `without_plugin(spec)`.
        d: its data.
        source: the scene with its cables, a specification or a compiled model.
        cables: cables by name, where `source` has none: then it is the compiled model
            that `m` was made of, on any release of MuJoCo that mujoco_warp takes.
        terms: parameters of `Cable` that are off and may be switched on by `vary`.
        rest_in_pose: whether a reset lays the cables at their pretension in the pose of
            the world, as `settle` does, and not in `qpos0`.

    Raises:
        CableError: no cable, an end or integrator that is not supported, or a model
            that is not that of `without_plugin`.
    """
    routes: Mapping[str, Route] = {}
    if cables is None:
        # Of a MuJoCo that can run the plugin, which other scenes do not need.
        scene = import_module("cc_mujoco.warp._scene")
        model, cables, routes = scene.held_cables(source)
    elif isinstance(source, mujoco.MjModel):
        model = source
    else:
        raise CableError(
            "cables given by name are attached to the compiled model that `m` was made "
            f"of, an MjModel, not {type(source).__name__}"
        )
    return AttachedCables(m, d, model, cables, routes, terms, rest_in_pose)
