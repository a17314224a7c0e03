"""What a controller is, what it may measure, and what it knows of its device.

    controller = CONTROLLERS["pi"](env.unwrapped.drive)
    controller.reset()
    observation, info = env.reset(seed=0)
    torque = controller.torque(info)                       # Nm at the motor pulley
    env.step(env.unwrapped.action(torque))

Controllers work on numbers and, for many environments at once, on arrays; both give
the same bits.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError

MEASURED = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "joint_angle_rad",
    "joint_torque_nm",
    "desired_torque_nm",
)
"""All that a controller may read: encoders, a joint torque sensor and the task.

The names are those of the columns of an episode log, hence keys of `info`. Cable
tensions, slip, slack and the wearer's intention are known to a simulation alone.
"""


@dataclass(frozen=True)
class Drive:
    """What a controller knows of its device beforehand."""

    ratio: float
    """Joint torque per motor torque without friction, signed [-]."""
    low: float
    """Least torque of the motor [Nm]."""
    high: float
    """Greatest torque of the motor [Nm]."""
    period: float
    """Time between two calls of a controller [s]."""
    one_way: bool = False
    """Whether the cables only transmit positive motor torque: one cable pulls, none
    pulls back."""

    def __post_init__(self) -> None:
        """Refuse a drive that cannot be controlled."""
        if not (math.isfinite(self.ratio) and self.ratio != 0.0):
            raise CableError(
                f"Drive.ratio must be a finite number other than 0, not {self.ratio!r}."
            )
        if not self.low < self.high:
            raise CableError(
                f"Drive.low must be below Drive.high = {self.high!r} Nm, "
                f"not {self.low!r} Nm."
            )
        if not (math.isfinite(self.period) and self.period > 0.0):
            raise CableError(
                f"Drive.period must be a positive number of seconds, "
                f"not {self.period!r}."
            )


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
            observation: At least the keys `MEASURED`, each a number or an array over
                environments; others are not read.

        Returns:
            A float for numbers, an array for arrays.
        """
