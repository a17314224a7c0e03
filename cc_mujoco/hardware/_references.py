"""Torque that the joint should get: constant, a course in time, or by its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import tables
from cc_mujoco._utils.units import CLOCK, TORQUE, Kind
from cc_mujoco._validation import MAX_DURATION, require_number
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._packet import Readings
from cc_mujoco.human import TRAJECTORIES, Task, task

Array = NDArray[np.float64]


class Desired(Protocol):
    """Torque at the joint, by time and motion."""

    def torque(self, time: float, seen: Readings) -> float:
        """Return the torque [N m] at a time since the loop began [s]."""


@dataclass(frozen=True)
class TorqueTable:
    """A course in time, linear between its points and held after the last."""

    times: Array
    torques: Array

    def torque(self, time: float, seen: Readings) -> float:
        return float(np.interp(time, self.times, self.torques))

    def require_within(self, drive: Drive, limits: Limits) -> None:
        """Find out, before a rig is touched, whether the motor can give these torques.

        Args:
            drive: Drive of the rig, with the torques that the motor may give.
            limits: Limits that are enforced.

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
        at = time if self.task.of_time else 0.0
        return float(self.task.torque(seen.joint_angle, seen.joint_velocity, at))

    @classmethod
    def named(cls, name: str) -> Virtual:
        """Return the virtual environment of a name.

        One that follows a gait, which no rig measures, or an angle, which no rig is
        given, is refused.
        """
        found = task(name)
        if found.about_reference or found.commands_angle:
            raise CableError(
                f"task {name!r} follows an angle over time, and a rig follows torques; "
                "take `spring` or `tunnel`, or give a course of torque as `csv`."
            )
        if found.follows_gait:
            raise CableError(
                f"task {name!r} follows the phase of a gait, which the rig does not "
                "measure; give its course as `csv`."
            )
        return cls(found)


def constant_course(torque: float) -> TorqueTable:
    return TorqueTable(np.zeros(1), np.array([torque]))


def course_from_trajectory(name: str, amplitude: float, duration: float) -> TorqueTable:
    """Return a trajectory of `cc-mujoco play` as a course of torque.

    `amplitude` is the torque where the trajectory has its own [N m], `duration` that of
    the run [s].
    """
    found = look_up("trajectory", name, TRAJECTORIES)
    require_number("duration", duration, 0.01, MAX_DURATION, "s")
    motion = found.sample(duration, 0.002, np.random.default_rng(0))
    return TorqueTable(motion.time, amplitude / found.amplitude * motion.angle)


def course_from_csv(path: Path) -> TorqueTable:
    times, torques = read_columns(path, {"time_s": CLOCK, "torque_nm": TORQUE})
    return TorqueTable(times, torques)


def read_columns(path: Path, columns: Mapping[str, Kind]) -> tuple[Array, ...]:
    """Read the named columns of a table (n,) each.

    `columns` are their names and what they measure; the first is time and must rise.
    """
    names = tables.column_names(path)
    found = [
        tables.quantity_column(path, names, name, measured)
        for name, measured in columns.items()
    ]
    read = tables.read_course(path, found)
    if not read[0].size:
        raise CableError(f"{path} has no row of data below its header.")
    return read
