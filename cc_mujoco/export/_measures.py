"""Stack and work of an exported controller, measured with gcc if it is installed.

The stack is the sum of the frames along the deepest path of calls; none is recursive.
The work is counted: an instrumented build gets noisy readings of a joint that swings,
stops and turns, and counts the basic blocks that each step executes.
"""

import functools
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cc_mujoco.export import _files as files
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._templates import fill
from cc_mujoco.native import FloatArray
from cc_mujoco.native import _library as native_library

FLAGS = "-std=c99", "-O2", "-ffp-contract=off"


class Measures(NamedTuple):
    """Stack and work of a controller; None if unknown."""

    stack: int | None  # [bytes], without that of the C library's functions
    blocks: int | None  # most basic blocks of a step

    def lines(self) -> list[str]:
        stack = blocks = "not known, as there is no gcc here"
        if self.stack is not None:
            stack = (
                f"at most {self.stack} bytes (gcc -O2, {platform.machine()}), and what "
                "exp, log and pow of the C library take"
            )
        if self.blocks is not None:
            blocks = f"at most {self.blocks} basic blocks, counted in 1500 steps"
        return [f"stack: {stack}", f"work of a step: {blocks}"]


def measure(plan: ExportPlan) -> Measures:
    """Return stack and work of a controller, cached by its source and compiler."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return Measures(None, None)
    about = subprocess.run([gcc, "--version"], capture_output=True, text=True)
    axes = [(a.law.step.__qualname__, a.fields, a.tables[:2]) for a in plan.axes]
    follows = repr((axes, plan.torques.shape, plan.torques.tables))

    def found() -> list[int | None]:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            files.write(folder, plan, "a controller")
            return [stack_bound(folder, [gcc, *FLAGS]), _most_blocks(folder, plan, gcc)]

    return Measures(*native_library.kept("work", [follows, about.stdout], found))


def stack_bound(folder: Path, compiler: Sequence[str]) -> int | None:
    """Return the stack that the functions of a controller need [bytes].

    It is None if the compiler, a command of gcc with its flags, does not report it, or
    if the depth of calls has no bound.
    """
    with tempfile.TemporaryDirectory() as place:
        made = Path(place) / "controller.o"
        source = folder / "cc_controller.c"
        words = [*compiler, "-fcallgraph-info=su", "-c", source, "-o", made]
        done = subprocess.run([str(word) for word in words], capture_output=True)
        graph = made.with_suffix(".ci")
        if done.returncode or not graph.exists():
            return None
        text = graph.read_text()
    sizes: dict[str, int] = {}
    calls: dict[str, list[str]] = {}
    for title, label in re.findall(r'node: \{ title: "(.*?)" label: "(.*?)"', text):
        size = re.search(r"(\d+) bytes \(([\w,]+)\)", label)
        if size and size[2] not in ("static", "dynamic,bounded"):
            return None
        sizes[title] = int(size[1]) if size else 0
    edges = r'edge: \{ sourcename: "(.*?)" targetname: "(.*?)"'
    for caller, target in re.findall(edges, text):
        calls.setdefault(caller, []).append(target)

    @functools.cache
    def deepest(name: str) -> int:
        below = [deepest(called) for called in calls.get(name, ())]
        return sizes.get(name, 0) + max(below, default=0)

    try:
        entries = "init", "set_parameters", "step"
        return max(deepest(f"cc_controller_{entry}") for entry in entries)
    except RecursionError:
        return None


def _most_blocks(folder: Path, plan: ExportPlan, gcc: str) -> int | None:
    with tempfile.TemporaryDirectory() as place:
        program, built = Path(place) / "count", Path(place) / "cc_controller.o"
        compiling = [*FLAGS, "-fsanitize-coverage=trace-pc", "-c", "-o", built]
        linking = ["-O2", "-I", folder, "-o", program, "-x", "c", "-", "-x", "none"]
        for words in (
            [*compiling, folder / "cc_controller.c"],
            [*linking, built, folder / "cc_parameters.c", "-lm"],
        ):
            command, counting = [gcc, *map(str, words)], fill("count_blocks.c")
            done = subprocess.run(command, input=counting.encode(), capture_output=True)
            if done.returncode:
                return None
        rows = swinging_readings(plan, 1500).tobytes()  # as many as `lines` says
        counted = subprocess.run([program], input=rows, capture_output=True, check=True)
    return int(counted.stdout)


def swinging_readings(plan: ExportPlan, count: int) -> FloatArray:
    """Return noisy readings (count, readings) of a joint that swings and stops.

    The joint swings by 0.3 rad at 9 rad/s and rests at 0.2 rad in the last 0.1 s of
    every 0.5 s. Noise: 1e-4 rad, 1e-4 rad/s and 2 % of the greatest torque.
    """
    rng = np.random.default_rng(0)
    t = 1e-3 * np.arange(count)  # [s]
    angle, speed = 0.3 * np.sin(9.0 * t), 2.7 * np.cos(9.0 * t)
    still = t % 0.5 > 0.4
    angle[still], speed[still] = 0.2, 0.0
    found = []
    for axis in plan.axes:
        value = {f.name.removeprefix(axis.prefix): f.value for f in axis.fields}
        ratio, most = value.get("ratio", 1.0), value["high"]
        torque = 0.5 * most * abs(ratio) * np.sin(23.0 * t)
        for name in axis.seen:
            kind = name.removeprefix(axis.prefix)
            turn = ratio if kind.startswith("motor") else 1.0
            if "angle" in kind or "velocity" in kind:
                column = turn * (angle if "angle" in kind else speed)
                column = column + rng.normal(size=count) * 1e-4 * abs(turn)
            elif kind.endswith("torque_nm"):
                column = torque + rng.normal(size=count) * 0.02 * most * abs(ratio)
            else:
                # Tensions of 20 N; 1 for all else
                column = np.full(count, 20.0 if kind.startswith("tension") else 1.0)
            found.append(column)
    return np.column_stack(found)
