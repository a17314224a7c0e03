"""`cc-mujoco list`: every name that the other commands take."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from cc_mujoco.commands.play import SCENES


@dataclass(frozen=True)
class Listing:
    """Show the scenes, trajectories, tasks, controllers and experiments there are."""

    interrupted: ClassVar[str] = "nothing was written"

    def run(self) -> None:
        """Print every name with its meaning."""
        from cc_mujoco.control import CONTROLLERS
        from cc_mujoco.human import TASKS, TRAJECTORIES
        from cc_mujoco.reproduce import EXPERIMENTS

        meanings = {
            "scenes": {
                name: f"{scene.meaning}; plays {scene.trajectory}, {scene.task}"
                for name, scene in SCENES.items()
            },
            "trajectories": _meanings(TRAJECTORIES),
            "tasks": _meanings(TASKS),
            "controllers": _meanings(CONTROLLERS),
            "experiments": EXPERIMENTS,
        }
        width = max(len(name) for group in meanings.values() for name in group)
        for number, (group, entries) in enumerate(meanings.items()):
            print(("\n" if number else "") + group)
            for name, meaning in entries.items():
                print(f"  {name:{width}}  {meaning}")


def _meanings(registry: Mapping[str, object]) -> dict[str, str]:
    """Return the first line of every entry's documentation."""
    lines = {name: inspect.getdoc(entry) or "" for name, entry in registry.items()}
    return {name: text.partition("\n")[0] for name, text in lines.items()}
