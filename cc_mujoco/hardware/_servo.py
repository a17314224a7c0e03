"""A motor that follows a course of angles, played by torque.

    loop = Loop(rig, controller("none", drive), Servo(drive, course), ...)

A servo is a `Desired`: what it asks for is the joint's torque without friction, and the
controller `none` makes the motor's of it. So the limits, the watchdog and the log of a
run are those of every other.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.parsing import parse_toml
from cc_mujoco._utils.units import ANGLE, CLOCK
from cc_mujoco._validation import require_parameter
from cc_mujoco.datasets._columns import DATASET_FILE
from cc_mujoco.datasets._dataset_file import read_dataset_file
from cc_mujoco.datasets._folders import MOTION_FILE
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.hardware._limits import Limits
from cc_mujoco.hardware._packet import Readings
from cc_mujoco.hardware._references import Array, read_columns

APPROACH_TIME = 1.0
"""Time in which the motor goes from where it is to where its course begins [s]."""


@dataclass(frozen=True)
class Stiffness:
    """Stiffness with which a motor is held on its course."""

    stiffness: float
    """[N m/rad]"""
    damping: float
    """[N m s/rad]"""
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
        first = float(self._angles[0])
        if time < APPROACH_TIME:
            turn = math.pi * time / APPROACH_TIME
            half = 0.5 * (first - begin)
            return begin + half * (1.0 - math.cos(turn)), (
                half * math.pi / APPROACH_TIME * math.sin(turn)
            )
        now = time - APPROACH_TIME
        step = self._drive.period
        angle, later = np.interp((now, now + step), self._times, self._angles)
        return float(angle), float(later - angle) / step


@dataclass(frozen=True)
class Planned:
    """Motion to be played on a rig: where its log goes, and both angles over time."""

    path: Path
    name: str
    """Name that its log gets, and that `dataset.toml` knows."""
    notes: str
    """Instructions before it is played."""
    times: Array
    """(n,) from 0 [s]."""
    motor: Array
    """Angle of the motor to be played (n,) [rad]."""
    joint: Array
    """Angle of the joint that is expected (n,) [rad]."""

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
    found = []
    for path in paths:
        name = path.stem.replace(MOTION_FILE.split("_")[0], "trial")
        times, motor, joint = read_columns(
            path, {"time_s": CLOCK, "motor_angle_rad": ANGLE, "joint_angle_rad": ANGLE}
        )
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
    head, *tables = re.split(
        r"(?m)^(?=\[trials\b)", (plan / DATASET_FILE).read_text(encoding="utf-8")
    )
    if inertia > 0.0 and "rig" not in parse_toml(head):
        head = f"{head.rstrip()}\n\n[rig]\nrotor_inertia = {inertia:g}\n"
    place = out / DATASET_FILE
    content = place.read_text(encoding="utf-8") if place.exists() else head
    if trial in parse_toml(content).get("trials", {}):
        return
    own = [text for text in tables if trial in parse_toml(text)["trials"]]
    with replacing(place) as partial:
        partial.write_text("\n".join([content.rstrip(), "", *own]), encoding="utf-8")
