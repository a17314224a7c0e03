"""A CAN bus of python-can (`pip install 'cc_mujoco[can]'`), shared by several rigs.

    CanPort(CanPlace("can0"), [0x111], fd=True)     # SocketCAN
    CanPort(CanPlace("PCAN_USBBUS1", "pcan", {"f_clock_mhz": 80}), [0x111], fd=True)

Some interfaces can open a bus only once, so all rigs share the open one; a frame that
is read goes to the port of its identifier.
"""

import difflib
import importlib.util
import logging
import re
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NoReturn

from cc_mujoco.errors import CableError, import_extra
from cc_mujoco.hardware._address import MAX_SHORT_ID, CanAddress, CanPlace
from cc_mujoco.hardware._rig import MAX_PENDING, PacketRig, pending

if TYPE_CHECKING:
    import can

MAX_FAILURES = 5  # number of errors in a row from which the bus counts as gone
NETWORK_FOLDER = Path("/sys/class/net")


@dataclass
class _SharedBus:
    """Open bus, with the received frames of each of its ports."""

    bus: "can.BusABC"
    fd: bool  # true if it was opened as one of CAN FD
    waiting: "dict[int, deque[can.Message]]" = field(default_factory=dict)
    """Frames by identifier; some ports hear several."""


CanBuses = dict[tuple[str, str], _SharedBus]
"""Buses that are open, by channel and interface."""


class CanPort:
    """Port that sends frames on a bus and receives those of its identifiers."""

    def __init__(
        self,
        place: CanPlace,
        identifiers: Iterable[int],
        *,
        fd: bool,
        buses: CanBuses | None = None,
    ) -> None:
        """Open the bus unless it is among `buses`, to which it is added; send nothing.

        Frames of `identifiers` are received, of CAN FD if `fd`, else of classical CAN.
        """
        self.ignored: Counter[str] = Counter()
        self.where = f"the CAN bus {place.channel!r} of interface {place.interface!r}"
        self._interface, self._fd = place.interface, fd
        self._can = _python_can()
        # Those of python-can, of the system, of a wrong frame
        self._errors = self._can.CanError, OSError, ValueError
        buses = {} if buses is None else buses
        key = place.channel, place.interface
        if key not in buses:
            buses[key] = _SharedBus(self._open(place), fd)
        if buses[key].fd != fd:
            raise CableError(
                f"{self.where} carries CAN FD for one axis and classical CAN for "
                "another; give each a bus of its own."
            )
        self._bus, self._waiting = buses[key].bus, buses[key].waiting
        self._own: deque[can.Message] = deque(maxlen=MAX_PENDING)
        self._identifiers = frozenset(identifiers)
        self._waiting.update(dict.fromkeys(self._identifiers, self._own))
        self._failure_counts = {"sent to": 0, "read from": 0}

    def receive(self) -> "can.Message | None":
        """Return the next frame, or None if there is none; see `Connection`."""
        if self._own:
            return self._own.popleft()
        for _ in range(MAX_PENDING):
            try:
                # Without filters of python-can: by those a frame of others would look
                # like the end of what came.
                frame = self._bus.recv(0.0)
            except self._errors as error:
                self._count_failure("read from", error)
            self._failure_counts["read from"] = 0
            if frame is None:
                return None
            if frame.is_error_frame:
                self.ignored["error frame"] += 1
                # Bit 0x40: the controller is off the bus.
                if self._interface == "socketcan" and frame.arbitration_id & 0x40:
                    raise CableError(
                        f"{self.where} is off after too many errors; is the rig "
                        "on, with the same bit rates, and is the bus terminated?"
                    )
            elif not frame.is_remote_frame:
                if frame.arbitration_id in self._identifiers:
                    return frame
                if frame.arbitration_id in self._waiting:
                    self._waiting[frame.arbitration_id].append(frame)
        return None

    def send(self, identifier: int, data: bytes) -> None:
        """Send a frame; an identifier above 0x7ff is extended to 29 bits."""
        frame = self._can.Message(
            arbitration_id=identifier,
            is_extended_id=identifier > MAX_SHORT_ID,
            is_fd=self._fd,
            bitrate_switch=self._fd,
            data=data,
        )
        try:
            self._bus.send(frame, timeout=0.0)
        except self._errors as error:
            self._count_failure("sent to", error)
        self._failure_counts["sent to"] = 0

    def close(self) -> None:
        for identifier in self._identifiers:
            self._waiting.pop(identifier, None)
        if self._waiting:
            return
        try:
            self._bus.shutdown()
        except self._errors:  # of a device that was pulled out, say
            self.ignored["not closed"] += 1

    def _open(self, place: CanPlace) -> "can.BusABC":
        library, where, fd = self._can, self.where, self._fd
        if place.interface not in library.VALID_INTERFACES:
            raise CableError.unknown(
                "CAN interface", place.interface, library.VALID_INTERFACES
            )
        mtu = NETWORK_FOLDER / place.channel / "mtu"
        if fd and place.interface == "socketcan" and mtu.is_file():
            # SocketCAN opens a network without CAN FD silently; its MTU is 16, not 72.
            if int(mtu.read_text()) < 72:
                raise _classical_can_error(where)
        _require_known(place, where)
        kind = library.CanProtocol.CAN_FD
        how: dict[str, object] = {}
        if fd:  # only the virtual bus takes the first keyword
            how = {"protocol": kind} if place.interface == "virtual" else {"fd": True}
        try:
            bus: can.BusABC = library.Bus(
                channel=place.channel,
                interface=place.interface,
                ignore_config=True,  # `rig.toml` says all
                **{**how, **place.bus},
            )
        except (*self._errors, ImportError, TypeError, LookupError) as error:
            raise CableError(
                f"{where} cannot be opened: {_error_text(error)}."
            ) from error
        if fd and bus.protocol not in (kind, library.CanProtocol.CAN_FD_NON_ISO):
            bus.shutdown()
            raise _classical_can_error(where)
        return bus

    def _count_failure(self, done: str, error: Exception) -> NoReturn:
        self._failure_counts[done] += 1
        if self._failure_counts[done] < MAX_FAILURES:
            raise OSError(str(error)) from error
        raise CableError(
            f"{self.where} cannot be {done}: {_error_text(error)}; is "
            "the rig on, with the same bit rates, and is the bus terminated?"
        ) from error


def _python_can() -> ModuleType:
    """Return the module `can` with its log silenced; faults are reported as errors."""
    library: ModuleType = import_extra("can", "a rig on CAN needs python-can", "can")
    if not (log := logging.getLogger("can")).handlers:
        log.addHandler(logging.NullHandler())
    return library


def _require_known(place: CanPlace, where: str) -> None:
    """Refuse options of an interface that do not occur as words in its source code.

    Interfaces accept any option, and ignore those that they do not know.
    """
    words = _source_words(place.interface) if place.bus else set()
    for key in place.bus:
        if words and key not in words:
            near = difflib.get_close_matches(key, words, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else "."
            raise CableError(f"{where} knows no {key!r}, a key of `bus`{hint}")


def _source_words(interface: str) -> set[str]:
    """Return all words in the source code of a python-can interface, if it has any."""
    from can import bit_timing, bus
    from can.interfaces import BACKENDS

    try:
        spec = importlib.util.find_spec(BACKENDS[interface][0])
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


def _classical_can_error(where: str) -> CableError:
    return CableError(
        f"{where} is one of classical CAN, or was opened as one; the frames of this "
        "rig have up to 64 bytes, which takes CAN FD."
    )


def _error_text(error: Exception) -> str:
    message = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(message).split()).rstrip(".")


class CanLink:
    """Link that carries one packet per CAN FD frame of its identifier."""

    def __init__(self, address: CanAddress, buses: CanBuses | None = None) -> None:
        self._address = address
        self._port = CanPort(address, [address.reading_id], fd=True, buses=buses)
        self.ignored, self.where = self._port.ignored, self._port.where

    def receive(self) -> bytes | None:
        for frame in pending(self._port.receive):
            if frame.is_extended_id == (frame.arbitration_id > MAX_SHORT_ID):
                return bytes(frame.data)
        return None

    def send(self, data: bytes) -> None:
        self._port.send(self._address.command_id, data)

    def close(self) -> None:
        self._port.close()


class CanRig(PacketRig):
    """Rig that exchanges packets on a CAN FD bus."""

    def __init__(self, address: CanAddress, buses: CanBuses | None = None) -> None:
        """Open the bus unless it is among the open `buses`, as `CanPort` does."""
        super().__init__(CanLink(address, buses))
