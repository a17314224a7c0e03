"""The task of mjlab: the person walks on the ground, and motors pull at push-off."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mjlab")

import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg

from cc_mujoco.human._walking_body import DRUM, PUSH_OFF
from cc_mujoco.warp.mjlab.walking_task import MOTORS, TASK, walker

ANKLES = ("right_ankle", "left_ankle")
WORLDS, STEPS, MEASURED, SCALE = 2, 500, 250, 5.0
LEVER = 0.11
"""Arm of the heel lever [m], about."""
SLACK = 0.01
"""Rope that hangs outside push-off [m]."""


@pytest.fixture(scope="module")
def env():
    configuration = load_env_cfg(TASK)
    configuration.scene.num_envs, configuration.seed = WORLDS, 1
    return ManagerBasedRlEnv(configuration, device="cpu")


def walked(env, law):
    """Walk for 5 s; return ankle power, tension and load of the last 2.5 s."""
    env.reset(seed=1)
    person, found = walker(env), []
    data, motors = env.scene["robot"].data, env.scene["robot"].find_joints(MOTORS)[0]
    ankles = env.scene["robot"].find_joints(ANKLES, preserve_order=True)[0]
    begun = data.joint_pos[:, ankles].clone()
    for _ in range(STEPS):
        apart = data.joint_pos[:, motors] * DRUM
        apart += LEVER * (data.joint_pos[:, ankles] - begun)
        rate = data.joint_vel[:, motors] * DRUM + LEVER * data.joint_vel[:, ankles]
        *_, over, _, _ = env.step(law(person, apart, rate) / SCALE)
        assert not over.any(), "the person fell"
        power = (person.torque * person.rates)[:, :, 2]
        tension = env.scene["robot"].actuators[-1].tension[..., 1]
        found.append(torch.cat((power, tension, person.load), dim=-1).numpy())
    return np.split(np.array(found)[-MEASURED:], 3, axis=-1)


def following(person, apart, rate):
    """Follow the ankle with a slack rope."""
    return -(8.0 * (apart + SLACK) + 0.3 * rate) / DRUM


def pushing(person, apart, rate):
    """Help while the ankle plantarflexes, as `WalkingEnv.assistance` does."""
    phases = person.person.phase
    torque = [
        [-PUSH_OFF.torque(0.0, 0.0, float(phase)) for phase in leg] for leg in phases
    ]
    pull = torch.tensor(torque) * DRUM / LEVER
    return torch.where(pull > 0.1, pull, following(person, apart, rate))


def test_the_person_walks_upright_while_motors_pull_at_push_off(env):
    alone, _, load = walked(env, following)
    helped, tension, _ = walked(env, pushing)
    work = [float(np.maximum(power, 0.0).mean()) for power in (alone, helped)]
    print(f"positive power of an ankle {work[0]:.1f} W alone, {work[1]:.1f} W helped")
    assert load.sum(axis=-1).mean() == pytest.approx(1.0, abs=0.1)
    assert tension.max() > 100.0


def test_the_configuration_of_ppo_is_complete(env):
    assert load_rl_cfg(TASK).algorithm.class_name == "PPO"
    assert env.action_manager.total_action_dim == 2
    assert env.observation_manager.group_obs_dim["actor"] == (18,)
