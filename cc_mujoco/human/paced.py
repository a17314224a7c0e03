"""Help of the gait at another walking speed."""

from __future__ import annotations

from dataclasses import dataclass

from cc_mujoco.human.pace import Pace
from cc_mujoco.human.tasks import Real, Task


@dataclass(frozen=True)
class Paced(Task):
    """A task that follows the measured walk, at the speed of another.

    torque = share base(angle, velocity, w(phase)), w of `Pace.phase`: help stays where
    it is between heel strike, toe-off and the next heel strike.
    """

    of_phase = True
    base: Task
    """Of the phase alone, at the speed of the measured walk."""
    pace: Pace
    """The walk."""
    share: float = 1.0
    """Torque over that of `base` [-]."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        """Torque of the help [Nm]; see `Task.torque`."""
        return self.share * self.base.torque(angle, velocity, self.pace.phase(phase))
