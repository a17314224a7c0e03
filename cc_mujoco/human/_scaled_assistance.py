"""Help of the gait at another walking speed."""

from __future__ import annotations

from dataclasses import dataclass

from cc_mujoco.human._pace import Pace
from cc_mujoco.human._tasks import Assist, Real, Swing, Task


@dataclass(frozen=True)
class Paced(Task):
    """A task that follows the measured walk, at the speed of another.

    torque = share base(angle, velocity, w(phase)), w of `Pace.phase`: help stays where
    it is between heel strike, toe-off and the next heel strike.
    """

    of_phase = True
    base: Task
    """Task that depends on the phase alone, at the speed of the measured walk."""
    pace: Pace
    """The walk."""
    share: float = 1.0
    """Torque over that of `base` [-]."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        """Return the torque of the help [N m]; see `Task.torque`."""
        return self.share * self.base.torque(angle, velocity, self.pace.phase(phase))


def scale_task(task: Task, pace: Pace, size: float = 1.0) -> Task:
    """Return a task scaled to another wearer or walking speed.

    `Assist` and `Swing` keep to the stride and go with the moment of their joint; tasks
    that do not follow the gait, and profiles, stay what they are.

    Args:
        task: As the wearer of the scenes has it at the measured speed.
        pace: How the wearer walks.
        size: Moments over those of the scenes' wearer [-], see `Body.moment`.
    """
    if pace == Pace() and size == 1.0:
        return task
    if isinstance(task, Assist):
        return Paced(task, pace, size * pace.moment("ankle"))
    if isinstance(task, Swing):
        return Paced(task, pace, size * pace.moment("hip"))
    return task
