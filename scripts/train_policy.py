"""Train a policy on the wrist handle with Stable-Baselines3, for the benchmark.

    pip install 'cc_mujoco[policy]'
    python scripts/train_policy.py --steps 36000 --out runs/policy.zip
    cc-mujoco benchmark --scene wrist --controllers pi runs/policy.zip

A short training with PPO on random tasks and motions: it shows how a policy gets into
the benchmark, and is no measure of what learning can do. The policy gives the share of
the motor's torque, held for several control steps, and learns on inputs of the size of
1: the environment's observation times a matrix. That goes into the first layer of what
is saved, which sees the observation itself, as any policy trained on the environment.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.control import Drive

ENVIRONMENT = "cc_mujoco/WristHandle-v0"
PLAYED = (("sine", "spring"), ("sweep", "transparent"), ("multisine", "spring"))
"""Trajectories and tasks of the training."""
HOLD = 5
"""Control steps for which an action is held in training."""


def scaling(drive: Drive) -> NDArray[np.float64]:
    """From the observation of the wrist to inputs of the size of 1, (6, 6).

    Twist in tenths of a rad, velocities in 10 rad/s of the joint, angle, and in tenths
    of the greatest torque what is desired and what of it is lacking; all at the joint.
    """
    ratio, most = drive.ratio, 0.1 * abs(drive.ratio) * drive.high
    return np.array(
        [
            [10.0 / ratio, 0.0, -10.0, 0.0, 0.0, 0.0],
            [0.0, 0.1 / ratio, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0 / most],
            [0.0, 0.0, 0.0, 0.0, -1.0 / most, 1.0 / most],
        ]
    )


class Scaled(gymnasium.Wrapper):
    """An environment with `scaling`, and a reward of a few units."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap an environment of this package."""
        super().__init__(env)
        self._scaling = scaling(env.unwrapped.drive)  # type: ignore[attr-defined]
        size = len(self._scaling)
        self.observation_space = Box(-np.inf, np.inf, (size,), dtype=np.float32)

    def reset(self, **kwargs: Any) -> Any:
        """Start an episode."""
        seen, info = self.env.reset(**kwargs)
        return self._inputs(seen), info

    def step(self, action: Any) -> Any:
        """Hold an action; the reward falls with the size of the error, not its square.

        A square would make nothing count but the first moments of a bad policy.
        """
        total = 0.0
        for _ in range(HOLD):
            seen, _, terminated, truncated, info = self.env.step(action)
            error = info["joint_torque_nm"] - info["desired_torque_nm"]
            total -= min(abs(error), 5.0) / HOLD
            if terminated or truncated:
                break
        return self._inputs(seen), total, terminated, truncated, info

    def _inputs(self, seen: NDArray[np.float64]) -> NDArray[np.float32]:
        return (self._scaling @ seen).astype(np.float32)


def make(place: int) -> Any:
    """A function that makes one of the environments of the training."""
    trajectory, task = PLAYED[place % len(PLAYED)]

    def build() -> gymnasium.Env[Any, Any]:
        env = gymnasium.make(
            ENVIRONMENT,
            disable_env_checker=True,
            trajectory=trajectory,
            task=task,
            duration=6.0,
        )
        return Scaled(env)

    return build


def main() -> None:
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=36_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs", "policy.zip"))
    arguments = parser.parse_args()
    if arguments.out.exists():  # hours of training, perhaps
        parser.error(f"{arguments.out} is there already; name a file that is not.")

    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import DummyVecEnv
        from torch import from_numpy, no_grad, set_num_threads
    except ModuleNotFoundError:
        raise SystemExit(
            "training needs Stable-Baselines3: pip install 'cc_mujoco[policy]'"
        ) from None

    about: Any = {
        "policy": "MlpPolicy",
        "n_steps": 1024,
        "batch_size": 512,
        "gamma": 0.97,
        "learning_rate": 5e-4,
        "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -1.0},
        "seed": arguments.seed,
        "device": "cpu",
        "verbose": 1,
    }
    model = PPO(env=DummyVecEnv([make(place) for place in range(6)]), **about)
    # Sums of a thread each depend on how many there are; one gives one policy.
    set_num_threads(1)
    model.learn(arguments.steps)
    env = gymnasium.make(ENVIRONMENT, disable_env_checker=True)
    plain = PPO(env=env, **about)
    plain.policy.load_state_dict(model.policy.state_dict())
    matrix = from_numpy(scaling(env.unwrapped.drive)).float()  # type: ignore[attr-defined]
    with no_grad():
        for net in ("policy_net", "value_net"):
            first = getattr(plain.policy.mlp_extractor, net)[0]
            first.weight.copy_(first.weight @ matrix)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    plain.save(arguments.out)
    print(f"saved {arguments.out}")


if __name__ == "__main__":
    main()
