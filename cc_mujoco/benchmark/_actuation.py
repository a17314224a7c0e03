"""Effects between the command of a controller and the torque of the motor.

Actuation(delay=2, cogging=(0.01,), order=12)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.simulation._batch import Fleet
from cc_mujoco.simulation._loop import Columns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Actuation:
    """Late commands and a torque that changes with the angle of the motor."""

    delay: int = 0
    """Control steps by which a command is late."""
    cogging: tuple[float, ...] = ()
    """Amplitude of the torque of every motor [N m]; none by default."""
    order: int = 1
    """Waves of that torque in a turn of the motor's pulley."""
    phase: float = 0.0
    """Phase of that torque at an angle of 0 [rad]."""

    @property
    def is_plain(self) -> bool:
        """Return whether the motor gets what the controller commands."""
        return not self.delay and not self.cogging


PLAIN = Actuation()
"""Actuation of a motor that gets what its controller commands."""


class HinderedFleet(Fleet):
    """Devices whose motors do not get what their controllers command."""

    def __init__(
        self, actuations: Sequence[Actuation], *args: Any, **settings: Any
    ) -> None:
        """Make the batch.

        Args:
            actuations: Of every device.
            *args: See `Fleet`.
            **settings: See `Fleet`.
        """
        super().__init__(*args, **settings)
        self.set_actuations(actuations)

    def set_actuations(self, actuations: Sequence[Actuation]) -> None:
        """Take the effects of every device; `start` comes after."""
        shape = len(actuations), len(self.prefixes)
        self._delay = np.array([one.delay for one in actuations])
        self._past = np.zeros((int(self._delay.max()) + 1, *shape))
        self._size = np.array([one.cogging or (0.0,) * shape[1] for one in actuations])
        self._order = np.array([[float(one.order)] for one in actuations])
        self._phase = np.array([[one.phase] for one in actuations])
        self._angle = np.zeros(shape)

    def start(self) -> Columns:
        """Bring all to the start; see `DrivenDevice.start`."""
        self._past[:] = 0.0
        return self._remember(super().start())

    def advance(self, torque: Array) -> Columns:
        """Go a control step; see `DrivenDevice.advance`."""
        rows, axes = self._angle.shape
        commanded = np.broadcast_to(np.reshape(torque, (-1, axes)), (rows, axes))
        self._past = np.roll(self._past, 1, axis=0)
        self._past[0] = commanded
        late = self._past[self._delay, np.arange(rows)]
        wave = np.sin(self._order * self._angle + self._phase)
        return self._remember(super().advance(late + self._size * wave))

    def _remember(self, columns: Columns) -> Columns:
        for place, prefix in enumerate(self.prefixes):
            self._angle[:, place] = columns[f"{prefix}motor_angle_rad"]
        return columns
