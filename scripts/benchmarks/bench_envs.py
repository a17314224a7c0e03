"""Steps per second of the vector environments against Gymnasium's SyncVectorEnv.

    python scripts/benchmarks/bench_envs.py

Both run the same actions, by turns in one process, so that what else the machine does
falls on both, and beside them MuJoCo's own `Batch` takes the same physics steps of the
same bare model from the same start under the same controls, wearer and all, without
observations, rewards and scripts. Prints the ratios of the speeds by the clock; bare
times are of this machine only.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import tyro
from gymnasium.vector import VectorEnv
from mujoco.batch import Batch
from numpy.typing import NDArray

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.device import Physics
from cc_mujoco.envs import IDS

Array = NDArray[np.float32]


ROUNDS = 5
"""Turns that each of them takes."""


def main(
    envs: tuple[int, ...] = (1, 16, 64, 256), seconds: float = 0.5, steps: int = 500
) -> None:
    """Print a table for each environment.

    Args:
        seconds: per turn of `SyncVectorEnv`.
        steps: per turn of the others.
    """
    print(
        f"{'environment':26} {'envs':>5} {'batch':>12} {'sync':>12} {'ratio':>7}"
        f" {'of Batch':>9}"
    )
    for name in IDS:
        for count in envs:
            batch, sync, share = compare(name, count, seconds, steps)
            print(
                f"{name:26} {count:5d} {batch:8.0f} st/s {sync:8.0f} st/s "
                f"{batch / sync:7.2f} {share:9.2f}",
                flush=True,
            )


def compare(name: str, count: int, seconds: float, steps: int) -> tuple[float, ...]:
    """Return steps/s of vector environment and loop, and the first over physics."""
    modes = ("vector_entry_point", "sync")
    env, loop = (gymnasium.make_vec(name, count, vectorization_mode=m) for m in modes)
    loop.reset(seed=0)
    bare = physics(env, steps)
    found = []
    for _ in range(ROUNDS):
        env.reset(seed=0)
        own = taken(lambda: play(env, steps))
        found.append((steps * count / own, rate(loop, seconds), taken(bare) / own))
    env.close()
    loop.close()
    return tuple(np.median(found, axis=0).tolist())


def play(env: VectorEnv, steps: int) -> None:
    given = actions(env)
    for step in range(steps):
        env.step(given[step % len(given)])


def physics(env: VectorEnv, steps: int) -> Callable[[], None]:
    """Return a function that only advances the physics of an environment, as `play`."""
    own: Any = env.unwrapped
    env.reset(seed=0)
    skip, there = own.exo.frame_skip, own.simulations.batch
    batch, start = Batch(own.model, own.num_envs, 0), there.state.copy()
    for field in Physics._fields:
        batch.bind(field)
    given: list[NDArray[np.float64]] = []

    def keep(_: int, control: NDArray[np.float64], **__: object) -> None:
        given.append(control.copy())

    # Controls follow from actions and scripts alone, so nothing need be simulated.
    with patch.object(there, "rollout", keep):
        play(env, steps)

    def advance() -> None:
        batch.state[:] = start
        for control in given:
            batch.rollout(skip, control, record=())

    return advance


def taken(turn: Callable[[], None]) -> float:
    start = time.perf_counter()
    turn()
    return time.perf_counter() - start


def actions(env: Any) -> Array:
    shape = env.action_space.shape or ()
    drawn = np.random.default_rng(0).uniform(-1, 1, (64, *shape))
    return drawn.astype(np.float32)


def rate(env: VectorEnv, seconds: float) -> float:
    """Return environment steps per second with random actions, over `seconds` [s]."""
    given, steps, step = actions(env), 0, env.step
    start = now = time.perf_counter()
    while now - start < seconds:
        step(given[steps % len(given)])
        steps += 1
        now = time.perf_counter()
    return steps * env.num_envs / (now - start)


if __name__ == "__main__":
    tyro.cli(main)
