"""Time of a step of an exported controller.

    python scripts/benchmarks/bench_export.py --scene wrist ankle
    python scripts/benchmarks/bench_export.py --scene hand --controllers decoupled_pi

Every controller that can be exported drives all axes of its device for an episode with
noisy torque sensors; what it read is then fed to the exported one by a program in C
that times each step. Needs gcc. Prints size of the object file, memory, stack, and
the median, the 999th of a thousand and the longest of the steps of an episode, each the
fastest of several repetitions of that step: the others were interrupted by something
else.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import tyro

from cc_mujoco.control import axes_controller
from cc_mujoco.device import TENSION_COLUMN, Drive
from cc_mujoco.export import EXPORTED, ExportPlan, write
from cc_mujoco.export._measures import FLAGS, stack_bound

PROGRAM = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")


def readings(
    env: Any, drives: list[Drive], name: str, duration: float
) -> tuple[ExportPlan, np.ndarray]:
    """Return plan and readings (steps, readings) of an episode of `duration` [s]."""
    device = env.exo.device
    plan = ExportPlan.of(name, drives, device.driven, device.prefixes)
    law = axes_controller(name, drives, device.prefixes)
    _, info = env.reset(seed=1)
    law.reset()
    random = np.random.default_rng(2)
    rows = []
    for _ in range(round(duration / drives[0].period)):
        seen, row = dict(info), []
        for axis, drive, prefix in zip(plan.axes, drives, device.prefixes, strict=True):
            seen[f"{prefix}joint_torque_nm"] += random.normal() * drive.torque_noise
            row += [float(seen[prefix + column]) for column in axis.columns]
            tensions = [
                max(float(info[f"tension_{cable}_nodes_n"][node]), 0.0)
                for _, cable, node in axis.tension_readings
            ]
            if axis.taps is not None:
                taps = np.reshape(tensions, axis.taps.nodes.shape)
                seen[prefix + TENSION_COLUMN] = taps
            row += tensions
            row += [float(seen[prefix + column]) for column in axis.other_columns]
        rows.append(row)
        *_, info = env.step(env.action(law.torque(seen)))
    return plan, np.array(rows)


def timed(plan: ExportPlan, read: np.ndarray, repetitions: int) -> str:
    """Return a row of the table: size and times of an exported, compiled controller."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "controller")
        write(folder, plan, "a benchmark")
        (folder / "bench.c").write_text(PROGRAM)
        sources = ["bench.c", "cc_parameters.c", "cc_controller.o"]
        for words in (["-c", "cc_controller.c"], ["-o", "bench", *sources, "-lm"]):
            subprocess.run(["gcc", *FLAGS, *words], cwd=folder, check=True)
        stack = stack_bound(folder, ["gcc", *FLAGS])
        size = (folder / "cc_controller.o").stat().st_size
        done = subprocess.run(
            [folder / "bench", str(repetitions), str(len(read))],
            input=read.tobytes(),
            capture_output=True,
            check=True,
        )
    took = np.frombuffer(done.stdout) * 1e-3
    middle, high = np.quantile(took, [0.5, 0.999])
    return (
        f"{size / 1024:.0f} | {8 * plan.memory_size / 1024:.1f} | {stack} | "
        f"{middle:.2f} | {high:.2f} | {took.max():.2f}"
    )


def main(
    scene: tuple[str, ...] = ("wrist",),
    duration: float = 5.0,
    repetitions: int = 20,
    controllers: tuple[str, ...] = tuple(EXPORTED),
) -> None:
    """Print the table, of episodes of length `duration` [s]."""
    print(
        "| scene | controller | object [KiB] | memory [KiB] | stack [bytes] "
        "| median [us] | 99.9 % [us] | longest [us] |\n"
        "|---|---|---:|---:|---:|---:|---:|---:|"
    )
    for place in scene:
        env: Any = gymnasium.make(
            "cc_mujoco/Device-v1",
            device=place,
            disable_env_checker=True,
            duration=duration,
        ).unwrapped
        for name in controllers:
            plan, read = readings(env, list(env.drives), name, duration)
            row = timed(plan, read, repetitions)
            print(f"| {place} | `{name}` | {row} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
