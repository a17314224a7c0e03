"""Controller of many devices at once, whose drives may differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller, axes_controller
from cc_mujoco.control._axes import Law, runs_code
from cc_mujoco.device._drive import Drive

Array = NDArray[np.float64]


class Unpowered(Controller):
    """Motors that give no torque."""

    def __init__(self, drive: Drive, axes: int = 1) -> None:
        super().__init__(drive)
        self._axes = axes

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Mapping[str, Any]) -> Any:
        if self._axes == 1:
            return 0.0
        shape = np.shape(next(iter(observation.values())))
        return np.zeros((*shape, self._axes))


class PlantsController(Controller):
    """A controller for each of several plants, of one axis or of all."""

    def __init__(self, laws: Sequence[Controller]) -> None:
        super().__init__(laws[0].drive)
        self.laws = tuple(laws)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset those of all plants; see `Controller.reset`."""
        for row, law in enumerate(self.laws):
            if where is None or where[row]:
                law.reset()

    def given(self, torque: Any) -> None:
        """Accept the torques of every plant, (n,) or (n, axes); see `Controller`."""
        for law, own in zip(self.laws, torque, strict=True):
            law.given(own)

    def torque(self, observation: Mapping[str, Any]) -> Array:
        """Return the torque of every motor [N m], (n,) or (n, axes)."""
        # The `info` of an episode that ended is a mapping among the columns.
        columns = {n: v for n, v in observation.items() if isinstance(v, np.ndarray)}
        return np.stack(
            [
                law.torque({name: value[row] for name, value in columns.items()})
                for row, law in enumerate(self.laws)
            ]
        )


def batched_controller(
    given: Law | Mapping[str, Law],
    drives: Sequence[Sequence[Drive]],
    prefixes: Sequence[str],
) -> Controller:
    """Make the controller of many devices, of one axis or several.

    What it does for one of them is the same as for that one alone. Equal devices share
    a controller that takes arrays; code from outside may know numbers only.

    Args:
        given: As of `control.axes_controller`.
        drives: Of every axis of each device.
        prefixes: Beginnings of the columns of each axis.

    Raises:
        CableError: As `control.axes_controller`.
    """
    first = drives[0]
    are_equal = all(list(own) == list(first) for own in drives)
    if len(drives) == 1 or (are_equal and not runs_code(given)):
        return axes_controller(given, first, prefixes)
    return PlantsController([axes_controller(given, own, prefixes) for own in drives])
