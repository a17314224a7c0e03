"""Desired joint torque of a run: a table in time, a virtual environment, a servo.

    axis = DrivenAxis(rig, drive, Servo(drive, times, angles), limits, dog)

A servo tracks angles of the motor. Its output is the joint torque that corresponds to
the motor torque without friction, from which the controller `none` computes the motor
torque. A trial thus has the limits, the watchdog and the log of every other run.
"""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

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
from cc_mujoco.native import FloatArray as Array


class Desired(Protocol):
    """Desired torque at the joint, as a function of time and readings."""

    def torque(self, time: float, seen: Readings) -> float:
        """Return the torque [N m] for a time since the loop began [s]."""


@dataclass(frozen=True)
class TorqueTable:
    """Joint torque [N m] over time [s], linear between points, then constant."""

    times: Array
    torques: Array

    def torque(self, time: float, seen: Readings) -> float:
        return float(np.interp(time, self.times, self.torques))

    def require_within(self, drive: Drive, limits: Limits) -> None:
        """Refuse torques beyond the motor's, without friction, or beyond a limit."""
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
    """Torque of a virtual environment that the joint moves in, see `human.Task`."""

    task: Task

    def torque(self, time: float, seen: Readings) -> float:
        at = time if self.task.of_time else 0.0
        return float(self.task.torque(seen.joint_angle, seen.joint_velocity, at))

    @classmethod
    def named(cls, name: str) -> "Virtual":
        """Return a named virtual environment; refuse a gait or commanded angle."""
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
    """Return a trajectory as torques with a peak of `amplitude` [N m]."""
    found = look_up("trajectory", name, TRAJECTORIES)
    require_number("duration", duration, 0.01, MAX_DURATION, "s")
    motion = found.sample(duration, 0.002, np.random.default_rng(0))
    return TorqueTable(motion.time, amplitude / found.amplitude * motion.angle)


def course_from_csv(path: Path) -> TorqueTable:
    times, torques = read_columns(path, {"time_s": CLOCK, "torque_nm": TORQUE})
    return TorqueTable(times, torques)


def read_columns(path: Path, columns: Mapping[str, Kind]) -> tuple[Array, ...]:
    """Return the named columns of a table, (n,) each; the first must be rising time."""
    names = tables.column_names(path)
    found = [tables.quantity_column(path, names, *each) for each in columns.items()]
    read = tables.read_course(path, found)
    if not read[0].size:
        raise CableError(f"{path} has no row of data below its header.")
    return read


APPROACH_TIME = 1.0  # motion to the first angle of a table [s]


@dataclass(frozen=True)
class Stiffness:
    """Gains with which a servo holds a motor on its angles."""

    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]
    integral: float  # rate of the torque per error [N m/(rad s)]

    def __post_init__(self) -> None:
        require_parameter(self, "stiffness", 1e-9, 1e9, "N m/rad")
        require_parameter(self, "damping", 0.0, 1e9, "N m s/rad")
        require_parameter(self, "integral", 0.0, 1e12, "N m/(rad s)")

    @classmethod
    def of(cls, drive: Drive) -> "Stiffness":
        """Return the highest gains for the motor's inertia and the period.

        A measurement is a period old, a torque acts for another, and a motor may lag.
        With t the period plus that lag, damping is a quarter of inertia / t, stiffness
        is damping / (6 t), and integral is stiffness / (25 t).
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
    """Servo that keeps the motor on a table of angles; see `Desired`."""

    def __init__(
        self, drive: Drive, times: Array, angles: Array, firm: Stiffness | None = None
    ) -> None:
        """Take motor `angles` (n,) [rad] at `times` (n,) from 0 [s].

        The gains are `firm`, by default `Stiffness.of` the drive.
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
        """Return the motor's desired angle [rad] and speed [rad/s] at a time [s].

        `begin` is its angle at time 0 [rad], from which a half cosine leads to the
        first angle of the table in `APPROACH_TIME`.
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
    """Planned trial: motor angles to play, expected joint angles, name of the log."""

    path: Path
    name: str  # name that its log gets, and that `dataset.toml` knows
    notes: str  # instructions before it is played
    times: Array  # (n,) from 0 [s]
    motor: Array  # angle of the motor to be played (n,) [rad]
    joint: Array  # angle of the joint that is expected (n,) [rad]

    @property
    def duration(self) -> float:
        """Duration of the run, including the approach to the first angle [s]."""
        return APPROACH_TIME + float(self.times[-1])

    def servo(self, drive: Drive, firm: Stiffness | None = None) -> Servo:
        return Servo(drive, self.times, self.motor, firm)

    def require_within(self, limits: Limits, drive: Drive) -> None:
        """Refuse a trial that would exceed the rig's limits; call before connecting.

        In a plan a joint angle is positive in the direction in which the cable pulls.
        On the rig it has the sign of the scene.
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
    """Return the trials in a folder that `cc-mujoco diagnose --plan` wrote."""
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
    """Copy the entries of a planned trial to the `dataset.toml` next to its log.

    That file lists only recorded trials, as readers refuse entries without a log.
    Existing entries are kept. Logs have the commanded torque, a part of which
    accelerates the rotor; its `inertia` at the pulley [kg m^2] is written too, unless
    it is 0 (unknown).
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
