"""Export of policies from training libraries to files."""

from __future__ import annotations

import dataclasses
import os
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import wrappers

from cc_mujoco.control import Network, write_policy
from cc_mujoco.errors import CableError

from ._scalar import DeviceEnv
from ._vector import DeviceVectorEnv

PLAIN_WRAPPERS = (
    wrappers.Autoreset, wrappers.ClipAction, wrappers.FlattenObservation,
    wrappers.HumanRendering, wrappers.NormalizeReward, wrappers.OrderEnforcing,
    wrappers.PassiveEnvChecker, wrappers.RecordEpisodeStatistics, wrappers.RecordVideo,
    wrappers.TimeLimit, wrappers.vector.ClipAction, wrappers.vector.DictInfoToList,
    wrappers.vector.FlattenObservation, wrappers.vector.HumanRendering,
    wrappers.vector.NormalizeReward, wrappers.vector.RecordEpisodeStatistics,
    wrappers.vector.RecordVideo, gymnasium.RewardWrapper,
    gymnasium.vector.VectorRewardWrapper,
)  # fmt: skip
"""Wrappers of Gymnasium that change neither observations nor what an action does."""
NORMALISERS = wrappers.NormalizeObservation, wrappers.vector.NormalizeObservation
TRANSFORMERS = wrappers.TransformObservation, wrappers.vector.TransformObservation


def save_policy(model: Any, path: str | os.PathLike[str], env: Any = None) -> None:
    """Write the policy of a trained model to a file.

    Args:
        model: One of
            - a model of Stable-Baselines3 PPO, A2C, SAC, TD3 or DDPG with an
              `MlpPolicy`, trained on an environment of `gymnasium.make` or on
              `StableBaselines`, with or without `VecNormalize`;
            - rsl_rl's `OnPolicyRunner` with an `MLPModel` on any wrapper of an
              environment of this package;
            - the agent of CleanRL's `ppo_continuous_action.py`, or the actor of its
              SAC, TD3 or DDPG;
            - a `torch.nn.Sequential` of `Linear` layers and activations;
            - a `cc_mujoco.control.Network`, as of NumPy arrays.
        path: Path of the file, `*.safetensors`; see `cc_mujoco.control.write_policy`.
        env: Environment of the training in its wrappers, which the last three need.
            Statistics of `NormalizeObservation` and the bounds of a
            `TransformObservation` that clips around it become the network's.
            Environments of a `SyncVectorEnv` that normalise separately are pooled.

    Raises:
        CableError: If algorithm, network or environment is not one of these, or a
            wrapper changes observations or actions otherwise.
    """
    if isinstance(model, Network) or hasattr(model, "state_dict"):
        network, observed = _of_network(model, env)
    elif hasattr(model, "alg"):
        network, observed = _of_rsl_rl(model)
    elif hasattr(model, "get_env"):
        network, observed = _of_stable_baselines(model, env)
    else:
        raise CableError(
            "save_policy takes a model of Stable-Baselines3, a runner of rsl_rl, a "
            f"PyTorch module or a cc_mujoco.control.Network, not a "
            f"{type(model).__name__}."
        )
    write_policy(path, network, observed)


class _Seen(NamedTuple):
    """Observation of a policy through the wrappers of its environment."""

    observed: tuple[Any, ...]  # of each axis
    weight: float = 0.0  # number of observations normalised; 0 without it
    mean: Any = 0.0  # (size,)
    variance: Any = 1.0  # (size,), with the constant added to it
    far: float = np.inf  # bound at which the quotient is clipped

    @property
    def is_plain(self) -> bool:
        return not self.weight and np.isinf(self.far)

    def apply(self, network: Network) -> Network:
        """Return the network that normalises its observations first.

        Raises:
            CableError: If it already does.
        """
        if self.is_plain:
            return network
        own = network.mean.any() or (network.deviation != 1.0).any()
        if own or np.isfinite(network.far):
            raise CableError(
                "save_policy cannot save two normalisations of the observations, of "
                "the model and of its environment; train with one."
            )
        zeros = np.zeros(network.mean.size)
        mean, deviation = zeros + self.mean, zeros + np.sqrt(self.variance)
        return dataclasses.replace(
            network, mean=mean, deviation=deviation, far=self.far
        )


def _look_through(env: Any) -> _Seen:
    """Return what a policy observes through the wrappers of an environment."""
    if isinstance(env, (DeviceEnv, DeviceVectorEnv)):
        return _Seen(tuple(env.exo.observed))
    if hasattr(env, "observed"):  # `StableBaselines` and `RslRl`
        return _Seen(tuple(env.observed))
    if isinstance(env, gymnasium.vector.AsyncVectorEnv):
        raise CableError(
            "save_policy cannot look into the processes of AsyncVectorEnv; train on "
            "gymnasium.make_vec(ID), which is faster, or on SyncVectorEnv."
        )
    if envs := getattr(env, "envs", ()):
        return _pool([_look_through(one) for one in envs])
    inner = next((i for n in ("env", "venv") if (i := getattr(env, n, None))), None)
    if inner is None:
        raise CableError("save_policy needs a model trained on cc_mujoco's devices.")
    seen = _look_through(inner)
    if isinstance(env, NORMALISERS) and seen.is_plain:
        moments = env.obs_rms
        mean, variance = (np.asarray(x, float) for x in (moments.mean, moments.var))
        return _Seen(seen.observed, float(moments.count), mean, variance + env.epsilon)
    if type(env) in TRANSFORMERS and (bound := _clip_bound(env)):
        return seen._replace(far=min(seen.far, bound))
    wraps = isinstance(env, (gymnasium.Wrapper, gymnasium.vector.VectorWrapper))
    # Monitor of Stable-Baselines3 records what it passes on.
    if wraps and not (
        isinstance(env, PLAIN_WRAPPERS) or type(env).__name__ == "Monitor"
    ):
        raise CableError(
            f"save_policy cannot save through {type(env).__name__}, which may "
            "change observations or actions; train without it."
        )
    return seen


def _clip_bound(env: Any) -> float:
    """Return the bound of a wrapper that clips observations, 0 if it does otherwise."""
    shape = env.observation_space.shape
    numbers = np.linspace(-2.0, 2.0, int(np.prod(shape))).reshape(shape)
    try:
        far = float(np.max(env.func(1e6 + numbers)))
        done = np.array_equal(
            env.func(far * numbers), np.clip(far * numbers, -far, far)
        )
    except Exception:  # of a user's function
        return 0.0
    return far if done else 0.0


def _pool(each: list[_Seen]) -> _Seen:
    """Return one view of environments that may normalise by statistics of their own."""
    first = each[0]
    if any((one.observed, one.far) != (first.observed, first.far) for one in each):
        raise CableError("all environments must observe the same.")
    if first.is_plain or len(each) == 1:
        return first
    counts = np.array([one.weight for one in each])
    mean = np.average([one.mean for one in each], axis=0, weights=counts)
    squares = [one.variance + (one.mean - mean) ** 2 for one in each]
    variance = np.average(squares, axis=0, weights=counts)
    return _Seen(first.observed, counts.sum(), mean, variance, first.far)


def _of_network(model: Any, env: Any) -> tuple[Network, Any]:
    if env is None:
        raise CableError(
            f"save_policy needs the environment that the {type(model).__name__} was "
            "trained on, with its wrappers: save_policy(model, path, env)."
        )
    seen = _look_through(env)
    if not isinstance(model, Network):
        size = sum(own.space.shape[0] for own in seen.observed)
        still = np.zeros(size), np.ones(size)
        model = Network.of_layers(_module_layers(model), *still)
    return seen.apply(model), seen.observed


def _module_layers(model: Any) -> list[Any]:
    """Return the layers from observation to action of a PyTorch module.

    Actors of CleanRL's SAC, TD3 and DDPG do not name their activations, so their layers
    are compared with what the module computes.
    """
    import torch

    model = getattr(model, "actor_mean", model)  # of CleanRL's PPO
    if isinstance(model, torch.nn.Sequential):
        return [*model]
    head = getattr(model, "fc_mean", getattr(model, "fc_mu", None))
    if head is None or not hasattr(model, "action_scale"):
        raise CableError(
            "save_policy takes a PyTorch module that is a Sequential of Linear layers "
            f"or an actor of CleanRL, not {type(model).__name__}."
        )
    relu, tanh = torch.nn.ReLU(), torch.nn.Tanh()
    layers = torch.nn.Sequential(model.fc1, relu, model.fc2, relu, head, tanh)
    seen = torch.linspace(-2.0, 2.0, 8 * model.fc1.in_features).to(head.weight)
    seen = seen.reshape(8, -1)
    with torch.no_grad():
        found = model(seen)
        if isinstance(found, tuple):  # mean and deviation before the tangent, of SAC
            found = found[0].tanh() * model.action_scale + model.action_bias
        if not torch.allclose(layers(seen), found, atol=1e-6):
            raise CableError(
                "save_policy takes an actor of CleanRL with two hidden layers of ReLU "
                "and actions in [-1, 1], and this one acts otherwise; give its layers "
                "as a torch.nn.Sequential."
            )
    return [*layers]


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
    return network, _look_through(runner.env).observed


def _of_stable_baselines(model: Any, env: Any) -> tuple[Network, Any]:
    from stable_baselines3.common import vec_env

    inner, normal = model.get_env() if env is None else env, None
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
    seen = _look_through(inner)
    layers, squashed = _layers(model.policy)
    size = inner.observation_space.shape[0]
    mean, deviation, far = np.zeros(size), np.ones(size), np.inf
    if normal is not None and normal.norm_obs:
        mean = np.array(normal.obs_rms.mean, dtype=float)
        deviation = np.sqrt(normal.obs_rms.var + normal.epsilon)
        far = float(normal.clip_obs)
    network = Network.of_layers(layers, mean, deviation, squashed, far)
    return seen.apply(network), seen.observed


def _layers(policy: Any) -> tuple[list[Any], bool]:
    """Return the layers from observation to action, and whether tanh follows."""
    from stable_baselines3.common.torch_layers import FlattenExtractor

    actor: Any = getattr(policy, "actor", None)
    if actor is None and hasattr(policy, "mlp_extractor"):
        owner, squashed = policy, bool(getattr(policy, "squash_output", False))
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
    elif hasattr(actor, "latent_pi"):
        owner, squashed, layers = actor, True, [*actor.latent_pi, actor.mu]
    elif hasattr(actor, "mu"):  # TD3 and DDPG end in the tangent
        owner, squashed, layers = actor, True, [*actor.mu]
    else:
        raise CableError("the model must be one of PPO, A2C, SAC, TD3 or DDPG.")
    extractor = getattr(owner, "pi_features_extractor", owner.features_extractor)
    if not isinstance(extractor, FlattenExtractor):
        raise CableError("the policy must be an MlpPolicy without another extractor.")
    return layers, squashed
