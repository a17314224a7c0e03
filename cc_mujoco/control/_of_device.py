"""Controllers of whole devices, by a drive or by a device.

law = controller("lqg", "wrist")
law = controller("predictive", Plant("ankle", {"friction": 0.2}))
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cc_mujoco.control import _registry as registry
from cc_mujoco.control._axes import axes_controller
from cc_mujoco.control._controller import Controller
from cc_mujoco.device._axis_columns import split_by_axis
from cc_mujoco.device._description import Description
from cc_mujoco.device._device import Nominal
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._plant import Plant
from cc_mujoco.errors import CableError
from cc_mujoco.human import task as find_task


def controller(
    name: str | Callable[[Drive], Any], drive: Drive | Plant | Nominal | str | Path
) -> Controller:
    """Make a controller.

    Args:
        name: A key of `CONTROLLERS`, or of `POSITION_CONTROLLERS` for a drive that
            commands an angle, `module:function` or a function itself (see
            `_user_controller`), or the file of a policy, `*.safetensors`.
        drive: The device to be driven: name, file, `Device` or `Plant`, with its own
            task and sensors; or a `Drive`, as environments have as `unwrapped.drive`.

    Returns:
        The controller, reset; of a device with several axes as `axes_controller`.

    Raises:
        CableError: If there is no such controller; names the nearest and all others.
            Or if it commands what the task does not ask for, or needs a sensor at the
            joint that the device does not have.
    """
    if isinstance(drive, Drive):
        return registry.controller(name, drive)
    return axes_controller(name, *_device_drives(drive))


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
    """Return the controller that plays a task unless one is named.

    It is `pi_tuned`, whose gains follow from rotor, cables and delay of any device.
    Where the task commands an angle, it is `backlash_inverse` if the device has its
    parameters, else `none`. The task is of all axes or by axis, see `human.task`; that
    of the device by default.
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
