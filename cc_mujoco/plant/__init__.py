"""Plants: devices with some of their values changed, and what can be changed.

    from cc_mujoco.plant import Plant

    Plant("wrist", {"friction": 0.2, "wearer": 0.5}).model()

`VALUES` says what can be changed, `VARIABLES` which of it a design may set,
`IN_EPISODES` which of it may change from episode to episode of one model, `MATERIALS`
of what a cable may be.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cc_mujoco.plant.materials import MATERIALS
    from cc_mujoco.plant.motors import MOTORS
    from cc_mujoco.plant.plant import UNPLUGGED, Nominal, Plant, Scene
    from cc_mujoco.plant.variables import IN_EPISODES, VALUES, VARIABLES, Value

__all__ = [
    "IN_EPISODES",
    "MATERIALS",
    "MOTORS",
    "UNPLUGGED",
    "VALUES",
    "VARIABLES",
    "Nominal",
    "Plant",
    "Scene",
    "Value",
]

_MODULES = {
    "MATERIALS": "materials",
    "MOTORS": "motors",
    "UNPLUGGED": "plant",
    "Nominal": "plant",
    "Plant": "plant",
    "Scene": "plant",
}


def __getattr__(name: str) -> Any:
    if name in __all__:  # loaded when first used, as lists need no MuJoCo
        module = _MODULES.get(name, "variables")
        return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
