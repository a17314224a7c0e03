"""User controllers, as an entrant might submit them."""

from __future__ import annotations

import gc
import itertools
import os
import time
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
