"""Sources of the torque at either end of a transmission.

A torque sensor shows what passes through it; a load cell on the cable only what the
cable pulls; a motor's current what the motor makes, its own friction included; and a
known load says by its motion what the joint must have been given. What none of them
shows is not compared, and no effect that needs it is named.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from cc_mujoco.datasets._channels import TORQUES

Instrument = Literal["torque sensor", "load cells", "motor current", "known load"]


class Instruments(NamedTuple):
    """Sources of the torques in all trials of a dataset."""

    motor: Instrument | None = "torque sensor"
    joint: Instrument | None = "torque sensor"

    @property
    def rows(self) -> tuple[int, ...]:
        """Return which of motor (0) and joint (1) are compared."""
        return tuple(row for row, each in enumerate(self) if each is not None)

    @property
    def channels(self) -> tuple[str, ...]:
        """The torques that are compared, by their columns."""
        return tuple(TORQUES[row] for row in self.rows)


TORQUE_SENSORS = Instruments()
