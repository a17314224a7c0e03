"""`cc-mujoco list`: every name that the other commands take."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from cc_mujoco.cable import Parameter
    from cc_mujoco.metrics import Metric


@dataclass(frozen=True)
class Listing:
    """Show every name there is, each with its meaning."""

    interrupted: ClassVar[str] = "nothing was written"

    def run(self) -> None:
        """Print every name with its meaning."""
        from cc_mujoco.control import CONTROLLERS
        from cc_mujoco.device import MATERIALS, MOTORS, VARIABLES
        from cc_mujoco.device._registry import DEVICES
        from cc_mujoco.diagnosis import EFFECTS
        from cc_mujoco.human import TASKS, TRAJECTORIES
        from cc_mujoco.metrics import METRICS
        from cc_mujoco.thesis import EXPERIMENTS

        meanings = {
            "scenes": {
                name: f"{device.meaning}; plays {device.trajectory}, {device.task}"
                for name, device in DEVICES.items()
            },
            "scenes without an environment": {
                "bench": "pull-pull bench, where a diagnosis starts from",
                "bilateral": "bilateral exosuit: hip, knee and ankle of both legs",
                "hand": "hand with four tendons: flexors and extensors of two fingers",
            },
            "trajectories": _summaries(TRAJECTORIES),
            "tasks": _summaries(TASKS),
            "controllers": _summaries(CONTROLLERS),
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
        width = max(len(name) for group in meanings.values() for name in group)
        for number, (group, entries) in enumerate(meanings.items()):
            print(("\n" if number else "") + group)
            for name, meaning in entries.items():
                print(f"  {name:{width}}  {meaning}")


def _summaries(registry: Mapping[str, object]) -> dict[str, str]:
    """Return the first line of every entry's documentation."""
    lines = {name: inspect.getdoc(entry) or "" for name, entry in registry.items()}
    return {name: text.partition("\n")[0] for name, text in lines.items()}


def _with_units(registry: Mapping[str, Metric | Parameter]) -> dict[str, str]:
    return {
        name: entry.meaning + ("" if entry.unit == "1" else f" [{entry.unit}]")
        for name, entry in registry.items()
    }
