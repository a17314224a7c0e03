"""Steps per second of all worlds of mujoco_warp, with cables and without.

    python scripts/benchmarks/bench_warp.py --worlds 1 64 1024
    python scripts/benchmarks/bench_warp.py --device cuda:0 --worlds 1024 8192

The same scene twice in one process, turn by turn: with its cables attached, and with
their ends free. On a GPU steps are replayed from a captured graph. Prints the median of
the turns, their ratio with the middle half, the memory of the cables per world and what
compiling took, which is little where Warp's cache has the kernels.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import mujoco_warp as mjw
import numpy as np
import tyro
import warp as wp
from turns import by_turns, spread

from cc_mujoco.assets import scene_path
from cc_mujoco.warp import AttachedCables, attach, without_plugin


def main(
    device: str = "cpu",
    scene: str = "wrist",
    worlds: tuple[int, ...] = (64, 1024),
    steps: int = 50,
    rounds: int = 11,
) -> None:
    """Print the rates.

    Args:
        device: `cpu` or `cuda:0`.
        scene: scene with cables.
        worlds: numbers of worlds.
        steps: steps per turn.
        rounds: turns of each.
    """
    spec = mujoco.MjSpec.from_file(str(scene_path(scene)))
    print(f"{wp.get_device(device).name}, {scene}")
    print("| worlds | without, steps/s | with | ratio | kB per world | compiling, s |")
    print("|---:|---:|---:|---|---:|---:|")
    for count in worlds:
        with wp.ScopedDevice(device):
            print(_row(spec, count, steps, rounds), flush=True)


def _row(spec: mujoco.MjSpec, worlds: int, steps: int, rounds: int) -> str:
    plain = without_plugin(spec).compile()
    turns: list[Callable[[], float]] = []
    compiling, memory = [], 0
    for attached in (False, True):
        m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=worlds)
        if attached:
            memory = _memory(attach(m, d, spec))
        begin = time.perf_counter()
        mjw.step(m, d)
        wp.synchronize()
        compiling.append(time.perf_counter() - begin)
        turns.append(_turn(m, d, steps))
    spent = by_turns(dict(enumerate(turns)), rounds)
    free, held = (np.median(worlds * steps / times) for times in spent.values())
    return (
        f"| {worlds} | {free:,.0f} | {held:,.0f} | {spread(spent[0] / spent[1])} | "
        f"{memory / worlds / 1e3:.1f} | {compiling[1]:.1f} |"
    )


def _now() -> float:
    """Return the time [s]: of this process, or of the clock when the GPU is done."""
    if not wp.get_device().is_cuda:
        return time.process_time()
    wp.synchronize()
    return time.perf_counter()


def _turn(m: mjw.Model, d: mjw.Data, steps: int) -> Callable[[], float]:
    """Return a function that takes the steps and returns their time [s]."""
    graph = None
    if wp.get_device().is_cuda:
        with wp.ScopedCapture() as capture:
            mjw.step(m, d)
        graph = capture.graph

    def play() -> float:
        begin = _now()
        for i in range(steps):
            d.ctrl.fill_(0.3 * np.sin(0.05 * i))
            if graph is None:
                mjw.step(m, d)
            else:
                wp.capture_launch(graph)
        return _now() - begin

    return play


def _memory(cables: AttachedCables) -> int:
    arrays = [a for a in vars(cables).values() if isinstance(a, wp.array)]
    return sum(
        int(np.prod(a.shape)) * wp.types.type_size_in_bytes(a.dtype) for a in arrays
    )


if __name__ == "__main__":
    tyro.cli(main)
