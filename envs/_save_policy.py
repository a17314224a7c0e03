"""Export of policies from training libraries to files."""

from __future__ import annotations

import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium import wrappers

from cc_mujoco.control import Network, write_policy
from cc_mujoco.errors import CableError

from ._scalar import DeviceEnv
from ._vector import DeviceVectorEnv

PLAIN_WRAPPERS = (
    wrappers.Autoreset, wrappers.ClipAction, wrappers.OrderEnforcing,
    wrappers.PassiveEnvChecker, wrappers.RecordEpisodeStatistics, wrappers.RecordVideo,
    wrappers.TimeLimit, wrappers.vector.RecordEpisodeStatistics,
    gymnasium.RewardWrapper, gymnasium.vector.VectorRewardWrapper,
)  # fmt: skip
"""Wrappers of Gymnasium that change neither observations nor what an action does."""


def save_policy(model: Any, path: str | os.PathLike[str]) -> None:
    """Write the policy of a trained model to a file.

    Args:
        model: Model of Stable-Baselines3 PPO, A2C, SAC, TD3 or DDPG with an
            `MlpPolicy`, trained on an environment of `gymnasium.make` or on
            `StableBaselines`, with or without `VecNormalize`; or rsl_rl's
            `OnPolicyRunner` with an `MLPModel` on any wrapper of an environment of this
            package.
        path: Path of the file, `*.safetensors`; see `cc_mujoco.control.write_policy`.

    Raises:
        CableError: If algorithm, network or environment is not one of these, or a
            wrapper changes the observations of the policy.
    """
    saved = _of_rsl_rl if hasattr(model, "alg") else _of_stable_baselines
    network, observed = saved(model)
    write_policy(path, network, observed)


def _observed(env: Any) -> tuple[Any, ...]:
    """Return the observation of each axis, from the environment inside of wrappers."""
    while env is not None and not isinstance(env, (DeviceEnv, DeviceVectorEnv)):
        if hasattr(env, "observed"):  # `StableBaselines` and `RslRl`
            return tuple(env.observed)
        wraps = isinstance(env, (gymnasium.Wrapper, gymnasium.vector.VectorWrapper))
        # Monitor of Stable-Baselines3 records what it passes on.
        plain = isinstance(env, PLAIN_WRAPPERS) or type(env).__name__ == "Monitor"
        if wraps and not plain:
            raise CableError(
                f"save_policy cannot save through {type(env).__name__}, which may "
                "change observations or actions; train without it."
            )
        inner = [getattr(env, name, None) for name in ("env", "venv")]
        inner += list(getattr(env, "envs", ()))[:1]
        env = next((one for one in inner if one is not None), None)
    if env is None:
        raise CableError("save_policy needs a model trained on cc_mujoco's devices.")
    return tuple(env.exo.observed)


def _of_rsl_rl(runner: Any) -> tuple[Network, Any]:
    from rsl_rl.modules import GaussianDistribution

    actor = runner.alg.get_policy()
    gaussian = type(getattr(actor, "distribution", None)) is GaussianDistribution
    if actor.is_recurrent or not gaussian:
        raise CableError(
            "save_policy needs a runner whose actor is an MLPModel with a "
            "GaussianDistribution."
        )
    mean, deviation = np.zeros(actor.obs_dim), np.ones(actor.obs_dim)
    if actor.obs_normalization:
        mean = actor.obs_normalizer.mean.cpu().numpy().astype(float)
        deviation = (actor.obs_normalizer.std + actor.obs_normalizer.eps).cpu().numpy()
    network = Network.of_layers(actor.mlp, mean, deviation.astype(float))
    return network, _observed(runner.env)


def _of_stable_baselines(model: Any) -> tuple[Network, Any]:
    from stable_baselines3.common import vec_env

    inner, normal = model.get_env(), None
    while isinstance(inner, vec_env.VecEnvWrapper):
        if isinstance(inner, vec_env.VecNormalize):
            normal = inner
        elif not isinstance(inner, (vec_env.VecMonitor, vec_env.VecVideoRecorder)):
            raise CableError(
                f"save_policy cannot save through {type(inner).__name__}, which may "
                "change observations; train without it."
            )
        inner = inner.venv
    if isinstance(inner, vec_env.SubprocVecEnv):
        raise CableError(
            "save_policy cannot look into the processes of SubprocVecEnv; train on "
            "DummyVecEnv, or on StableBaselines, which is faster."
        )
    observed = _observed(inner)
    layers, squashed = _layers(model.policy)
    size = inner.observation_space.shape[0]
    mean, deviation, far = np.zeros(size), np.ones(size), np.inf
    if normal is not None and normal.norm_obs:
        mean = np.array(normal.obs_rms.mean, dtype=float)
        deviation = np.sqrt(normal.obs_rms.var + normal.epsilon)
        far = float(normal.clip_obs)
    return Network.of_layers(layers, mean, deviation, squashed, far), observed


def _layers(policy: Any) -> tuple[list[Any], bool]:
    """Return the layers from observation to action, and whether tanh follows."""
    from stable_baselines3.common.torch_layers import FlattenExtractor

    actor: Any = getattr(policy, "actor", None)
    if actor is None and hasattr(policy, "mlp_extractor"):
        owner, squashed = policy, bool(getattr(policy, "squash_output", False))
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
    elif hasattr(actor, "latent_pi"):
        owner, squashed, layers = actor, True, [*actor.latent_pi, actor.mu]
    elif hasattr(actor, "mu"):
        # TD3 and DDPG have the tangent as their last layer.
        owner, squashed, layers = actor, True, [*actor.mu][:-1]
    else:
        raise CableError("the model must be one of PPO, A2C, SAC, TD3 or DDPG.")
    extractor = getattr(owner, "pi_features_extractor", owner.features_extractor)
    if not isinstance(extractor, FlattenExtractor):
        raise CableError("the policy must be an MlpPolicy without another extractor.")
    return layers, squashed
