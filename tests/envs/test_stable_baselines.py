"""Stable-Baselines3 on the vector environment; where it is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco.control import controller, read_policy
from cc_mujoco.errors import CableError

algorithms = pytest.importorskip("stable_baselines3")

from stable_baselines3.common.vec_env import (  # noqa: E402
    VecEnvWrapper,
    VecMonitor,
    VecNormalize,
)

from cc_mujoco.envs import StableBaselines, save_policy  # noqa: E402

WRIST = "cc_mujoco/WristHandle-v1"
PAST: dict[str, Any] = {"hold": 2, "history": 1, "memory": True}


def made(count: int = 4, **given: Any) -> Any:
    """Return a vector environment for Stable Baselines."""
    about = {"duration": 0.02, "autoreset_mode": "SameStep", **PAST, **given}
    return gymnasium.make_vec(WRIST, count, **about)


def acts(model: Any, seen: Any) -> Any:
    """Return the action of a model at its mean."""
    given, _ = model.predict(seen.astype(np.float32), deterministic=True)
    return np.clip(given, -1.0, 1.0)


def test_it_steps_as_the_vector_environment_and_says_what_ended() -> None:
    parts = made(2), made(3, task="transparent")
    plain = made(2), made(3, task="transparent")
    env = StableBaselines(*parts)
    assert env.num_envs == 5
    env.seed(7)
    seen = env.reset()
    own = [plain[0].reset(seed=7), plain[1].reset(seed=9)]
    assert np.array_equal(seen, np.concatenate([one[0] for one in own]))
    random = np.random.default_rng(0)
    for step in range(1, 25):
        actions = random.uniform(-1, 1, (5, 1)).astype(np.float32)
        seen, rewards, overs, infos = env.step(actions)
        ours = [plain[0].step(actions[:2]), plain[1].step(actions[2:])]
        assert np.array_equal(seen, np.concatenate([one[0] for one in ours]))
        assert np.allclose(rewards, np.concatenate([one[1] for one in ours]))
        assert overs.all() == overs.any() == (step % 10 == 0)
        for row, info in enumerate(infos):
            assert ("terminal_observation" in info) == bool(overs[row])
            if overs[row]:
                part, place = divmod(row, 2) if row < 2 else (1, row - 2)
                last = ours[part][4]["final_obs"][place]
                assert np.array_equal(info["terminal_observation"], last)
                assert info["TimeLimit.truncated"]
    assert env.get_attr("num_envs") == [2, 2, 3, 3, 3]
    assert env.env_is_wrapped(gymnasium.Wrapper, 1) == [False]
    env.close()


@pytest.mark.parametrize("kind", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
@pytest.mark.parametrize("normalised", [True, False])
def test_what_any_algorithm_learns_is_played_as_it_predicts(
    kind: str, normalised: bool, tmp_path: Path
) -> None:
    env: VecEnvWrapper = VecMonitor(StableBaselines(made()))
    if normalised:
        env = VecNormalize(env, clip_obs=2.0)
    steps = {"n_steps": 16} if kind in ("PPO", "A2C") else {"learning_starts": 8}
    net = {"net_arch": [16, 16]}
    options: dict[str, Any] = {"seed": 0, "device": "cpu", "policy_kwargs": net}
    model = getattr(algorithms, kind)("MlpPolicy", env, **options, **steps)
    model.learn(64)
    path = tmp_path / "policy.safetensors"
    save_policy(model, path)
    network, observed = read_policy(path)
    assert observed == made().exo.observed
    random = np.random.default_rng(0)
    for seen in random.normal(0.0, 2.0, (10, network.mean.size)):
        shown = seen
        if normalised:
            moments = env.obs_rms  # type: ignore[attr-defined]
            shown = (seen - moments.mean) / np.sqrt(moments.var + 1e-8)
            shown = np.clip(shown, -2.0, 2.0)
        assert network(seen) == pytest.approx(acts(model, shown), abs=1e-6)
    drive = gymnasium.make(WRIST, duration=0.02).unwrapped.drive  # type: ignore[attr-defined]
    controller(str(path), drive)


@pytest.mark.parametrize("seed", [None, 3])
def test_it_trains_with_a_seed_and_without(seed: int | None) -> None:
    env = VecNormalize(StableBaselines(made()))
    model = algorithms.PPO("MlpPolicy", env, n_steps=16, seed=seed, device="cpu")
    model.learn(64)


def test_options_reach_the_plants() -> None:
    env = StableBaselines(made(2), made(3))
    env.seed(1)
    env.set_options({"friction": 0.05})
    env.reset()
    given = [plant for own in env.envs for plant in own.plants]
    assert all(0.05 in plant.values.values() for plant in given)
    env.reset()
    assert not any(0.05 in plant.values.values() for plant in env.envs[1].plants)
    env.set_options([{"friction": 0.1}, {"friction": 0.2}, {}, {}, {}])
    with pytest.raises(CableError, match="options of one vector environment"):
        env.reset()


def test_a_policy_of_a_plain_environment_is_saved(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    env: Any = gymnasium.make(WRIST, duration=0.02, **PAST)
    model = algorithms.PPO("MlpPolicy", env, n_steps=64, device="cpu")
    save_policy(model, path)
    _, observed = read_policy(path)
    assert observed == env.unwrapped.exo.observed
    rescaled = gymnasium.wrappers.RescaleAction(env, np.float32(-2.0), np.float32(2.0))
    other = algorithms.PPO("MlpPolicy", rescaled, n_steps=64, device="cpu")
    with pytest.raises(CableError, match="cannot save through"):
        save_policy(other, path)


def test_a_normalisation_of_gymnasium_is_saved_once(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    env = gymnasium.wrappers.NormalizeObservation(
        gymnasium.make(WRIST, duration=0.02, **PAST)
    )
    model = algorithms.PPO("MlpPolicy", env, n_steps=64, device="cpu")
    model.learn(64)
    save_policy(model, path)
    network, _ = read_policy(path)
    moments = env.obs_rms
    seen = np.random.default_rng(0).normal(size=network.mean.size)
    normal = (seen - moments.mean) / np.sqrt(moments.var + env.epsilon)
    assert network(seen) == pytest.approx(acts(model, normal), abs=1e-6)
    again = tmp_path / "again.safetensors"
    model.save(tmp_path / "model.zip")
    loaded = algorithms.PPO.load(tmp_path / "model.zip", device="cpu")
    save_policy(loaded, again, env)
    assert again.read_bytes() == path.read_bytes()
    twice = VecNormalize(model.get_env())
    model = algorithms.PPO("MlpPolicy", twice, n_steps=64, device="cpu")
    with pytest.raises(CableError, match="two normalisations"):
        save_policy(model, path)


def test_a_policy_of_two_motors_is_played_as_it_predicts(tmp_path: Path) -> None:
    about = {"duration": 0.02, "autoreset_mode": "SameStep", **PAST}
    many = gymnasium.make_vec("cc_mujoco/Device-v1", 4, device="exosuit", **about)
    env = StableBaselines(many)
    model = algorithms.PPO("MlpPolicy", env, n_steps=16, seed=0, device="cpu")
    model.learn(64)
    path = tmp_path / "policy.safetensors"
    save_policy(model, path)
    network, observed = read_policy(path)
    assert network.motors == len(observed) == 2
    seen = np.random.default_rng(0).normal(size=network.mean.size)
    assert network(seen) == pytest.approx(acts(model, seen), abs=1e-6)


def test_what_cannot_be_trained_or_saved_is_one_sentence(tmp_path: Path) -> None:
    for envs, words in (
        ((), "make_vec"),
        ((gymnasium.make(WRIST),), "make_vec"),
        ((made(autoreset_mode="NextStep"),), "SameStep"),
        ((made(), made(history=3)), "observe the same"),
    ):
        with pytest.raises(CableError, match=words):
            StableBaselines(*envs)
    env = StableBaselines(made())
    with pytest.raises(CableError, match="attributes"):
        env.set_attr("plant", None)
    with pytest.raises(CableError, match="methods"):
        env.env_method("reset")
    other = algorithms.PPO("MlpPolicy", "Pendulum-v1", n_steps=64, device="cpu")
    with pytest.raises(CableError, match="trained on cc_mujoco's devices"):
        save_policy(other, tmp_path / "p.safetensors")
    kinds = {"activation_fn": __import__("torch").nn.Mish}
    mish = algorithms.PPO("MlpPolicy", env, policy_kwargs=kinds, device="cpu")
    with pytest.raises(CableError, match="unknown activation 'mish'"):
        save_policy(mish, tmp_path / "p.safetensors")
