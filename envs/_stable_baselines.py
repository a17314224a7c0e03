"""Training with Stable-Baselines3: a vector environment, and saved policies.

    many = make_vec(ID, 64, autoreset_mode="SameStep", hold=5, history=4)
    model = PPO("MlpPolicy", VecNormalize(StableBaselines(many)))
    model.learn(500_000)
    save_policy(model, "runs/policy.safetensors")     # for `--controller` and Policy

Needs `pip install 'cc_mujoco[policy]'`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from cc_mujoco.control import Network, write_policy
from cc_mujoco.errors import CableError

from ._vector import DeviceVectorEnv

try:
    from stable_baselines3.common.torch_layers import FlattenExtractor
    from stable_baselines3.common.vec_env import VecEnv, VecNormalize
except ModuleNotFoundError:
    raise CableError(
        "this needs Stable-Baselines3: pip install 'cc_mujoco[policy]'."
    ) from None


class StableBaselines(VecEnv):  # type: ignore[misc]
    """Vector environments of this package, one or several, as Stable-Baselines3's."""

    def __init__(self, *envs: DeviceVectorEnv) -> None:
        """Put environments side by side.

        Args:
            envs: Made with `autoreset_mode="SameStep"`; of equal spaces.

        Raises:
            CableError: If they are not.
        """
        own = [env.unwrapped for env in envs]
        if not own or not all(isinstance(env, DeviceVectorEnv) for env in own):
            raise CableError(
                "StableBaselines needs vector environments of cc_mujoco, as "
                "gymnasium.make_vec(..., autoreset_mode='SameStep') makes them."
            )
        if any(env.mode is not AutoresetMode.SAME_STEP for env in own):
            raise CableError(
                "Stable-Baselines3 needs environments made with "
                "autoreset_mode='SameStep'."
            )
        self.envs = own
        self.observed = own[0].exo.observed
        """Observed quantities, for `save_policy`."""
        if any(env.exo.observed != self.observed for env in own):
            raise CableError("all environments must observe the same.")
        self._seeds: list[int | None] = [None] * len(own)
        self._ends = np.cumsum([env.num_envs for env in own])
        first = own[0]
        self._actions: NDArray[np.float32] = np.zeros((0, 0), np.float32)
        self.render_mode = None
        super().__init__(
            int(self._ends[-1]),
            first.single_observation_space,
            first.single_action_space,
        )

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed of the next reset; environments count up from it."""
        starts = [0, *self._ends[:-1].tolist()]
        self._seeds = [None if seed is None else seed + start for start in starts]
        return [None if seed is None else seed + i for i in range(self.num_envs)]

    def reset(self) -> NDArray[np.float32]:
        """Start an episode in all of them."""
        seen = [
            env.reset(seed=seed)[0]
            for env, seed in zip(self.envs, self._seeds, strict=True)
        ]
        self._seeds = [None] * len(self.envs)
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        found: NDArray[np.float32] = np.concatenate(seen)
        return found

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions (num_envs, axes) of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], Any]:
        """Step; `infos` hold no more than Stable-Baselines3 needs."""
        parts = np.split(self._actions, self._ends[:-1])
        seen, rewards, overs = [], [], []
        infos: list[dict[str, Any]] = []
        for env, part in zip(self.envs, parts, strict=True):
            observation, reward, terminated, truncated, info = env.step(part)
            over = terminated | truncated
            step_infos: list[dict[str, Any]] = [{} for _ in over]
            for row in np.flatnonzero(over):
                step_infos[row] = {
                    "terminal_observation": info["final_obs"][row],
                    "TimeLimit.truncated": bool(truncated[row] and not terminated[row]),
                }
            seen.append(observation)
            rewards.append(reward)
            overs.append(over)
            infos += step_infos
        gained = np.concatenate(rewards).astype(np.float32)
        over = np.concatenate(overs)
        return np.concatenate(seen), gained, over, infos

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment that each one is in."""
        return [getattr(self.envs[i], attr_name) for i in self._places(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: environments of a batch have no attributes of their own."""
        raise CableError("single environments of a batch have no attributes to set.")

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Refuse: environments of a batch have no methods of their own."""
        raise CableError("single environments of a batch have no methods to call.")

    def env_is_wrapped(
        self,
        wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]],
        indices: Any = None,
    ) -> list[bool]:
        """None of them is."""
        return [False for _ in self._places(indices)]

    def _places(self, indices: Any) -> list[int]:
        rows = self._get_indices(indices)
        return [int(np.searchsorted(self._ends, row, side="right")) for row in rows]


def save_policy(model: Any, path: str | os.PathLike[str]) -> None:
    """Write the policy that an algorithm has learnt to a file.

    Args:
        model: PPO, A2C, SAC, TD3 or DDPG with an `MlpPolicy`, trained on
            `StableBaselines`, inside of `VecNormalize` or not.
        path: Of the file, `*.safetensors`; see `cc_mujoco.control.write_policy`.

    Raises:
        CableError: If it is another algorithm, network or environment.
    """
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
    linear = [layer for layer in layers if hasattr(layer, "weight")]
    kinds = {type(layer).__name__.lower() for layer in layers} - {"linear"}
    if len(kinds) > 1:
        raise CableError(
            f"a policy has one activation, not {', '.join(sorted(kinds))}."
        )
    network = Network(
        tuple(_numbers(layer.weight) for layer in linear),
        tuple(_numbers(layer.bias) for layer in linear),
        kinds.pop() if kinds else "identity",
        squashed,
        mean,
        deviation,
        far,
    )
    write_policy(path, network, inner.observed)


def _layers(policy: Any) -> tuple[list[Any], bool]:
    """Layers from observation to action, and whether a tangent follows them."""
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


def _numbers(tensor: Any) -> NDArray[np.float64]:
    found: NDArray[np.float64] = tensor.detach().cpu().numpy().astype(np.float64)
    return found
