"""Raw memory for compiled callbacks: views on C arrays, text, MuJoCo's own calls.

Addresses are plain integers here, so that callbacks can follow the pointers of
`mjModel` and `mjData` at the offsets of `_mj_offsets.py`. All functions are compiled
and hold no lock; nothing here checks bounds.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import llvmlite.binding  # type: ignore[import-untyped]
import llvmlite.ir as ir  # type: ignore[import-untyped]
import numpy as np
import numpy.typing as npt
from mujoco.introspect.enums import ENUMS
from numba import carray  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic

from cc_mujoco._utils.compilation import internal as internal
from cc_mujoco._utils.compilation import types as types
from cc_mujoco.plugin._engine import LIBRARY
from cc_mujoco.plugin._mj_offsets import offset, structure
from cc_mujoco.plugin._prebuilt import address_in_library

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

_carray: Any = carray


def export(name: str, address: int | None) -> None:
    """Let compiled code find a C function by name.

    Numba keeps code in its cache that calls by name, not code that holds an address.
    """
    llvmlite.binding.add_symbol(name, address)


CALLBACKS: dict[str, Any] = {}
"""Compiled functions that other compiled code calls by name."""


def export_callback(name: str, code: Any) -> None:
    """Let compiled code find a compiled function by name, and keep it."""
    export(name, code.address)
    CALLBACKS[name] = code


def call_by_name(name: str, signature: Any) -> Any:
    """Return a function of the plugin as compiled code calls it, by name.

    Raises:
        ImportError: The plugin is that of a shared library without this function.
    """
    address = address_in_library(name)
    if address is not None:
        export(name, address)
    return types.ExternalFunction(name, signature)


ENGINE_FUNCTIONS = (
    "mju_malloc", "mju_free", "mju_message", "mj_solveM", "mj_applyFT", "mj_kinematics",
    "mj_tendon", "mj_fullM", "mj_mulM", "mj_isSparse", "mju_cholFactor",
    "mju_cholSolve",
)  # fmt: skip
"""Functions of MuJoCo that compiled code calls by name."""
for _name in ENGINE_FUNCTIONS:
    _function = ctypes.cast(getattr(LIBRARY, _name), ctypes.c_void_p)
    export(_name, _function.value)

allocate = types.ExternalFunction("mju_malloc", types.intp(types.intp))
release = types.ExternalFunction("mju_free", types.void(types.intp))
solve_inertia = types.ExternalFunction(
    "mj_solveM", types.void(types.intp, types.intp, types.intp, types.intp, types.int32)
)
_at_position = types.void(types.intp, types.intp)
evaluate_bodies = types.ExternalFunction("mj_kinematics", _at_position)
evaluate_tendons = types.ExternalFunction("mj_tendon", _at_position)
full_inertia = types.ExternalFunction(
    "mj_fullM", types.void(types.intp, types.intp, types.intp)
)
multiply_inertia = types.ExternalFunction(
    "mj_mulM", types.void(types.intp, types.intp, types.intp, types.intp)
)
is_sparse = types.ExternalFunction("mj_isSparse", types.int32(types.intp))
factorise = types.ExternalFunction(
    "mju_cholFactor", types.int32(types.intp, types.int32, types.float64)
)
solve_factorised = types.ExternalFunction(
    "mju_cholSolve", types.void(types.intp, types.intp, types.intp, types.int32)
)
_apply = types.ExternalFunction(
    "mj_applyFT",
    types.void(
        types.intp, types.intp, types.intp, types.intp, types.intp, types.int32,
        types.intp,
    ),
)  # fmt: skip
_send_message = types.ExternalFunction("mju_message", types.void(types.intp))

_MESSAGE_SIZE = ctypes.sizeof(structure("mjLogMessage"))
_LEVEL = offset("mjLogMessage", "level")
_SUBJECT = offset("mjLogMessage", "subject")
_WARNING = int(ENUMS["mjtLogLevel"].values["mjLOG_WARNING"])
MESSAGE_CAPACITY = structure("mjLogMessage").subject.size
"""Longest message in bytes, its final zero included."""

MAX_QUOTED = 90
"""Longest name or value quoted in full; MuJoCo keeps 500 bytes of a message."""
_QUOTE = np.frombuffer(b"'", np.uint8)
_NO_CHARACTER = np.frombuffer(b"?", np.uint8)
_ELLIPSIS = np.frombuffer(b"...", np.uint8)
_DECIMAL_POINT = np.frombuffer(b".", np.uint8)
_MINUS = np.frombuffer(b"-", np.uint8)
_EXPONENT = np.frombuffer(b"e", np.uint8)
_INF, _NAN = np.frombuffer(b"inf", np.uint8), np.frombuffer(b"nan", np.uint8)
_SCIENTIFIC = 1e9
"""Number from which its thousandths are given with an exponent."""
_MILLISECONDS = np.frombuffer(b" ms", np.uint8)
_MILLIMETRES = np.frombuffer(b" mm", np.uint8)

DIGEST_SLOTS = 256  # digests of messages that are remembered, a power of 2
LIBRARY.mju_malloc.restype = ctypes.c_void_p
LIBRARY.mju_malloc.argtypes = (ctypes.c_size_t,)
# Compiled code outlives this module, and so must what it writes to.
_digests = LIBRARY.mju_malloc(8 * DIGEST_SLOTS)
ctypes.memset(_digests, 0, 8 * DIGEST_SLOTS)
DIGEST_TABLE = "cc_mujoco_said"
"""Name of the table of digests in compiled code."""
export(DIGEST_TABLE, _digests)


@intrinsic
def _digest_address(context: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [])
        declare: Any = cgutils.get_or_insert_function
        symbol = declare(builder.module, kind, DIGEST_TABLE)
        return builder.ptrtoint(symbol, ir.IntType(64))

    return types.intp(), codegen


_digest_table: Any = _digest_address


@intrinsic
def _as_pointer(context: Any, address: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), codegen


_pointer: Any = _as_pointer


def _access(kind: Any) -> tuple[Any, Any]:
    """Load and store of one value at an address."""

    @intrinsic
    def load(context: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            place = context.get_value_type(kind).as_pointer()
            # Text lies at any address, so that words of it are not aligned.
            return builder.load(builder.inttoptr(args[0], place), align=1)

        return kind(types.intp), codegen

    @intrinsic
    def store(context: Any, address: Any, value: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            place = context.get_value_type(kind).as_pointer()
            builder.store(args[1], builder.inttoptr(args[0], place))
            return context.get_dummy_value()

        return types.void(types.intp, kind), codegen

    return load, store


load_byte: Callable[[int], int]
store_byte: Callable[[int, int], None]
load_byte, store_byte = _access(types.uint8)
load_integer: Callable[[int], int]
store_integer: Callable[[int, int], None]
load_integer, store_integer = _access(types.int32)
load_word: Callable[[int], int]
store_word: Callable[[int, int], None]
load_word, store_word = _access(types.int64)
load_real: Callable[[int], float]
store_real: Callable[[int, float], None]
load_real, store_real = _access(types.float64)


@internal
def apply_force(
    model: int,
    data: int,
    scratch: int,
    point: int,
    body: int,
    target: int,
    x: float,
    y: float,
    z: float,
) -> None:
    """Add a force on a point of a body to the forces on the degrees of freedom.

    `scratch` holds six numbers, of which the last three are 0.
    """
    store_real(scratch, x)
    store_real(scratch + 8, y)
    store_real(scratch + 16, z)
    _apply(model, data, scratch, scratch + 24, point, body, target)


@internal
def floats(address: int, count: int) -> npt.NDArray[np.float64]:
    """Return a view on `count` doubles."""
    view: npt.NDArray[np.float64] = _carray(_pointer(address), (count,), np.float64)
    return view


@internal
def words(address: int, count: int) -> npt.NDArray[np.int64]:
    """Return a view on `count` aligned words of 8 bytes."""
    view: npt.NDArray[np.int64] = _carray(_pointer(address), (count,), np.int64)
    return view


@internal
def same_words(a: int, b: int, count: int) -> bool:
    """Return whether `count` aligned words at two addresses are equal, bit by bit."""
    one, other, different = words(a, count), words(b, count), 0
    for i in range(count):
        different |= one[i] ^ other[i]
    return different == 0


@internal
def copy_words(source: int, target: int, count: int) -> None:
    """Copy aligned words of 8 bytes."""
    given, taken = words(source, count), words(target, count)
    for i in range(count):
        taken[i] = given[i]


# Loops, as Numba takes ten times as long to compile the same on whole arrays.
@internal
def fill(target: Floats, value: float) -> None:
    """Set all numbers of an array."""
    for i in range(target.size):
        target[i] = value


@internal
def assign(target: Floats, source: Floats) -> None:
    """Copy an array into one of its size."""
    for i in range(target.size):
        target[i] = source[i]


@internal
def add(target: Floats, source: Floats, factor: float) -> None:
    """Add a multiple of an array to one of its size."""
    for i in range(target.size):
        target[i] += factor * source[i]


@internal
def dot(a: Floats, b: Floats) -> float:
    """Return the scalar product."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@internal
def equal(a: Floats, b: Floats) -> bool:
    """Return whether two arrays hold the same numbers."""
    for i in range(a.size):
        if a[i] != b[i]:
            return False
    return True


@internal
def is_zero(a: Floats) -> bool:
    """Return whether an array is all 0."""
    for i in range(a.size):
        if a[i] != 0.0:
            return False
    return True


@internal
def text(address: int) -> Bytes:
    """Return a view on a zero-terminated string, without its zero."""
    length = 0
    while load_byte(address + length) != 0:
        length += 1
    view: Bytes = _carray(_pointer(address), (length,), np.uint8)
    return view


@internal
def copy(source: int, target: int, size: int) -> None:
    """Copy `size` bytes from one address to another."""
    for i in range(size):
        store_byte(target + i, load_byte(source + i))


@internal
def clear(address: int, size: int) -> None:
    """Set `size` bytes to zero."""
    for i in range(size):
        store_byte(address + i, 0)


@internal
def append(message: Bytes, used: int, part: Bytes) -> int:
    """Append text to a message, truncated to its capacity; nothing outside of it.

    Returns:
        The new length.
    """
    for i in range(part.size):
        if 0 <= used < message.size - 1:
            message[used] = part[i]
            used += 1
    return used


@internal
def quote(message: Bytes, used: int, part: Bytes) -> int:
    """Add text in quotes, at most `MAX_QUOTED` bytes of it and no split character.

    What is no character in UTF-8 becomes a question mark.

    Returns:
        The new length.
    """
    used = append(message, used, _QUOTE)
    at = 0
    while at < part.size:
        size = _character_size(part, at)
        if at + max(size, 1) > MAX_QUOTED or used + size >= message.size:
            used = append(message, used, _ELLIPSIS)
            break
        if size == 0:
            used = append(message, used, _NO_CHARACTER)
        else:
            used = append(message, used, part[at : at + size])
        at += max(size, 1)
    return append(message, used, _QUOTE)


@internal
def _character_size(part: Bytes, at: int) -> int:
    """Return the bytes of the UTF-8 character at a place, 0 where there is none."""
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
def append_integer(message: Bytes, used: int, value: int) -> int:
    """Add a number in decimal digits.

    Returns:
        The new length.
    """
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
    return append(message, used, digits[start:])


@internal
def append_thousandths(message: Bytes, used: int, value: float, unit: Bytes) -> int:
    """Add a number of a base unit in its thousandth, rounded down to three digits.

    Returns:
        The new length.
    """
    if value < 0.0:
        used = append(message, used, _MINUS)
    value, exponent = abs(value), 0
    if not value < math.inf:
        used = append(message, used, _INF if value > 0.0 else _NAN)
        return append(message, used, unit)
    if value >= _SCIENTIFIC:
        exponent = 3
        while value >= 10.0:
            value /= 10.0
            exponent += 1
        value *= 1e-3
    millionths = int(1e6 * value * (1.0 + 1e-12))
    used = append_integer(message, used, millionths // 1000)
    used = append(message, used, _DECIMAL_POINT)
    for digit in (100, 10, 1):
        used = append_integer(message, used, millionths // digit % 10)
    if exponent > 0:
        used = append(message, used, _EXPONENT)
        used = append_integer(message, used, exponent)
    return append(message, used, unit)


@internal
def append_milliseconds(message: Bytes, used: int, seconds: float) -> int:
    """Add a time in milliseconds, rounded down to a microsecond."""
    return append_thousandths(message, used, seconds, _MILLISECONDS)


@internal
def append_millimetres(message: Bytes, used: int, metres: float) -> int:
    """Add a length in millimetres, rounded down to a micrometre."""
    return append_thousandths(message, used, metres, _MILLIMETRES)


@internal
def warned_once(message: Bytes, used: int, about: int) -> bool:
    """Return whether this process already issued `message` on `about`; record it.

    A batch of a thousand simulations need not say the same a thousand times.
    """
    digest = 1469598103934665603 ^ about
    for i in range(used):
        digest = (digest ^ message[i]) * 1099511628211
    place = _digest_table() + 8 * (digest & (DIGEST_SLOTS - 1))
    if load_word(place) == digest:
        return True
    store_word(place, digest)
    return False


@internal
def warn(message: Bytes, used: int) -> None:
    """Hand a message to MuJoCo as a warning.

    A warning during compilation becomes part of the `ValueError` when it fails.
    """
    record = allocate(_MESSAGE_SIZE)
    clear(record, _MESSAGE_SIZE)
    store_integer(record + _LEVEL, _WARNING)
    for i in range(used):
        store_byte(record + _SUBJECT + i, message[i])
    _send_message(record)
    release(record)
