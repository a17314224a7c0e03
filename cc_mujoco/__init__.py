"""Bowden-cable transmissions with distributed friction for MuJoCo."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cc_mujoco.arrival import when_imported

if TYPE_CHECKING:
    from cc_mujoco import engine, envs

__all__ = ["engine", "envs"]

__version__ = "0.1.0"

# In a checkout the environments and scenes are siblings of this package; installed,
# they are inside it. This makes an uninstalled checkout behave like an installed one.
if not (Path(__file__).parent / "envs").is_dir():
    __path__.append(str(Path(__file__).parents[1]))


def __getattr__(name: str) -> Any:
    if name in __all__:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


# Registers the engine plugin: MuJoCo loads models with cables.
when_imported("mujoco", lambda: import_module("cc_mujoco.engine"))

# `gymnasium.make` knows the environments.
when_imported("gymnasium", lambda: import_module("cc_mujoco.envs").register())
