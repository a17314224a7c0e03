"""Tension sensors of a design, for the controllers that use some.

A study compares transmissions, so its sensors are ideal: no noise, no delay, at both
ends and in the middle of every cable, where the benchmark has its noisy ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control import Controller, Drive, controller
from cc_mujoco.engine import Reader
from cc_mujoco.sensing import PERFECT, TENSIONS

Array = NDArray[np.float64]


def equip(drive: Drive) -> Drive:
    """A drive with ideal tension sensors along every cable."""
    return PERFECT.equip(drive)


class Taps:
    """Where the sensors are in the plugin state of a simulation."""

    def __init__(self, readers: Sequence[Reader], drive: Drive) -> None:
        """Find them.

        Args:
            readers: one per cable.
            drive: with sensors along each.
        """
        self._places = np.array(
            [
                [reader.nodes.start + node for node in sensors.nodes]
                for reader, sensors in zip(readers, drive.sensors, strict=True)
            ]
        )

    def read(self, plugin_state: Array) -> Array:
        """Tensions (..., cables, sensors), 0 where a cable is slack [N]."""
        return np.maximum(plugin_state[..., self._places], 0.0)


class Sensed(Controller):
    """A controller that finds tension sensors in the columns of an episode log."""

    def __init__(self, name: str, drive: Drive, cables: Sequence[str]) -> None:
        """Make the controller.

        Args:
            name: of the controller.
            drive: of the device.
            cables: their names, as in the columns.
        """
        super().__init__(drive)
        self._cables = tuple(cables)
        self._drive = equip(drive)
        self._law = controller(name, self._drive)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Begin anew; see `Controller.reset`."""
        self._law.reset(where)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        told = np.array(
            [
                observation[f"tension_{name}_nodes_n"][list(sensors.nodes)]
                for name, sensors in zip(self._cables, self._drive.sensors, strict=True)
            ]
        )
        return self._law.torque({**observation, TENSIONS: told})
