"""A rig of a motor drive that speaks its maker's protocol, and sensors at the joint.

None of the drives was tried on hardware: the tests have simulated peers, written from
the documents that the modules name.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple, Protocol

from cc_mujoco.hardware._packet import Readings, Status
from cc_mujoco.hardware._rig import Connection, Rig, end_safely

TURN = 2.0 * math.pi
"""A turn, in which drives measure angles [rad]."""
Now = Callable[[], float]
"""Clock of the host [s]."""


class MotorState(NamedTuple):
    """Reading of a drive, at its own shaft."""

    time: float
    """Time at which the host received it [s]."""
    angle: float
    """[rad]"""
    velocity: float
    """[rad/s]"""
    status: Status | None
    """None while the drive prepares to enable its motor."""


class MotorDrive(Connection, Protocol):
    """Connection to one motor: it reads the motor's state and commands its torque."""

    def read(self) -> MotorState | None:
        """Return the newest reading, or None if none came since the last call."""

    def write(self, torque: float) -> None:
        """Command a shaft torque [N m]; enable the motor after its first reading."""

    def stop(self) -> None:
        """Command zero torque and disable the motor; sent several times."""


class Enabling:
    """Status of a drive between the request to enable its motor and its answer."""

    def __init__(self, now: Now) -> None:
        self._now = now
        self._since: float | None = None
        self._enabled = False

    def request(self) -> None:
        if self._since is None:
            self._since = self._now()

    def status(self, enabled: bool) -> Status | None:
        if enabled:
            self._enabled = True
            return Status.ENABLED
        waits = self._since is not None and not self._enabled
        # A drive takes at most 1 s to enable its motor; its status is unknown.
        if waits and self._now() - (self._since or 0.0) < 1.0:
            return None
        return Status.NONE


class DriveRig:
    """A drive at the motor, with another rig's sensors at the joint.

    A reading is complete when both were read since the last one. The other rig gets
    commands of zero torque, since one behind UDP sends to whom it has heard.
    """

    def __init__(self, drive: MotorDrive, joint: Rig, gear: float, zero: float) -> None:
        """Take both; nothing is sent yet."""
        self._drive, self._joint = drive, joint
        self._gear, self._zero = gear, zero
        self._motor: MotorState | None = None
        self._seen: Readings | None = None
        self._closed = False
        self.where = drive.where

    @property
    def ignored(self) -> Counter[str]:
        """Packets that were not used, by why; see `Rig`."""
        others = Counter(getattr(self._joint, "ignored", ()))
        named = {f"at the joint: {why}": count for why, count in others.items()}
        return self._drive.ignored + Counter(named)

    def read(self) -> Readings | None:
        """Return a reading of motor and joint; see `Rig`.

        Raises:
            CableError: One of them carries nothing any more.
        """
        try:
            self._motor = self._drive.read() or self._motor
        except OSError:
            self._drive.ignored["unreachable"] += 1
        self._seen = self._joint.read() or self._seen
        motor, joint = self._motor, self._seen
        if motor is None or joint is None:
            return None
        self._motor = self._seen = None
        status = motor.status
        amiss = (joint.status or Status.NONE) & (Status.FAULT | Status.STOPPED)
        if amiss:
            status = amiss | (status or Status.NONE)
        return Readings(
            motor.time,
            motor.angle / self._gear + self._zero,
            motor.velocity / self._gear,
            *joint[3:6],
            status,
        )

    def write(self, torque: float) -> None:
        """Command a torque of the motor [N m]; see `Rig`.

        Raises:
            CableError: One of them carries nothing any more.
        """
        try:
            self._drive.write(torque / self._gear)
        except OSError:
            self._drive.ignored["unsent"] += 1
        self._joint.write(0.0)

    def close(self) -> None:
        """Disable the motor, for good; see `Rig`."""
        if self._closed:
            return
        self._closed = True
        end_safely(self._drive.stop, 2e-3, self._drive.close, self._joint.close)
