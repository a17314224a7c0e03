"""Settings that all tests share."""

from __future__ import annotations

import pytest
from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a compiled function
# includes its compilation.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Compile what is kept on disk once, before workers start that would each do it."""
    if hasattr(config, "workerinput"):
        return
    import gymnasium

    import cc_mujoco.envs  # noqa: F401, compiles the plugin
    from cc_mujoco.control import controller
    from cc_mujoco.transmission import Cable, Transmission, replay

    cable, still = Cable(), [0.0, 0.0]
    replay(cable, 1e-3, u_proximal=still, u_distal=still)
    pulleys = Transmission.pull_pull(cable, motor_radius=0.02, joint_radius=0.05)
    pulleys.replay(1e-3, motor_angle=still, joint_angle=still)
    with gymnasium.make("cc_mujoco/WristHandle-v0") as env:
        _, seen = env.reset(seed=0)
        for name in ("model", "stiction"):
            controller(name, env.unwrapped.drive).torque(seen)
