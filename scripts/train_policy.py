"""Train policies on a device with Stable-Baselines3, and keep their learning curves.

    pip install 'cc_mujoco[policy]'
    python scripts/train_policy.py --algorithm ppo --seeds 5 --out runs/ppo
    python scripts/train_policy.py --fixed --out runs/fixed
    python scripts/train_policy.py --scene finger --smoothness 0.01 --out runs/finger
    python scripts/train_policy.py --scene knee.xml --out runs/knee    # of your own
    cc-mujoco benchmark wrist --controllers pi runs/ppo/0.safetensors

A policy drives all motors of a device at once. For every seed `--out` gets the policy
N.safetensors and N/progress.csv, in which Stable-Baselines3 keeps steps, time and mean
returns of the episodes, with the noise of exploration. All environments draw cables,
wearer, delay and noise anew in every episode, from ranges that cover most of the
benchmark; with --fixed there is one cable, a liner of ordinary friction. With
--smoothness a change of the action by 1 costs as much.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cc_mujoco.cable import PATHS
from cc_mujoco.device import Device, DeviceModel, find_device
from cc_mujoco.envs import DeviceVectorEnv
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, Hold, Spring, Task, Transparent, Wearer

HAND = Wearer(40.0, 1.0)  # wearer of the bench, of which `wearer` is a multiple


BENCH = "bench"  # name of the bench of the diagnosis study


@cache
def bench() -> Device:
    """Return the bench of the diagnosis study, with a hand as the wearer.

    Noise is that of the study's torque sensor.
    """
    units = {"twist": 0.02, "joint_angle": 0.5, "torque_error": 1.0}
    return Device(
        BENCH,
        meaning="two Bowden cables between a motor and a joint that a hand holds",
        trajectory="multisine",
        axis={
            "reach": 0.5,
            "task": "transparent",
            "safe_torque": 10.0,
            "observation": {**units, "desired_torque": 1.0},
        },
        sensors={"torque_noise": 0.025, "tension_noise": 0.3},
        wearer={"joint": {"stiffness": HAND.stiffness, "damping": HAND.damping}},
    )


def device_of(scene: str) -> Device:
    return bench() if scene == BENCH else find_device(scene)


@dataclass(frozen=True)
class Sines(Task):
    """A torque of sines over time, plus that of a spring."""

    sizes: tuple[float, ...]  # amplitudes of the sines [N m]
    lines: tuple[float, ...]  # periods of each in one of the phase
    shifts: tuple[float, ...]  # phase of each [rad]
    stiffness: float  # torque over angle [N m/rad], of either sign

    def torque(self, angle: Any, velocity: Any, phase: Any) -> Any:
        """Return the desired torque [N m]; see `Task.torque`."""
        found = self.stiffness * angle
        for size, line, shift in zip(self.sizes, self.lines, self.shifts, strict=True):
            found = found + size * np.sin(2.0 * np.pi * line * phase + shift)
        return found


Part = tuple[str | None, Any, int]
"""Trajectory and task, those of the device by default, and a number of parts."""

PLAYED: dict[str, tuple[Part, ...]] = {
    "wrist": (("multisine", Spring(2.5), 3), ("reversals", Transparent(), 1)),
    "ankle": (("walk", TASKS["assist"], 3), ("reversals", Hold(-15.0), 1)),
    "finger": (("multisine", TASKS["hold"], 1), ("reach", TASKS["hold"], 1)),
    "bench": tuple(
        ("multisine", Sines((1.4, 0.8), lines, shifts, stiffness), 1)
        for lines, shifts, stiffness in (
            ((3.0, 11.0), (0.0, 1.0), 1.0),
            ((4.0, 9.0), (2.0, 4.0), -3.0),
            ((6.0, 13.0), (4.0, 0.0), 2.0),
            ((2.0, 7.0), (5.0, 3.0), -1.0),
        )
    ),
}
"""Trajectories and tasks of the training by scene, and how many parts of the
environments; other devices play their own motion."""
OBSERVED: dict[str, Any] = {"hold": 5, "history": 4, "memory": True}
LINERS = {"friction": (0.04, 0.23), "break_away": (1.0, 3.2)}
SPREAD = {"axial_stiffness": (0.7, 1.3), "pretension": (0.5, 1.5), "wrap": (0.7, 1.33)}
"""Ranges over the scene's values; the wrap of what lies in a conduit all the way."""
OTHERS = {"wearer": (0.25, 4.0), "delay": (0, 5), "noise": (0.0, 3.0)}
FIXED = {"delay": (1, 1), "noise": (1.0, 1.0)}
ORDINARY = {"friction": (0.1, 0.1), "break_away": (1.5, 1.5)}
"""Values of one cable; at the bench that of its scene."""

ALGORITHMS: dict[str, dict[str, Any]] = {
    "ppo": {
        "n_steps": 64,
        "batch_size": 1024,
        "n_epochs": 5,
        "gamma": 0.95,
        "gae_lambda": 0.9,
        "learning_rate": lambda left: 1e-3 * left + 1e-5,
        "policy_kwargs": {"net_arch": [64, 64]},
    },
    # A step of the optimiser lasts as long as some fifty of an environment: one for
    # all steps of the vector environment, and the larger for that.
    "sac": {
        "learning_rate": lambda left: 3e-3 * left + 1e-5,
        "gamma": 0.95,
        "batch_size": 256,
        "buffer_size": 300_000,
        "learning_starts": 5000,
        "train_freq": 1,
        "gradient_steps": 1,
        "tau": 0.03,
        "target_entropy": -2.0,
        "policy_kwargs": {"net_arch": [64, 64]},
    },
}
DEVIATIONS = {"wrist": -1.0, "ankle": -3.5, "finger": -2.0, "bench": -2.0}
"""Logarithms of the standard deviation of actions that PPO begins with. It shrinks by
half in a training as long as these, and what it makes of torque at the joint must be of
the size of the errors that matter: an action of 1 is 5 N m at the wrist and 240 N m at
the ankle. Of other devices it follows from the error that costs 1 per second."""
TAUT = {"wrist": 0.0, "ankle": 0.02, "finger": 0.0, "bench": 0.0}
"""Action that PPO begins with where a drum pays out many turns: a cable that hangs
slack, as without it, does not show what the motor does. Of other devices it is twice
what holds the pretension of cables that only pull."""
ENVIRONMENTS = {"ppo": 64, "sac": 128}
"""Number of environments trained on together, by default."""


def randomised(device: Device) -> dict[str, tuple[float, float]]:
    """Return the ranges from which plants of a device are drawn."""
    ranges: dict[str, tuple[float, float]] = dict(LINERS)
    for key, (low, high) in SPREAD.items():
        for name, cable in device.cables.items():
            if key != "wrap" or cable.path == PATHS[0]:
                ends = (f"{end * getattr(cable, key):.6g}" for end in (low, high))
                least, most = map(float, ends)
                ranges[f"{name}.{key}"] = least, most
    others = {n: r for n, r in OTHERS.items() if n != "wearer" or device.wearers}
    return ranges | others


def first_actions(scene: str) -> tuple[float, list[float]]:
    """Return log standard deviation and means, by motor, of PPO's first actions."""
    if scene in DEVIATIONS:
        return DEVIATIONS[scene], [TAUT[scene]]
    device = device_of(scene)
    model = DeviceModel.of(device)
    deviations, means = [], []
    for axis, own, drive in zip(
        device.description.axes, model.axes, model.drives(1.0), strict=True
    ):
        share = axis.torque_scale / (own.torque_limit * abs(own.ratio))
        deviations.append(min(max(math.log(1.5 * share), -4.0), -1.0))
        held = sum(abs(c.proximal) * c.cable.pretension for c in drive.cables)
        means.append(2.0 * held / own.torque_limit if drive.one_way else 0.0)
    return min(deviations), means


def make(
    options: argparse.Namespace,
    ranges: Mapping[str, tuple[float, ...]] = MappingProxyType({}),
    observed: Mapping[str, Any] = OBSERVED,
    played: Sequence[Part] = (),
) -> list[DeviceVectorEnv]:
    """Return vector environments; `ranges` replace entries of `randomised`."""
    scene, device = options.scene, device_of(options.scene)
    played = played or PLAYED.get(scene, ((None, None, 1),))
    fixed: dict[str, Any] = FIXED if scene == BENCH else FIXED | ORDINARY
    parts = sum(part for *_, part in played)
    return [
        DeviceVectorEnv(
            device,
            options.envs * part // parts,
            trajectory,
            task,
            duration=options.seconds,
            threads=1,
            autoreset_mode="SameStep",
            smoothness=options.smoothness,
            randomise=fixed if options.fixed else {**randomised(device), **ranges},
            **observed,
        )
        for trajectory, task, part in played
    ]


def train(seed: int, options: argparse.Namespace) -> None:
    import stable_baselines3
    import torch
    from stable_baselines3.common.logger import configure
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from cc_mujoco.benchmark import declare_training
    from cc_mujoco.envs import StableBaselines, save_policy

    # Sums of a thread each depend on how many there are; one gives one policy.
    torch.set_num_threads(1)
    envs = make(options)
    env = VecNormalize(VecMonitor(StableBaselines(*envs)), gamma=0.95)

    kind = getattr(stable_baselines3, options.algorithm.upper())
    chosen = dict(ALGORITHMS[options.algorithm])
    if options.algorithm == "ppo":
        deviation, means = first_actions(options.scene)
        begin = {"log_std_init": deviation}
        chosen["policy_kwargs"] = chosen["policy_kwargs"] | begin
    model = kind("MlpPolicy", env, device="cpu", seed=seed, **chosen)
    if options.algorithm == "ppo":
        with torch.no_grad():
            model.policy.action_net.bias.copy_(torch.tensor(means))
    model.set_logger(configure(str(options.out / str(seed)), ["csv"]))
    start = time.process_time()
    model.learn(options.steps)
    rate = options.steps / (time.process_time() - start)
    path = options.out / f"{seed}.safetensors"
    save_policy(model, path)
    declare_training(path, ())
    print(f"{options.algorithm} seed {seed}: {rate:.0f} steps/s of processor")


def require(module: str, name: str) -> None:
    """Exit with a message if a module that training needs is not installed."""
    if find_spec(module) is None:
        raise SystemExit(f"training needs {name}: pip install 'cc_mujoco[policy]'")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", default="wrist", help="name or file of a device")
    parser.add_argument("--algorithm", choices=ALGORITHMS, default="ppo")
    parser.add_argument("--steps", type=int, default=250_000)
    parser.add_argument("--envs", type=int, help="by default as many as suit it")
    parser.add_argument("--seconds", type=float, default=3.0, help="of an episode")
    parser.add_argument("--smoothness", type=float, default=0.0)
    parser.add_argument("--seeds", type=int, default=1, help="how many")
    parser.add_argument("--fixed", action="store_true", help="one cable only")
    parser.add_argument("--out", type=Path, default=Path("runs", "policy"))
    arguments = parser.parse_args()
    for name in ("steps", "seconds", "seeds", "envs"):
        if (given := getattr(arguments, name)) is not None and given <= 0:
            parser.error(f"--{name} must be above 0.")
    arguments.envs = arguments.envs or ENVIRONMENTS[arguments.algorithm]
    try:
        device_of(arguments.scene)
    except CableError as error:
        parser.error(str(error))
    for seed in (seeds := range(arguments.seeds)):
        if (there := arguments.out / f"{seed}.safetensors").exists():  # hours, perhaps
            parser.error(f"{there} is there already; name another --out.")
    require("stable_baselines3", "Stable-Baselines3")
    arguments.out.mkdir(parents=True, exist_ok=True)
    try:
        for seed in seeds:
            train(seed, arguments)
    except (CableError, OSError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        parser.exit(130, "interrupted; policies of finished seeds are kept.\n")


if __name__ == "__main__":
    main()
