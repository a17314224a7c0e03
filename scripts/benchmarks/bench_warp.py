"""Steps per second of all worlds of mujoco_warp, with cables and without.

    python scripts/benchmarks/bench_warp.py --device cuda:0 --out build/warp.md
    python scripts/benchmarks/bench_warp.py --scenes wrist --worlds 1 64 1024

The same scene twice in one process, turn by turn: with its cables attached, and with
their ends free. On a GPU steps are replayed from a captured graph. Prints, and writes,
the median of the turns, their ratio with the middle half, the memory of the cables per
world and what the first step took, which is compiling unless Warp's cache has the
kernels. A number of worlds for which memory does not last ends its scene.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import tyro
import warp as wp
from turns import by_turns, spread

from cc_mujoco.assets import scene_path
from cc_mujoco.warp import attach, without_plugin
from cc_mujoco.warp._cables import _LookAhead
from cc_mujoco.warp._paths import LedCables

HEAD = """| scene | worlds | without, steps/s | with | ratio | kB per world | first, s |
|---|---:|---:|---:|---|---:|---:|"""


def main(
    device: str = "cpu",
    scenes: tuple[str, ...] = ("wrist", "exosuit", "hand"),
    worlds: tuple[int, ...] = (1, 16, 256, 1024, 4096, 16384, 65536),
    steps: int = 50,
    rounds: int = 11,
    out: Path | None = None,
) -> None:
    """Print the rates.

    Args:
        device: `cpu` or `cuda:0`.
        scenes: scenes with cables.
        worlds: numbers of worlds.
        steps: steps per turn.
        rounds: turns of each.
        out: file for the table, too.
    """
    wp.config.quiet = True
    title = f"{wp.get_device(device).name}, Warp {wp.__version__}, {steps} steps a turn"
    lines = [title, "", HEAD]
    print(*lines, sep="\n")
    for scene in scenes:
        spec = mujoco.MjSpec.from_file(str(scene_path(scene)))
        for count in worlds:
            try:
                with wp.ScopedDevice(device):
                    row = _row(spec, count, steps, rounds)
            except RuntimeError as error:  # as Warp says that memory does not last
                lines.append(f"| {scene} | {count} | {str(error).splitlines()[0]} |")
                print(lines[-1])
                break
            lines.append(f"| {scene} {row}")
            print(lines[-1], flush=True)
            if out is not None:
                out.parent.mkdir(parents=True, exist_ok=True)
                out.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _row(spec: mujoco.MjSpec, worlds: int, steps: int, rounds: int) -> str:
    plain = without_plugin(spec).compile()
    turns: list[Callable[[], float]] = []
    played, first, memory = [], [], 0
    for attached in (False, True):
        m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=worlds)
        if attached:
            memory = _memory(attach(m, d, spec))
        begin = time.perf_counter()
        mjw.step(m, d)
        wp.synchronize()
        first.append(time.perf_counter() - begin)
        turns.append(_turn(plain, m, d, steps))
        played.append(d)
    spent = by_turns(dict(enumerate(turns)), rounds)
    lost = sum(np.count_nonzero(~np.isfinite(d.qpos.numpy())) for d in played)
    if lost:
        raise SystemExit(f"{lost} positions of {worlds} worlds are no numbers")
    free, held = (np.median(worlds * steps / times) for times in spent.values())
    return (
        f"| {worlds} | {free:,.0f} | {held:,.0f} | {spread(spent[0] / spent[1])} | "
        f"{memory / worlds / 1e3:.1f} | {first[1]:.1f} |"
    )


def _now() -> float:
    """Return the time [s]: of this process, or of the clock when the GPU is done."""
    if not wp.get_device().is_cuda:
        return time.process_time()
    wp.synchronize()
    return time.perf_counter()


def _turn(
    model: mujoco.MjModel, m: mjw.Model, d: mjw.Data, steps: int
) -> Callable[[], float]:
    """Return a function that takes the steps and returns their time [s]."""
    graph = None
    if wp.get_device().is_cuda:
        with wp.ScopedCapture() as capture:
            mjw.step(m, d)
        graph = capture.graph
    # A tenth of what every actuator may do, to and fro.
    most = np.where(model.actuator_ctrllimited, model.actuator_ctrlrange[:, 1], 0.0)
    phases = 0.1 * np.sin(np.arange(32) * np.pi / 16.0)
    wave = [
        wp.array(np.tile(phase * most, (d.nworld, 1)).astype(np.float32))
        for phase in phases
    ]

    def play() -> float:
        begin = _now()
        for i in range(steps):
            wp.copy(d.ctrl, wave[i % len(wave)])
            if graph is None:
                mjw.step(m, d)
            else:
                wp.capture_launch(graph)
        return _now() - begin

    return play


def _memory(owner: Any) -> int:
    """Return the bytes of all arrays that cables, or a part of them, have."""
    arrays: dict[int, int] = {}
    left = [owner]
    while left:
        for value in vars(left.pop()).values():
            if isinstance(value, wp.array):
                size = wp.types.type_size_in_bytes(value.dtype)
                arrays[value.ptr] = int(np.prod(value.shape)) * size
            elif hasattr(value, "_ctype") or isinstance(value, _LookAhead | LedCables):
                left.append(value)
    return sum(arrays.values())


if __name__ == "__main__":
    tyro.cli(main)
