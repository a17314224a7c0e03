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

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
