"""Lateness of the cycles of `cc-mujoco run`, against a rig in a process of its own.

    python scripts/benchmarks/check_jitter.py --duration 600 --priority 30

Starts `scripts/play_rig.py` and the host, over UDP of this machine, and prints cycles
that were missed and how late the others began. With `--priority` both run under
`chrt -f`, the rig by 10 less. `--controllers` are run one after another.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import tyro

from cc_mujoco.report import table

PLAY_RIG = Path(__file__).parents[1] / "play_rig.py"
SETTINGS = """scene = "bench"
period = {period}

[rig]
address = "127.0.0.1:{port}"

[limits]
torque = 8.0
torque_rate = 1000.0
motor_speed = 60.0
joint_range = [-2.5, 2.5]

[watchdog]
missed_readings = 100
missed_deadlines = 100

[task]
trajectory = "sine"
amplitude = 1.0
"""
HEAD = (
    "controller", "priority", "cycles", "missed", "median [us]", "99 % [us]",
    "longest [ms]", "work, median [us]", "load before, after", "outcome",
)  # fmt: skip


def under(priority: int, words: list[str]) -> list[str]:
    """Return a command run by `chrt -f` at this priority; 0 leaves it unchanged."""
    chrt = shutil.which("chrt")
    if not priority:
        return words
    if chrt is None or subprocess.run([chrt, "-f", str(priority), "true"]).returncode:
        raise SystemExit("chrt is not there, or may not be used; leave out --priority.")
    return [chrt, "-f", str(priority), *words]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def played(name: str, duration: float, period: float, priority: int) -> dict[str, Any]:
    """Run a controller against a rig; return the content of `run.json`."""
    with tempfile.TemporaryDirectory() as place:
        folder, port = Path(place), free_port()
        (folder / "rig.toml").write_text(SETTINGS.format(port=port, period=period))
        rig = [sys.executable, str(PLAY_RIG), "--port", str(port)]
        rig += ["--period", str(period)]
        with subprocess.Popen(
            under(priority and priority - 10, rig), stdout=subprocess.PIPE, text=True
        ) as bench:
            try:
                assert bench.stdout is not None
                bench.stdout.readline()  # it is there
                host = [
                    *(sys.executable, "-m", "cc_mujoco.cli", "run"),
                    *("--rig", str(folder / "rig.toml"), "--controller", name),
                    *("--duration", str(duration), "--out", str(folder / "out")),
                ]
                subprocess.run(under(priority, host), stdout=subprocess.DEVNULL)
            finally:
                bench.terminate()
        return json.loads((folder / "out" / "run.json").read_text())


def row(name: str, duration: float, period: float, priority: int) -> tuple[str, ...]:
    before = os.getloadavg()[0]
    found = played(name, duration, period, priority)
    late, work = found["late"], found["work"]
    return (
        f"`{name}`", str(priority or "usual"), str(found["cycles"]),
        str(found["missed_cycles"]), f"{late['p50_us']:.0f}", f"{late['p99_us']:.0f}",
        f"{1e-3 * late['longest_us']:.2f}", f"{work['p50_us']:.0f}",
        f"{before:.1f}, {os.getloadavg()[0]:.1f}", found["outcome"],
    )  # fmt: skip


def main(
    duration: float = 600.0,
    period: float = 0.001,
    priority: int = 0,
    controllers: tuple[str, ...] = ("model",),
) -> None:
    """Run each controller.

    Args:
        duration: of a run [s].
        period: of the loop [s].
        priority: of `chrt -f`, 11 to 99.
        controllers: their names.
    """
    if priority and not 11 <= priority <= 99:
        raise SystemExit(f"--priority is {priority}; it must be 11 to 99.")
    rows = [row(name, duration, period, priority) for name in controllers]
    print(table(HEAD, rows))


if __name__ == "__main__":
    tyro.cli(main)
