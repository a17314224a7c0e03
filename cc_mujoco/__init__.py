"""Bowden-cable transmissions with distributed friction for MuJoCo.

What most programs need is here, imported when it is first used; each room of the
package (`transmission`, `engine`, `control`, ...) has the rest.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cc_mujoco import benchmark
    from cc_mujoco.diagnosis.diagnose import diagnose
    from cc_mujoco.engine import add_friction, read
    from cc_mujoco.plant import Plant
    from cc_mujoco.recording.simulate import play, simulate
    from cc_mujoco.transmission import Cable, Section, replay
    from cc_mujoco.whatif import study

__all__ = [
    "Cable",
    "Plant",
    "Section",
    "add_friction",
    "benchmark",
    "diagnose",
    "play",
    "read",
    "replay",
    "simulate",
    "study",
]

__version__ = "0.1.0"

_ROOMS = {
    "Cable": "transmission",
    "Plant": "plant",
    "Section": "transmission",
    "add_friction": "engine",
    "diagnose": "diagnosis",
    "play": "recording",
    "read": "engine",
    "replay": "transmission",
    "simulate": "recording",
    "study": "whatif",
}


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return getattr(import_module(f"{__name__}.{_ROOMS[name]}"), name)
    if name in __all__:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


# MuJoCo loads models with cables once the engine has registered its plugin. Where it is
# imported later, MuJoCo does that itself, by the entry point `cc_mujoco_plugin`: the
# engine takes a second to import, for which `cc-mujoco --help` need not wait.
if "mujoco" in sys.modules:
    import_module("cc_mujoco.engine")

# `gymnasium.make` knows the environments.
import_module("cc_mujoco.envs").register()
