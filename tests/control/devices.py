"""Devices without inertia for the tests of controllers with a model."""

from __future__ import annotations

from typing import Any

import numpy as np

from cc_mujoco.cable import Cable, Section
from cc_mujoco.control import _planner_memory as planner_memory
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.device import CableDrive, Drive
from cc_mujoco.native import FloatArray

WRAP = 3.0


def kept(law: Any) -> FloatArray:
    """Return what a planning controller keeps of one device; see `_planner_memory`."""
    memory: FloatArray = law._memory[0, planner_steps.LAW :]
    return memory[: planner_memory.FRICTION + len(law.drive.cables)]


def cable(friction: float = 0.1, segments: int = 10) -> Cable:
    """Return a cable of 2 m that is wrapped by `WRAP` radians."""
    return Cable(
        friction=friction,
        segments=segments,
        pretension=12.0,
        conduit=(Section(2.0, 2.0 / WRAP),),
    )


def pull_pull(friction: float = 0.1) -> Drive:
    """Two cables on equal pulleys of 10 cm."""
    own = cable(friction)
    pair = (CableDrive(own, -0.1, -0.1), CableDrive(own, 0.1, 0.1))
    return Drive(1.0, -20.0, 20.0, 0.001, cables=pair)


def single(friction: float = 0.1) -> Drive:
    """One cable whose torques are tensions and whose angles are displacements."""
    row = (CableDrive(cable(friction), -1.0, -1.0),)
    return Drive(1.0, 0.0, 500.0, 0.001, one_way=True, cables=row)


def there_and_back(duration: float = 4.0, reach: float = 0.4) -> FloatArray:
    """Joint angle that goes out and comes back at constant speed [rad], 1 kHz."""
    time = np.arange(0.0, duration, 0.001)
    return reach * (1.0 - np.abs(2.0 * time / duration - 1.0))


def growth(friction: Any) -> Any:
    """Tension ratio of the whole cable."""
    return np.exp(friction * WRAP)
