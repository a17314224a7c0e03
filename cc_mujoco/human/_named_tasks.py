"""Tasks by text: names, numbers, torque profiles and tasks of the user.

>>> from cc_mujoco.human import task
>>> task("hold:-12")
Hold(pull=-12.0)
>>> task("tunnel:half_width=0.1,limit=0.5").limit
0.5
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cc_mujoco._utils.tables import is_table
from cc_mujoco._utils.user_code import user_errors
from cc_mujoco.errors import CableError
from cc_mujoco.human._parsing import user_object, with_numbers
from cc_mujoco.human._tasks import TASKS, Real, Task
from cc_mujoco.human._torque_table import read_torque


@dataclass(frozen=True)
class UserTask(Task):
    """A task of the user's own class, whose errors are reported in one sentence."""

    name: str
    """`MODULE:NAME`."""
    own: Task
    """The user's task."""

    def torque(self, angle: Real, velocity: Real, phase: Real) -> Real:
        """Return the torque of the user's task [N m]; see `Task.torque`."""
        with user_errors(f"task {self.name!r}"):
            found: Any = self.own.torque(angle, velocity, phase)
        if np.asarray(found).dtype.kind not in "fiu":
            raise CableError(
                f"task {self.name!r} gave {found!r}; it must be a torque in N m."
            )
        torque: Real = found
        return torque

    @property
    def of_phase(self) -> bool:
        """True if the torque of the user's task follows from `phase` alone."""
        return self.own.of_phase

    @property
    def of_time(self) -> bool:
        """True if `phase` is the time since the start [s] for the user's task."""
        return self.own.of_time

    @property
    def about_reference(self) -> bool:
        """True if `angle` is that beyond the reference for the user's task."""
        return self.own.about_reference

    @property
    def commands_angle(self) -> bool:
        """True if the joint is to follow the reference by the user's task."""
        return self.own.commands_angle


def task(given: str | Path | Task, joints: Sequence[str] = ()) -> Task:
    """Return the task that is meant.

    Args:
        given: A key of `TASKS`, also with numbers (`hold:-12`, `spring:2.5`,
            `tunnel:half_width=0.1,limit=0.5`); a torque profile over phase or time in a
            table (a `Path`, or a text that ends as one, see `read_torque`);
            `MODULE:NAME` of a `Task` or a function that returns one; or a task.
        joints: Name of the joint that the torque acts on, for a table.

    Raises:
        CableError: If there is no such task, or it cannot be read or made.
    """
    if isinstance(given, Task):
        return given
    if isinstance(given, Path) or (isinstance(given, str) and is_table(given)):
        return read_torque(given, joints)
    if not isinstance(given, str):
        raise CableError(
            f"task must be a name, the path of a table or a Task, not {given!r}."
        )
    name, colon, _ = given.partition(":")
    if colon and name not in TASKS:
        made: Task = user_object("task", given, TASKS, Task, UserTask)
        return made
    return with_numbers("task", given, TASKS)
