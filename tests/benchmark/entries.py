"""User controllers, as an entrant might submit them."""

from __future__ import annotations

import ctypes
import gc
import itertools
import os
import socket
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np


def wrong(drive: Any) -> Any:
    """Return a controller of an infinite torque."""
    return lambda seen: np.full_like(seen["joint_torque_nm"], np.inf)


def wide(drive: Any) -> Any:
    """Return a controller of too many torques."""
    return lambda seen: np.zeros(17)


def curious(drive: Any) -> Any:
    """Return a controller that reads what nobody measures."""
    return lambda seen: seen["tension_flexor_distal_n"]


def strong(drive: Any) -> Any:
    """Return a controller of which each second torque is beyond every motor."""
    torques = itertools.cycle((0.0, 1e6))
    return lambda seen: np.full_like(seen["joint_torque_nm"], next(torques))


def endless(drive: Any) -> Any:
    """Return a controller that never gives a torque."""
    return lambda seen: next(n for n in itertools.count() if n < 0)


def unmade(drive: Any) -> Any:
    """Return no controller, ever."""
    while True:
        time.sleep(1.0)


def ending(drive: Any) -> Any:
    """Return a controller that ends its process."""
    return lambda seen: os._exit(7)


def cheat(drive: Any) -> Any:
    """Return a controller without torque that overwrites every score it can reach."""
    from cc_mujoco.benchmark import _cell as cell
    from cc_mujoco.device import Sensing

    cell.episode_scores = lambda *_, **__: {s.name: 0.0 for s in cell.SCORES}
    cell.play_group = cell.sample_plants = None
    Sensing.equip = None
    np.sqrt = np.mean = lambda x, *_, **__: 0.0 * x
    object.__setattr__(drive, "high", 1e9)

    kinds = {type(each).__name__ for each in gc.get_objects()}
    if kinds & {"Plant", "CellSetup", "Cell", "Measuring"}:
        raise RuntimeError("the judge is here")
    return lambda seen: 0.0 * seen["desired_torque_nm"]


def prying(drive: Any) -> Any:
    """Return a controller that raises with the names of its successful intrusions."""
    judge, left = os.getppid(), Path(tempfile.gettempdir(), "left")
    pages = Path(f"/proc/{judge}")

    def trace() -> None:
        if ctypes.CDLL(None).ptrace(16, judge, 0, 0):
            raise OSError

    ways: dict[str, Callable[[], object]] = {
        "memory": lambda: (pages / "mem").open("rb"),
        "environment": lambda: (pages / "environ").read_bytes(),
        "files": lambda: os.readlink(pages / "fd" / "0"),
        "folder": lambda: os.readlink(pages / "cwd"),
        "trace": trace,
        "signal": lambda: os.kill(judge, 0),
        "write": lambda: Path("left").write_text(""),
        "overwrite": lambda: Path(__file__).open("a"),
        "socket": lambda: socket.create_connection(("127.0.0.1", 9)),
        "earlier": left.read_text,
    }
    found = []
    for name, way in ways.items():
        try:
            way()
        except ConnectionRefusedError:  # it was free to connect
            found.append(name)
        except OSError:
            continue
        else:
            found.append(name)
    left.write_text("of use in another condition")
    raise RuntimeError(f"ways: {found}")


def scanning(drive: Any) -> Any:
    """Return a controller that raises with the searched numbers its process holds.

    They are in the file `SEARCHED` under a mask, so that none is here because of it.
    """
    mask = np.uint64(0x5A5A5A5A5A5A5A5A)
    searched = np.fromfile(os.environ["SEARCHED"], np.uint64)

    def law(seen: Any) -> Any:
        found: set[int] = set()
        for line in Path("/proc/self/maps").read_text().splitlines():
            ends, rights, *_ = line.split()
            if rights.startswith("rw"):
                first, last = (int(end, 16) for end in ends.split("-"))
                words = (ctypes.c_uint64 * ((last - first) // 8)).from_address(first)
                held = np.isin(searched, np.frombuffer(words, np.uint64) ^ mask)
                found.update(np.flatnonzero(held).tolist())
        raise RuntimeError(f"held: {sorted(found)}")

    return law


def idle(drive: Any) -> Any:
    """Return a controller that computes for 1 ms and denies it."""
    from cc_mujoco.benchmark import _user_entry

    time.thread_time = time.process_time = lambda: 0.0

    def law(seen: Any) -> Any:
        until = time.perf_counter() + 1e-3
        while time.perf_counter() < until:
            pass
        return 0.0 * seen["desired_torque_nm"]

    assert _user_entry
    return law


def reading(drive: Any) -> Any:
    """Return a controller without torque, unless cells of the run can be read."""
    found = [path.name for path in Path(os.environ["CELLS"]).glob("*.parquet")]
    if found:
        raise RuntimeError(f"finished: {found[0]}")
    return lambda seen: 0.0 * seen["desired_torque_nm"]
