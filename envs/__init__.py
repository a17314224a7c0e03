"""Gymnasium environments: a wrist handle and an ankle exoskeleton driven by cables.

    import gymnasium
    import cc_mujoco

    env = gymnasium.make("cc_mujoco/WristHandle-v0", trajectory="reach", task="spring")
    many = gymnasium.make_vec("cc_mujoco/AnkleExo-v0", num_envs=256)

`make_vec` simulates on a thread pool and equals, bit for bit, a `SyncVectorEnv` of the
single environments. The classes' documentation says what they observe and reward.
`RecordVideo(env, folder)` makes videos of 30 pictures a second.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .ankle_exo import AnkleExo, AnkleExoVector
    from .video import RecordVideo
    from .wrist_handle import WristHandle, WristHandleVector

__all__ = [
    "IDS",
    "AnkleExo",
    "AnkleExoVector",
    "RecordVideo",
    "WristHandle",
    "WristHandleVector",
    "register",
]

IDS = {
    "cc_mujoco/WristHandle-v0": "cc_mujoco.envs.wrist_handle:WristHandle",
    "cc_mujoco/AnkleExo-v0": "cc_mujoco.envs.ankle_exo:AnkleExo",
}
"""Ids and where their classes are; a class's vector form has `Vector` appended."""


def register() -> None:
    """Tell Gymnasium of every environment, once; `import cc_mujoco` does it."""
    import gymnasium

    for name, entry_point in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=entry_point,
                vector_entry_point=f"{entry_point}Vector",
            )


def __getattr__(name: str) -> Any:
    # Classes come when asked for: with them come the scenes' and the wearer's modules,
    # which an import of the package alone need not wait for.
    if name == "RecordVideo":
        return importlib.import_module(f"{__name__}.video").RecordVideo
    for place in IDS.values():
        module, single = place.split(":")
        if name in (single, f"{single}Vector"):
            return getattr(importlib.import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
