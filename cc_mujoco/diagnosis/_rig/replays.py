"""Cache of replays of records; changes of sensors or outer loads need no replay.

Records are replayed independently of each other, each in a thread. The key of a replay
is everything that acts on the cables, so candidates, folds and derivatives share it.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Lock
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.polynomial import Polynomial

from cc_mujoco.cable import Cable, Driven, Transmission
from cc_mujoco.cable._coupled_route import CoupledCables, CoupledPath
from cc_mujoco.datasets._moment_arm import Lever
from cc_mujoco.diagnosis._rig.records import LEAD_SAMPLES, Record
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class Setting(NamedTuple):
    """Everything that a replay of a record depends on.

    Attributes:
        cables: agonist first.
        motor_radius: of the motor's pulley [m].
        joint_radius: of the joint's pulley [m].
        backlash: between joint and its pulley [rad].
        late: delay of the recorded joint angle [s].
        offset: of the joint's angle [rad].
        substeps: simulation steps per sample.
        lever: in place of the joint's pulley, or None.
        courses: of cables that the joint leads, see `Bench.courses`.
        share: of the courses' distal displacements.
        arm: coefficients of the joint's moment arm over the nominal one, 1 + a q + b
            q^2 + ..., or none.
        motor_arm: the same at the motor, where q is the angle by which a cable is wound
            on: that of the motor, and its negative for the antagonist.
    """

    cables: tuple[Cable, ...]
    motor_radius: float
    joint_radius: float
    backlash: float
    late: float
    offset: float
    substeps: int
    lever: Lever | None = None
    courses: tuple[CoupledPath, ...] = ()
    share: float = 1.0
    arm: tuple[float, ...] = ()
    motor_arm: tuple[float, ...] = ()

    def following(self, joint: FloatArray) -> FloatArray:
        """Return the motor angle at which the cables keep their length (samples,)."""
        found: FloatArray = self.joint_radius / self.motor_radius * self.turned(joint)
        return found

    def turned(self, joint: FloatArray) -> FloatArray:
        """Return the pulley angle that takes as much cable as the joint (samples,)."""
        if not self.arm:
            return joint if self.lever is None else self.lever.turned(joint)
        if self.lever is None:
            whole = Polynomial((1.0, *self.arm)).integ()
            found: FloatArray = whole(joint)
            return found
        angles = self.lever.joint
        arm = self.moment_share(angles)
        middle = 0.5 * (arm[1:] + arm[:-1]) * np.diff(angles)
        taken = np.concatenate([[0.0], np.cumsum(middle)])
        found = np.interp(joint, angles, taken - np.interp(0.0, angles, taken))
        return found

    def moment_share(self, joint: FloatArray) -> FloatArray:
        """Return the arm at the joint over the nominal one at 0 (samples,)."""
        own = np.ones(1) if self.lever is None else self.lever.share(joint)
        if self.arm:
            own = own * Polynomial((1.0, *self.arm))(joint)
        return own


class Played(NamedTuple):
    """Signals of a replay, (samples,) each.

    Attributes:
        joint_angle: as it is compared [rad].
        motor: torque into the motor's pulley [N m].
        joint: torque into the joint [N m].
        tension_proximal: of every cable at the motor (cables, samples) [N].
        tension_distal: of every cable at the joint (cables, samples) [N].
    """

    joint_angle: FloatArray
    motor: FloatArray
    joint: FloatArray
    tension_proximal: FloatArray
    tension_distal: FloatArray

    @property
    def proximal(self) -> FloatArray:
        """Pull of the proximal ends, agonist less antagonist [N]."""
        return _agonist_less_antagonist(self.tension_proximal)

    @property
    def distal(self) -> FloatArray:
        """Pull of the distal ends, agonist less antagonist [N]."""
        return _agonist_less_antagonist(self.tension_distal)


def _agonist_less_antagonist(tension: FloatArray) -> FloatArray:
    found: FloatArray = np.array([1.0, -1.0])[: len(tension)] @ tension
    return found


REPLAYS: WeakKeyDictionary[Record, OrderedDict[Setting, Played]] = WeakKeyDictionary()
"""Cached replays, of every record the last `Limit.max_replays`."""
_LOCK = Lock()


def cached_replay(record: Record, setting: Setting) -> Played:
    with _LOCK:
        kept = REPLAYS.setdefault(record, OrderedDict())
        if setting in kept:
            kept.move_to_end(setting)
            return kept[setting]
    found = replay(record, setting)
    with _LOCK:
        kept[setting] = found
        if len(kept) > Limit.max_replays:
            kept.popitem(last=False)
    return found


def replay(record: Record, setting: Setting) -> Played:
    """Replay a record, or return its cached replay."""
    joint = shift_signal(record.joint_angle, setting.late / record.dt) + setting.offset
    if record.unhooked:
        nothing = np.zeros(joint.size)
        slack = np.zeros((len(setting.cables), joint.size))
        return Played(joint - setting.offset, nothing, nothing, slack, slack)
    following: Callable[[FloatArray], FloatArray] = setting.following
    courses = setting.courses
    path = record.path
    if path is not None:
        courses = path.along(joint, setting.cables[0].segments)
        along = (
            -setting.share * courses[0].reach[: path.ramp + 1] / setting.motor_radius
        )
        following = partial(_recorded, along)

    motor, turned = with_lead_in(record.motor_angle, joint, following, setting.substeps)
    if path is not None:  # its courses go by the rows
        turned = np.arange(motor.size) / setting.substeps
    dt = record.dt / setting.substeps
    torques = _replay_cables(setting, courses, dt, motor, turned)
    keep = slice(LEAD_SAMPLES * setting.substeps, None, setting.substeps)
    return Played(
        joint - setting.offset,
        torques.motor_torque[keep].copy(),
        torques.joint_torque[keep].copy(),
        torques.tension_proximal[:, keep].copy(),
        torques.tension_distal[:, keep].copy(),
    )


def _recorded(along: FloatArray, joint: FloatArray) -> FloatArray:
    """Return the motor angle of a lead-in that is known, whatever the joint's."""
    return along


def _replay_cables(
    setting: Setting,
    courses: tuple[CoupledPath, ...],
    dt: float,
    motor: FloatArray,
    joint: FloatArray,
) -> Driven:
    """Replay both angles, of the joint itself, through the cables."""
    proximal, distal = setting.motor_radius, setting.joint_radius
    if courses:
        drive = CoupledCables(setting.cables, courses, proximal, setting.share)
        return drive.replay(dt, motor_angle=motor, joint_angle=joint)
    if setting.motor_arm:
        return _replay_wound(setting, dt, motor, joint)
    pulleys = Transmission(setting.cables, proximal, distal, backlash=setting.backlash)
    if setting.lever is None and not setting.arm:
        return pulleys.replay(dt, motor_angle=motor, joint_angle=joint)
    played = pulleys.replay(dt, motor_angle=motor, joint_angle=setting.turned(joint))
    return replace(
        played, joint_torque=played.joint_torque * setting.moment_share(joint)
    )


def _replay_wound(
    setting: Setting, dt: float, motor: FloatArray, joint: FloatArray
) -> Driven:
    """Replay both angles through cables on a drum whose radius changes.

    Each cable is subject to the angle of a round pulley that winds as much, so it is
    played twice and the part of one cable taken from each. Cables that share play or
    leave an eccentric pulley are refused.
    """
    if setting.backlash or any(c.eccentricity or c.ovality for c in setting.cables):
        raise CableError(
            "a drum whose radius changes cannot be simulated together with play or an "
            "eccentric pulley"
        )
    arm = Polynomial((1.0, *setting.motor_arm))
    pulleys = Transmission(setting.cables, setting.motor_radius, setting.joint_radius)
    signs = (1.0, -1.0)[: len(setting.cables)]
    parts = [
        pulleys.replay(
            dt,
            motor_angle=sign * arm.integ()(sign * motor),
            joint_angle=setting.turned(joint),
        )
        for sign in signs
    ]
    proximal = np.array([p.tension_proximal[k] for k, p in enumerate(parts)])
    distal = np.array([p.tension_distal[k] for k, p in enumerate(parts)])
    levers = np.array([sign * arm(sign * motor) for sign in signs])
    return replace(
        parts[0],
        motor_torque=setting.motor_radius * np.sum(levers * proximal, axis=0),
        joint_torque=setting.joint_radius
        * setting.moment_share(joint)
        * _agonist_less_antagonist(distal),
        tension_proximal=proximal,
        tension_distal=distal,
    )


def with_lead_in(
    motor: FloatArray,
    joint: FloatArray,
    following: Callable[[FloatArray], FloatArray],
    substeps: int,
) -> tuple[FloatArray, FloatArray]:
    """Return both angles after a lead-in, refined to `substeps` per sample.

    It begins at the pose 0, where the cables are in pretension and to which wrap and
    pulleys refer, takes both ends to where the joint is, then the motor to its place.
    The angles are (samples,) [rad]; `following` is the motor angle at which the cables
    keep their length, by that of the joint.
    """
    there = np.linspace(0.0, 1.0, Limit.ramp_samples + 1) * joint[0]
    along = following(there)
    settling = np.linspace(along[-1], motor[0], Limit.ramp_samples + 1)[:-1]
    led_motor = np.concatenate([along[:-1], settling, motor])
    led_joint = np.concatenate(
        [there[:-1], np.full(Limit.ramp_samples, joint[0]), joint]
    )
    if substeps == 1:
        return led_motor, led_joint
    size = led_motor.size
    x = np.arange(size * substeps - substeps + 1) / substeps
    old = np.arange(size)
    return np.interp(x, old, led_motor), np.interp(x, old, led_joint)


def shift_signal(signal: FloatArray, samples: float) -> FloatArray:
    """Return the signal advanced by `samples`, with linear interpolation (samples,)."""
    if samples == 0.0:
        return signal
    x = np.arange(signal.size)
    found: FloatArray = np.interp(x + samples, x, signal)
    return found
