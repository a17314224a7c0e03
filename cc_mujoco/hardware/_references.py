"""Torque that the joint should get: constant, a course in time, or by its motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.csv_files import read_sheet
from cc_mujoco._utils.units import CLOCK, TORQUE, Kind
from cc_mujoco._validation import MAX_DURATION, require_number
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._packet import Readings
from cc_mujoco.human import Task, task, trajectory

Array = NDArray[np.float64]

COURSE_COLUMNS = {"time_s": CLOCK, "torque_nm": TORQUE}
"""Columns of a course in a CSV file."""
_PHASE_TASKS = ("assist", "swing")


class Desired(Protocol):
    """Torque at the joint, by time and motion."""

    def torque(self, time: float, seen: Readings) -> float:
        """Return the torque [N m].

        Args:
            time: Since the loop began [s].
            seen: What is measured.
        """


@dataclass(frozen=True)
class TorqueTable:
    """A course in time, linear between its points and held after the last."""

    times: Array
    torques: Array

    def torque(self, time: float, seen: Readings) -> float:
        """See `Desired`."""
        return float(np.interp(time, self.times, self.torques))

    def require_within(self, drive: Drive, limits: Limits) -> None:
        """Find out, before a rig is touched, whether the motor can give these torques.

        Args:
            drive: Of the rig, with the torques that the motor may give.
            limits: That are kept.

        Raises:
            CableError: It cannot, were there no friction, or the run would be stopped.
        """
        most = float(max(self.torques, key=abs))
        low, high = drive.reach
        if abs(most) > limits.joint_torque:
            raise CableError(
                f"[task] asks for {most:g} N m at the joint, beyond [limits] "
                f"joint_torque = {limits.joint_torque:g} N m."
            )
        if abs(most) > max(-low, high):
            raise CableError(
                f"[task] asks for {most:g} N m at the joint, and [limits] torque = "
                f"{limits.torque:g} N m at the motor gives at most {max(-low, high):g}"
                "; ask for less, or raise the limit."
            )
        if drive.one_way and most and not np.any(self.torques * drive.ratio > 0.0):
            raise CableError(
                f"[task] asks for {most:g} N m at the joint, and one cable only pulls: "
                f"{low + 0.0:g} to {high + 0.0:g} N m."
            )


@dataclass(frozen=True)
class Virtual:
    """A virtual environment that the joint moves in, as in `cc-mujoco play`."""

    task: Task

    def torque(self, time: float, seen: Readings) -> float:
        """See `Desired`."""
        return float(self.task.torque(seen.joint_angle, seen.joint_velocity, 0.0))

    @classmethod
    def named(cls, name: str) -> Virtual:
        """Return the virtual environment of a name.

        Raises:
            CableError: There is none, or it follows a gait, which no rig measures.
        """
        found = task(name)
        if name in _PHASE_TASKS:
            raise CableError(
                f"task {name!r} follows the phase of a gait, which the rig does not "
                "measure; give its course as `csv`."
            )
        return cls(found)


def constant_course(torque: float) -> TorqueTable:
    """Return a course of the same torque [N m] all the time."""
    return TorqueTable(np.zeros(1), np.array([torque]))


def course_from_trajectory(name: str, amplitude: float, duration: float) -> TorqueTable:
    """Return a trajectory of `cc-mujoco play` as a course of torque.

    Args:
        name: Of the trajectory.
        amplitude: Torque where the trajectory has its amplitude [N m].
        duration: Of the run [s].

    Raises:
        CableError: There is no such trajectory.
    """
    found = trajectory(name)
    require_number("duration", duration, 0.01, MAX_DURATION, "s")
    motion = found.sample(duration, 0.002, np.random.default_rng(0))
    return TorqueTable(motion.time, amplitude / found.amplitude * motion.angle)


def course_from_csv(path: Path) -> TorqueTable:
    """Return a course from a file with the columns `time_s` and `torque_nm`.

    Raises:
        CableError: It cannot be read or used; names file, line and column.
    """
    times, torques = read_columns(path, COURSE_COLUMNS)
    return TorqueTable(times, torques)


def read_columns(path: Path, columns: Mapping[str, Kind]) -> tuple[Array, ...]:
    """Read the named columns of a CSV file (n,) each.

    Args:
        path: Of the file, in a form of `csv_files`.
        columns: Their names and what they measure; the first is time and must rise.

    Raises:
        CableError: It cannot be read or used; names file, line and column.
    """
    sheet = read_sheet(path)
    places = [sheet.column(name, measured) for name, measured in columns.items()]
    found = [
        [sheet.number(row, place, -math.inf, math.inf) for place in places]
        for row in sheet.rows
    ]
    if not found:
        raise CableError(f"{path} has no line of data below its header.")
    table = np.array(found).T
    times = table[0]
    if (late := np.flatnonzero(np.diff(times) <= 0.0)).size:
        raise CableError(
            f"{path}, column {places[0].name}: {times[late[0] + 1]:g} s must be after "
            f"the {times[late[0]]:g} s of the line before."
        )
    return tuple(table)
