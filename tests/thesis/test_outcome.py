"""Ratios in claims: rounding and format."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from thesis._outcome import round_down_ratio


@given(st.floats(1e-3, 1e6))
def test_a_ratio_is_rounded_down_and_by_no_more_than_it_takes(
    ratio: float,
) -> None:
    told = round_down_ratio(ratio)
    assert ratio / 2.5 <= float(told) * (1.0 + 1e-9) <= ratio * (1.0 + 1e-6)
    assert told.strip("0.") in ("1", "2", "5")


def test_rounded_ratios_are_written_plainly() -> None:
    assert [round_down_ratio(x) for x in (17327.0, 8000.0, 71.0, 5.5)] == [
        "10000",
        "5000",
        "50",
        "5",
    ]
