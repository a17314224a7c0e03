"""Raw memory for compiled callbacks: C arrays, text, MuJoCo's structures and calls.

Addresses are plain integers here, so that callbacks can follow the pointers of
`mjModel` and `mjData` at the offsets of `_mj_offsets.py`. All functions are compiled
and hold no lock; nothing here checks bounds.
"""

import ctypes
import math
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mujoco import mjtWrap
from mujoco.introspect.enums import ENUMS

from cc_mujoco.native import FloatArray
from cc_mujoco.native import FloatMatrix as FloatMatrix
from cc_mujoco.native import internal as internal
from cc_mujoco.native._functions import callback as callback
from cc_mujoco.native._functions import reinterpret as reinterpret
from cc_mujoco.native._kinds import BYTE, INT, Array, Memory
from cc_mujoco.native._kinds import CInt as CInt
from cc_mujoco.plugin._engine import LIBRARY
from cc_mujoco.plugin._mj_offsets import MjData as MjData
from cc_mujoco.plugin._mj_offsets import MjLogMessage, place, structure
from cc_mujoco.plugin._mj_offsets import MjModel as MjModel

Bytes = Annotated[Any, Array(BYTE)]
"""Text: an array of bytes, or a literal."""


ENGINE: "list[Engine]" = []
"""Functions of MuJoCo, in the order of the table in `native_plugin.h`."""


class Engine:
    """A function of MuJoCo: compiled code calls it by its name."""

    def __init__(self, name: str, result: Any, *arguments: Any) -> None:
        ENGINE.append(self)
        self.name = name
        self._call = ctypes.CFUNCTYPE(result, *arguments)((name, LIBRARY))
        self.arguments, self.result = arguments, result

    def __call__(self, *given: Any) -> Any:
        return self._call(*given)


_AT, _INT = ctypes.c_ssize_t, ctypes.c_int
allocate = Engine("mju_malloc", _AT, ctypes.c_size_t)
release = Engine("mju_free", None, _AT)
_send_message = Engine("mju_message", None, _AT)
solve_inertia = Engine("mj_solveM", None, _AT, _AT, _AT, _AT, _INT)
apply_wrench = Engine("mj_applyFT", None, _AT, _AT, _AT, _AT, _AT, _INT, _AT)
evaluate_bodies = Engine("mj_kinematics", None, _AT, _AT)
evaluate_tendons = Engine("mj_tendon", None, _AT, _AT)
full_inertia = Engine("mj_fullM", None, _AT, _AT, _AT)
multiply_inertia = Engine("mj_mulM", None, _AT, _AT, _AT, _AT)
is_sparse = Engine("mj_isSparse", _INT, _AT)
factorise = Engine("mju_cholFactor", _INT, _AT, _INT, ctypes.c_double)
solve_factorised = Engine("mju_cholSolve", None, _AT, _AT, _AT, _INT)
mark_stack = Engine("mj_markStack", None, _AT)
free_stack = Engine("mj_freeStack", None, _AT)
borrow = Engine("mj_stackAllocNum", _AT, _AT, ctypes.c_size_t)

_RECORD_SIZE = place("mjLogMessage")
_WARNING = int(ENUMS["mjtLogLevel"].values["mjLOG_WARNING"])
_CAPACITY = structure("mjLogMessage").subject.size
"""Longest message in bytes, its final zero included."""
MAX_QUOTED = 90
"""Longest name or value quoted in full; MuJoCo keeps 500 bytes of a message."""


def memory(layout: type[ctypes.Structure]) -> Memory:
    """Return the type that compiled code gives the address of a `ctypes` structure."""
    return Memory(
        INT.c,
        layout.__name__,
        layout,
        lambda path: getattr(layout, path.split(".")[1]).offset,
    )


class _Message(ctypes.Structure):
    """Message under construction: `MESSAGE_WORDS` words of 8 bytes, 0 at first."""

    _fields_ = (
        ("used", ctypes.c_int64),
        ("text", ctypes.c_uint8 * _CAPACITY),
        ("about", ctypes.c_int64),  # digest of the model that it is about
    )


Message = Annotated[Any, memory(_Message)]
MESSAGE_WORDS = ctypes.sizeof(_Message) // 8

DIGEST_SLOTS = 256  # number of digests of messages that are kept, a power of 2
_digests = (ctypes.c_int64 * DIGEST_SLOTS)()


def _digest_table() -> int:
    return ctypes.addressof(_digests)


def copy(source: int, target: int, size: int) -> None:
    ctypes.memmove(target, source, size)


def clear(address: int, size: int) -> None:
    ctypes.memset(address, 0, size)


def same(a: int, b: int, size: int) -> bool:
    return ctypes.string_at(a, size) == ctypes.string_at(b, size)


@reinterpret
def floats(address: int, count: int) -> FloatArray:
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))


@reinterpret
def words(address: int, count: int) -> npt.NDArray[np.int64]:
    return np.ctypeslib.as_array((ctypes.c_int64 * count).from_address(address))


@reinterpret
def octets(address: int, count: int) -> Bytes:
    return np.ctypeslib.as_array((ctypes.c_uint8 * count).from_address(address))


@internal
def borrow_floats(data: int, count: int) -> FloatArray:
    """Return `count` numbers on MuJoCo's stack, valid until `free_stack`."""
    return floats(borrow(data, count), count)


@reinterpret
def float_rows(address: int, rows: int, columns: int) -> FloatMatrix:
    return floats(address, rows * columns).reshape(rows, columns)


@internal
def borrow_rows(data: int, rows: int, columns: int) -> FloatMatrix:
    """Return a matrix of zeros on MuJoCo's stack, valid until `free_stack`."""
    place = borrow_floats(data, rows * columns)
    place[:] = 0.0
    return float_rows(place.ctypes.data, rows, columns)


@internal
def add(target: FloatArray, source: FloatArray, factor: float) -> None:
    for i in range(target.size):
        target[i] += factor * source[i]


@internal
def dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@internal
def is_zero(a: FloatArray) -> bool:
    for i in range(a.size):
        if a[i] != 0.0:
            return False
    return True


@internal
def text(address: int) -> Bytes:
    length, content = 0, octets(address, 0)
    while content[length] != 0:
        length += 1
    return octets(address, length)


@internal
def message_at(address: int) -> Message:
    return address


@internal
def append(message: Message, part: Bytes) -> None:
    for i in range(part.size):
        if 0 <= message.used < _CAPACITY - 1:
            message.text[message.used] = part[i]
            message.used += 1


@internal
def quote(message: Message, part: Bytes) -> None:
    """Append in quotes at most `MAX_QUOTED` bytes of text, `?` for bytes not UTF-8."""
    append(message, "'")
    at = 0
    while at < part.size:
        size = _character_size(part, at)
        if at + max(size, 1) > MAX_QUOTED or message.used + size >= _CAPACITY:
            append(message, "...")
            break
        append(message, part[at : at + size] if size > 0 else "?")
        at += max(size, 1)
    append(message, "'")


@internal
def _character_size(part: Bytes, at: int) -> int:
    """Return the bytes of the UTF-8 character at index `at`, or 0 if it is none."""
    first, size = part[at], 1
    low, high = 0x80, 0xBF  # of the second byte
    if first >= 0x80:
        size = 2 if first < 0xE0 else 3 if first < 0xF0 else 4
        low = 0xA0 if first == 0xE0 else 0x90 if first == 0xF0 else low
        high = 0x9F if first == 0xED else 0x8F if first == 0xF4 else high
    if 0x80 <= first < 0xC2 or first > 0xF4 or at + size > part.size:
        return 0
    for k in range(1, size):
        if not low <= part[at + k] <= high:
            return 0
        low, high = 0x80, 0xBF
    return size


@internal
def append_integer(message: Message, value: int) -> None:
    digits = np.zeros(20, np.uint8)
    start, negative = digits.size, value < 0
    while start > 1:
        digit = value % 10
        if negative and digit > 0:
            digit -= 10
        start -= 1
        digits[start] = 48 + abs(digit)
        value = (value - digit) // 10
        if value == 0:
            break
    if negative:
        start -= 1
        digits[start] = 45
    append(message, digits[start:])


@internal
def append_label(message: Message, name: Bytes, index: int) -> None:
    if name.size == 0:
        append_integer(message, index)
    else:
        quote(message, name)


@internal
def append_thousandths(message: Message, value: float, unit: Bytes) -> None:
    """Append `value` times 1000, rounded down to three decimals, and its `unit`."""
    if value < 0.0:
        append(message, "-")
    value, exponent = abs(value), 0
    if not value < math.inf:
        append(message, "inf" if value > 0.0 else "nan")
        append(message, unit)
        return
    if value >= 1e9:  # from where on, and below 1e-5, there is an exponent
        exponent = 3
        while value >= 10.0:
            value /= 10.0
            exponent += 1
        value *= 1e-3
    while 0.0 < value < 1e-5 or (exponent < 0 and value < 1e-3):
        value *= 10.0
        exponent -= 1
    millionths = int(1e6 * value * (1.0 + 1e-12))
    append_integer(message, millionths // 1000)
    append(message, ".")
    for digit in (100, 10, 1):
        append_integer(message, millionths // digit % 10)
    if exponent != 0:
        append(message, "e")
        append_integer(message, exponent)
    append(message, unit)


@internal
def digest(found: int, address: int, size: int) -> int:
    """Return the digest `found` continued by the bytes at an address (FNV-1a)."""
    content = octets(address, size)
    for i in range(size):
        found = (found ^ content[i]) * 1099511628211
    return found


@internal
def warned_once(message: Message) -> bool:
    """Return whether this message on this model was issued; record it."""
    found = digest(message.about, message.text.ctypes.data, message.used)
    said, place = words(_digest_table(), DIGEST_SLOTS), found & (DIGEST_SLOTS - 1)
    known = said[place] == found
    said[place] = found
    return bool(known)


@internal
def warn(message: Message) -> None:
    """Hand a message to MuJoCo as a warning.

    A warning during compilation becomes part of the `ValueError` when it fails.
    """
    record = _log_message(allocate(_RECORD_SIZE))
    clear(record, _RECORD_SIZE)
    record.level = _WARNING
    copy(message.text.ctypes.data, record.subject.ctypes.data, message.used)
    _send_message(record)
    release(record)


@internal
def _log_message(address: int) -> MjLogMessage:
    return address


@internal
def has_timestep(model: MjModel) -> bool:
    return bool(0.0 < model.opt.timestep < math.inf)


@internal
def disabled(model: MjModel, flag: int) -> bool:
    """Return whether the model sets a `flag` of `mjtDisableBit`."""
    return bool(model.opt.disableflags & flag != 0)


@internal
def name(model: MjModel, start: int) -> Bytes:
    """Return the name at an offset in `model.names`, as of `model.name_siteadr`."""
    return text(model.names.ctypes.data + start)


@internal
def attributes(model: MjModel, instance: int) -> int:
    return int(model.plugin_attr.ctypes.data + model.plugin_attradr[instance])


@internal
def state(model: MjModel, data: MjData, instance: int) -> int:
    return int(data.plugin_state.ctypes.data + 8 * model.plugin_stateadr[instance])


@internal
def path_end(model: MjModel, tendon: int) -> int:
    """Return the index in `wrap_type` behind the last place of a tendon's path."""
    return int(model.tendon_adr[tendon] + model.tendon_num[tendon])


@internal
def wrap_body(model: MjModel, place: int) -> int:
    """Return the body of the joint, site or geom at `place` in `wrap_type`, or -1."""
    if model.wrap_type[place] == mjtWrap.mjWRAP_PULLEY:
        return -1
    thing = model.wrap_objid[place]
    if model.wrap_type[place] == mjtWrap.mjWRAP_JOINT:
        return int(model.jnt_bodyid[thing])
    if model.wrap_type[place] == mjtWrap.mjWRAP_SITE:
        return int(model.site_bodyid[thing])
    return int(model.geom_bodyid[thing])


@internal
def first_cable(model: MjModel, instance: int) -> int:
    other = 0
    while model.plugin[other] != model.plugin[instance]:
        other += 1
    return other
