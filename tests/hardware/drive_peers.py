"""Simulated motor drives, written from their makers' documents, that a test steps.

Each is a rotor of unit inertia without friction, in the drive's own units: turns, turns
per second and newton metres, or counts and currents.
"""

from __future__ import annotations

import os
import struct
import tty
from collections.abc import Iterator

import can

STEP = 0.002
"""Period of a peer [s]."""


class OdriveAxis:
    """Axis of an ODrive, firmware 0.6; a heartbeat comes every fifth step."""

    def __init__(self, bus: can.BusABC, node: int) -> None:
        self.bus, self.node = bus, node
        self.state, self.error = 1, 0x0100_0000  # idle; its watchdog had expired
        self.modes: tuple[int, ...] = ()
        self.torque = self.turns = self.speed = 0.0
        self.steps = self.silent_for = 0
        self.requests: list[int] = []

    def step(self) -> None:
        while (frame := self.bus.recv(0.0)) is not None:
            if frame.arbitration_id >> 5 == self.node and not frame.is_extended_id:
                assert not frame.is_fd
                self._take(frame.arbitration_id & 0x1F, bytes(frame.data))
        self.steps += 1
        self.silent_for += 1
        if self.silent_for > 25 and self.state == 8:
            self.fail(0x0100_0000)
        driven = self.state == 8 and self.modes == (1, 1)
        self.speed += STEP * (self.torque if driven else 0.0)
        self.turns += STEP * self.speed
        if self.steps % 5 == 0:
            self._send(0x01, struct.pack("<IBBBB", self.error, self.state, 0, 0, 0))
        self._send(0x09, struct.pack("<ff", self.turns, self.speed))

    def fail(self, error: int) -> None:
        self.state, self.error = 1, error

    def _take(self, command: int, data: bytes) -> None:
        if command == 0x18:
            self.error = 0
        elif command == 0x0B:
            self.modes = struct.unpack("<II", data)
        elif command == 0x07:
            (requested,) = struct.unpack("<I", data)
            self.requests.append(requested)
            self.state = requested if not self.error else 1
        elif command == 0x0E:
            (self.torque,) = struct.unpack("<f", data)
            self.silent_for = 0

    def _send(self, command: int, data: bytes) -> None:
        identifier = (self.node << 5) + command
        self.bus.send(
            can.Message(arbitration_id=identifier, is_extended_id=False, data=data)
        )


class MoteusController:
    """A moteus controller that answers each frame in which a reply is requested."""

    def __init__(self, bus: can.BusABC, node: int) -> None:
        self.bus, self.node = bus, node
        self.mode, self.fault = 11, 0  # the last host did not stop it
        self.command: dict[int, float] = {}
        self.turns = self.speed = 0.0
        self.left = 0.0

    def step(self) -> None:
        while (frame := self.bus.recv(0.0)) is not None:
            if frame.arbitration_id & 0x7F == self.node:
                assert frame.is_fd and len(frame.data) in (12, 48)
                self._take(frame.arbitration_id, bytes(frame.data))
        self.left -= STEP
        if self.mode == 10 and self.left <= 0.0:
            self.mode = 11
        get = self.command.get
        scaled = get(0x23, 1.0), get(0x24, 1.0), get(0x2B, 1.0)
        assert self.mode != 10 or scaled == (0.0, 0.0, 0.0)
        self.speed += STEP * (get(0x22, 0.0) if self.mode == 10 else 0.0)
        self.turns += STEP * self.speed

    def _take(self, identifier: int, data: bytes) -> None:
        reply = b""
        place = 0
        while place < len(data):
            kind, place = data[place], place + 1
            if kind == 0x50:
                continue
            form, count = "bhif"[kind >> 2 & 3], kind & 3
            if not count:
                count, place = data[place], place + 1
            start, place = data[place], place + 1
            if kind >> 4 == 1:
                values = [self._register(start + k) for k in range(count)]
                if form == "b":
                    values = [int(value) for value in values]
                reply += bytes([kind + 0x10, start])
                reply += struct.pack(f"<{count}{form}", *values)
                continue
            assert kind >> 4 == 0
            size = struct.calcsize(f"<{count}{form}")
            values = struct.unpack_from(f"<{count}{form}", data, place)
            place += size
            for k, value in enumerate(values, start):
                self._write(k, value)
        if identifier & 0x8000:
            sizes = (8, 12, 16, 20, 24)
            size = next(size for size in sizes if size >= len(reply))
            answer = can.Message(
                arbitration_id=self.node << 8,
                is_extended_id=self.node << 8 > 0x7FF,
                is_fd=True,
                data=reply + b"\x50" * (size - len(reply)),
            )
            self.bus.send(answer)

    def _register(self, number: int) -> float:
        state = {0: self.mode, 1: self.turns, 2: self.speed, 3: 0.0, 15: self.fault}
        return state[number]

    def _write(self, number: int, value: float) -> None:
        if number == 0:
            if value == 0:
                self.mode, self.fault = 0, 0
            elif self.mode not in (1, 11):  # both end by a stop only
                self.mode = int(value)
            self.command = {}
        else:
            self.command[number] = value
            if number == 0x27:
                self.left = value


class DynamixelServo:
    """A servo of the X series behind a pseudo-terminal."""

    def __init__(self, node: int, mode: int = 3) -> None:
        self.node = node
        self.end, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self.end, False)
        self.port = os.ttyname(self._far)
        self.table = bytearray(256)
        self.table[11] = mode
        self.table[38:40] = struct.pack("<H", 648)
        self.table[102:104] = struct.pack("<h", 648)  # as after a change of mode
        self.table[98] = 0xFF  # its watchdog has stopped it
        self.alert = False
        self.counts = self.speed = 0.0
        self.silent_for = 0
        self.mode_writes = 0
        self.noise = b""
        """Bytes that are heard before each reply."""
        self._heard = b""

    def close(self) -> None:
        os.close(self.end)
        os.close(self._far)

    @property
    def current(self) -> int:
        """Current of the motor, in units."""
        on = self.table[64] == 1 and self.table[98] != 0xFF and self.table[11] == 0
        return struct.unpack_from("<h", self.table, 102)[0] if on else 0

    def step(self) -> None:
        try:
            self._heard += os.read(self.end, 4096)
        except BlockingIOError:
            pass
        self.silent_for += 1
        for packet in self._packets():
            self.silent_for = 0
            self._take(packet)
        limit = self.table[98]
        if (
            self.table[64]
            and 0 < limit < 0xFF
            and self.silent_for * STEP > 0.02 * limit
        ):
            self.table[98] = 0xFF
        self.speed += 0.001 * self.current
        self.counts += self.speed
        place = struct.pack("<ii", round(self.speed), round(self.counts))
        self.table[128:136] = place

    def _packets(self) -> Iterator[bytes]:
        while len(self._heard) >= 7:
            assert self._heard[:4] == b"\xff\xff\xfd\x00"
            size = 7 + self._heard[5] + 256 * self._heard[6]
            if len(self._heard) < size:
                return
            packet, self._heard = self._heard[:size], self._heard[size:]
            assert checksum(packet[:-2]) == packet[-2] + 256 * packet[-1]
            yield packet

    def _take(self, packet: bytes) -> None:
        kind, rest = packet[7], packet[8:-2]
        address, size = struct.unpack_from("<HH", rest)
        if kind == 0x83:
            assert packet[4] == 0xFE
            assert rest[4] == self.node and len(rest) == 5 + size
            self._write(address, rest[5:])
        elif packet[4] == self.node:
            assert kind == 0x02
            self._answer(bytes(self.table[address : address + size]))

    def _write(self, address: int, data: bytes) -> None:
        if address == 11:
            if self.table[64]:
                return
            self.mode_writes += 1
        if address == 64 and self.alert:
            return
        if address == 102:
            (goal,) = struct.unpack("<h", data)
            if abs(goal) > 648 or self.table[98] == 0xFF:
                return
        self.table[address : address + len(data)] = data

    def _answer(self, data: bytes) -> None:
        body = bytes([0x55, 0x80 if self.alert else 0]) + data
        body = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        packet = b"\xff\xff\xfd\x00" + struct.pack("<BH", self.node, len(body) + 2)
        packet += body
        value = checksum(packet)
        packet += bytes([value & 255, value >> 8])
        os.write(self.end, self.noise + packet)


def checksum(data: bytes) -> int:
    """Return the CRC-16 of a packet by division of polynomials."""
    dividend = int.from_bytes(data, "big") << 16
    for bit in range(dividend.bit_length() - 1, 15, -1):
        if dividend >> bit & 1:
            dividend ^= 0x18005 << (bit - 16)
    return dividend
