"""Gymnasium environments: devices that are driven by cables.

    import gymnasium
    import cc_mujoco

    env = gymnasium.make("cc_mujoco/WristHandle-v1", trajectory="reach", task="spring")
    many = gymnasium.make_vec("cc_mujoco/AnkleExo-v1", num_envs=256)
    mine = gymnasium.make("cc_mujoco/Device-v1", device="knee.xml")

`make_vec` simulates on a thread pool, or with `backend="warp"` in mujoco_warp, on a
GPU if there is one. On a thread pool it equals a `SyncVectorEnv` of single
environments: bit for bit if the scene states its inertias, else to rounding.
`DeviceEnv` states observations and rewards, `IDS` the ids; `WalkingEnv` is a person who
walks on the ground. `RecordVideo(env, folder)` makes videos of 30 frames per second;
`StableBaselines(many)` is an environment for Stable-Baselines3, `RslRl(many)` one for
rsl_rl; `save_policy` saves the policies that they train.
"""

import lazy_loader

__getattr__, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = [name for name in _names if name not in ("RslRl", "StableBaselines")]
"""Names that need no training library."""
