"""Gymnasium environments: devices that are driven by cables.

    import gymnasium
    import cc_mujoco

    env = gymnasium.make("cc_mujoco/WristHandle-v1", trajectory="reach", task="spring")
    many = gymnasium.make_vec("cc_mujoco/AnkleExo-v1", num_envs=256)

`make_vec` simulates on a thread pool and equals, bit for bit, a `SyncVectorEnv` of the
single environments. The classes' documentation states what they observe and reward;
`cc_mujoco.device.DEVICES` has the ids.
`RecordVideo(env, folder)` makes videos of 30 pictures a second; `StableBaselines(many)`
is what Stable-Baselines3 trains on, and `save_policy` keeps what it has learnt.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._registered import (
        AnkleExo,
        AnkleExoVector,
        HipKneeExosuit,
        HipKneeExosuitVector,
        TendonFinger,
        TendonFingerVector,
        WristHandle,
        WristHandleVector,
    )
    from ._scalar import ExoEnv
    from ._stable_baselines import StableBaselines, save_policy
    from ._vector import ExoVectorEnv
    from ._video import RecordVideo

__all__ = [
    "AnkleExo",
    "AnkleExoVector",
    "ExoEnv",
    "ExoVectorEnv",
    "HipKneeExosuit",
    "HipKneeExosuitVector",
    "RecordVideo",
    "StableBaselines",
    "TendonFinger",
    "TendonFingerVector",
    "WristHandle",
    "WristHandleVector",
    "register",
    "save_policy",
]

MODULES = {
    "ExoEnv": "_scalar",
    "ExoVectorEnv": "_vector",
    "RecordVideo": "_video",
    "StableBaselines": "_stable_baselines",
    "save_policy": "_stable_baselines",
}
"""Module of a name that is not that of an environment."""


def register() -> None:
    """Register every environment with Gymnasium, once; `import cc_mujoco` does it."""
    import gymnasium

    # The ids of `DEVICES`, whose import would take longer than that of Gymnasium.
    for kind in __all__:
        vector, name = f"{kind}Vector", f"cc_mujoco/{kind}-v1"
        if vector in __all__ and name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{__name__}._registered:{kind}",
                vector_entry_point=f"{__name__}._registered:{vector}",
            )


def __getattr__(name: str) -> Any:
    # Classes come on request: with them come the scenes' and the wearer's modules,
    # which an import of the package alone need not wait for.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = MODULES.get(name, "_registered")
    return getattr(importlib.import_module(f"{__name__}.{module}"), name)
