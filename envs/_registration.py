"""Registration of the environments with Gymnasium, by id."""

from __future__ import annotations

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


def register() -> None:
    """Register every environment with Gymnasium, once, when `cc_mujoco` is imported."""
    import gymnasium

    for name, device in {**IDS, "cc_mujoco/Device-v1": ""}.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{__package__}._scalar:DeviceEnv",
                vector_entry_point=f"{__package__}._vector:DeviceVectorEnv",
                kwargs={"device": device},
            )
    if WALKING not in gymnasium.registry:
        gymnasium.register(WALKING, entry_point=f"{__package__}._walking:WalkingEnv")
