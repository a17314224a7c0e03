"""Environments in mujoco_warp against those in MuJoCo: differences and speeds.

    python scripts/benchmarks/bench_backends.py agree --devices wrist ankle endoscope
    python scripts/benchmarks/bench_backends.py rate --envs 64 1024

`agree` plays whole episodes of both with the same seeds and actions, on the plant of
the scene and on plants that are drawn, and prints differences over the largest value:
root mean square and worst. The last columns are of MuJoCo against itself with actions
that differ by up to 1e-6: so sensitive is the device. `rate` takes turns in one process
and prints environment steps per second of processor, with one thread, their ratio, and
the time per environment step that is not physics.
"""

from __future__ import annotations

import argparse
import time
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
from turns import Array, spread

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.simulation._warp_worlds import WarpWorlds

ID = "cc_mujoco/Device-v1"
DRAWN = {"friction": (0.05, 0.2), "wearer": (0.5, 2.0), "delay": (0, 3)}
"""Ranges of plants in which friction is as large at rest as in motion."""
PLANTS: dict[str, dict[str, Any]] = {
    "scene": {},
    "drawn": {"randomise": {**DRAWN, "break_away": (1.0, 1.0)}},
    "drawn, break-away": {"randomise": {**DRAWN, "break_away": (1.0, 3.0)}},
}
COLUMNS = ("joint_angle_rad", "joint_torque_nm", "tension")
ROUNDS = 7  # turns that each backend takes


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(required=True)
    agree = commands.add_parser("agree")
    agree.add_argument("--devices", nargs="+", default=["wrist", "ankle", "endoscope"])
    agree.add_argument("--plants", nargs="+", choices=PLANTS, default=list(PLANTS))
    agree.add_argument("--seconds", type=float, default=10.0, help="of an episode")
    agree.add_argument("--envs", type=int, default=8)
    agree.set_defaults(run=print_agreement)
    rate = commands.add_parser("rate")
    rate.add_argument("--devices", nargs="+", default=["wrist"])
    rate.add_argument("--envs", type=int, nargs="+", default=[64, 1024])
    rate.add_argument("--steps", type=int, default=20, help="per turn")
    rate.set_defaults(run=print_rates)
    arguments = parser.parse_args()
    arguments.run(arguments)


def print_agreement(arguments: argparse.Namespace) -> None:
    """Print the differences of whole episodes."""
    print("| device | plant | quantity | RMS | worst | RMS, 1e-6 | worst |")
    print("|---|---|---|---:|---:|---:|---:|")
    for device in arguments.devices:
        for plant in arguments.plants:
            made = {"device": device, "duration": arguments.seconds, **PLANTS[plant]}
            for name, numbers in differences(arguments.envs, made).items():
                shown = " | ".join(f"{number:.1e}" for number in numbers)
                print(f"| {device} | {plant} | {name} | {shown} |", flush=True)


def differences(count: int, given: dict[str, Any]) -> dict[str, list[float]]:
    """Return, by quantity, four differences over the largest value."""
    envs = [
        gymnasium.make_vec(ID, count, backend=backend, **given).unwrapped
        for backend in ("mujoco", "warp", "mujoco")
    ]
    reset = [env.reset(seed=0) for env in envs]
    for seen, _ in reset[1:]:
        np.testing.assert_array_equal(seen, reset[0][0])
    info, first = reset[0][1], envs[0]
    sums: dict[str, Array] = {}
    worst: dict[str, Array] = {}
    largest: dict[str, float] = {}
    shift, noise = np.arange(count)[:, None], np.random.default_rng(0)
    for step in range(first.exo.steps):
        wave = 0.1 * np.sin(4.0 * step * first.exo.period + shift)
        action = (aimed(first, info) + wave).astype(np.float32)
        other = (action + noise.uniform(-1e-6, 1e-6, action.shape)).astype(np.float32)
        infos = [
            env.step(given)[4]
            for env, given in zip(envs, (action, action, other), strict=True)
        ]
        info = infos[0]
        for name in COLUMNS:
            values = [gathered(one, name) for one in infos]
            error = np.abs(np.stack([values[1] - values[0], values[2] - values[0]]))
            square = (error**2).reshape(2, -1).mean(axis=1)
            sums[name] = sums.get(name, np.zeros(2)) + square
            most = error.reshape(2, -1).max(axis=1)
            worst[name] = np.maximum(worst.get(name, most), most)
            size = float(np.abs(values[0]).max())
            largest[name] = max(largest.get(name, 0.0), size)
    found = {}
    for name in COLUMNS:
        rms = np.sqrt(sums[name] / first.exo.steps) / largest[name]
        most = worst[name] / largest[name]
        found[name] = [rms[0], most[0], rms[1], most[1]]
    return found


def aimed(env: Any, info: dict[str, Any]) -> Array:
    """Return the actions that give the desired torques without friction."""
    columns = [f"{prefix}desired_torque_nm" for prefix in env.exo.device.prefixes]
    wanted = np.stack([info[name] for name in columns], axis=1)
    ratios = np.array([drive.ratio for drive in env.drives])
    return np.asarray(wanted / ratios / env.exo.device.torque_limits)


def gathered(info: dict[str, Any], name: str) -> Array:
    """Return a quantity of all axes or cables."""
    end = "_nodes_n" if name == "tension" else name
    keys = [key for key in info if key[0] != "_" and key.endswith(end)]
    return np.concatenate([info[key].reshape(len(info[key]), -1) for key in keys], 1)


def print_rates(arguments: argparse.Namespace) -> None:
    """Print the speeds."""
    print("| device | envs | mujoco, steps/s | warp | ratio | host, us per step |")
    print("|---|---:|---:|---:|---|---:|")
    for device in arguments.devices:
        for count in arguments.envs:
            rates, host = speeds(device, count, arguments.steps)
            mujoco, warp = np.median(rates, axis=0)
            ratio = spread(rates[:, 1] / rates[:, 0])
            print(
                f"| {device} | {count} | {mujoco:,.0f} | {warp:,.0f} | {ratio} | "
                f"{1e6 * host:.1f} |",
                flush=True,
            )


def speeds(device: str, count: int, steps: int) -> tuple[Array, float]:
    """Return steps per second of both (turns, 2), and the time that is not physics."""
    envs = [
        gymnasium.make_vec(ID, count, device=device, **given)
        for given in ({"threads": 1}, {"backend": "warp"})
    ]
    shape = envs[0].action_space.shape or ()
    drawn = np.random.default_rng(0).uniform(-0.3, 0.3, (steps, *shape))
    actions = drawn.astype(np.float32)
    for env in envs:
        env.reset(seed=0)
        env.step(actions[0])
    rates, physics, host = np.empty((ROUNDS, 2)), 0.0, []
    sample = WarpWorlds._take_sample

    def timed(worlds: WarpWorlds) -> None:
        nonlocal physics
        begin = time.process_time()
        sample(worlds)
        physics += time.process_time() - begin

    with patch.object(WarpWorlds, "_take_sample", timed):
        for turn in range(ROUNDS):
            for place, env in enumerate(envs):
                physics, begin = 0.0, time.process_time()
                for action in actions:
                    env.step(action)
                spent = time.process_time() - begin
                rates[turn, place] = steps * count / spent
            host.append((spent - physics) / (steps * count))
    return rates, float(np.median(host))


if __name__ == "__main__":
    main()
