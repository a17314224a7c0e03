"""Play a rig in real time, in a process of its own, for `cc-mujoco run`.

    python scripts/play_rig.py --port 5005 --effect viscous_friction --amount 200
    python scripts/play_rig.py --rig rig.toml

It is at a port of this machine, or at the addresses in a `rig.toml`, on CAN as well.
The bench of `scripts/diagnosis_study/driven.py`; where the scene of the `rig.toml` has
several axes, that device, on a wearer whose joints move in sines. Every axis answers
with a reading every `--period` (500 Hz unless given), and has the watchdog that the
packet demands of a rig: no command for 50 ms, no torque.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import signal
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent / "diagnosis_study"))

from driven import Bench, Instruments

from cc_mujoco import hardware
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._can_bus import CanBuses
from cc_mujoco.hardware._settings import RigAxes
from rig import make_rig
from rig.makes import MAKES

PERIOD = 0.002  # time between two readings, by default [s]
STATE = (
    "motor_angle_rad", "motor_velocity_rad_s", "joint_angle_rad", "joint_velocity_rad_s"
)  # fmt: skip
"""Columns of an axis that its encoders read."""

SILENCE = 0.05
"""Time without a command after which there is no torque [s]."""
Sender = tuple[str, int]
"""Sender of a packet; on CAN, where nobody has an address, the bus."""


class UdpEnd:
    def __init__(self, host: str, port: int) -> None:
        self.name = f"{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise CableError(
                f"port {self.name} cannot be used ({error}); is a rig there already?"
            ) from error
        self._socket.setblocking(False)

    def receive(self) -> tuple[bytes, Sender] | None:
        """Return the next packet and its sender, None if there is none."""
        try:
            return self._socket.recvfrom(1024)
        except OSError:
            return None

    def send(self, data: bytes, to: Sender) -> None:
        """Send a packet; it may be lost."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, to)

    def close(self) -> None:
        self._socket.close()


class ServedHost:
    """The host that commands the rig, with watchdog, sequence check and enabling."""

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
        if self._sequence is None:
            if command.status != hardware.Status.NONE:
                return
        elif not packet.is_newer(command.sequence, self._sequence):
            return
        self._sequence, self._heard, self.address = command.sequence, now, sender
        self.enabled = bool(command.status & hardware.Status.ENABLED)
        self.torque = command.torque if self.enabled else 0.0
        if command.status & hardware.Status.STOPPED:
            self._let_go()
            self.address = None

    def watch(self, now: float) -> None:
        """Set the torque to 0 if the host has been silent too long."""
        if now - self._heard > SILENCE:
            self._let_go()

    def _let_go(self) -> None:
        self.enabled, self.torque, self._sequence = False, 0.0, None


class CanEnd:
    """The rig's end of a CAN bus, without blocking; see `UdpEnd`."""

    def __init__(
        self, address: hardware.CanAddress, buses: CanBuses | None = None
    ) -> None:
        self.name = f"can:{address.channel}"
        self._link = hardware.CanLink(address.other_end(), buses)

    def receive(self) -> tuple[bytes, Sender] | None:
        try:
            data = self._link.receive()
        except (OSError, CableError):  # of the bus, which may come back
            return None
        return None if data is None else (data, (self.name, 0))

    def send(self, data: bytes, to: Sender) -> None:
        with contextlib.suppress(OSError, CableError):
            self._link.send(data)

    def close(self) -> None:
        self._link.close()


class SwungBench:
    """The bench of `driven.py`, with one axis, whose joint a hand swings."""

    def __init__(
        self, bench: Bench, seed: int, swing: float, swing_period: float
    ) -> None:
        self.period = bench.period
        self._bench, self._instruments = bench, Instruments(seed, bench.period)
        self._swing, self._pace = swing, 2.0 * math.pi / swing_period
        self._time = 0.0
        bench.advance(0.0, 0.0, 0.0)  # compiles

    def advance(self, torques: Sequence[float]) -> None:
        size, along = self._swing * min(1.0, self._time), self._pace * self._time
        turn, speed = math.sin(along), self._pace * math.cos(along)
        self._bench.advance(torques[0], size * turn, size * speed)
        self._time += self.period

    def readings(self, statuses: Sequence[hardware.Status]) -> list[hardware.Readings]:
        bench, status = self._bench, statuses[0]
        return [self._instruments.readings(bench.state, bench.joint_torque, status)]


class Worn:
    """A device on a wearer whose joints move in sines; its axes have names."""

    def __init__(self, device: Any) -> None:
        """Begin an episode of a device as `cc_mujoco/Device-v1` takes it."""
        self._env: Any = gymnasium.make(
            "cc_mujoco/Device-v1",
            device=device,
            disable_env_checker=True,
            trajectory="sine",
            task="transparent",
            duration=600.0,  # s
        ).unwrapped
        _, self._info = self._env.reset(seed=1)
        self.period: float = self._env.drives[0].period
        self.names: tuple[str, ...] = self._env.device.axis_names

    def advance(self, torques: Mapping[str, float]) -> None:
        """Advance a period with torques of the motors [N m], 0 for those not named."""
        given = np.array([torques.get(name, 0.0) for name in self.names])
        action = self._env.action(given if given.size > 1 else float(given[0]))
        *_, self._info = self._env.step(action)

    def column(self, axis: str, name: str) -> float:
        """Return the true value of a log column of an axis."""
        prefix = f"{axis}." if len(self.names) > 1 else ""
        return float(self._info[prefix + name])

    def close(self) -> None:
        self._env.close()


class WornRig:
    """A device as a rig; all its motors or some are commanded."""

    def __init__(
        self, worn: Worn, names: Sequence[str], seed: int, period: float
    ) -> None:
        self._steps = max(1, round(period / worn.period))
        self.period = self._steps * worn.period
        self._worn, self._names = worn, names
        self._instruments = [
            Instruments(seed + k, self.period) for k in range(len(names))
        ]

    def advance(self, torques: Sequence[float]) -> None:
        given = dict(zip(self._names, torques, strict=True))
        for _ in range(self._steps):
            self._worn.advance(given)

    def readings(self, statuses: Sequence[hardware.Status]) -> list[hardware.Readings]:
        found = []
        for name, own, status in zip(
            self._names, self._instruments, statuses, strict=True
        ):
            state = np.array([self._worn.column(name, each) for each in STATE])
            torque = self._worn.column(name, "joint_torque_nm")
            found.append(own.readings(state, torque, status))
        return found


def serve(ends: Sequence[Any], played: Any) -> None:
    """Play until the process is terminated."""
    hosts = [ServedHost() for _ in ends]
    count, late = 0, 0
    begin = time.perf_counter()
    while True:
        deadline = begin + count * played.period
        while (now := time.perf_counter()) < deadline:
            time.sleep(max(deadline - now - 1e-4, 0.0))
        late += now > deadline + played.period
        for end, host in zip(ends, hosts, strict=True):
            had = host.address
            while (found := end.receive()) is not None:
                host.take(*found, now)
            if had is not None and host.address is None:
                print(f"told to stop; {late} of {count} periods late", flush=True)
            host.watch(now)
        played.advance([host.torque for host in hosts])
        count += 1
        statuses = [
            hardware.Status.ENABLED if host.enabled else hardware.Status.NONE
            for host in hosts
        ]
        stamp = round(count * played.period * 1e9)
        for end, host, seen in zip(ends, hosts, played.readings(statuses), strict=True):
            if host.address is not None:
                end.send(packet.pack_reading(count, stamp, seen), host.address)


def ends_of(axes: Sequence[hardware.Settings]) -> list[Any]:
    buses: CanBuses = {}
    found: list[Any] = []
    for each in axes:
        address = each.address()
        if isinstance(address, hardware.CanAddress):
            found.append(CanEnd(address, buses))
        elif isinstance(address, hardware.UdpAddress):
            found.append(UdpEnd(address.host, address.port))
        else:
            kind = "a class of its own" if address is None else "a motor drive"
            raise CableError(f"{each.path} names {kind}, which this cannot play.")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=5005)
    parser.add_argument(
        "--rig", type=Path, help="rig.toml of the host, for its addresses"
    )
    parser.add_argument("--effect", choices=sorted(MAKES["guides"].effects))
    parser.add_argument("--amount", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--swing", type=float, default=0.3, help="of the hand [rad]")
    parser.add_argument("--swing-period", type=float, default=2.0, help="[s]")
    parser.add_argument("--period", type=float, default=PERIOD, help="[s]")
    given = parser.parse_args()
    hidden = {given.effect: given.amount} if given.effect else {}
    try:
        if not 2e-4 <= given.period <= 0.1:
            raise CableError(
                f"--period is {given.period:g} s; it must be 0.0002 to 0.1 s."
            )
        axes = RigAxes(hardware.read_axes(given.rig)) if given.rig else None
        print("a rig gets ready, which takes some seconds", flush=True)
        if axes is not None and len(axes.device.axis_names) > 1:
            worn = Worn(axes.device)
            played = WornRig(worn, axes.names, given.seed, given.period)
        else:
            bench = Bench(make_rig(given.seed, make="guides"), hidden, given.period)
            played = SwungBench(bench, given.seed, given.swing, given.swing_period)
        # Nobody waits for an answer before.
        ends = ends_of(axes.settings) if axes else [UdpEnd("127.0.0.1", given.port)]
    except CableError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(0))
    with contextlib.ExitStack() as closing:
        for end in ends:
            closing.enter_context(contextlib.closing(end))
        print(f"a rig is at {' '.join(end.name for end in ends)}", flush=True)
        serve(ends, played)


if __name__ == "__main__":
    main()
