"""Train a policy on the wrist handle with Stable-Baselines3, for the benchmark.

    pip install 'cc_mujoco[policy]'
    python scripts/train_policy.py --steps 36000 --out runs/policy.zip
    cc-mujoco benchmark --scene wrist --controllers pi runs/policy.zip

A short training with PPO on random tasks and motions: it shows how a policy gets into
the benchmark, and is no measure of what learning can do. The policy sees `features` and
gives the share of the motor's torque, held for several control steps.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.control import features

PLAYED = (("sine", "spring"), ("sweep", "transparent"), ("multisine", "spring"))
"""Trajectories and tasks of the training."""
HOLD = 5
"""Control steps for which an action is held in training."""


class Seen(gymnasium.Wrapper):
    """An environment that shows `features`, and scales its reward to a few units."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap an environment of this package."""
        super().__init__(env)
        self.observation_space = Box(-10.0, 10.0, (6,), dtype=np.float32)
        self._drive = env.unwrapped.drive  # type: ignore[attr-defined]

    def reset(self, **kwargs: Any) -> Any:
        """Start an episode."""
        _, info = self.env.reset(**kwargs)
        return features(info, self._drive), info

    def step(self, action: Any) -> Any:
        """Hold an action; the reward falls with the size of the error, not its square.

        A square would make nothing count but the first moments of a bad policy.
        """
        total = 0.0
        for _ in range(HOLD):
            _, _, terminated, truncated, info = self.env.step(action)
            error = info["joint_torque_nm"] - info["desired_torque_nm"]
            total -= min(abs(error), 5.0) / HOLD
            if terminated or truncated:
                break
        return features(info, self._drive), total, terminated, truncated, info


def make(place: int) -> Any:
    """A function that makes one of the environments of the training."""
    trajectory, task = PLAYED[place % len(PLAYED)]

    def build() -> gymnasium.Env[Any, Any]:
        env = gymnasium.make(
            "cc_mujoco/WristHandle-v0",
            disable_env_checker=True,
            trajectory=trajectory,
            task=task,
            duration=6.0,
        )
        return Seen(env)

    return build


def main() -> None:
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=36_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs", "policy.zip"))
    arguments = parser.parse_args()

    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import DummyVecEnv
        from torch import set_num_threads
    except ModuleNotFoundError:
        raise SystemExit(
            "training needs Stable-Baselines3: pip install 'cc_mujoco[policy]'"
        ) from None

    model = PPO(
        "MlpPolicy",
        DummyVecEnv([make(place) for place in range(6)]),
        n_steps=1024,
        batch_size=512,
        gamma=0.97,
        learning_rate=5e-4,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.0},
        seed=arguments.seed,
        device="cpu",
        verbose=1,
    )
    # Sums of a thread each depend on how many there are; one gives one policy.
    set_num_threads(1)
    model.learn(arguments.steps)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    model.save(arguments.out)
    print(f"saved {arguments.out}")


if __name__ == "__main__":
    main()
