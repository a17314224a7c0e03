"""Controllers from outside, as an entrant might hand them in."""

from __future__ import annotations

import gc
import os
from typing import Any

import numpy as np


def wrong(drive: Any) -> Any:
    """Of one device too many torques, of three an exception, of four an end."""

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
    """No torque at all, and every score changed wherever it can be reached."""
    from cc_mujoco.benchmark import cell, scores
    from cc_mujoco.sensing import Sensing

    cell.score = scores.score = lambda *_, **__: {s.name: 0.0 for s in scores.SCORES}
    cell.play_group = cell.draw = None
    Sensing.equip = None
    np.sqrt = np.mean = lambda x, *_, **__: 0.0 * x
    object.__setattr__(drive, "high", 1e9)

    kinds = {type(each).__name__ for each in gc.get_objects()}
    if kinds & {"Plant", "CellSetup", "Cell", "Measuring"}:
        raise RuntimeError("the judge is here")
    return lambda seen: 0.0 * seen["desired_torque_nm"]
