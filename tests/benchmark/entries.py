"""User controllers, as an entrant might submit them."""

from __future__ import annotations

import gc
import os
from typing import Any

import numpy as np


def wrong(drive: Any) -> Any:
    """Return a controller that fails in a way that depends on the number of devices.

    One device: too many torques. Three: an exception. Four: exit of the process. Any
    other number: an infinite torque.
    """

    def law(seen: Any) -> Any:
        rows = np.size(seen["joint_torque_nm"])
        if rows == 1:
            return np.zeros(17)
        if rows == 3:
            return seen["tension_flexor_distal_n"]
        if rows == 4:
            os._exit(7)
        return np.full_like(seen["joint_torque_nm"], np.inf)

    return law


def cheat(drive: Any) -> Any:
    """Return a controller without torque that overwrites every score it can reach."""
    from cc_mujoco.benchmark import _cell as cell
    from cc_mujoco.benchmark import _scores as scores
    from cc_mujoco.device import Sensing

    cell.episode_scores = scores.episode_scores = lambda *_, **__: {
        s.name: 0.0 for s in scores.SCORES
    }
    cell.play_group = cell.sample_plants = None
    Sensing.equip = None
    np.sqrt = np.mean = lambda x, *_, **__: 0.0 * x
    object.__setattr__(drive, "high", 1e9)

    kinds = {type(each).__name__ for each in gc.get_objects()}
    if kinds & {"Plant", "CellSetup", "Cell", "Measuring"}:
        raise RuntimeError("the judge is here")
    return lambda seen: 0.0 * seen["desired_torque_nm"]
