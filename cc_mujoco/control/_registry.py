"""All controllers by name.

>>> from cc_mujoco.device._drive import Drive
>>> from cc_mujoco.control import controller
>>> drive = Drive(ratio=5.2, low=-1.0, high=1.0, period=0.001)
>>> controller("none", drive).torque({"desired_torque_nm": 2.6})
0.5
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cc_mujoco._utils.provenance import POLICY_ENDING, is_user_controller
from cc_mujoco.control._backlash_inverse import BacklashInverse
from cc_mujoco.control._controller import Controller
from cc_mujoco.control._distal_feedback import DistalFeedback
from cc_mujoco.control._disturbance import DisturbanceObserver
from cc_mujoco.control._feed_forward import FeedForward
from cc_mujoco.control._gaussian import LinearQuadraticGaussian
from cc_mujoco.control._hysteresis_inverse import (
    BoucWenFeedForward,
    CableInverse,
    LinearFit,
    PrandtlIshlinskiiInverse,
    SmoothBacklashInverse,
)
from cc_mujoco.control._model_based import ModelBased
from cc_mujoco.control._policy import Policy
from cc_mujoco.control._position import IdealRatio
from cc_mujoco.control._predictive import PredictiveCompensation
from cc_mujoco.control._proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control._stiction import StictionCompensation
from cc_mujoco.control._tension_feedback import AdaptiveModel, FusedFeedback
from cc_mujoco.control._tuned_feedback import FrictionFeedForward, TunedFeedback
from cc_mujoco.control._user_controller import from_callable
from cc_mujoco.device._axis_columns import split_by_axis
from cc_mujoco.device._description import Description
from cc_mujoco.device._device import Nominal
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._plant import Plant
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.human import task as find_task

CONTROLLERS: dict[str, type[Controller]] = {
    "none": FeedForward,
    "feedback": Feedback,
    "pi": ProportionalIntegral,
    "pi_tuned": TunedFeedback,
    "pi_feed_forward": FrictionFeedForward,
    "inverse": BacklashInverse,
    "lqg": LinearQuadraticGaussian,
    "fused": FusedFeedback,
    "model": ModelBased,
    "stiction": StictionCompensation,
    "disturbance": DisturbanceObserver,
    "predictive": PredictiveCompensation,
    "adaptive": AdaptiveModel,
}
"""Every controller of torque with its default gains, to be called with a `Drive`."""

POSITION_CONTROLLERS: dict[str, type[Controller]] = {
    "none": IdealRatio,
    "linear": LinearFit,
    "backlash_inverse": SmoothBacklashInverse,
    "prandtl_ishlinskii": PrandtlIshlinskiiInverse,
    "bouc_wen": BoucWenFeedForward,
    "cable_inverse": CableInverse,
    "distal_feedback": DistalFeedback,
}
"""Every controller of a joint angle, for a drive that commands one."""


def controller(
    name: str | Callable[[Drive], Any], drive: Drive | Plant | Nominal | str | Path
) -> Controller:
    """Make a controller.

    Args:
        name: A key of `CONTROLLERS`, or of `POSITION_CONTROLLERS` for a drive that
            commands an angle, `module:function` or a function itself (see
            `external`), or the file of a policy, `*.safetensors` (see `policy`).
        drive: The device to be driven: name, file, `Device` or `Plant`, with its own
            task and sensors; or a `Drive`, as environments have as `unwrapped.drive`.

    Returns:
        The controller, reset.

    Raises:
        CableError: If there is no such controller; names the nearest and all others.
            Or if it commands what the task does not ask for, or needs a sensor at the
            joint that the device does not have.
    """
    if not isinstance(drive, Drive):
        from cc_mujoco.control._axes import axes_controller  # which imports this module

        return axes_controller(name, *_device_drives(drive))
    if not isinstance(name, str):
        return from_callable(name, drive)
    if name.endswith(POLICY_ENDING):
        return Policy(drive, name)
    if is_user_controller(name):
        return from_callable(name, drive)
    if drive.commands_angle:
        if name in CONTROLLERS and name not in POSITION_CONTROLLERS:
            raise CableError(
                f"controller {name!r} follows a torque, and the task commands an "
                f"angle; take one of {', '.join(POSITION_CONTROLLERS)}."
            )
        return look_up("controller", name, POSITION_CONTROLLERS)(drive)
    if name in POSITION_CONTROLLERS and name not in CONTROLLERS:
        raise CableError(
            f"controller {name!r} follows an angle, and the task commands a torque; "
            "take the task `position`."
        )
    kind = look_up("controller", name, CONTROLLERS)
    if not drive.joint_sensor:
        raise CableError(
            f"controller {name!r} follows a torque that depends on the joint, and this "
            "device measures nothing there; take the task `position`, or set "
            "joint_sensor = true in [sensors]."
        )
    return kind(drive)


def _device_drives(
    device: Plant | Nominal | str | Path,
) -> tuple[list[Drive], tuple[str, ...]]:
    """Return the drives of a device as it is, and the prefixes of their columns."""
    if not isinstance(device, (Plant, Nominal, str, Path)):
        raise CableError(
            "a controller is made for a Drive, a Device, a Plant or the name or file "
            f"of a device, not for {device!r}."
        )
    plant = device if isinstance(device, Plant) else Plant(device)
    model = DeviceModel(plant.description, plant.model())
    period = model.frame_skip * float(model.model.opt.timestep)
    drives = [
        dataclasses.replace(
            drive, commands_angle=find_task(axis.task, (axis.limb,)).commands_angle
        )
        for drive, axis in zip(
            model.drives(period), plant.description.axes, strict=True
        )
    ]
    return drives, model.prefixes


def default_controller(device: Description, task: Any = None) -> str:
    """Return the name of the controller that plays a task unless one is named.

    That is `pi_tuned`, whose gains follow from rotor, cables and delay of any device.
    Where the task commands an angle, it is `backlash_inverse` if the device has its
    parameters, else `none`.

    Args:
        device: The description of a device.
        task: Of all axes or by axis, see `human.task`; that of the device by default.
    """
    axis = device.axes[0]
    if isinstance(task, str):
        task = split_by_axis(task, [axis.name])
    named = task.get(axis.name) if isinstance(task, Mapping) else task
    given = axis.task if named is None else named
    if len(device.axes) > 1 or not find_task(given, (axis.limb,)).commands_angle:
        return "pi_tuned"
    fitted = device.hysteresis.get(axis.name, {})
    return "backlash_inverse" if "backlash_inverse" in fitted else "none"
