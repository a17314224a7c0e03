"""The task of mjlab: the person walks, and a motor takes over work of the ankle."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("mjlab")

from mjlab.envs import ManagerBasedRlEnv  # noqa: E402
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg  # noqa: E402

from cc_mujoco.human import Profile  # noqa: E402
from cc_mujoco.human._walking_rig import DRUM  # noqa: E402
from cc_mujoco.warp.mjlab._walker import walker  # noqa: E402
from cc_mujoco.warp.mjlab.walking_task import TASK  # noqa: E402

WORLDS, STEPS, SCALE = 2, 600, 5.0
LEVER = 0.1
"""Arm of the heel lever in push-off [m], about."""


@pytest.fixture(scope="module")
def env():
    configuration = load_env_cfg(TASK)
    configuration.scene.num_envs, configuration.seed = WORLDS, 1
    return ManagerBasedRlEnv(configuration, device="cpu")


def walked(env, law):
    """Walk for 6 s; return ankle power, tension, height and load of the last 3 s."""
    env.reset(seed=1)
    person, found = walker(env), []
    for _ in range(STEPS):
        *_, over, _, _ = env.step(law(person))
        assert not over.any(), "the person fell"
        power = (person.torque * person.rates)[:, :, 2]
        tension = env.scene["robot"].actuators[-1].tension[..., 1]
        found.append(torch.cat((power, tension, person.load), dim=-1).numpy())
    return np.split(np.array(found)[STEPS // 2 :], 3, axis=-1)


def limp(person):
    return torch.zeros(WORLDS, 2)


def pushing(person):
    """Help while the ankle plantarflexes, as `WalkingEnv.assistance`."""
    task = Profile(onset=46.0, peak_time=56.0, fall=6.0)
    torque = [
        [-task.torque(0.0, 0.0, float(p)) for p in leg] for leg in person.person.phase
    ]
    return torch.tensor(torque) * DRUM / LEVER / SCALE


def test_a_pulse_in_push_off_takes_over_positive_work_of_the_ankle(env):
    alone, _, load = walked(env, limp)
    helped, tension, _ = walked(env, pushing)
    work = [float(np.maximum(power, 0.0).mean()) for power in (alone, helped)]
    print(f"positive power of an ankle {work[0]:.1f} W alone, {work[1]:.1f} W helped")
    assert load.sum(axis=-1).mean() == pytest.approx(1.0, abs=0.1)
    assert tension.max() > 100.0
    assert work[1] < 0.95 * work[0]


def test_the_configuration_of_ppo_is_complete(env):
    assert load_rl_cfg(TASK).algorithm.class_name == "PPO"
    assert env.action_manager.total_action_dim == 2
    assert env.observation_manager.group_obs_dim["actor"] == (18,)
