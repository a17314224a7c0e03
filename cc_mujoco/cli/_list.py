"""`cc-mujoco list`: every name that the other commands take."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

if TYPE_CHECKING:
    from cc_mujoco.cable import Parameter
    from cc_mujoco.device import Device
    from cc_mujoco.metrics import Metric


@dataclass(frozen=True)
class Listing:
    """Show every name there is, each with its meaning."""

    interrupted: ClassVar[str] = "nothing was written"

    scene: Annotated[str, tyro.conf.arg(metavar="SCENE", help_behavior_hint="")] = ""
    """Show the axes, cables and joints of this device instead."""

    def run(self) -> None:
        """Print every name with its meaning."""
        from cc_mujoco.assets import SCENES
        from cc_mujoco.control import CONTROLLERS, POSITION_CONTROLLERS
        from cc_mujoco.device import MATERIALS, MOTORS, VARIABLES, find_device
        from cc_mujoco.diagnosis import EFFECTS
        from cc_mujoco.human import TASKS, TRAJECTORIES
        from cc_mujoco.metrics import METRICS
        from cc_mujoco.thesis import EXPERIMENTS

        if self.scene:
            device = find_device(self.scene)
            _print({"devices": {self.scene: _plays(device)}} | _parts(device))
            return
        meanings = {
            "devices": {name: _plays(find_device(name)) for name in SCENES},
            "trajectories": _summaries(TRAJECTORIES),
            "tasks": _summaries(TASKS),
            "controllers": _summaries(CONTROLLERS),
            "controllers of the task position": _summaries(POSITION_CONTROLLERS),
            "experiments": EXPERIMENTS,
            "effects that a diagnosis can name": {
                name: effect.title for name, effect in EFFECTS.items()
            },
            "variables of what-ifs": _with_units(VARIABLES),
            "materials of what-ifs": {
                name: f"{material.meaning}; friction {material.friction.low:.2g} to "
                f"{material.friction.high:.2g}, typically "
                f"{material.friction.typical:.2g}"
                for name, material in MATERIALS.items()
            },
            "motors of what-ifs": {
                name: f"{motor.continuous_torque:g} N m for ever, {motor.mass:g} kg; "
                f"{motor.source}"
                for name, motor in MOTORS.items()
            },
            "metrics": _with_units(METRICS),
        }
        _print(meanings)


def _print(meanings: Mapping[str, Mapping[str, str]]) -> None:
    """Print groups of names with their meanings."""
    width = max(len(name) for group in meanings.values() for name in group)
    for number, (group, entries) in enumerate(meanings.items()):
        print(("\n" if number else "") + group)
        for name, meaning in entries.items():
            print(f"  {name:{width}}  {meaning}")


def _plays(device: Device) -> str:
    """Return what a device is and what is played on it."""
    about = device.description
    tasks = {
        f"{axis.name}={axis.task}" if len(about.axes) > 1 else axis.task
        for axis in about.axes
    }
    return f"{about.meaning}; plays {about.trajectory}, {', '.join(sorted(tasks))}"


def _parts(device: Device) -> dict[str, dict[str, str]]:
    """Return the names of what a device has, with their meanings."""
    about = device.description
    return {
        f"axes of {device.name}": {
            axis.name: f"motor {axis.motor} drives joint {axis.joint} by cable "
            f"{', '.join(axis.cables)}"
            for axis in about.axes
        },
        f"cables of {device.name}": {
            name: f"{cable.length:.3g} m, friction {cable.friction:g}, pretension "
            f"{cable.pretension:g} N"
            for name, cable in device.cables.items()
        },
        f"joints of {device.name} that the wearer moves": {
            joint: f"actuator {name}" for joint, name in about.movers.items()
        },
    }


def _summaries(registry: Mapping[str, object]) -> dict[str, str]:
    """Return the first line of every entry's documentation."""
    lines = {name: inspect.getdoc(entry) or "" for name, entry in registry.items()}
    return {name: text.partition("\n")[0] for name, text in lines.items()}


def _with_units(registry: Mapping[str, Metric | Parameter]) -> dict[str, str]:
    return {
        name: entry.meaning + ("" if entry.unit == "1" else f" [{entry.unit}]")
        for name, entry in registry.items()
    }
