"""Rig at the other end of a link, in a thread; it can corrupt its packets."""

from __future__ import annotations

import math
import random
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import TracebackType

from cc_mujoco.hardware import Readings, Status
from cc_mujoco.hardware import _packet as packet
from cc_mujoco.hardware._packet import Command
from hardware.ends import End, UdpEnd


@dataclass
class Peer:
    """Rig that answers every command with a reading, at rest except for noise."""

    spoil: Callable[[int, bytes], Iterable[bytes]] = lambda count, data: [data]
    """Function of the reading's number and packet that returns the packets to send."""
    end: End = field(default_factory=UdpEnd)
    commands: list[Command] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    corrupt: int = 0

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._leaving = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Peer:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._leaving.set()
        self._thread.join()
        self.end.close()

    @property
    def torques(self) -> list[float]:
        return [command.torque for command in self.commands]

    def stopped(self) -> bool:
        return bool(self.commands) and bool(self.commands[-1].status & Status.STOPPED)

    def kill(self) -> None:
        """Stop answering, as after a loss of the machine."""
        self._over.set()

    def _serve(self) -> None:
        draw = random.Random(0)
        count = 0
        while not self._over.is_set():
            if (data := self.end.receive()) is None:
                if self._leaving.is_set():  # all that was sent is heard
                    return
                continue
            command = packet.read_command(data)
            if command is None:
                self.corrupt += 1
                continue
            self.commands.append(command)
            self.times.append(time.perf_counter())
            count += 1
            noise = [1e-4 * draw.gauss(0.0, 1.0) for _ in range(5)]
            sent = packet.pack_reading(
                count, time.perf_counter_ns(), Readings(0.0, *noise, Status.ENABLED)
            )
            for each in self.spoil(count, sent):
                self.end.send(each)


NOWHERE = 'address = "127.0.0.1:5005"'


def toml(rig: str = NOWHERE, task: str = "torque = 0.5") -> str:
    """Return a `rig.toml` with limits that a busy machine can meet."""
    return f"""
scene = "bench"
period = 0.002

[rig]
{rig}

[limits]
torque = 1.0
torque_rate = 20.0
motor_speed = 30.0
joint_range = [-1.0, 1.0]
soft_start = 0.05
stop_time = 0.05

[watchdog]
missed_readings = 99999
missed_deadlines = 99999

[task]
{task}
"""


def sine(_: object) -> Callable[[dict[str, float]], float]:
    """Return a controller for `module:function`."""
    return lambda seen: math.sin(100.0 * seen["motor_angle_rad"])
