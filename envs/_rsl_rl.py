"""Vector environment for training with rsl_rl.

    many = make_vec(ID, 64, autoreset_mode="Disabled", hold=5, history=4)
    runner = OnPolicyRunner(RslRl(many), config)
    runner.learn(100, init_at_random_ep_len=True)
    save_policy(runner, "runs/policy.safetensors")     # for `--controller` and Policy

Needs `pip install rsl-rl-lib`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from cc_mujoco.errors import CableError

from ._vector import DeviceVectorEnv

try:
    import torch
    from rsl_rl.env import VecEnv
    from tensordict import TensorDict
except ModuleNotFoundError:
    raise CableError("this needs rsl_rl: pip install rsl-rl-lib.") from None


class RslRl(VecEnv):  # type: ignore[misc]
    """Vector environment of this package for rsl_rl, on the CPU.

    Attributes:
        max_episode_length: Steps of an episode.
        episode_length_buf: Steps since each environment's last reset, (num_envs,). An
            environment that counts to `max_episode_length` is reset.
    """

    def __init__(self, env: DeviceVectorEnv, seed: int | None = None) -> None:
        """Reset the environment.

        Args:
            env: Made with `autoreset_mode="Disabled"`.
            seed: Seed of the first reset; see `DeviceVectorEnv.reset`.

        Raises:
            CableError: If `env` is no `DeviceVectorEnv`, or resets itself.
        """
        own = env.unwrapped
        if not isinstance(own, DeviceVectorEnv) or own.mode is not (
            AutoresetMode.DISABLED
        ):
            raise CableError(
                "RslRl needs a vector environment of cc_mujoco, as "
                "gymnasium.make_vec(..., autoreset_mode='Disabled') makes it."
            )
        self.env = own
        self.observed = own.exo.observed  # observed quantities, for `save_policy`
        self.num_envs = own.num_envs
        self.num_actions = len(own.drives)
        self.max_episode_length = own.episode_steps
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self.device = "cpu"
        self.cfg: dict[str, Any] = {"device": own.device.name}
        self._seen, _ = own.reset(seed=seed)

    def get_observations(self) -> TensorDict:
        """Return the observations, (num_envs, size) in the group `policy`."""
        seen = torch.from_numpy(self._seen.copy())
        # Name of the only group of observations
        return TensorDict({"policy": seen}, batch_size=[self.num_envs])

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Step with actions (num_envs, num_actions); reset environments that end.

        Returns:
            Observations, rewards, whether each episode ended, and `time_outs`: whether
            it ended at its duration instead of by a failure.
        """
        given = actions.detach().cpu().numpy()
        self._seen, rewards, failed, truncated, _ = self.env.step(given)
        self.episode_length_buf += 1
        full = self.episode_length_buf >= self.max_episode_length
        over = failed | truncated | full.numpy()
        if over.any():
            self._seen, _ = self.env.reset(options={"reset_mask": over})
            self.episode_length_buf[torch.from_numpy(over)] = 0
        gained = torch.from_numpy(rewards.astype(np.float32))
        extras = {"time_outs": torch.from_numpy(over & ~failed)}
        return self.get_observations(), gained, torch.from_numpy(over).long(), extras
