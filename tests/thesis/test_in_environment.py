"""An online estimator beside the step loop of an environment."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import cc_mujoco  # noqa: F401  registers the environments
from cc_mujoco import plugin
from cc_mujoco.device import Sensors
from thesis._estimators import FrictionEstimator


def test_friction_of_the_scene_is_found_while_the_environment_steps() -> None:
    env = gymnasium.make("cc_mujoco/WristHandle-v1", duration=1.0)
    inner = env.unwrapped
    cable = plugin.from_mjcf(inner.model)["flexor"]
    sensors = Sensors.at(cable, np.linspace(0.0, cable.length, 11).tolist(), 0.5)
    estimator = FrictionEstimator(cable, sensors, start=2.0 * cable.friction)
    random = np.random.default_rng(1)
    env.reset(seed=0)
    over, step = False, 0
    while not over:
        push = np.array([0.4 * np.sin(0.2 * step)], dtype=np.float32)
        _, _, terminated, truncated, _ = env.step(push)
        over, step = terminated or truncated, step + 1
        reading = plugin.read(inner.model, inner.data, "flexor")
        seen = reading.tension[list(sensors.nodes)]
        estimator.update(seen + 0.5 * random.normal(size=seen.shape), reading.slip)
    env.close()
    assert estimator.friction == pytest.approx(cable.friction, rel=0.05)
    # Where motion turns in the first or last segment its direction does not tell so.
    unseen = 0.005 * cable.friction
    error = abs(estimator.friction - cable.friction)
    assert error < 3.0 * estimator.deviation + unseen
    assert estimator.misfit == pytest.approx(1.0, abs=0.2)
