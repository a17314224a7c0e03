"""Decimal text to the nearest float, compiled.

The C library's `strtod` follows the locale and takes "4o" for 4, `nan` and `1e400`;
this takes decimal numbers in full and nothing else, and rounds as Python's `float`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cc_mujoco.native import compiled, internal
from cc_mujoco.plugin._ffi import Bytes

Integers = npt.NDArray[np.int64]

_BITS = 30
_BASE = 1 << _BITS
_PRECISION = 53
_LOWEST = -1074
_MAX_DIGITS = 800
"""Digits that decide: a number half way between two floats has at most 767."""
_MAX_LIMBS = 280
"""Limbs of the integers below, at most."""


@internal
def is_digit(character: int) -> bool:
    return 48 <= character <= 57


@internal
def is_space(character: int) -> bool:
    return character == 32 or 9 <= character <= 13


@internal
def strip(text: Bytes) -> Bytes:
    """Return the text without blanks around it."""
    begin, end = 0, text.size
    while begin < end and is_space(text[begin]):
        begin += 1
    while end > begin and is_space(text[end - 1]):
        end -= 1
    return text[begin:end]


@internal
def _nearest(digits: Integers, count: int, exponent: int) -> float:
    """Return the nearest float, ties to even, by exact integers.

    The integer is kept in limbs of 30 bits, lowest first; a negative power of ten is
    divided out of it after a shift that leaves more bits than a float holds.
    """
    if count == 0 or count + exponent < -330:
        return 0.0
    if count + exponent > 310:
        return math.inf
    shifted = 0 if exponent >= 0 else (-4 * exponent + 70) // _BITS + 1
    size = shifted + (4 * (count + max(exponent, 0))) // _BITS + 2
    limbs = np.zeros(_MAX_LIMBS, np.int64)
    for k in range(count + max(exponent, 0)):
        carry = digits[k] if k < count else 0
        for limb in range(shifted, size):
            carry += limbs[limb] * 10
            limbs[limb] = carry % _BASE
            carry //= _BASE
    sticky = False
    for _ in range(-exponent):
        rest = 0
        for limb in range(size - 1, -1, -1):
            rest = rest * _BASE + limbs[limb]
            limbs[limb] = rest // 10
            rest %= 10
        sticky = sticky or rest != 0
    length = size * _BITS
    while not _bit(limbs, length - 1):
        length -= 1
    lowest = max(length - _PRECISION, _LOWEST + shifted * _BITS)
    mantissa = 0
    for bit in range(length - 1, lowest - 1, -1):
        mantissa = 2 * mantissa + (_bit(limbs, bit) if bit >= 0 else 0)
    if lowest > 0 and _bit(limbs, lowest - 1):
        for bit in range(lowest - 1):
            sticky = sticky or _bit(limbs, bit) == 1
        if sticky or mantissa % 2 == 1:
            mantissa += 1
    return math.ldexp(float(mantissa), lowest - shifted * _BITS)


@internal
def _bit(limbs: Integers, position: int) -> int:
    return int(limbs[position // _BITS] >> (position % _BITS)) & 1


@compiled
def number(text: Bytes) -> float:
    """Return the number that `text` spells, or NaN if it spells no finite number."""
    text = strip(text)
    i = 0
    negative = False
    if text.size > 0 and (text[0] == 43 or text[0] == 45):
        negative = text[0] == 45
        i = 1
    digits = np.zeros(_MAX_DIGITS, np.int64)
    count, seen, exponent, point = 0, 0, 0, False
    while i < text.size and (is_digit(text[i]) or (text[i] == 46 and not point)):
        if text[i] == 46:
            point = True
        else:
            seen += 1
            if count == _MAX_DIGITS:
                # A digit further back only tells that the number is not half way.
                if text[i] != 48:
                    digits[count - 1] = max(digits[count - 1], 1)
                exponent += 1
            elif count > 0 or text[i] != 48:
                digits[count] = text[i] - 48
                count += 1
            if point:
                exponent -= 1
        i += 1
    if seen == 0:
        return math.nan
    if i < text.size and (text[i] == 101 or text[i] == 69):
        i += 1
        down = i < text.size and text[i] == 45
        if i < text.size and (text[i] == 43 or text[i] == 45):
            i += 1
        if i == text.size:
            return math.nan
        power = 0
        while i < text.size and is_digit(text[i]):
            power = min(power * 10 + (text[i] - 48), 1_000_000_000)
            i += 1
        exponent += -power if down else power
    if i != text.size:
        return math.nan
    value = _nearest(digits, count, exponent)
    if math.isinf(value):
        return math.nan
    return -value if negative else value
