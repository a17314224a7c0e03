"""Designs per second of `cc-mujoco whatif` against a loop of single environments.

    python scripts/benchmarks/bench_whatif.py

The batch and the loop play the same designs by turns in one process, so that what else
the machine does falls on both. Prints the ratio of their speeds, designs per second,
and the time that 10,000 designs would take; bare times are of this machine only.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from cc_mujoco.control import controller
from cc_mujoco.episode import Single, run
from cc_mujoco.sensing import PERFECT, Measuring
from cc_mujoco.whatif import Plan, carry_out, make_plan
from cc_mujoco.whatif.build import Builder

EPISODE = (
    "efficiency",
    "tracking_error",
    "peak_motor_torque",
    "peak_motor_power",
    "slack_margin",
    "slack_share",
    "peak_tension",
    "strength_used",
)
"""Metrics that need the episode alone."""

LOOPED = 2
"""Designs of a turn of the loop."""


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="wrist")
    parser.add_argument("--designs", type=int, default=768)
    parser.add_argument("--duration", type=float, default=10.0)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--everything", action="store_true", help="all metrics")
    arguments = parser.parse_args()
    for step in (5e-4, 1e-3):
        plan = make_plan(
            arguments.scene,
            {"friction": "0.05:0.2", "loops": "0.5:3", "pretension": "5:40"},
            sampling="lhs",
            samples=arguments.designs,
            controllers=["pi"],
            duration=arguments.duration,
            timestep=step,
            metrics=() if arguments.everything else EPISODE,
        )
        print(
            f"{arguments.scene}, {arguments.designs} designs of "
            f"{arguments.duration:g} s, control at 1 kHz, physics at {1e-3 / step:g} "
            "kHz"
        )
        found: dict[str, list[tuple[float, float]]] = {"loop": []}
        found |= {f"{threads} threads": [] for threads in arguments.threads}
        for _ in range(arguments.rounds):
            found["loop"].append(rates(LOOPED, lambda p=plan: loop(p)))
            for n in arguments.threads:
                batch = partial(carry_out, plan, threads=n)
                found[f"{n} threads"].append(rates(len(plan.designs), batch))
        base = np.array(found["loop"])
        for name, measured in found.items():
            wall, processor = np.median(measured, axis=0)
            ratio = np.median(np.array(measured) / base, axis=0)
            print(
                f"  {name:10} {wall:7.2f} designs/s ({ratio[0]:5.1f} times the loop), "
                f"{processor:7.2f} per processor second ({ratio[1]:5.1f} times), "
                f"10,000 designs in {10_000 / wall / 60:.1f} min"
            )


def rates(count: int, play: Callable[[], object]) -> tuple[float, float]:
    """Designs per second, and per second of processor time, all threads together."""
    start = time.perf_counter(), time.process_time()
    play()
    taken = time.perf_counter() - start[0], time.process_time() - start[1]
    return count / taken[0], count / taken[1]


def loop(plan: Plan) -> None:
    """Play designs in single environments, one after another."""
    protocol = plan.protocol
    builder = Builder(protocol.scene, protocol.timestep)
    for design in plan.designs[:LOOPED]:
        model = builder.model(design, whole=True)
        env: Any = gymnasium.make(
            builder.device.environment,
            disable_env_checker=True,
            model=model,
            trajectory=protocol.trajectory,
            task=protocol.task,
            duration=protocol.duration,
            frame_skip=protocol.frame_skip,
        ).unwrapped
        law = controller(protocol.controllers[0], env.drive)
        driven = env.exo.device.driven
        measuring = Measuring(PERFECT, law.drive, driven, protocol.seed, env.exo.steps)
        run(Single(env, protocol.seed), law, measure=measuring.measure)


if __name__ == "__main__":
    main()
