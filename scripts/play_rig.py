"""Play a rig in real time, in a process of its own, for `cc-mujoco run`.

    python scripts/play_rig.py --port 5005 --effect viscous_friction --amount 200
    python scripts/play_rig.py --rig rig.toml

It is at a port of this machine, or at the address in a `rig.toml`, on CAN as well. The
bench of `scripts/diagnosis_study/driven.py`. It answers with a reading every `--period`
(500 Hz unless given), and has the watchdog that the packet demands of a rig: no command
for 50 ms, no torque.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import signal
import socket
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Protocol

sys.path.insert(0, str(Path(__file__).resolve().parent / "diagnosis_study"))

from driven import Bench, Instruments

from cc_mujoco.errors import CableError
from cc_mujoco.hardware import CanAddress, CanLink, Status, read_settings
from cc_mujoco.hardware import _packet as packet
from rig import make_rig
from rig.makes import MAKES

PERIOD = 0.002
"""Time between two readings, by default [s]."""
SILENCE = 0.05
"""Time without a command after which there is no torque [s]."""


Sender = tuple[str, int]
"""Sender of a packet; on CAN, where nobody has an address, the bus."""


class End(Protocol):
    """The rig's end of a link; nothing of it waits."""

    name: str

    def receive(self) -> tuple[bytes, Sender] | None:
        """Return the next packet and its sender, None if there is none."""

    def send(self, data: bytes, to: Sender) -> None:
        """Send a packet; it may be lost."""

    def close(self) -> None:
        """Leave."""


class UdpEnd:
    """A port of this machine."""

    def __init__(self, host: str, port: int) -> None:
        self.name = f"{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise CableError(
                f"--port: {self.name} cannot be used ({error}); is a rig there already?"
            ) from error
        self._socket.setblocking(False)

    def receive(self) -> tuple[bytes, Sender] | None:
        """See `End`."""
        try:
            return self._socket.recvfrom(1024)
        except OSError:
            return None

    def send(self, data: bytes, to: Sender) -> None:
        """See `End`."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, to)

    def close(self) -> None:
        """See `End`."""
        self._socket.close()


class CanEnd:
    """The other end of the address that a host has."""

    def __init__(self, address: CanAddress) -> None:
        self.name = f"can:{address.channel}"
        self._link = CanLink(address.other_end())

    def receive(self) -> tuple[bytes, Sender] | None:
        """See `End`."""
        try:
            data = self._link.receive()
        except (OSError, CableError):  # of the bus, which may come back
            return None
        return None if data is None else (data, (self.name, 0))

    def send(self, data: bytes, to: Sender) -> None:
        """See `End`."""
        with contextlib.suppress(OSError, CableError):
            self._link.send(data)

    def close(self) -> None:
        """See `End`."""
        self._link.close()


class Host:
    """Host that the rig obeys: its duties as to watchdog, sequence and enabling."""

    def __init__(self) -> None:
        self.address: Sender | None = None
        """Address to which readings go."""
        self.enabled = False
        self.torque = 0.0
        self._sequence: int | None = None
        self._heard = -math.inf

    def take(self, data: bytes, sender: Sender, now: float) -> None:
        """Take a packet; a new host begins with a command that is not enabled."""
        command = packet.read_command(data)
        if command is None:
            return
        begins = self._sequence is None
        if begins and command.status != Status.NONE:
            return
        if not begins and not packet.is_newer(command.sequence, self._sequence):
            return
        self._sequence, self._heard, self.address = command.sequence, now, sender
        self.enabled = bool(command.status & Status.ENABLED)
        self.torque = command.torque if self.enabled else 0.0
        if command.status & Status.STOPPED:
            self._let_go()
            self.address = None

    def watch(self, now: float) -> None:
        """Take the torque away from a host that is silent."""
        if now - self._heard > SILENCE:
            self._let_go()

    def _let_go(self) -> None:
        self.enabled, self.torque, self._sequence = False, 0.0, None


def serve(end: End, bench: Bench, seed: int, swing: float, swing_period: float) -> None:
    """Play until the process is terminated."""
    period = bench.period
    instruments, host = Instruments(seed, period), Host()
    pace = 2.0 * math.pi / swing_period
    count, late = 0, 0
    begin = time.perf_counter()
    while True:
        deadline = begin + count * period
        while (now := time.perf_counter()) < deadline:
            time.sleep(max(deadline - now - 1e-4, 0.0))
        late += now > deadline + period
        had = host.address
        while (found := end.receive()) is not None:
            host.take(*found, now)
        if had is not None and host.address is None:
            print(f"told to stop; {late} of {count} periods late", flush=True)
        host.watch(now)
        time_ = count * period
        size = swing * min(1.0, time_)
        along = pace * time_
        bench.advance(
            host.torque, size * math.sin(along), size * pace * math.cos(along)
        )
        count += 1
        status = Status.ENABLED if host.enabled else Status.NONE
        seen = instruments.readings(bench.state, bench.joint_torque, status)
        if host.address is not None:
            stamp = round(count * period * 1e9)
            end.send(packet.pack_reading(count, stamp, seen), host.address)


def end_of(rig: Path | None, port: int) -> End:
    """Return this end of a link.

    Args:
        rig: A `rig.toml` with the address, or None.
        port: Of this machine if there is none.

    Raises:
        CableError: The file cannot be read, or names no such place.
    """
    if rig is None:
        return UdpEnd("127.0.0.1", port)
    address = read_settings(rig).address()
    if address is None:
        raise CableError(f"{rig} names a class of its own, which this cannot play.")
    if isinstance(address, CanAddress):
        return CanEnd(address)
    return UdpEnd(address.host, address.port)


def _ended(number: int, _: FrameType | None) -> None:
    raise SystemExit(0)


def main() -> None:
    """Play the rig of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=5005)
    parser.add_argument(
        "--rig", type=Path, help="rig.toml of the host, for its address"
    )
    parser.add_argument("--effect", choices=sorted(MAKES["guides"].effects))
    parser.add_argument("--amount", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--swing", type=float, default=0.3, help="of the hand [rad]")
    parser.add_argument("--swing-period", type=float, default=2.0, help="[s]")
    parser.add_argument("--period", type=float, default=PERIOD, help="[s]")
    given = parser.parse_args()
    hidden = {given.effect: given.amount} if given.effect else {}
    if not 2e-4 <= given.period <= 0.1:
        parser.error(f"--period is {given.period:g} s; it must be 0.0002 to 0.1 s.")
    try:
        bench = Bench(make_rig(given.seed, make="guides"), hidden, given.period)
        print("a rig gets ready, which takes some seconds", flush=True)
        bench.advance(0.0, 0.0, 0.0)  # compiles
        end = end_of(given.rig, given.port)  # nobody waits for an answer before
    except CableError as error:
        parser.error(str(error))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _ended)
    with contextlib.closing(end):
        print(f"a rig is at {end.name}", flush=True)
        serve(end, bench, given.seed, given.swing, given.swing_period)


if __name__ == "__main__":
    main()
