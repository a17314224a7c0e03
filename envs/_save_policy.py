"""Policies that a library for training has learnt, as files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from cc_mujoco.control import Network, write_policy
from cc_mujoco.errors import CableError


def save_policy(model: Any, path: str | os.PathLike[str]) -> None:
    """Write the policy that an algorithm has learnt to a file.

    Args:
        model: Of Stable-Baselines3 PPO, A2C, SAC, TD3 or DDPG with an `MlpPolicy`,
            trained on `StableBaselines`, inside of `VecNormalize` or not; or rsl_rl's
            `OnPolicyRunner` with an `MLPModel` on `RslRl`.
        path: Of the file, `*.safetensors`; see `cc_mujoco.control.write_policy`.

    Raises:
        CableError: If it is another algorithm, network or environment.
    """
    saved = _of_rsl_rl if hasattr(model, "alg") else _of_stable_baselines
    network, observed = saved(model)
    write_policy(path, network, observed)


def _of_rsl_rl(runner: Any) -> tuple[Network, Any]:
    """Return the network of a runner and what it observes."""
    from rsl_rl.modules import GaussianDistribution

    from ._rsl_rl import RslRl

    actor = runner.alg.get_policy()
    gaussian = type(getattr(actor, "distribution", None)) is GaussianDistribution
    if not isinstance(runner.env, RslRl) or actor.is_recurrent or not gaussian:
        raise CableError(
            "save_policy needs a runner on RslRl whose actor is an MLPModel with a "
            "GaussianDistribution."
        )
    mean, deviation = np.zeros(actor.obs_dim), np.ones(actor.obs_dim)
    if actor.obs_normalization:
        mean = actor.obs_normalizer.mean.cpu().numpy().astype(float)
        deviation = (actor.obs_normalizer.std + actor.obs_normalizer.eps).cpu().numpy()
    network = Network.of_layers(actor.mlp, mean, deviation.astype(float))
    return network, runner.env.observed


def _of_stable_baselines(model: Any) -> tuple[Network, Any]:
    """Return the network of an algorithm and what it observes."""
    from stable_baselines3.common.vec_env import VecNormalize

    from ._stable_baselines import StableBaselines

    inner, normal = model.get_env(), None
    while inner is not None and not isinstance(inner, StableBaselines):
        normal = inner if isinstance(inner, VecNormalize) else normal
        inner = getattr(inner, "venv", None)
    if inner is None:
        raise CableError("save_policy needs a model trained on StableBaselines.")
    layers, squashed = _layers(model.policy)
    size = inner.observation_space.shape[0]
    mean, deviation, far = np.zeros(size), np.ones(size), np.inf
    if normal is not None and normal.norm_obs:
        mean = np.array(normal.obs_rms.mean, dtype=float)
        deviation = np.sqrt(normal.obs_rms.var + normal.epsilon)
        far = float(normal.clip_obs)
    network = Network.of_layers(layers, mean, deviation, squashed, far)
    return network, inner.observed


def _layers(policy: Any) -> tuple[list[Any], bool]:
    """Return the layers from observation to action, and whether a tangent follows."""
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
