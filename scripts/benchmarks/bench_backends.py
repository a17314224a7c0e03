"""Differences of environments in mujoco_warp from those in MuJoCo.

    python scripts/benchmarks/bench_backends.py --devices wrist ankle endoscope

Simulates whole episodes in both with the same seeds and actions, on the plant of the
scene and on random plants, and prints RMS and worst differences relative to the largest
value. The last columns compare MuJoCo with itself under actions that differ by up to
1e-6: the sensitivity of the device.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import tyro
from turns import Array

import cc_mujoco  # noqa: F401, registers the environments

ID = "cc_mujoco/Device-v1"
DRAWN = {"friction": (0.05, 0.2), "wearer": (0.5, 2.0), "delay": (0, 3)}
"""Ranges of plants in which friction is as large at rest as in motion."""
PLANTS: dict[str, dict[str, Any]] = {
    "scene": {},
    "drawn": {"randomise": {**DRAWN, "break_away": (1.0, 1.0)}},
    "drawn, break-away": {"randomise": {**DRAWN, "break_away": (1.0, 3.0)}},
}
COLUMNS = ("joint_angle_rad", "joint_torque_nm", "tension")


def main(
    devices: tuple[str, ...] = ("wrist", "ankle", "endoscope"),
    plants: tuple[str, ...] = tuple(PLANTS),
    seconds: float = 10.0,
    envs: int = 8,
) -> None:
    """Print the differences of whole episodes.

    Args:
        devices: names of devices.
        plants: of `PLANTS`.
        seconds: length of an episode.
        envs: environments played together.
    """
    print("| device | plant | quantity | RMS | worst | RMS, 1e-6 | worst |")
    print("|---|---|---|---:|---:|---:|---:|")
    for device in devices:
        for plant in plants:
            made = {"device": device, "duration": seconds, **PLANTS[plant]}
            for name, numbers in differences(envs, made).items():
                shown = " | ".join(f"{number:.1e}" for number in numbers)
                print(f"| {device} | {plant} | {name} | {shown} |", flush=True)


def differences(count: int, given: dict[str, Any]) -> dict[str, list[float]]:
    """Return, by quantity, the four relative differences of a row of the table."""
    envs = [
        gymnasium.make_vec(ID, count, backend=backend, **given).unwrapped
        for backend in ("mujoco", "warp", "mujoco")
    ]
    reset = [env.reset(seed=0) for env in envs]
    for observed, _ in reset[1:]:
        np.testing.assert_array_equal(observed, reset[0][0])
    info, first = reset[0][1], envs[0]
    seen = {name: [] for name in COLUMNS}
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
            seen[name].append([gathered(one, name) for one in infos])
    found = {}
    for name, rows in seen.items():
        values = np.array(rows)
        error = np.abs(values[:, 1:] - values[:, :1]) / np.abs(values[:, 0]).max()
        rms = np.sqrt(np.mean(error**2, axis=(0, 2, 3)))
        worst = error.max(axis=(0, 2, 3))
        found[name] = [rms[0], worst[0], rms[1], worst[1]]
    return found


def aimed(env: Any, info: dict[str, Any]) -> Array:
    """Return the actions that would give the desired torques without friction."""
    columns = [f"{prefix}desired_torque_nm" for prefix in env.exo.device.prefixes]
    wanted = np.stack([info[name] for name in columns], axis=1)
    ratios = np.array([drive.ratio for drive in env.drives])
    return np.asarray(wanted / ratios / env.exo.device.torque_limits)


def gathered(info: dict[str, Any], name: str) -> Array:
    """Return the column `name` of all axes or cables, joined."""
    end = "_nodes_n" if name == "tension" else name
    keys = [key for key in info if key[0] != "_" and key.endswith(end)]
    return np.concatenate([info[key].reshape(len(info[key]), -1) for key in keys], 1)


if __name__ == "__main__":
    tyro.cli(main)
