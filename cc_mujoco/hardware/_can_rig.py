"""A rig on a CAN FD bus, by python-can (`pip install 'cc_mujoco[can]'`).

    CanRig(CanAddress("can0"))                      # SocketCAN
    CanRig(CanAddress("PCAN_USBBUS1", "pcan", bus={"f_clock_mhz": 80, ...}))

A packet is the data of one frame, with bit-rate switch. Several rigs of a process share
a bus: an interface may open it only once, and a frame is read once for all.
"""

from __future__ import annotations

import difflib
import importlib.util
import logging
import re
from collections import Counter, deque
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NoReturn

from cc_mujoco.errors import CableError
from cc_mujoco.hardware._address import MAX_SHORT_ID, CanAddress
from cc_mujoco.hardware._rig import PacketRig

if TYPE_CHECKING:
    import can

MAX_FAILURES = 5
"""So many in a row are no accident: the bus is gone."""
MAX_DRAINED_FRAMES = 200
"""Most frames looked at between two packets; a bus full of others must not hold up."""
NETWORK_FOLDER = Path("/sys/class/net")
_FD_MTU = 72
"""MTU of a network of SocketCAN with CAN FD; without it is 16."""
_BUS_OFF = 0x40
"""Bit in the identifier of SocketCAN's error frames: the controller is off the bus."""
_NULL_HANDLER = logging.NullHandler()


@dataclass
class _SharedBus:
    """An open bus with the packets that came for each of its links."""

    bus: can.BusABC
    waiting: dict[tuple[int, bool], deque[bytes]] = field(default_factory=dict)
    """Packets by identifier, and by whether it has 29 bits."""


CanBuses = dict[tuple[str, str], _SharedBus]
"""Buses that are open, by channel and interface."""


class CanLink:
    """A packet in a CAN FD frame; frames with other identifiers are left alone."""

    def __init__(self, address: CanAddress, buses: CanBuses | None = None) -> None:
        """Open the bus, unless it is open already; nothing is sent yet.

        Args:
            address: On the bus.
            buses: Those that are open, to which that of the address is added.

        Raises:
            CableError: python-can is not installed, the interface is unknown, cannot be
                opened, or has no CAN FD.
        """
        self.ignored: Counter[str] = Counter()
        self.where = _bus_name(address)
        self._address = address
        self._can = _python_can()
        buses = {} if buses is None else buses
        place = address.channel, address.interface
        if place not in buses:
            buses[place] = _SharedBus(_open_bus(self._can, address))
        self._bus, self._waiting = buses[place].bus, buses[place].waiting
        self._own: deque[bytes] = deque(maxlen=MAX_DRAINED_FRAMES)
        self._identifier = address.reading_id, address.reading_id > MAX_SHORT_ID
        self._waiting[self._identifier] = self._own
        self._failure_counts = {"sent to": 0, "read from": 0}

    def receive(self) -> bytes | None:
        """See `Link`."""
        if self._own:
            return self._own.popleft()
        for _ in range(MAX_DRAINED_FRAMES):
            try:
                # Without filters of python-can: by those a frame of others would look
                # like the end of what came.
                frame = self._bus.recv(0.0)
            except Exception as error:  # each interface has its own
                self._count_failure("read from", error)
            self._failure_counts["read from"] = 0
            if frame is None:
                return None
            if frame.is_error_frame:
                self.ignored["error frame"] += 1
                self._require_on(frame)
            elif not frame.is_remote_frame:
                name = frame.arbitration_id, frame.is_extended_id
                if name == self._identifier:
                    return bytes(frame.data)
                if name in self._waiting:
                    self._waiting[name].append(bytes(frame.data))
        return None

    def send(self, data: bytes) -> None:
        """See `Link`."""
        identifier = self._address.command_id
        frame = self._can.Message(
            arbitration_id=identifier,
            is_extended_id=identifier > MAX_SHORT_ID,
            is_fd=True,
            bitrate_switch=True,
            data=data,
        )
        try:
            self._bus.send(frame, timeout=0.0)
        except Exception as error:  # each interface has its own
            self._count_failure("sent to", error)
        self._failure_counts["sent to"] = 0

    def close(self) -> None:
        """See `Link`; the last one closes the bus."""
        self._waiting.pop(self._identifier, None)
        if self._waiting:
            return
        try:
            self._bus.shutdown()
        except Exception:  # of a device that was pulled out, say
            self.ignored["not closed"] += 1

    def _count_failure(self, done: str, error: Exception) -> NoReturn:
        self._failure_counts[done] += 1
        if self._failure_counts[done] < MAX_FAILURES:
            raise OSError(str(error)) from error
        raise CableError(
            f"{_bus_name(self._address)} cannot be {done}: {_error_text(error)}; is "
            "the rig on, with the same bit rates, and is the bus terminated?"
        ) from error

    def _require_on(self, frame: can.Message) -> None:
        if self._address.interface == "socketcan" and frame.arbitration_id & _BUS_OFF:
            raise CableError(
                f"{_bus_name(self._address)} is off after too many errors; is the rig "
                "on, with the same bit rates, and is the bus terminated?"
            )


class CanRig(PacketRig):
    """A rig on a CAN FD bus."""

    def __init__(self, address: CanAddress, buses: CanBuses | None = None) -> None:
        """Open the bus, unless it is open already; nothing is sent yet.

        Args:
            address: On the bus.
            buses: Those that are open, see `CanLink`.

        Raises:
            CableError: As `CanLink`.
        """
        super().__init__(CanLink(address, buses))


def _python_can() -> ModuleType:
    """Return the library `can` with its log silenced; errors report faults."""
    try:
        import can
    except ImportError:
        raise CableError(
            "a rig on CAN needs python-can: pip install 'cc_mujoco[can]'."
        ) from None
    logging.getLogger("can").addHandler(_NULL_HANDLER)
    return can


def _open_bus(library: ModuleType, address: CanAddress) -> can.BusABC:
    if address.interface not in library.VALID_INTERFACES:
        raise CableError.unknown(
            "CAN interface", address.interface, library.VALID_INTERFACES
        )
    _require_fd_network(address)
    _require_known(address)
    fd = library.CanProtocol.CAN_FD
    # Only the virtual bus takes this keyword.
    how = {"protocol": fd} if address.interface == "virtual" else {"fd": True}
    try:
        bus: can.BusABC = library.Bus(
            channel=address.channel,
            interface=address.interface,
            ignore_config=True,  # `rig.toml` says all
            **{**how, **address.bus},
        )
    except Exception as error:  # each interface has its own
        raise CableError(
            f"{_bus_name(address)} cannot be opened: {_error_text(error)}."
        ) from error
    if bus.protocol not in (fd, library.CanProtocol.CAN_FD_NON_ISO):
        bus.shutdown()
        raise _classical_can_error(address)
    return bus


def _require_known(address: CanAddress) -> None:
    """Refuse words for an interface that occur nowhere in its code.

    Interfaces take any word and pass over those that they do not know.
    """
    words = _source_words(address.interface) if address.bus else set()
    for key in address.bus:
        if words and key not in words:
            near = difflib.get_close_matches(key, words, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else "."
            raise CableError(
                f"{_bus_name(address)} knows no {key!r}, a key of `bus`{hint}"
            )


def _source_words(interface: str) -> set[str]:
    """Return all words in the code of an interface of python-can, if it has code."""
    from can import bit_timing, bus
    from can.interfaces import BACKENDS

    module = BACKENDS[interface][0]
    try:
        spec = importlib.util.find_spec(module)
    except ImportError:  # of what it needs; the interface itself tells of it
        spec = None
    if spec is None or spec.origin is None:
        return set()
    own = Path(spec.origin)
    alone = spec.parent == "can.interfaces"  # others have a package of their own
    files = [own] if alone else [*own.parent.rglob("*.py")]
    files += [Path(str(each.__file__)) for each in (bus, bit_timing)]
    texts = (file.read_text(encoding="utf-8") for file in files)
    return {word for text in texts for word in re.findall(r"\w+", text)}


def _require_fd_network(address: CanAddress) -> None:
    """Require CAN FD, since SocketCAN opens a network without it silently."""
    mtu = NETWORK_FOLDER / address.channel / "mtu"
    if address.interface != "socketcan" or not mtu.is_file():
        return
    if int(mtu.read_text()) < _FD_MTU:
        raise _classical_can_error(address)


def _classical_can_error(address: CanAddress) -> CableError:
    return CableError(
        f"{_bus_name(address)} is one of classical CAN, or was opened as one; a "
        "reading is one frame of 64 bytes, which takes CAN FD."
    )


def _bus_name(address: CanAddress) -> str:
    return f"the CAN bus {address.channel!r} of interface {address.interface!r}"


def _error_text(error: Exception) -> str:
    message = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(message).split()).rstrip(".")
