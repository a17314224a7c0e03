"""Cables at rest in the present pose before the first step, and stable time steps.

data.qpos[:] = pose  # or mj_resetDataKeyframe
settle(model, data)  # rope="keep" for a state of the same machine
step_limits(model, data)["flexor"].distal  # [s]
"""

import math
import warnings
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco.errors import CableWarning, look_up
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import _readings as readings
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._registration import plugin_function


class StepLimits(NamedTuple):
    """Time steps below which a cable is stable [s].

    Attributes:
        proximal: limit by the proximal end, while that is explicit.
        distal: limit by the distal end, while that is explicit.
        pieces: limit by the pieces of an open path.
    """

    proximal: float
    distal: float
    pieces: float = math.inf


def settle(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    *,
    rope: Literal["keep", "remount"] = "remount",
) -> None:
    """Bring all cables to rest in the present pose.

    MuJoCo's resets, that to a keyframe too, bring them to rest in the pose `qpos0`.
    Without this call the first step pulls them to the present pose, as after a jump of
    the joints. Afterwards the tension is the same along each cable, nothing has
    slipped, and energy and memory of friction are those of a reset. All else of `data`
    is kept and updated by `mj_forward`.

    The tension is that of a rope which is mounted anew in this pose, or of the rope
    that is mounted in `qpos0`, stretched or slack by what its ends and its path have
    moved since. Only the second keeps the relation of motor and joint.

    A batch takes the state over: `mj_getState` of `data` into a row of `Batch.state`,
    or `data.plugin_state` into a row of the bound `plugin_state`.

    Args:
        model: a model; without cables this is `mj_forward`, and a `CableWarning`.
        data: its simulation.
        rope: `"remount"` for the pretension in this pose, as of a scene that begins
            here; `"keep"` for the rope mounted in `qpos0`, as of a state that is
            restored without its `plugin_state`.

    Raises:
        CableError: `rope` is neither, or the data are of another model.
    """
    keeps = look_up("rope", rope, {"remount": 0, "keep": 1})
    require_kind("model", model, mujoco.MjModel)
    require_kind("data", data, mujoco.MjData)
    readings.require_data_of(model, data)
    held = [readings.held_instance(model, data, name) for name in instances(model)]
    if not held:
        warnings.warn("settle finds no cable in this model", CableWarning, 2)
    mujoco.mj_fwdPosition(model, data)
    lay = plugin_function("settle")
    for instance in held:
        lay(model._address, data._address, instance, keeps)
    mujoco.mj_forward(model, data)


def step_limits(
    model: mujoco.MjModel, data: mujoco.MjData | None = None
) -> dict[str, StepLimits]:
    """Return the time steps of the model below which its cables are stable, by cable.

    Where friction holds the cable its end is a spring of EA over half its last segment.
    About an inertia J that an end moves by a pulley of radius r alone, steps below
    2 / sqrt(stiffness r^2 / J) are stable for it; for the general case see
    `_stability_limits.py`. If the step is longer than 0.8 of that for a cable alone,
    its ends are implicit and always stable, unless it has `ends` = `explicit`. Cables
    of one joint that pass the limit only together stay explicit. Pieces of an open path
    are always explicit, and the stiffer the shorter they are. The plugin warns, through
    MuJoCo, of a `timestep` that is too long.

    Args:
        model: the model.
        data: a simulation whose pose counts; by default that of `qpos0`, and for the
            pieces of an open path the worst of the poses over the ranges of its joints,
            see `_tendon_survey.sweep`.

    Returns:
        Limits [s], infinite for what moves nothing.

    Raises:
        CableError: the data are of another model.
    """
    require_kind("model", model, mujoco.MjModel)
    # Compiled code takes seconds to load, and few need it.
    from cc_mujoco.plugin._tendon_survey import sweep

    everywhere = data is None
    if data is None:
        data = mujoco.MjData(model)
    readings.require_data_of(model, data)
    for name in instances(model):
        readings.held_instance(model, data, name)
    mujoco.mj_fwdPosition(model, data)
    found = {
        name: _limits_here(model, data, own) for name, own in instances(model).items()
    }
    for name, limits in found.items():
        if everywhere and math.isfinite(limits.pieces):
            poses = sweep(model, model.qpos0, readings.route_tendon(model, name))
            pieces = shortest_piece_step(model, data, name, poses)
            found[name] = limits._replace(pieces=pieces)
    return found


def shortest_piece_step(
    model: mujoco.MjModel, data: mujoco.MjData, name: str, poses: FloatArray
) -> float:
    """Return the stable time step of an open path's pieces over `poses` (k, nq) [s].

    The `qpos` of `data` is left at the last pose.
    """
    # Compiled code takes seconds to load, and few need it.
    from cc_mujoco.plugin._tendon_survey import piece_timesteps

    found = math.inf
    alone = piece_timesteps(model, data, readings.route_tendon(model, name), 1.0, poses)
    # With what all cables do to each other only where it is shortest without.
    for pose in (poses[0], *poses[np.argsort(alone)[:5]]):
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        found = min(found, _limits_here(model, data, instances(model)[name]).pieces)
    return found


def _limits_here(
    model: mujoco.MjModel, data: mujoco.MjData, instance: int
) -> StepLimits:
    return StepLimits(*readings.numbers_of("limits", model, data, instance, 3).tolist())
