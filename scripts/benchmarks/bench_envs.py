"""Steps per second of the vector environments against Gymnasium's SyncVectorEnv.

    python scripts/benchmarks/bench_envs.py

Both run the same actions, by turns in one process, so that what else the machine does
falls on both, and beside them MuJoCo's own `Batch` takes the same physics steps of the
same model, without observations, rewards and scripts. Prints the ratios of the speeds;
bare times are of this machine only.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.devices import DEVICES

Array = NDArray[np.float32]

ROUNDS = 5
"""Turns that each of the two takes."""


def main() -> None:
    """Print a table for each environment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--envs", type=int, nargs="+", default=[1, 16, 64, 256])
    parser.add_argument("--seconds", type=float, default=0.5, help="per turn")
    arguments = parser.parse_args()
    print(
        f"{'environment':26} {'envs':>5} {'batch':>12} {'sync':>12} {'ratio':>7}"
        f" {'of Batch':>9}"
    )
    for name in (device.environment for device in DEVICES.values()):
        for count in arguments.envs:
            batch, sync, raw = compare(name, count, arguments.seconds)
            print(
                f"{name:26} {count:5d} {batch:8.0f} st/s {sync:8.0f} st/s "
                f"{batch / sync:7.2f} {batch / raw:9.2f}"
            )


def compare(name: str, count: int, seconds: float) -> tuple[float, float, float]:
    """Return steps per second of both and of the physics: the median of the turns."""
    modes = ("vector_entry_point", "sync")
    pair = [gymnasium.make_vec(name, count, vectorization_mode=mode) for mode in modes]
    bare = gymnasium.make_vec(name, count)
    for env in (*pair, bare):
        env.reset(seed=0)
    rates = []
    for _ in range(ROUNDS):
        speeds = [rate(env.step, count, seconds) for env in pair]
        rates.append((*speeds, rate(physics(bare), count, seconds)))
    for env in (*pair, bare):
        env.close()
    batch, sync, raw = np.median(rates, axis=0)
    return float(batch), float(sync), float(raw)


def physics(env: VectorEnv) -> Callable[[Array], object]:
    """What advances the simulations of an environment by a step of it, and no more."""
    own = env.unwrapped
    place, scale = own.exo.device.motor_control, own.exo.device.motor_scale
    control = np.zeros((own.num_envs, own.exo.frame_skip, own.model.nu))

    def advance(actions: Array) -> object:
        control[:, :, place] = scale * actions
        return own.batch.rollout(own.exo.frame_skip, control, record=())

    return advance


def rate(step: Callable[[Array], object], count: int, seconds: float) -> float:
    """Step with random actions for a while; return environment steps per second."""
    actions = np.random.default_rng(0).uniform(-1, 1, (64, count, 1))
    actions = actions.astype(np.float32)
    steps = 0
    start = now = time.perf_counter()
    while now - start < seconds:
        step(actions[steps % len(actions)])
        steps += 1
        now = time.perf_counter()
    return steps * count / (now - start)


if __name__ == "__main__":
    main()
