"""Effects between the command of a controller and the torque of the motor.

Actuation(delay=2, cogging=(0.01,), order=12)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    """Periods of that torque in a turn of the motor's pulley."""
    phase: float = 0.0
    """Phase of that torque at an angle of 0 [rad]."""

    @property
    def is_plain(self) -> bool:
        """True if the motor applies the command of the controller."""
        return not self.delay and not self.cogging


PLAIN = Actuation()
"""Actuation of a motor that applies the command of its controller."""


class Hindrance:
    """Motors that do not apply their controllers' commands; see `Batch.actuate`."""

    def __init__(
        self, actuations: Sequence[Actuation], prefixes: Sequence[str]
    ) -> None:
        """Prepare, with the actuation of every device and the axes' column prefixes."""
        shape = len(actuations), len(prefixes)
        self._angles = [f"{prefix}motor_angle_rad" for prefix in prefixes]
        self._delay = np.array([one.delay for one in actuations])
        self._past = np.zeros((int(self._delay.max()) + 1, *shape))
        self._size = np.array([one.cogging or (0.0,) * shape[1] for one in actuations])
        self._order = np.array([[float(one.order)] for one in actuations])
        self._phase = np.array([[one.phase] for one in actuations])

    def __call__(self, step: int, columns: Columns, torque: Array) -> Array:
        """Return the torque of the motors [N m], (devices, axes)."""
        if step == 0:
            self._past[:] = 0.0
        shape = self._past.shape[1:]
        angle = np.stack([columns[name] for name in self._angles], axis=1)
        self._past = np.roll(self._past, 1, axis=0)
        self._past[0] = np.broadcast_to(np.reshape(torque, (-1, shape[1])), shape)
        late: Array = self._past[self._delay, np.arange(shape[0])]
        wave: Array = np.sin(self._order * angle + self._phase)
        return late + self._size * wave
