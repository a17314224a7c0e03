"""Decimal numbers in compiled code: read as Python reads them, written in any case."""

from __future__ import annotations

import math
from decimal import Context, Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.native import IntArray, compiled
from cc_mujoco.plugin import _config as parse_float
from cc_mujoco.plugin import _ffi as ffi

ANY_INTEGER = st.integers(-(2**63), 2**63 - 1)
MARGIN = 40
"""Words around a message that no writer may touch."""


def read(text: str) -> float:
    return parse_float.number(np.frombuffer(text.encode(), np.uint8))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_survives_its_text(value: float) -> None:
    assert read(repr(value)) == value
    assert math.copysign(1.0, read(repr(value))) == math.copysign(1.0, value)


@given(st.integers(0, 10**60), st.integers(0, 10**40), st.integers(-360, 330))
def test_agrees_with_python_on_long_numbers(whole: int, part: int, power: int) -> None:
    text = f"{whole}.{part}e{power}"
    expected = float(text)
    assert read(text) == expected or (math.isinf(expected) and math.isnan(read(text)))


@given(st.integers(2**52, 2**53 - 1), st.integers(0, 200))
def test_ties_go_to_even(mantissa: int, power: int) -> None:
    text = str((2 * mantissa + 1) * 2**power)
    assert read(text) == float(text)


@pytest.mark.parametrize("tail", ["", "0" * 100, "0" * 100 + "1", "9" * 900])
@pytest.mark.parametrize("value", [3.0 * 2.0**-1074, 1.0 + 2.0**-52, 1.5e300])
def test_digits_far_back_break_a_tie(value: float, tail: str) -> None:
    with localcontext(Context(prec=1200)):
        halfway = f"{(Decimal(value) + Decimal(math.nextafter(value, 0.0))) / 2:f}"
    text = f"{halfway}{'' if '.' in halfway else '.'}{tail}"
    assert read(text) == float(text)


@pytest.mark.parametrize(
    "text", ["1.", "  .5 ", "+3e+02", "0e999999999999", "00012", "5e-324", "-0"]
)
def test_reads_every_way_to_write_a_number(text: str) -> None:
    assert read(text) == float(text)


@pytest.mark.parametrize(
    "text",
    ["", " ", "abc", "4o", "nan", "inf", "-inf", "1e400", "-", ".", "e5", "1e", "1e+",
     "1.2.3", "1_0", "0x10", "--1", "1 2", "1,5"],
)  # fmt: skip
def test_refuses_what_is_no_finite_number(text: str) -> None:
    assert math.isnan(read(text))


@compiled
def write(what: int, room: IntArray, whole: int, real: float, part: ffi.Bytes) -> int:
    """Append to the message in a room; return how many bytes it has."""
    message = ffi.message_at(room.ctypes.data)
    if what == 0:
        ffi.append_integer(message, whole)
    elif what == 1:
        ffi.append_thousandths(message, real, " ms")
    elif what == 2:
        ffi.append_thousandths(message, real, part)
    elif what == 3:
        ffi.quote(message, part)
    else:
        ffi.append(message, part)
    return int(message.used)


def written(what: int, whole: int = 0, real: float = 0.0, part: bytes = b"") -> bytes:
    """Return what a writer appends to an empty message."""
    room = np.zeros(ffi.MESSAGE_WORDS, np.int64)
    end = write(what, room, whole, real, np.frombuffer(part, np.uint8))
    return room[1:].tobytes()[:end]


@given(ANY_INTEGER)
def test_every_integer_is_written(value: int) -> None:
    assert written(0, whole=value).decode() == str(value)


@given(st.floats())
def test_every_float_is_written_in_thousandths(value: float) -> None:
    for what, unit in ((1, " ms"), (2, " mm")):
        text = written(what, real=value, part=unit.encode()).decode()
        if not math.isfinite(value):
            assert text == f"{abs(value) if math.isnan(value) else value}{unit}"
            continue
        number = float(Decimal(text.removesuffix(unit)) / 1000)
        assert math.isclose(number, value, rel_tol=1e-3, abs_tol=1e-323)
        assert abs(number) <= abs(value) * (1.0 + 1e-11)


@given(
    st.integers(0, 4), ANY_INTEGER, st.floats(), ANY_INTEGER | st.integers(900, 1100),
    st.binary(min_size=9, max_size=60),
)  # fmt: skip
def test_no_writer_leaves_its_message(
    what: int, whole: int, real: float, used: int, content: bytes
) -> None:
    memory = np.full(ffi.MESSAGE_WORDS + 2 * MARGIN, 7, np.int64)
    room = memory[MARGIN:-MARGIN]
    room[0] = used
    end = write(what, room, whole, real, np.frombuffer(content, np.uint8))
    assert (memory[:MARGIN] == 7).all() and (memory[-MARGIN:] == 7).all()
    assert end == used or used < end < 8 * (ffi.MESSAGE_WORDS - 1)


@given(st.binary(max_size=200))
def test_quoted_bytes_are_text(content: bytes) -> None:
    text = written(3, part=content).decode()
    assert text.startswith("'") and text.endswith("'")
    try:
        whole = content.decode()
    except UnicodeDecodeError:
        assert "?" in text or text.endswith("...'")
    else:
        assert text == f"'{whole}'" or (
            text.endswith("...'") and whole.startswith(text[1:-4])
        )
