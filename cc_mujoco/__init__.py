"""Bowden-cable transmissions with distributed friction for MuJoCo."""

from __future__ import annotations

from pathlib import Path

__version__ = "0.1.0"

# In a checkout the environments and scenes are siblings of this package; installed,
# they are inside it. This makes an uninstalled checkout behave like an installed one.
if not (Path(__file__).parent / "envs").is_dir():
    __path__.append(str(Path(__file__).parents[1]))

# Registers the engine plugin: from here on MuJoCo loads models with cables.
from cc_mujoco import engine  # noqa: F401

# From here on `gymnasium.make` knows the environments.
from cc_mujoco.envs import register as _register

_register()
