"""The compiled number reader accepts decimal numbers only and rounds as Python does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cc_mujoco.plugin import _parse_float as parse_float


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
