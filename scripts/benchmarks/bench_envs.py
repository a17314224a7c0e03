"""Steps per second of the vector environments against Gymnasium's SyncVectorEnv.

    python scripts/benchmarks/bench_envs.py

Both run the same actions, by turns in one process, so that what else the machine does
falls on both. Prints the ratio of their speeds; bare times are of this machine only.
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.devices import DEVICES

ROUNDS = 5
"""Turns that each of the two takes."""


def main() -> None:
    """Print a table for each environment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--envs", type=int, nargs="+", default=[1, 16, 64, 256])
    parser.add_argument("--seconds", type=float, default=0.5, help="per turn")
    arguments = parser.parse_args()
    print(f"{'environment':26} {'envs':>5} {'batch':>12} {'sync':>12} {'ratio':>7}")
    for name in (device.environment for device in DEVICES.values()):
        for count in arguments.envs:
            batch, sync = compare(name, count, arguments.seconds)
            print(
                f"{name:26} {count:5d} {batch:8.0f} st/s {sync:8.0f} st/s "
                f"{batch / sync:7.2f}"
            )


def compare(name: str, count: int, seconds: float) -> tuple[float, float]:
    """Return environment steps per second of both: the median of the turns."""
    modes = ("vector_entry_point", "sync")
    pair = [gymnasium.make_vec(name, count, vectorization_mode=mode) for mode in modes]
    rates: tuple[list[float], list[float]] = ([], [])
    for env in pair:
        env.reset(seed=0)
    for _ in range(ROUNDS):
        for env, found in zip(pair, rates, strict=True):
            found.append(rate(env, seconds))
    for env in pair:
        env.close()
    return float(np.median(rates[0])), float(np.median(rates[1]))


def rate(env: VectorEnv, seconds: float) -> float:
    """Step with random actions for a while; return environment steps per second."""
    actions = np.random.default_rng(0).uniform(-1, 1, (64, env.num_envs, 1))
    actions = actions.astype(np.float32)
    steps = 0
    start = now = time.perf_counter()
    while now - start < seconds:
        env.step(actions[steps % len(actions)])
        steps += 1
        now = time.perf_counter()
    return steps * env.num_envs / (now - start)


if __name__ == "__main__":
    main()
