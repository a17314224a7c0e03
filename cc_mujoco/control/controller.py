"""What a controller is and what it may measure.

    controller = CONTROLLERS["pi"](env.unwrapped.drive)
    controller.reset()
    observation, info = env.reset(seed=0)
    torque = controller.torque(info)                       # Nm at the motor pulley
    env.step(env.unwrapped.action(torque))

Controllers work on numbers and, for many environments at once, on arrays; both give
the same bits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.compiled import FloatArray
from cc_mujoco.control.drive import Drive


class Controller(ABC):
    """A law for the motor torque; subclasses are small and may keep a state."""

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device to be driven.
        """
        self.drive = drive

    @abstractmethod
    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Forget the past, before every episode.

        Args:
            where: Mask of the environments that start anew; all of them by default.
        """

    @abstractmethod
    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [Nm], inside the limits of the drive.

        Args:
            observation: At least the keys `sensing.MEASURED`, each a number or an array
                over environments; others are not read, except `sensing.TENSIONS`
                where the drive has such sensors.

        Returns:
            A float for numbers, an array for arrays.
        """

    def limited(self, torque: Any) -> Any:
        """A torque within the limits of the motor, a float for a number [Nm]."""
        within = np.clip(torque, self.drive.low, self.drive.high)
        return within if isinstance(within, np.ndarray) else float(within)


def readings(observation: Mapping[str, Any], names: Sequence[str]) -> FloatArray:
    """What is measured by these names (rows, names); a number is a row of its own."""
    columns = [np.atleast_1d(np.asarray(observation[name], float)) for name in names]
    seen = np.empty((max(column.size for column in columns), len(names)))
    for place, column in enumerate(columns):
        seen[:, place] = column
    return seen
