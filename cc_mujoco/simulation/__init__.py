"""Simulation: an episode of one device or of many, and its log.

    from cc_mujoco.simulation import simulate
    log = simulate("wrist", "pi", trajectory="sine", task="spring", seed=0)
    log["joint_torque_nm"]                      # (T,) [N m]

`simulate` returns an `EpisodeLog`; `play` returns that of an environment with its
wrappers. `run` is the loop of an episode, of one device or of a `Batch`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
