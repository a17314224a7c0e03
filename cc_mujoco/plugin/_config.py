"""The configuration of a plugin instance, read by compiled code.

`Cable.from_config` accepts and refuses the same texts in Python. MuJoCo passes
attributes on as one block of zero-terminated values in the order of `KEYS`, where an
absent key and an empty value look the same; so the keys without which a cable has no
meaning, `REQUIRED`, must be given, and an empty one is refused with them.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cc_mujoco.cable import _cable as cable
from cc_mujoco.cable._cable import KEYS
from cc_mujoco.cable._friction import DRAG_TERMS
from cc_mujoco.cable._open_path import ROLLING as ROLLING
from cc_mujoco.native import FloatArray, compiled, internal
from cc_mujoco.plugin._engine import REQUIRED
from cc_mujoco.plugin._ffi import Bytes, FloatMatrix, Message, append, quote, text

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
    """Return the number that `text` spells, or NaN if it spells no finite number.

    The C library's `strtod` follows the locale and takes "4o" for 4, `nan` and `1e400`;
    this takes decimal numbers in full and nothing else, and rounds as Python's `float`.
    """
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


VALID_CONFIGURATION = -1
"""Key that `read` returns when the configuration can be used."""

SCALARS = len(cable.PARAMETERS)
(
    SEGMENTS, CONDUIT, ROUTE, BEND, PATH, MOUTH, ENDS_KEY, GUIDES,
    FRICTION, WRAP_GROWTH, CLEARANCE, _STATIC, _PRETENSION, _EXPONENT, ECCENTRICITY,
    OVALITY,
) = map(
    KEYS.index,
    (
        "segments", "conduit", "route", "bend", "path", "mouth", "ends", "guides",
        "friction", "wrap_growth", "clearance", "static_friction", "pretension",
        "tension_exponent", "eccentricity", "ovality",
    ),
)  # fmt: skip
_OF_A_CONDUIT = tuple(map(KEYS.index, cable.OF_A_CONDUIT))
DRAGS_PER_LENGTH = tuple(place for place, _, unit in DRAG_TERMS if unit != "N")
"""Keys of drag along the conduit, which that of a seal is not."""
_DEFAULT_SEGMENTS = cable.Cable.segments
_LOW = np.array([p.low for p in cable.PARAMETERS])
_HIGH = np.array([p.high for p in cable.PARAMETERS])
_LOW_OPEN = np.array([p.low_open for p in cable.PARAMETERS])
_DEFAULT = np.array([p.default for p in cable.PARAMETERS])
_REQUIRED = np.array([key in REQUIRED for key in KEYS])


_ALLOWED = {p.name: p.allowed for p in cable.PARAMETERS}
_ALLOWED |= {
    "static_friction": "0 (off) or at least `friction`, and "
    + _ALLOWED["static_friction"],
    "tension_exponent": "0 (off) where `pretension` is 0, and "
    + _ALLOWED["tension_exponent"],
    "clearance": f"{_ALLOWED['clearance']}, and 0 (off) where `path` is not `guided`",
    "eccentricity": _ALLOWED["eccentricity"]
    + ", less than the `gear` of the proximal end",
    "ovality": _ALLOWED["ovality"]
    + ", and its sum with `eccentricity` less than the `gear` of the proximal end",
    "segments": cable.SEGMENTS_ALLOWED,
    "conduit": cable.CONDUIT_ALLOWED,
    "route": "the name of a spatial tendon of the model",
    "bend": cable.BEND_ALLOWED,
    "path": cable.PATH_ALLOWED,
    "mouth": cable.MOUTH_ALLOWED,
    "ends": cable.ENDS_ALLOWED,
    "guides": cable.GUIDES_ALLOWED,
    **{
        k: f"{_ALLOWED[k]}, and 0 (off) where `path` is `open`"
        for k in cable.OF_A_CONDUIT
    },
}
_ALLOWED_VALUES = tuple(_ALLOWED[key] for key in KEYS)
_FIXED, _ROUTED = cable.BENDS
_AUTO, _EXPLICIT = cable.ENDS
_GUIDED, _OPEN, _MIXED = cable.PATHS


@internal
def key_text(block: int, key: int) -> Bytes:
    for _ in range(key):
        block += text(block).size + 1
    return text(block)


@internal
def block_size(block: int) -> int:
    start = block
    for _ in range(len(KEYS)):
        block += text(block).size + 1
    return block - start


@internal
def segment_count(block: int) -> int:
    """Return the number of segments, or 0 if the text is no allowed number."""
    written = strip(key_text(block, SEGMENTS))
    if key_text(block, SEGMENTS).size == 0:
        return _DEFAULT_SEGMENTS
    count = 0
    for k in range(written.size):
        if not is_digit(written[k]):
            return 0
        count = min(10 * count + (written[k] - 48), cable.MAX_SEGMENTS + 1)
    return count if count <= cable.MAX_SEGMENTS else 0


@internal
def bends_with_route(block: int) -> bool:
    return equal_text(key_text(block, BEND), _ROUTED)


@internal
def is_open(block: int) -> bool:
    written = key_text(block, PATH)
    return equal_text(written, _OPEN) or equal_text(written, _MIXED)


@internal
def path_kind(block: int) -> int:
    return int(is_open(block)) + int(is_mixed(block))


@internal
def is_explicit(block: int) -> bool:
    return equal_text(key_text(block, ENDS_KEY), _EXPLICIT)


@internal
def is_mixed(block: int) -> bool:
    return equal_text(key_text(block, PATH), _MIXED)


@internal
def length(block: int) -> float:
    """Return the length of the conduit [m]; the configuration must be valid."""
    sections = np.empty((cable.MAX_SECTIONS, 2))
    count = _sections(key_text(block, CONDUIT), sections)
    total = 0.0
    for i in range(count):
        total += sections[i, 0]
    return total


@internal
def _sections(written: Bytes, sections: FloatMatrix) -> int:
    count, i = 0, 0
    while True:
        while i < written.size and is_space(written[i]):
            i += 1
        if i == written.size:
            return count
        begin, colon = i, -1
        while i < written.size and not is_space(written[i]):
            if written[i] == 58 and colon < 0:
                colon = i
            i += 1
        if colon < 0 or count == cable.MAX_SECTIONS:
            return 0
        length = number(written[begin:colon])
        bend = written[colon + 1 : i]
        radius = math.inf if equal_text(bend, "inf") else number(bend)
        if not (0.0 < length <= cable.MAX_LENGTH and length <= cable.MAX_WRAP * radius):
            return 0
        sections[count, 0] = length
        sections[count, 1] = radius
        count += 1


@internal
def next_guide(written: Bytes, start: int) -> tuple[int, int, int]:
    """Return begin and end of the next guide's name, -1: none, and its word's end."""
    begin = start
    while begin < written.size and is_space(written[begin]):
        begin += 1
    if begin == written.size:
        return -1, -1, -1
    end, colon = begin, begin
    while end < written.size and not is_space(written[end]):
        if written[end] == 58:
            colon = end
        end += 1
    return begin, colon, end


@internal
def guide_radius(written: Bytes) -> float:
    if equal_text(written, cable.ROLLER):
        return ROLLING
    radius = number(written)
    return radius if 0.0 < radius <= cable.MAX_LENGTH else 0.0


@internal
def equal_text(a: Bytes, b: Bytes) -> bool:
    if a.size != b.size:
        return False
    for i in range(a.size):
        if a[i] != b[i]:
            return False
    return True


@internal
def explain(message: Message, block: int, key: int) -> None:
    """Append why a key cannot be used: its name, its value and the allowed values."""
    append(message, "key `")
    append(message, KEYS[key])
    append(message, "` is ")
    written = key_text(block, key)
    if written.size == 0:
        append(message, "missing or empty")
    else:
        quote(message, written)
    append(message, "; it must be ")
    append(message, _ALLOWED_VALUES[key])


@compiled
def read(block: int, values: FloatArray, sections: FloatMatrix) -> tuple[int, int]:
    """Read the attribute block of an instance.

    Out: scalar parameters in the order of `PARAMETERS`, and `sections` (`MAX_SECTIONS`,
    2), length and bend radius [m]. Returns the index of the first key that cannot be
    used or `VALID_CONFIGURATION`, and the number of sections.
    """
    for key in range(SCALARS):
        written = key_text(block, key)
        if written.size == 0:
            if _REQUIRED[key]:
                return key, 0
            values[key] = _DEFAULT[key]
            continue
        x = number(written)
        above = x > _LOW[key] if _LOW_OPEN[key] else x >= _LOW[key]
        if not (above and x <= _HIGH[key]):
            return key, 0
        values[key] = x
    if 0.0 < values[_STATIC] < values[FRICTION]:
        return _STATIC, 0
    if values[_EXPONENT] != 0.0 and values[_PRETENSION] == 0.0:
        return _EXPONENT, 0
    if segment_count(block) == 0:
        return SEGMENTS, 0
    bend = key_text(block, BEND)
    follows = bends_with_route(block) and key_text(block, ROUTE).size > 0
    if not (bend.size == 0 or equal_text(bend, _FIXED) or follows):
        return BEND, 0
    path = key_text(block, PATH)
    free = is_open(block)
    if not (path.size == 0 or equal_text(path, _GUIDED) or free):
        return PATH, 0
    if free and key_text(block, ROUTE).size == 0:
        return PATH, 0
    if (key_text(block, MOUTH).size > 0) != is_mixed(block):
        return MOUTH, 0
    ends = key_text(block, ENDS_KEY)
    if not (ends.size == 0 or equal_text(ends, _AUTO) or is_explicit(block)):
        return ENDS_KEY, 0
    guides = key_text(block, GUIDES)
    begin, colon, end = next_guide(guides, 0)
    while begin >= 0:
        if colon == begin or guide_radius(guides[colon + 1 : end]) == 0.0 or not free:
            return GUIDES, 0
        begin, colon, end = next_guide(guides, end)
    for key in _OF_A_CONDUIT:
        if values[key] != 0.0 and equal_text(path, _OPEN):
            return key, 0
    if values[CLEARANCE] > 0.0 and free:
        return CLEARANCE, 0
    count = _sections(key_text(block, CONDUIT), sections)
    return (VALID_CONFIGURATION if count > 0 else CONDUIT), count
