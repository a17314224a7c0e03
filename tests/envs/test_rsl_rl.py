"""rsl_rl on the vector environment; where it is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco.control import read_policy
from cc_mujoco.errors import CableError

pytest.importorskip("rsl_rl")

import torch
from rsl_rl.runners import OnPolicyRunner

from cc_mujoco.envs import RslRl, save_policy

PAST: dict[str, Any] = {"hold": 2, "history": 1, "memory": True}


def made(count: int = 4, device: str = "wrist", **given: Any) -> Any:
    """Return a vector environment whose episodes have ten steps."""
    about = {"duration": 0.02, "autoreset_mode": "Disabled", **PAST, **given}
    return gymnasium.make_vec("cc_mujoco/Device-v1", count, device=device, **about)


def runner(env: RslRl, normalised: bool = True) -> OnPolicyRunner:
    """Return rsl_rl's runner with small networks."""
    net = {
        "class_name": "MLPModel",
        "hidden_dims": [8, 8],
        "activation": "elu",
        "obs_normalization": normalised,
    }
    gaussian = {"class_name": "GaussianDistribution", "init_std": 0.5}
    return OnPolicyRunner(
        env,
        {
            "algorithm": {"class_name": "PPO"},
            "actor": {**net, "distribution_cfg": gaussian},
            "critic": net,
            "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
            "num_steps_per_env": 8,
            "save_interval": 100,
        },
    )


def test_it_steps_as_the_vector_environment_and_resets_what_is_over() -> None:
    env, plain = RslRl(made(), seed=7), made(autoreset_mode="SameStep")
    seen, _ = plain.reset(seed=7)
    assert (env.num_envs, env.num_actions, env.max_episode_length) == (4, 1, 10)
    assert np.array_equal(env.get_observations()["policy"], seen)
    random = np.random.default_rng(0)
    for step in range(1, 25):
        actions = random.uniform(-1, 1, (4, 1)).astype(np.float32)
        found, rewards, over, extras = env.step(torch.from_numpy(actions))
        seen, gained, *_ = plain.step(actions)
        assert np.array_equal(found["policy"], seen)
        assert np.allclose(rewards, gained)
        assert over.tolist() == extras["time_outs"].tolist() == [step % 10 == 0] * 4
        assert env.episode_length_buf.tolist() == [step % 10] * 4


def test_environments_whose_count_began_later_are_reset_earlier() -> None:
    env = RslRl(made())
    env.episode_length_buf = torch.tensor([0, 3, 9, 8])
    overs = [env.step(torch.zeros(4, 1))[2].tolist() for _ in range(7)]
    assert np.flatnonzero(np.sum(overs, axis=0)).tolist() == [1, 2, 3]
    assert overs[0] == [0, 0, 1, 0] and overs[1] == [0, 0, 0, 1]


@pytest.mark.parametrize("device", ["wrist", "exosuit"])
@pytest.mark.parametrize("normalised", [True, False])
def test_what_it_learns_is_played_as_it_predicts(
    device: str, normalised: bool, tmp_path: Path
) -> None:
    env = RslRl(made(device=device), seed=0)
    learner = runner(env, normalised)
    learner.learn(2, init_at_random_ep_len=True)
    path = tmp_path / "policy.safetensors"
    save_policy(learner, path)
    network, observed = read_policy(path)
    assert observed == env.observed
    act = learner.get_inference_policy()
    seen = env.get_observations()
    seen["policy"] = seen["policy"].double()
    learner.alg.get_policy().double()
    with torch.no_grad():
        given = act(seen).clamp(-1.0, 1.0).numpy()
    for row, own in zip(seen["policy"].numpy(), given, strict=True):
        assert network(row.astype(float)) == pytest.approx(own, abs=1e-6)


def test_what_cannot_be_trained_or_saved_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="Disabled"):
        RslRl(made(autoreset_mode="SameStep"))
    with pytest.raises(CableError, match="make_vec"):
        RslRl(gymnasium.make("cc_mujoco/WristHandle-v1"))  # type: ignore[arg-type]
    learner = runner(RslRl(made()))
    learner.alg.get_policy().distribution = None
    with pytest.raises(CableError, match="GaussianDistribution"):
        save_policy(learner, tmp_path / "policy.safetensors")
