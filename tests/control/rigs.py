"""Rigs by other equations than the package's, whose cables are not as believed.

The cables are one spring with friction after Dahl at its ends, without segments; what
the controller believes is another spring, other friction and another radius.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cc_mujoco.cable import Cable, Section
from cc_mujoco.device import TENSION_COLUMN, CableDrive, Drive, Sensors
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.native import FloatArray

_LENGTH = 1.0
_SWING, _ANGULAR = 0.3, 2.0 * math.pi * 0.9
"""Amplitude [rad] and angular frequency [rad/s] of the joint."""
_SUBSTEPS = 10
_PRESLIDING = 0.01
"""Angle at the joint over which friction builds up [rad]."""
_COUNTS = 16384
"""Counts of an encoder in a turn."""


@dataclasses.dataclass(frozen=True)
class Believed:
    """Drive as its data sheet has it; joint angles, both cables of a pair together."""

    ratio: float
    stiffness: float
    rest: float
    friction: float
    inertia: float
    high: float
    safe: float
    noise: float
    soft: float = 0.0
    """Compliance of a cable's ends at no torque [rad/(N m)], besides `stiffness`."""
    hardening: float = 0.0
    """Hardening of these ends, by the torque of a cable [1/(N m)]."""

    @property
    def pair(self) -> bool:
        """Return whether cables pull both ways."""
        return self.ratio > 0.0

    def drive(self) -> Drive:
        """Return it as controllers have it."""
        arm = 0.05
        count = 2 if self.pair else 1
        cable = Cable(
            friction=0.1,
            static_friction=0.15,
            pretension=self.rest / count / arm,
            axial_stiffness=self.stiffness / count / arm**2 * _LENGTH,
            conduit=(Section(_LENGTH, _LENGTH * 0.1 / self.friction),),
            end_compliance=self.soft * arm**2,
            end_hardening=self.hardening * arm,
        )
        proximal = arm / self.ratio
        row = [CableDrive(cable, -proximal, -arm)]
        if self.pair:
            row.append(CableDrive(cable, proximal, arm))
        else:
            row = [CableDrive(cable, -abs(proximal), arm)]
        nodes = Sensors((0, cable.segments // 2, cable.segments), (0.1,) * 3)
        return Drive(
            self.ratio,
            -self.high if self.pair else 0.0,
            self.high,
            0.001,
            one_way=not self.pair,
            cables=tuple(row),
            sensors=(nodes,) * len(row),
            inertia=self.inertia,
            delay=1,
            torque_noise=self.noise,
            safe_torque=self.safe,
        )


def _spring(believed: Believed, stiffness: float) -> Callable[[float], float]:
    """Return the torque of a cable by its stretch from rest [rad].

    Without its ends it has a stiffness [N m/rad].
    """
    rest = believed.rest / (2 if believed.pair else 1)
    if not believed.soft:
        return lambda stretch: max(rest + stiffness * stretch, 0.0)
    torques = 5.0 * believed.safe * np.linspace(0.0, 1.0, 9000)
    ends = believed.soft * np.log1p(believed.hardening * torques) / believed.hardening
    stretches = torques / stiffness + ends
    start = float(np.interp(rest, torques, stretches))
    return lambda stretch: float(np.interp(start + stretch, stretches, torques))


HANDLE = Believed(5.2, 41.0, 2.0, 0.75, 7e-5, 1.0, 8.0, 0.01)
"""Two cables of a light motor, as at a wrist."""
ANKLE = Believed(-4.8, 420.0, 0.7, 0.45, 5.65e-3, 50.0, 60.0, 0.3)
"""One cable of a heavy motor, as at an ankle."""
SUIT = Believed(-4.0, 350.0, 0.6, 0.2, 5e-3, 30.0, 60.0, 0.3, 3e-2, 0.1)
"""One cable held by straps and flesh, five times as soft slack as taut."""
KNEE = Believed(5.0 / 3.0, 167.0, 2.0, 0.2, 1e-3, 3.0, 2.0, 0.0)
"""Two stiff cables of little friction, whose motor swings on them at 20 Hz."""


@dataclasses.dataclass(frozen=True)
class Truth:
    """True parameters of a rig, over those that are believed."""

    stiffness: float = 1.0
    friction: float = 1.0
    radius: float = 1.0
    """Radius at the joint."""
    motor_friction: float = 0.0
    """Dry friction of the motor, as a share of the torque that makes the safe one."""


Fault = Callable[[dict[str, Any], dict[str, Any]], None]
"""Function that changes the readings, given those at the onset of the fault."""


def _set(column: str, value: Callable[[float, float], float]) -> Fault:
    def change(seen: dict[str, Any], held: dict[str, Any]) -> None:
        seen[column] = value(seen[column], held[column])

    return change


def _frozen(side: str) -> Fault:
    def change(seen: dict[str, Any], held: dict[str, Any]) -> None:
        seen[f"{side}_angle_rad"] = held[f"{side}_angle_rad"]
        seen[f"{side}_velocity_rad_s"] = 0.0

    return change


FAULTS: dict[str, Fault] = {
    "dead": _set("joint_torque_nm", lambda now, held: 0.0),
    "frozen": _set("joint_torque_nm", lambda now, held: held),
    "halved": _set("joint_torque_nm", lambda now, held: 0.5 * now),
    "reversed": _set("joint_torque_nm", lambda now, held: -now),
    "slipped": _set("motor_angle_rad", lambda now, held: now + 0.1),
    "motor-frozen": _frozen("motor"),
    "joint-frozen": _frozen("joint"),
}


@dataclasses.dataclass
class Ride:
    """Course of an episode (steps,)."""

    torque: FloatArray
    desired: FloatArray
    state: FloatArray
    """State of the guard."""


def ride(
    believed: Believed,
    truth: Truth,
    law: Any,
    state: Callable[[Any], float],
    fault: str = "",
    onset: float = 1.2,
    duration: float = 4.0,
    share: float = 0.5,
    seed: int = 0,
    steady: bool = False,
) -> Ride:
    """Drive a rig whose joint is moved by its wearer.

    Args:
        believed: What the controller believes.
        truth: What is true, over that.
        law: The controller.
        state: Function that returns the state of its guard.
        fault: One of `FAULTS`, or none.
        onset: Time at which it begins [s].
        duration: Of the episode [s].
        share: Greatest desired torque over the safe one.
        seed: Of the noise.
        steady: Whether the desired torque stays the same.
    """
    random = np.random.default_rng(seed)
    ratio, safe = believed.ratio, believed.safe
    sense = math.copysign(1.0, ratio)
    ends = [1.0, -1.0] if believed.pair else [sense]
    tension = _spring(believed, believed.stiffness * truth.stiffness / len(ends))
    half = 0.5 * believed.friction * truth.friction
    step = 0.001 / _SUBSTEPS
    count = round(duration / 0.001)
    torque, desired, states = (np.zeros(count) for _ in range(3))
    motor = speed = before = 0.0
    slip = [0.0, 0.0]  # of the end at the motor and of that at the joint
    rub = truth.motor_friction * safe / abs(ratio)
    held: dict[str, Any] = {}
    late: dict[str, Any] = {}
    command = 0.0
    for n in range(count):
        time = 0.001 * n
        wanted = share * safe
        if not steady:
            wanted *= math.sin(2.0 * math.pi * 1.1 * time)
        if not believed.pair:
            wanted = sense * max(sense * wanted, 0.0)
        for k in range(_SUBSTEPS):
            at = time + k * step
            joint = _SWING * math.sin(_ANGULAR * at)
            stretch = motor / ratio - truth.radius * joint
            pulls = [tension(end * stretch) for end in ends]
            at_joint = sum(
                end * pull * math.exp(-end * slip[1] * half)
                for end, pull in zip(ends, pulls, strict=True)
            )
            at_motor = sum(
                end * pull * math.exp(end * slip[0] * half)
                for end, pull in zip(ends, pulls, strict=True)
            )
            drag = rub * math.tanh(speed / 0.2) + 1e-3 * believed.inertia * speed
            speed += step * (command - at_motor / ratio - drag) / believed.inertia
            motor += step * speed
            moves = step * speed / ratio, truth.radius * (joint - before)
            before = joint
            for end, moved in enumerate(moves):
                rest = 1.0 - slip[end] * math.copysign(1.0, moved)
                slip[end] += moved / _PRESLIDING * rest
                slip[end] = min(max(slip[end], -1.0), 1.0)
        torque[n], desired[n] = truth.radius * at_joint, wanted
        turn = 2.0 * math.pi / _COUNTS
        seen: dict[str, Any] = dict.fromkeys(MEASURED_COLUMNS, 0.0) | {
            "motor_angle_rad": turn * round(motor / turn),
            "motor_velocity_rad_s": speed,
            "joint_angle_rad": turn * round(joint / turn),
            "joint_velocity_rad_s": _SWING * _ANGULAR * math.cos(_ANGULAR * time),
            "joint_torque_nm": torque[n] + random.normal(0.0, believed.noise),
            "desired_torque_nm": wanted,
        }
        now, late = late or seen, seen
        now = dict(now)
        if fault and time >= onset:
            held = held or dict(now)
            FAULTS[fault](now, held)
        now[TENSION_COLUMN] = np.full((len(ends), 3), 12.0)
        command = float(law.torque(now))
        command = min(max(command, law.drive.low), law.drive.high)
        states[n] = state(law)
    return Ride(torque, desired, states)
