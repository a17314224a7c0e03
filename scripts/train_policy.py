"""Train policies on the wrist handle with Stable-Baselines3, and keep how they learnt.

    pip install 'cc_mujoco[policy]'
    python scripts/train_policy.py --algorithm ppo --seeds 5 --out runs/ppo
    python scripts/train_policy.py --fixed --out runs/fixed
    cc-mujoco benchmark --scene wrist --controllers pi runs/ppo/0.safetensors

For every seed `--out` gets the policy N.safetensors and its learning curve N.csv:
steps, seconds of processor, and the mean return per second of simulated time of the
episodes since the last row, with the noise of exploration. All environments draw
cables, wearer, delay and noise anew in every episode, from ranges that most of the
benchmark lies in; with --fixed there is one cable, a liner of ordinary friction.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.human import Spring, Transparent

ENVIRONMENT = "cc_mujoco/WristHandle-v1"
PLAYED = (("multisine", Spring(2.5), 3), ("reversals", Transparent(), 1))
"""Trajectories and tasks of the training, and how many parts of the environments."""
OBSERVED: dict[str, Any] = {"hold": 5, "history": 4, "memory": True}
RANDOMISED = {
    "friction": (0.04, 0.23),
    "break_away": (1.0, 3.2),
    "axial_stiffness": (2800.0, 5200.0),
    "pretension": (5.0, 15.0),
    "wrap": (5.0, 9.5),
    "wearer": (0.25, 4.0),
    "delay": (0, 5),
    "noise": (0.0, 3.0),
}
FIXED = {
    "friction": (0.1, 0.1),
    "break_away": (1.5, 1.5),
    "delay": (1, 1),
    "noise": (1.0, 1.0),
}

COMMON: dict[str, Any] = {"policy": "MlpPolicy", "device": "cpu"}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_steps": 64,
        "batch_size": 1024,
        "n_epochs": 5,
        "gamma": 0.95,
        "gae_lambda": 0.9,
        "learning_rate": lambda left: 1e-3 * left + 1e-5,
        "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -1.0},
    },
    "sac": {
        "learning_rate": lambda left: 1e-3 * left + 1e-5,
        "gamma": 0.95,
        "batch_size": 512,
        "buffer_size": 300_000,
        "learning_starts": 5000,
        "train_freq": 1,
        "gradient_steps": 4,
        "tau": 0.01,
        "target_entropy": -2.0,
        "policy_kwargs": {"net_arch": [64, 64]},
    },
}


def make(
    count: int, seconds: float, ranges: dict[str, tuple[float, float]]
) -> list[Any]:
    """The vector environments of the training, as many single ones together."""
    parts = sum(part for *_, part in PLAYED)
    return [
        gymnasium.make_vec(
            ENVIRONMENT,
            count * part // parts,
            trajectory=trajectory,
            task=task,
            duration=seconds,
            threads=1,
            autoreset_mode="SameStep",
            randomise=ranges,
            **OBSERVED,
        )
        for trajectory, task, part in PLAYED
    ]


def bare_rate(envs: list[Any], seconds: float = 3.0) -> float:
    """Steps of single environments per second of processor, without any learning."""
    random = np.random.default_rng(0)
    for env in envs:
        env.reset(seed=0)
    steps, start = 0, time.process_time()
    while (spent := time.process_time() - start) < seconds:
        for env in envs:
            env.step(random.uniform(-1, 1, (env.num_envs, 1)).astype(np.float32))
            steps += env.num_envs
    return steps / spent


def train(seed: int, options: argparse.Namespace) -> None:
    """Train one policy, save it, write its curve."""
    import stable_baselines3
    import torch
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from cc_mujoco.envs import StableBaselines, save_policy

    # Sums of a thread each depend on how many there are; one gives one policy.
    torch.set_num_threads(1)
    ranges = FIXED if options.fixed else RANDOMISED
    envs = make(options.envs, options.seconds, ranges)
    bare = bare_rate(envs)
    env = VecNormalize(VecMonitor(StableBaselines(*envs)), gamma=0.95)

    class Curve(BaseCallback):  # type: ignore[misc]
        """Writes a row whenever ten thousand steps are done."""

        def _on_training_start(self) -> None:
            self.start, self.due, self.returns = time.process_time(), 0, []
            self.file = (options.out / f"{seed}.csv").open("w", newline="")
            self.rows = csv.writer(self.file)
            self.rows.writerow(("steps", "processor_s", "return_per_s"))

        def _on_step(self) -> bool:
            for info in self.locals["infos"]:
                if "episode" in info:
                    self.returns.append(info["episode"]["r"] / options.seconds)
            if self.num_timesteps >= self.due and self.returns:
                spent = time.process_time() - self.start
                mean = float(np.mean(self.returns))
                self.rows.writerow((self.num_timesteps, f"{spent:.1f}", f"{mean:.4f}"))
                self.file.flush()
                self.returns, self.due = [], self.num_timesteps + 10_000
            return True

        def _on_training_end(self) -> None:
            self.file.close()

    kind = getattr(stable_baselines3, options.algorithm.upper())
    model = kind(env=env, seed=seed, **COMMON, **ALGORITHMS[options.algorithm])
    start = time.process_time()
    model.learn(options.steps, callback=Curve())
    rate = options.steps / (time.process_time() - start)
    save_policy(model, options.out / f"{seed}.safetensors")
    print(
        f"{options.algorithm} seed {seed}: {rate:.0f} steps/s of processor, "
        f"{rate / bare:.2f} of the environments' own {bare:.0f}",
        flush=True,
    )


def main() -> None:
    """Train and save."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--algorithm", choices=ALGORITHMS, default="ppo")
    parser.add_argument("--steps", type=int, default=250_000)
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=3.0, help="of an episode")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seeds", type=int, default=1, help="how many")
    parser.add_argument("--fixed", action="store_true", help="one cable only")
    parser.add_argument("--out", type=Path, default=Path("runs", "policy"))
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    for seed in seeds:
        if (there := arguments.out / f"{seed}.safetensors").exists():  # hours, perhaps
            parser.error(f"{there} is there already; name another --out or --first.")
    try:
        import stable_baselines3  # noqa: F401
    except ModuleNotFoundError:
        raise SystemExit(
            "training needs Stable-Baselines3: pip install 'cc_mujoco[policy]'"
        ) from None
    arguments.out.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        train(seed, arguments)


if __name__ == "__main__":
    main()
