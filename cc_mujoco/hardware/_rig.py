"""Rigs as the loop uses them: over packets, or as a motor drive with joint sensors.

A packet rig is behind UDP or another link. A motor drive has its maker's protocol.
None of the drives was tried on hardware: tests use simulated peers, written from the
documents that the modules name.
"""

import contextlib
import math
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

from cc_mujoco.errors import CableError
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._packet import Command, Readings, Status

Item = TypeVar("Item")

MAX_PENDING, END_PACKETS = 200, 10
"""Largest number of packets or frames read in a cycle; number of packets sent to say
that the run is over, of which some may be lost."""


@runtime_checkable
class Rig(Protocol):
    """Interface that drives a motor and reads its sensors.

    A class of your own needs these three methods. It is made by `module:Class` with the
    other keys of `[rig]` as keywords. No method may block for long: the loop waits for
    it. It may have `ignored`, a `Counter` of the unused data received, by reason, and
    `where`, the address of the rig.
    """

    def read(self) -> Readings | None:
        """Return the newest reading, or None if none came since the last call."""

    def write(self, torque: float) -> None:
        """Command a torque of the motor [N m]."""

    def close(self) -> None:
        """Remove the torque of the motor and disconnect."""


class Connection(Protocol):
    """Connection to the other end, whose methods never wait.

    They raise `OSError` if a transfer failed and the next may succeed, and `CableError`
    if the connection is lost for good.
    """

    ignored: Counter[str]
    """Packets that were received and not used, or not sent, by reason."""
    where: str  # the address of the other end

    def close(self) -> None:
        """Disconnect from the rig; a second call does nothing."""


class Link(Connection, Protocol):
    """Connection that carries packets."""

    def receive(self) -> bytes | None: ...

    def send(self, data: bytes) -> None: ...


def end_safely(
    stop: Callable[[], None], interval: float, *close: Callable[[], None]
) -> None:
    """Try to stop a motor `END_PACKETS` times, then close, ignoring all errors.

    `stop` removes the torque; `interval` is the time after each try [s].
    """

    def try_stop() -> None:
        with contextlib.suppress(OSError, CableError):
            stop()
        time.sleep(interval)

    with contextlib.ExitStack() as ending:  # goes on after any error
        for each in (*reversed(close), *[try_stop] * END_PACKETS):
            ending.callback(each)


def pending(receive: Callable[[], Item | None]) -> Iterator[Item]:
    """Yield what `receive` returns until None, at most `MAX_PENDING` items.

    A sender without a pause thus cannot block the loop.
    """
    for _ in range(MAX_PENDING):
        if (found := receive()) is None:
            return
        yield found


class PacketRig:
    """Rig on a link: it checks received packets and sends commands.

    It sends zero torque without the enable bit until it has received a reading.
    """

    def __init__(self, link: Link) -> None:
        self.ignored = link.ignored
        """Unused packets by reason: corrupt, repeated, reordered, overtaken, stamp
        stands still, unreachable, unsent."""
        self.where = link.where  # the address at which it is looked for
        self._link = link
        self._sequence = 0
        self._last: packet.Packet | None = None
        self._closed = False

    def read(self) -> Readings | None:
        """Return the newest valid reading received since the last call; see `Rig`."""
        newest = None
        for data in pending(self._receive):
            found = packet.read_reading(data)
            if found is None:
                self.ignored["corrupt"] += 1
                continue
            last = self._last
            if last is not None and not packet.is_newer(found.sequence, last.sequence):
                same = found.sequence == last.sequence
                self.ignored["repeated" if same else "reordered"] += 1
                continue
            # An older time is a step of the clock, and is looked at.
            if last is not None and 0 <= last.stamp - found.stamp < 1_000_000_000:
                self.ignored["stamp stands still"] += 1
                continue
            self.ignored["overtaken"] += newest is not None
            self._last, newest = found, found.readings
        return newest

    def write(self, torque: float) -> None:
        """Send a torque, enabled once a reading was received; see `Rig`."""
        self._send(torque, Status.ENABLED if self._last else Status.NONE)

    def close(self) -> None:
        """Send the end of the run several times, then close; see `Rig`."""
        if self._closed:
            return
        self._closed = True
        end_safely(lambda: self._send(0.0, Status.STOPPED), 1e-3, self._link.close)

    def _receive(self) -> bytes | None:
        try:
            return self._link.receive()
        except OSError:
            self.ignored["unreachable"] += 1
            return None

    def _send(self, torque: float, status: Status) -> None:
        self._sequence += 1
        echo = 0 if self._last is None else self._last.stamp
        command = Command(self._sequence, echo, torque, status)
        try:
            self._link.send(packet.pack_command(command))
        except OSError:
            # As good as lost on the way; readings stop, too, and that is watched.
            self.ignored["unsent"] += 1


class _UdpLink:
    """Link that carries one packet per datagram, from its peer only."""

    def __init__(self, host: str, port: int) -> None:
        self.ignored: Counter[str] = Counter()
        self.where = f"{host}:{port}"
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
            family, _, _, _, address = found[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            self._socket.connect(address)
        except OSError as error:
            raise CableError(
                f"cannot reach the rig at {host}:{port}: {error.strerror}; `address` "
                "must be HOST:PORT of a machine that is there."
            ) from None

    def receive(self) -> bytes | None:
        """Return the next packet; raise if the system reports that nobody listens."""
        try:
            return self._socket.recv(1024)
        except (BlockingIOError, InterruptedError):
            return None

    def send(self, data: bytes) -> None:
        self._socket.send(data)

    def close(self) -> None:
        self._socket.close()


class UdpRig(PacketRig):
    """Rig behind UDP, which answers the sender of its last command."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(_UdpLink(host, port))


TURN = 2.0 * math.pi  # a turn, in which drives measure angles [rad]
Now = Callable[[], float]  # clock of the host [s]


class MotorState(NamedTuple):
    """Reading of a drive, at its own shaft."""

    time: float  # time at which the host received it [s]
    angle: float  # [rad]
    velocity: float  # [rad/s]
    status: Status | None  # None while the drive prepares to enable its motor


class MotorDrive(Connection, Protocol):
    """Connection to one motor: it reads the motor's state and commands its torque."""

    def read(self) -> MotorState | None:
        """Return the newest reading, or None if none came since the last call."""

    def write(self, torque: float) -> None:
        """Command a shaft torque [N m]; enable the motor after its first reading."""

    def stop(self) -> None:
        """Command zero torque and disable the motor; called several times."""


class Enabling:
    """Status of a drive's motor, which may be unknown while it is being enabled."""

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
    """Drive at the motor, combined with another rig's sensors at the joint.

    A reading is complete when both ends have new data. The joint's rig gets commands of
    zero torque, because one behind UDP answers only the sender of a command.
    """

    def __init__(self, drive: MotorDrive, joint: Rig, gear: float, zero: float) -> None:
        """Combine a drive, with gear and zero [rad], and the rig at the joint."""
        self._drive, self._joint = drive, joint
        self._gear, self._zero = gear, zero
        self._motor: MotorState | None = None
        self._seen: Readings | None = None
        self._closed = False
        self.where = drive.where

    @property
    def ignored(self) -> Counter[str]:
        """Number of unused packets of both, by reason; see `Rig`."""
        others = Counter(getattr(self._joint, "ignored", ()))
        named = {f"at the joint: {why}": count for why, count in others.items()}
        return self._drive.ignored + Counter(named)

    def read(self) -> Readings | None:
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
        angle = motor.angle / self._gear + self._zero
        speed = motor.velocity / self._gear
        return Readings(motor.time, angle, speed, *joint[3:6], status)

    def write(self, torque: float) -> None:
        try:
            self._drive.write(torque / self._gear)
        except OSError:
            self._drive.ignored["unsent"] += 1
        self._joint.write(0.0)

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        end_safely(self._drive.stop, 2e-3, self._drive.close, self._joint.close)
