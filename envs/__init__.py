"""Gymnasium environments: devices that are driven by cables.

    import gymnasium
    import cc_mujoco

    env = gymnasium.make("cc_mujoco/WristHandle-v1", trajectory="reach", task="spring")
    many = gymnasium.make_vec("cc_mujoco/AnkleExo-v1", num_envs=256)
    mine = gymnasium.make("cc_mujoco/Device-v1", device="knee.xml")

`make_vec` simulates on a thread pool, or with `backend="warp"` in mujoco_warp, on a
GPU if there is one; on a thread pool it equals a `SyncVectorEnv` of the single
environments: bit for bit where the scene states its inertias, else to rounding.
`DeviceEnv` states what is observed and rewarded, `IDS` the ids; `WalkingEnv` is a
person who walks on the ground.
`RecordVideo(env, folder)` makes videos of 30 pictures a second; `StableBaselines(many)`
is what Stable-Baselines3 trains on, `RslRl(many)` what rsl_rl does, and `save_policy`
keeps what they have learnt.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._rsl_rl import RslRl
    from ._save_policy import save_policy
    from ._scalar import DeviceEnv
    from ._stable_baselines import StableBaselines
    from ._vector import DeviceVectorEnv
    from ._video import RecordVideo
    from ._walking import WalkingEnv

__all__ = [
    "BACKENDS",
    "IDS",
    "WALKING",
    "DeviceEnv",
    "DeviceVectorEnv",
    "RecordVideo",
    "RslRl",
    "StableBaselines",
    "WalkingEnv",
    "register",
    "save_policy",
]

IDS = {
    "cc_mujoco/WristHandle-v1": "wrist",
    "cc_mujoco/AnkleExo-v1": "ankle",
    "cc_mujoco/TendonFinger-v1": "finger",
    "cc_mujoco/HipKneeExosuit-v2": "exosuit",
}
"""Ids of the built-in devices; `cc_mujoco/Device-v1` takes any."""

WALKING = "cc_mujoco/Walking-v0"
"""Id of the person who walks on the ground, see `WalkingEnv`."""

BACKENDS = ("mujoco", "warp")
"""Engines of vector environments: that of MuJoCo in batches, and mujoco_warp."""

_MODULES = {
    "DeviceEnv": "_scalar",
    "DeviceVectorEnv": "_vector",
    "RecordVideo": "_video",
    "RslRl": "_rsl_rl",
    "StableBaselines": "_stable_baselines",
    "WalkingEnv": "_walking",
    "save_policy": "_save_policy",
}


def register() -> None:
    """Register every environment with Gymnasium, once; `import cc_mujoco` does it."""
    import gymnasium

    for name, device in {**IDS, "cc_mujoco/Device-v1": ""}.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{__name__}._scalar:DeviceEnv",
                vector_entry_point=f"{__name__}._vector:DeviceVectorEnv",
                kwargs={"device": device},
            )
    if WALKING not in gymnasium.registry:
        gymnasium.register(WALKING, entry_point=f"{__name__}._walking:WalkingEnv")


def __getattr__(name: str) -> Any:
    # Classes come on request: with them come the modules of scenes and wearer, which
    # an import of the package alone need not wait for.
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
