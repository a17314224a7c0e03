"""Time of the native library: compiling, loading, calling.

    python scripts/benchmarks/bench_core.py [--wheel]

Every line of the table is the processor time of a process of its own, with what it
starts. `bench_steps.py` has the speed of the engine.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tyro

from cc_mujoco.cable import Cable, Section, packed_parameters, rest_state
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.native._library import library

ROOT = Path(__file__).parents[2]
READ = """
from cc_mujoco.assets import scene_path
import mujoco, cc_mujoco
model = mujoco.MjModel.from_xml_path(str(scene_path("wrist")))
data = mujoco.MjData(model)
mujoco.mj_step(model, data)
cc_mujoco.read(model, data, "flexor")
from cc_mujoco.native._library import library
print(library()._name)
"""
EDITED = "cc_mujoco/cable/_parameters.py"


def main(wheel: bool = False) -> None:
    """Print the table.

    Args:
        wheel: also build the wheel, install it into a folder and read with it.
    """
    print(f"{'processor time':34} {'seconds':>8}  library")
    with tempfile.TemporaryDirectory() as home:
        tree, cache = Path(home) / "tree", Path(home) / "cache"
        for name in ("cc_mujoco", "envs", "assets"):
            place = tree / ("cc_mujoco" if name != "cc_mujoco" else "") / name
            ignore = shutil.ignore_patterns("__pycache__", "*.so")
            shutil.copytree(ROOT / name, place, ignore=ignore)
        show("import cc_mujoco", "import cc_mujoco", tree, cache)
        show("first read, nothing compiled", READ, tree, cache)
        show("read", READ, tree, cache)
        file = tree / EDITED
        text = file.read_text()
        file.write_text(f"# A comment.\n{text}")
        show("read after a changed comment", READ, tree, cache)
        file.write_text(f"{text}\nCHANGED = 1\n")
        show("read after a changed statement", READ, tree, cache)
        if wheel:
            pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps")
            place = Path(home) / "wheel"
            more = ("--no-build-isolation", "--target", place, ROOT)
            subprocess.run([*pip, *more], check=True)
            show("first read from a wheel", READ, place, Path(home) / "none")
    print(f"a step of 5 segments, called from Python: {call():.2f} us")
    print(library()._name)


def show(name: str, code: str, place: Path, cache: Path) -> None:
    """Run code with the package of a folder, and print its processor time."""
    paths = {"PYTHONPATH": str(place), "CC_MUJOCO_CACHE_DIR": str(cache)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=os.environ | paths,
        cwd=place,
        check=True,
        capture_output=True,
        text=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{name:34} {spent:8.2f}  {done.stdout.strip()}", flush=True)


def call(rounds: int = 300, calls: int = 300) -> float:
    """Return the time of a step of five segments, called from Python [us].

    Args:
        rounds: means of which the least counts.
        calls: calls of which the mean is taken.
    """
    cable = Cable(friction=0.2, conduit=(Section(1.0, 1.0),), segments=5)
    prm, state = packed_parameters(cable), rest_state(cable)
    new, work = state.copy(), np.zeros(kernel.work_size(5))
    times = []
    for _ in range(rounds):
        begin = time.thread_time()
        for _ in range(calls):
            kernel.step(
                prm, 5, state, kernel.POSITION, 1e-4, kernel.POSITION, 0.0, 1e-3, new,
                work,
            )  # fmt: skip
        times.append((time.thread_time() - begin) / calls)
    return 1e6 * min(times)


if __name__ == "__main__":
    tyro.cli(main)
