"""The configuration of a plugin instance, read by compiled code.

`Cable.from_config` accepts and refuses the same texts in Python. MuJoCo passes
attributes on as one block of zero-terminated values in the order of `KEYS`, where an
absent key and an empty value look the same; so the keys without which a cable has no
meaning, `REQUIRED`, must be given, and an empty one is refused with them.
"""

import math
from types import SimpleNamespace

import numpy as np

from cc_mujoco.cable import _cable as cable
from cc_mujoco.cable._cable import KEYS, PARAMETERS
from cc_mujoco.cable._friction import DRAG_TERMS
from cc_mujoco.cable._layout import SCALARS as SCALARS
from cc_mujoco.cable._mesh import SECTION_SIZE as SECTION_SIZE
from cc_mujoco.cable._mesh import measure_conduit
from cc_mujoco.cable._open_path import ROLLING as ROLLING
from cc_mujoco.cable._soft_end import SoftEnd, fit_curve
from cc_mujoco.native import FloatArray, compiled, internal
from cc_mujoco.plugin._engine import REQUIRED
from cc_mujoco.plugin._ffi import Bytes, FloatMatrix, Message, append, quote, text


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


def value_of(text: Bytes) -> float:
    """Return the float nearest to a decimal number, ties to even."""
    return float(bytes(text))


@compiled
def number(text: Bytes) -> float:
    """Return the number that `text` spells, or NaN if it spells no finite number.

    The C library takes "4o" for 4, `nan` and `1e400`; this takes decimal numbers in
    full and nothing else, and rounds as Python's `float`.
    """
    text = strip(text)
    i = 1 if text.size > 0 and (text[0] == 43 or text[0] == 45) else 0
    seen, point = 0, False
    while i < text.size and (is_digit(text[i]) or (text[i] == 46 and not point)):
        point = point or text[i] == 46
        seen += is_digit(text[i])
        i += 1
    if seen == 0:
        return math.nan
    if i < text.size and (text[i] == 101 or text[i] == 69):
        i += 1
        if i < text.size and (text[i] == 43 or text[i] == 45):
            i += 1
        if i == text.size:
            return math.nan
        while i < text.size and is_digit(text[i]):
            i += 1
    if i != text.size:
        return math.nan
    value = value_of(text)
    return value if math.isfinite(value) else math.nan


VALID_CONFIGURATION = -1
"""Key that `read` returns when the configuration can be used."""

KEY = SimpleNamespace(**{key: i for i, key in enumerate(KEYS)})
"""Index of each key in `KEYS`, as an attribute; scalar parameters come first."""
_OF_A_CONDUIT = tuple(map(KEYS.index, cable.OF_A_CONDUIT))
_NEEDED = tuple((KEYS.index(key), KEYS.index(it)) for key, it in cable.NEEDED.items())
SCALES = tuple((KEYS.index(key), KEYS.index(it)) for key, it in cable.SCALES.items())
_SPRINGS = np.array([[KEYS.index(k) for k in pair] for pair in cable.SPRINGS.items()])
DRAGS_PER_LENGTH = tuple(place for place, _, unit in DRAG_TERMS if unit != "N")
"""Indices of drag parameters per length of conduit; drag of a seal is in newtons."""
DEFAULTS = np.array([p.default for p in PARAMETERS])
_SCALARS = SimpleNamespace(
    low=np.array([p.low for p in PARAMETERS]),
    high=np.array([p.high for p in PARAMETERS]),
    low_open=np.array([p.low_open for p in PARAMETERS]),
    default=DEFAULTS,
    required=np.array([key in REQUIRED for key in KEYS]),
)
"""Bounds and defaults of scalar parameters, in the order of `PARAMETERS`."""


def _allowed_values() -> tuple[str, ...]:
    """Return a text on the allowed values of each key, in the order of `KEYS`."""
    own = {p.name: p.allowed for p in PARAMETERS} | cable.ALLOWED
    own["route"] = "the name of a spatial tendon of the model"
    for key in cable.OF_A_CONDUIT:
        own[key] += ", and 0 (off) where `path` is `open`"
    own["eccentricity"] += ", less than the `gear` of the proximal end"
    own["ovality"] += (
        ", and its sum with `eccentricity` less than the `gear` of the proximal end"
    )
    for key, before in (
        ("static_friction", "0 (off) or at least `friction`"),
        ("stress_relaxation", "0 (off) where sections differ in `seating_tension`"),
        *((key, cable.OFF_WITHOUT.format(it)) for key, it in cable.NEEDED.items()),
    ):
        own[key] = f"{before}, and {own[key]}"
    return tuple(own[key] for key in KEYS)


_ALLOWED_VALUES = _allowed_values()


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
    """Return the number of segments in an attribute block, 0 if it is not allowed."""
    written = strip(key_text(block, KEY.segments))
    if key_text(block, KEY.segments).size == 0:
        return cable.Cable.segments
    count = 0
    for k in range(written.size):
        if not is_digit(written[k]):
            return 0
        count = min(10 * count + (written[k] - 48), cable.MAX_SEGMENTS + 1)
    return count if count <= cable.MAX_SEGMENTS else 0


@internal
def bends_with_route(block: int) -> bool:
    return equal_text(key_text(block, KEY.bend), cable.BENDS[1])


@internal
def is_open(block: int) -> bool:
    written = key_text(block, KEY.path)
    return equal_text(written, cable.PATHS[1]) or equal_text(written, cable.PATHS[2])


@internal
def path_kind(block: int) -> int:
    return int(is_open(block)) + int(is_mixed(block))


@internal
def is_explicit(block: int) -> bool:
    return equal_text(key_text(block, KEY.ends), cable.ENDS[1])


@internal
def is_mixed(block: int) -> bool:
    return equal_text(key_text(block, KEY.path), cable.PATHS[2])


@internal
def length(block: int) -> float:
    """Return the length of the conduit [m]; the configuration must be valid."""
    sections = np.empty((cable.MAX_SECTIONS, SECTION_SIZE))
    count = _words(key_text(block, KEY.conduit), SECTION_SIZE, sections)
    total, _, _ = measure_conduit(sections[:count])
    return total


@compiled
def spring(block: int, end: int) -> SoftEnd:
    """Return the spring of the loading curve of `end` 0 (distal) or 1 (proximal).

    Its numbers are NaN without a valid curve.
    """
    points = np.empty((cable.MAX_SECTIONS, SECTION_SIZE))
    return fit_curve(points, _words(key_text(block, _SPRINGS[end, 0]), 2, points))


@internal
def _words(written: Bytes, most: int, rows: FloatMatrix) -> int:
    """Read words of 2 or `most` numbers; return how many, or 0 if one cannot be used.

    With `most` of `SECTION_SIZE` they are sections of a conduit.
    """
    count, i = 0, 0
    while True:
        while i < written.size and is_space(written[i]):
            i += 1
        if i == written.size:
            return count
        if count == cable.MAX_SECTIONS:
            return 0
        begin, parts, ended = i, 0, False
        rows[count, 2] = rows[count, 3] = 1.0
        while not ended:
            ended = i == written.size or is_space(written[i])
            if ended or written[i] == 58:
                if parts == most:
                    return 0
                word = written[begin:i]
                straight = parts == 1 and equal_text(word, "inf")
                rows[count, parts] = math.inf if straight else number(word)
                parts += 1
                begin = i + 1
            if not ended:
                i += 1
        length, radius = rows[count, 0], rows[count, 1]
        if parts != 2 and parts != most:
            return 0
        short = 0.0 < length <= cable.MAX_LENGTH and length <= cable.MAX_WRAP * radius
        if most == SECTION_SIZE and not short:
            return 0
        count += 1


@internal
def next_guide(written: Bytes, start: int) -> tuple[int, int, int]:
    """Return begin, colon and end of the next word `name:value` of the key `guides`.

    The search begins at index `start`. If no word is left, all three are -1; without a
    colon the second is the begin.
    """
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
    """Append to `message` the name, value and allowed values of an unusable key."""
    for part in ("key `", KEYS[key], "` is "):
        append(message, part)
    written = key_text(block, key)
    if written.size == 0:
        append(message, "missing or empty")
    else:
        quote(message, written)
    append(message, "; it must be ")
    append(message, _ALLOWED_VALUES[key])


@compiled
def read(block: int, values: FloatArray, sections: FloatMatrix) -> tuple[int, int]:
    """Read the configuration of an instance from the attributes at address `block`.

    Write the scalar parameters, in the order of `PARAMETERS`, to `values`, and the
    sections of the conduit to `sections` (`MAX_SECTIONS`, `SECTION_SIZE`). Return the
    index of the first key that cannot be used or `VALID_CONFIGURATION`, and the number
    of sections.
    """
    for key in range(SCALARS):
        written = key_text(block, key)
        if written.size == 0:
            if _SCALARS.required[key]:
                return key, 0
            values[key] = _SCALARS.default[key]
            continue
        x, low = number(written), _SCALARS.low[key]
        for end in range(2):
            if key == _SPRINGS[end, 0] and math.isnan(x):
                x = spring(block, end).compliance
        above = x > low if _SCALARS.low_open[key] else x >= low
        if not (above and x <= _SCALARS.high[key]):
            return key, 0
        values[key] = x
    for end in range(2):
        hardness, key = spring(block, end).hardening, _SPRINGS[end, 1]
        if math.isnan(hardness):
            continue
        if hardness > _SCALARS.high[key] or key_text(block, key).size > 0:
            return _SPRINGS[end, 0], 0
        values[key] = hardness
    if 0.0 < values[KEY.static_friction] < values[KEY.friction]:
        return KEY.static_friction, 0
    for key, needed in _NEEDED:
        if values[key] != 0.0 and values[needed] == 0.0:
            return key, 0
    if segment_count(block) == 0:
        return KEY.segments, 0
    bend = key_text(block, KEY.bend)
    follows = bends_with_route(block) and key_text(block, KEY.route).size > 0
    if not (bend.size == 0 or equal_text(bend, cable.BENDS[0]) or follows):
        return KEY.bend, 0
    path = key_text(block, KEY.path)
    free = is_open(block)
    if not (path.size == 0 or equal_text(path, cable.PATHS[0]) or free):
        return KEY.path, 0
    if free and key_text(block, KEY.route).size == 0:
        return KEY.path, 0
    if (key_text(block, KEY.mouth).size > 0) != is_mixed(block):
        return KEY.mouth, 0
    ends = key_text(block, KEY.ends)
    if not (ends.size == 0 or equal_text(ends, cable.ENDS[0]) or is_explicit(block)):
        return KEY.ends, 0
    guides = key_text(block, KEY.guides)
    begin, colon, end = next_guide(guides, 0)
    while begin >= 0:
        if colon == begin or guide_radius(guides[colon + 1 : end]) == 0.0 or not free:
            return KEY.guides, 0
        begin, colon, end = next_guide(guides, end)
    for key in _OF_A_CONDUIT:
        if values[key] != 0.0 and equal_text(path, cable.PATHS[1]):
            return key, 0
    count = _words(key_text(block, KEY.conduit), SECTION_SIZE, sections)
    for s in range(count):
        play, seating = sections[s, 2], sections[s, 3]
        allowed = 0.0 <= play and 0.0 < seating
        for key, factor in ((KEY.clearance, play), (KEY.seating_tension, seating)):
            allowed = allowed and values[key] * factor <= _SCALARS.high[key]
        if not allowed:
            return KEY.conduit, 0
        if values[KEY.stress_relaxation] > 0.0 and seating != sections[0, 3]:
            return KEY.stress_relaxation, 0
    return (VALID_CONFIGURATION if count > 0 else KEY.conduit), count
