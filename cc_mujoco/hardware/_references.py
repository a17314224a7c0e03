"""Torque that the joint should get: constant, in time, by its motion, or of a servo.

    loop = Loop(rig, controller("none", drive), Servo(drive, course), ...)

What a servo asks for is the joint's torque without friction that keeps the motor on a
course of angles, and the controller `none` makes the motor's of it. So the limits, the
watchdog and the log of a run are those of every other.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import tables
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.parsing import parse_toml
from cc_mujoco._utils.units import ANGLE, CLOCK, TORQUE, Kind
from cc_mujoco._validation import MAX_DURATION, require_number, require_parameter
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._folders import MOTION_FILE
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
        """Return the virtual environment of a name; refuse one of a gait or angle."""
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
    """Read the named columns of a table (n,) each; the first is time and must rise."""
    names = tables.column_names(path)
    found = [tables.quantity_column(path, names, *each) for each in columns.items()]
    read = tables.read_course(path, found)
    if not read[0].size:
        raise CableError(f"{path} has no row of data below its header.")
    return read


APPROACH_TIME = 1.0
"""Time in which the motor goes from where it is to where its course begins [s]."""


@dataclass(frozen=True)
class Stiffness:
    """Stiffness with which a motor is held on its course."""

    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]
    integral: float
    """Rate at which the torque grows while there is an error [N m/(rad s)]."""

    def __post_init__(self) -> None:
        require_parameter(self, "stiffness", 1e-9, 1e9, "N m/rad")
        require_parameter(self, "damping", 0.0, 1e9, "N m s/rad")
        require_parameter(self, "integral", 0.0, 1e12, "N m/(rad s)")

    @classmethod
    def of(cls, drive: Drive) -> Stiffness:
        """Return the firmest hold of a motor of this inertia at this period.

        What is measured is a period old, a torque lasts for another, and a motor may
        lag. So the damping stays at a quarter of inertia over that time; stiffness and
        integral act in 6 and in 25 of those times.

        Raises:
            CableError: The inertia is not known.
        """
        if not drive.inertia > 0.0:
            raise CableError(
                "to follow a course the motor's inertia must be known; the scene gives "
                "it none."
            )
        late = drive.period + drive.motor_lag
        damping = 0.25 * drive.inertia / late
        stiffness = damping / (6.0 * late)
        return cls(stiffness, damping, stiffness / (25.0 * late))


class Servo:
    """Servo whose torque keeps the motor on its course; see `Desired`."""

    def __init__(
        self, drive: Drive, times: Array, angles: Array, firm: Stiffness | None = None
    ) -> None:
        """Begin a course of motor `angles` at `times` from 0 (n,) [rad, s].

        It is as `firm` as `Stiffness.of` the drive by default.
        """
        self._drive = drive
        self._times, self._angles = times, angles
        self._servo_stiffness = firm or Stiffness.of(drive)
        self._begin: float | None = None
        self._integral, self._last = 0.0, 0.0

    def torque(self, time: float, seen: Readings) -> float:
        firm, drive = self._servo_stiffness, self._drive
        if time == 0.0 or self._begin is None:
            self._begin, self._integral, self._last = seen.motor_angle, 0.0, 0.0
        angle, speed = self.course(time, self._begin)
        error = angle - seen.motor_angle
        self._integral += firm.integral * error * (time - self._last)
        self._integral = min(max(self._integral, drive.low), drive.high)
        self._last = time
        torque = firm.stiffness * error + firm.damping * (speed - seen.motor_velocity)
        return drive.ratio * (torque + self._integral)

    def course(self, time: float, begin: float) -> tuple[float, float]:
        """Return the desired angle [rad] and speed [rad/s] of a motor from `begin`.

        The way to the course's first angle is a cosine.
        """
        if time < APPROACH_TIME:
            turn = math.pi * time / APPROACH_TIME
            half = 0.5 * (float(self._angles[0]) - begin)
            speed = half * math.pi / APPROACH_TIME * math.sin(turn)
            return begin + half * (1.0 - math.cos(turn)), speed
        now, step = time - APPROACH_TIME, self._drive.period
        angle, later = np.interp((now, now + step), self._times, self._angles)
        return float(angle), float(later - angle) / step


@dataclass(frozen=True)
class Planned:
    """Motion to be played on a rig: where its log goes, and both angles over time."""

    path: Path
    name: str  # name that its log gets, and that `dataset.toml` knows
    notes: str  # instructions before it is played
    times: Array  # (n,) from 0 [s]
    motor: Array  # angle of the motor to be played (n,) [rad]
    joint: Array  # angle of the joint that is expected (n,) [rad]

    @property
    def duration(self) -> float:
        """Length of the run, with the way to where the motion begins [s]."""
        return APPROACH_TIME + float(self.times[-1])

    def servo(self, drive: Drive, firm: Stiffness | None = None) -> Servo:
        return Servo(drive, self.times, self.motor, firm)

    def require_within(self, limits: Limits, drive: Drive) -> None:
        """Refuse a motion that would exceed the rig's limits, before connecting.

        In a plan the joint is positive where the cable pulls, at the rig as the scene
        has it.
        """
        low, high = limits.joint_range
        joint = math.copysign(1.0, drive.ratio) * self.joint
        for end in (float(joint.min()), float(joint.max())):
            if not low <= end <= high:
                raise CableError(
                    f"{self.path} takes the joint to {end:.3g} rad, outside its range "
                    f"of {low:g} to {high:g} rad; plan with a smaller --reach."
                )
        fastest = float(np.max(np.abs(np.diff(self.motor) / np.diff(self.times))))
        if fastest > limits.motor_speed:
            raise CableError(
                f"{self.path} turns the motor at {fastest:.3g} rad/s, beyond its limit "
                f"of {limits.motor_speed:g}; plan with a lower --speed."
            )


def read_plan(folder: str | os.PathLike[str]) -> list[Planned]:
    """Return the trials of a folder that `cc-mujoco diagnose --plan` wrote."""
    place = Path(folder)
    toml = place / DATASET_FILE
    paths = sorted(place.glob(MOTION_FILE.format("*")))
    if not paths or not toml.is_file():
        raise CableError(
            f"{folder} holds no plan, which has {MOTION_FILE.format('01')} and "
            f"{DATASET_FILE}; give the folder that `cc-mujoco diagnose --plan` wrote."
        )
    facts = read_dataset_file(toml)
    columns = {"time_s": CLOCK, "motor_angle_rad": ANGLE, "joint_angle_rad": ANGLE}
    found = []
    for path in paths:
        name = path.stem.replace(MOTION_FILE.split("_")[0], "trial")
        times, motor, joint = read_columns(path, columns)
        if times.size < 2:
            raise CableError(f"{path} has one line of data; a motion has two or more.")
        notes = facts.facts_of(Path(f"{name}.csv")).notes
        found.append(Planned(path, name, notes, times - times[0], motor, joint))
    return found


def add_trial_facts(plan: Path, trial: str, out: Path, inertia: float) -> None:
    """Add the facts of a planned trial to the `dataset.toml` next to its log.

    That file has only what was recorded: facts of a trial that is not there are an
    error to whoever reads it. Existing entries are not changed. Logs have the torque
    command of the motor, part of which accelerates its rotor, of `inertia` at its
    pulley [kg m^2]; 0 is not known.
    """
    planned = (plan / DATASET_FILE).read_text(encoding="utf-8")
    head, *tables = re.split(r"(?m)^(?=\[trials\b)", planned)
    if inertia > 0.0 and "rig" not in parse_toml(head):
        head = f"{head.rstrip()}\n\n[rig]\nrotor_inertia = {inertia:g}\n"
    place = out / DATASET_FILE
    content = place.read_text(encoding="utf-8") if place.exists() else head
    if trial in parse_toml(content).get("trials", {}):
        return
    own = [text for text in tables if trial in parse_toml(text)["trials"]]
    with replacing(place) as partial:
        partial.write_text("\n".join([content.rstrip(), "", *own]), encoding="utf-8")
