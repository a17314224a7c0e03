"""Vector environment for training with Stable-Baselines3.

    many = make_vec(ID, 64, autoreset_mode="SameStep", hold=5, history=4)
    model = PPO("MlpPolicy", VecNormalize(StableBaselines(many)))
    model.learn(500_000)
    save_policy(model, "runs/policy.safetensors")     # for `--controller` and Policy

Needs `pip install 'cc_mujoco[policy]'`.
"""

from __future__ import annotations

import itertools
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from cc_mujoco.errors import CableError

from ._vector import DeviceVectorEnv

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError:
    raise CableError(
        "this needs Stable-Baselines3: pip install 'cc_mujoco[policy]'."
    ) from None


class StableBaselines(VecEnv):  # type: ignore[misc]
    """One or several vector environments of this package, for Stable-Baselines3."""

    def __init__(self, *envs: DeviceVectorEnv) -> None:
        """Join vector environments to one.

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
        self.observed = own[0].exo.observed  # observed quantities, for `save_policy`
        if any(env.exo.observed != self.observed for env in own):
            raise CableError("all environments must observe the same.")
        self._ends = np.cumsum([env.num_envs for env in own])
        self._actions: NDArray[np.float32] = np.zeros((0, 0), np.float32)
        spaces = own[0].single_observation_space, own[0].single_action_space
        super().__init__(int(self._ends[-1]), *spaces)

    def reset(self) -> NDArray[np.float32]:
        """Start an episode in every environment.

        Seeds and options are those set by `seed` and `set_options` of the base class.

        Raises:
            CableError: If environments of one vector are given different options.
        """
        seen = []
        for env, end in zip(self.envs, self._ends.tolist(), strict=True):
            start = end - env.num_envs
            options = self._options[start]
            if any(other != options for other in self._options[start:end]):
                raise CableError(
                    "options of one vector environment must be equal; make one for "
                    "each plant and give StableBaselines several."
                )
            # Seeds of a vector count up from the first, as those of SB3 do.
            seen.append(env.reset(seed=self._seeds[start], options=options or None)[0])
        self._reset_seeds()
        self._reset_options()
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        found: NDArray[np.float32] = np.concatenate(seen)
        return found

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions (num_envs, axes) of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], Any]:
        """Step with the stored actions; `infos` has only what the library needs."""
        parts = np.split(self._actions, self._ends[:-1])
        infos: list[dict[str, Any]] = []
        found = []
        for env, part in zip(self.envs, parts, strict=True):
            observation, reward, terminated, truncated, info = env.step(part)
            over = terminated | truncated
            infos += ({} for _ in over)
            for row in np.flatnonzero(over):
                infos[row - len(over)] = {
                    "terminal_observation": info["final_obs"][row],
                    "TimeLimit.truncated": bool(truncated[row] and not terminated[row]),
                }
            found.append((observation, reward.astype(np.float32), over))
        seen, gained, overs = map(np.concatenate, zip(*found, strict=True))
        return seen, gained, overs, infos

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()

    def get_images(self) -> list[NDArray[np.uint8] | None]:
        """Return an image of each device (height, width, 3), or None without a mode."""
        drawn = (env.render() or [None] * env.num_envs for env in self.envs)
        return list(itertools.chain.from_iterable(drawn))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return, for each environment, an attribute of its vector environment."""
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
        """Return False for each: single environments have no wrappers."""
        return [False for _ in self._places(indices)]

    def _places(self, indices: Any) -> list[int]:
        rows = self._get_indices(indices)
        return [int(np.searchsorted(self._ends, row, side="right")) for row in rows]
